"""Damages bytes at random, as lines, disks and people do."""

from collections.abc import Callable, Sequence, Sized
from typing import Final

from numpy.random import Generator

LARGEST: Final = 1 << 17
"""Bytes of what comes out."""
_WILD: Final = (
    b"\xff" * 8, bytes(8), b"\x7f\xff\xff\xff", b"\x80" * 4, b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff",
    b"\x91" * 3000, b"[" * 3000, b"{" * 3000, b'{"a":' * 3000, b"a." * 3000, b"0x" + b"f" * 5000, b"1" * 5000,
    b"\x00", b"\x1b[2J", b"1e400", b"-1", b"nan", b"\xed\xa0\x80", b"\xf0\x9f\xa4\x96", b'"""', b"&a *a ",
)  # fmt: skip
"""Lengths beyond all bounds, nestings, numbers, characters that somebody might stumble over."""


def mutated(seeds: Sequence[bytes], draw: Generator) -> bytes:
    """One of the seeds, damaged in one to eight places."""
    data = bytearray(seeds[_index(draw, seeds)])
    for _ in range(1 + int(draw.integers(8))):
        _WAYS[_index(draw, _WAYS)](data, seeds, draw)
    return bytes(data[:LARGEST])


def _index(draw: Generator, things: Sized) -> int:
    return int(draw.integers(len(things)))


def _flip(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    if data:
        data[_index(draw, data)] ^= 1 << int(draw.integers(8))


def _overwrite(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    if data:
        data[_index(draw, data)] = int(draw.integers(256))


def _cut(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    del data[int(draw.integers(len(data) + 1)) :]


def _leave_out(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    del data[begin : begin + int(draw.integers(64))]


def _repeat(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    data[begin:begin] = data[begin : begin + int(draw.integers(256))]


def _splice(data: bytearray, seeds: Sequence[bytes], draw: Generator) -> None:
    other = seeds[_index(draw, seeds)]
    data[int(draw.integers(len(data) + 1)) :] = other[int(draw.integers(len(other) + 1)) :]


def _go_wild(data: bytearray, _: Sequence[bytes], draw: Generator) -> None:
    begin = int(draw.integers(len(data) + 1))
    wild = _WILD[_index(draw, _WILD)]
    data[begin : begin + int(draw.integers(2)) * len(wild)] = wild


_WAYS: Final[tuple[Callable[[bytearray, Sequence[bytes], Generator], None], ...]] = (
    *(_flip,) * 6, *(_overwrite,) * 4, _cut, *(_leave_out,) * 2, *(_repeat,) * 2, *(_splice,) * 2, _go_wild,
)  # fmt: skip
