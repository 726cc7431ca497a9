"""Lossless compression of scans to a third of their size (numba kernels).

Each range is predicted from the previous two by linear extrapolation; where they differ much, at an edge, the
previous range is the prediction. The residual, folded to 0, −1, 1, −2, …, is Rice-coded: its multiples of 2^k
in unary, a zero, and k bits; from eight ones on, the 16 bits follow uncoded. k follows a running mean of
earlier residuals, so no parameters are stored.
"""

from typing import Final

import numpy as np

from actors.array_types import Octets
from actors.kernels import njit

LARGEST: Final = 0xFFFF
"""Most bytes of ranges: the limit of msgpack's `bin 16`."""
_GENTLE: Final = 400
"""Largest difference of ranges on one wall, mm; own choice, the best on the chapter's floor."""
_ONES: Final = 8
"""Number of ones that announces 16 uncoded bits."""
_BEGIN: Final = 32
"""Twice the mean expected at first."""


class ScanBuffers:
    """Buffers for one scan; not thread-safe."""

    def __init__(self) -> None:
        plain, packed = bytearray(LARGEST + 1), bytearray(LARGEST + 1)
        self._plain, self._packed = memoryview(plain), memoryview(packed)
        self._plain_array = np.frombuffer(plain, np.uint8)
        self._packed_array = np.frombuffer(packed, np.uint8)

    def packed(self, ranges: bytes) -> bytes | None:
        """Compress an even number of bytes, at most LARGEST; None if they do not become fewer."""
        size = len(ranges)
        self._plain[:size] = ranges
        packed = _pack(self._plain_array, size >> 1, self._packed_array)
        return bytes(self._packed[:packed]) if packed else None

    def unpacked(self, packed: bytes, count: int) -> bytes:
        """Decompress `count` ranges. Raises ValueError if the bytes are not exactly these."""
        if not (len(packed) <= LARGEST and 0 <= 2 * count <= LARGEST):
            raise ValueError(f"a scan of {count} ranges in {len(packed)} bytes is too large")
        self._packed[: len(packed)] = packed
        if not _unpack(self._packed_array, len(packed), count, self._plain_array):
            raise ValueError(f"{len(packed)} bytes are not a packed scan of {count} ranges")
        return bytes(self._plain[: 2 * count])


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs; also compiles them."""
    ranges = np.arange(300) ** 2 % 2311
    ranges[100:120] = 0xFFFF
    buffers = ScanBuffers()
    packed = buffers.packed(ranges.astype("<u2").tobytes())
    return b"" if packed is None else packed + buffers.unpacked(packed, len(ranges))


@njit()  # type: ignore[untyped-decorator]
def _width(mean: int) -> int:
    """Return k for the next residual."""
    k = 0
    while 4 << k < mean:
        k += 1
    return k


@njit()  # type: ignore[untyped-decorator]
def _guess(last: np.int64, before: np.int64) -> np.int64:
    step = last - before
    return last + step if -_GENTLE < step < _GENTLE else last


@njit()  # type: ignore[untyped-decorator]
def _pack(plain: Octets, count: int, packed: Octets) -> int:
    """Compress; return the number of bytes in `packed`, or 0 if they would not be fewer."""
    before = last = held = np.int64(0)
    at, bits, mean = 0, 0, _BEGIN
    for place in range(count):
        value = np.int64(plain[2 * place]) | np.int64(plain[2 * place + 1]) << 8
        off = ((value - _guess(last, before) + 0x8000) & 0xFFFF) - 0x8000
        folded = off << 1 ^ off >> 63
        k = _width(mean)
        ones = folded >> k
        if ones < _ONES:
            held = (held << ones + 1 | (1 << ones) - 1 << 1) << k | folded & (1 << k) - 1
            bits += ones + 1 + k
        else:
            held = held << _ONES + 16 | 0xFF0000 | folded
            bits += _ONES + 16
        if at + 4 >= 2 * count:
            return 0
        while bits >= 8:
            bits -= 8
            packed[at] = held >> bits & 0xFF
            at += 1
        held &= (1 << bits) - 1
        mean += min(folded, 4 << k) - (mean >> 1)
        before, last = last, value
    if bits:
        packed[at] = held << 8 - bits & 0xFF
        at += 1
    return at


@njit()  # type: ignore[untyped-decorator]
def _unpack(packed: Octets, size: int, count: int, plain: Octets) -> bool:
    """Decompress; return False if the bytes are not the output of `_pack` for `count` ranges."""
    before = last = held = np.int64(0)
    at, bits, mean = 0, 0, _BEGIN
    for place in range(count):
        while bits < 32 and at < size:
            held = held << 8 | np.int64(packed[at])
            bits += 8
            at += 1
        k = _width(mean)
        ones = 0
        while ones < min(_ONES, bits) and held >> bits - 1 - ones & 1:
            ones += 1
        bits -= _ONES + 16 if ones == _ONES else ones + 1 + k
        if bits < 0:
            return False
        folded = held >> bits & 0xFFFF if ones == _ONES else ones << k | held >> bits & (1 << k) - 1
        if folded > 0xFFFF:
            return False
        held &= (1 << bits) - 1
        value = _guess(last, before) + (folded >> 1 ^ -(folded & 1)) & 0xFFFF
        plain[2 * place] = value & 0xFF
        plain[2 * place + 1] = value >> 8
        mean += min(folded, 4 << k) - (mean >> 1)
        before, last = last, value
    return at == size and bits < 8 and held == 0
