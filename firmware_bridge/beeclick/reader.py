"""Cuts the board's bytes into answers, and finds them again after noise.

The line has no checksum, so what is believed is decided by position. Behind a SYNC answer the bytes are
*aligned*: each answer begins where the last one ended, until one is impossible. From there on the reader
*searches*: it believes nothing but the next SYNC answer and, as their 32-bit numbers prove themselves,
confirmations of packets that are in flight. Nothing depends on how the bytes are cut into deliveries.
"""

from collections.abc import Iterable
from typing import Final

from firmware_bridge.beeclick.answers import SENT_SIZE, SENT_TYPE, Answer, PacketSent, Synchronised, read
from firmware_bridge.beeclick.wire import SYNC_PATTERN, NoiseError

_BEHIND: Final = len(SYNC_PATTERN) - 1
"""Bytes kept behind the present one: a pattern may have begun in what looked like an answer."""


class Reader:
    """The answers in a stream of bytes; keeps less than 300 bytes between deliveries."""

    def __init__(self) -> None:
        self.aligned = False
        self.junk_bytes = 0
        """Bytes that were skipped in searching."""
        self._bytes = bytearray()
        self._at = 0

    @property
    def partial(self) -> bool:
        """True while an answer has begun and not ended."""
        return self.aligned and self._at < len(self._bytes)

    def feed(self, data: bytes) -> None:
        """Append bytes; then call `next` until it gives None."""
        self._bytes += data

    def search(self) -> None:
        """Believe no more in the present alignment."""
        self.aligned = False

    def reset(self) -> None:
        """Forget all bytes; what comes next comes over another connection."""
        self.aligned = False
        self._bytes.clear()
        self._at = 0

    def next(self, sync_expected: bool, in_flight: Iterable[int]) -> Answer | NoiseError | None:
        """The next answer or sign of noise, after which the reader searches; None: more bytes are needed.

        While a SYNC answer is expected its pattern counts wherever it is, also inside an answer: a damaged
        length byte may have made one that swallows it. `in_flight`: numbers of the packets whose
        confirmations are believed while searching.
        """
        found: Answer | NoiseError | None
        found = self._aligned(sync_expected) if self.aligned else self._searched(in_flight)
        if found is None or self._at > 4 * _BEHIND:
            spent = max(self._at - _BEHIND, 0)
            del self._bytes[:spent]
            self._at -= spent
        return found

    def _pattern(self) -> int:
        """Where the next pattern ends that does not end before the present byte; -1: none is there."""
        begin = self._bytes.find(SYNC_PATTERN, max(self._at - _BEHIND, 0))
        return begin + len(SYNC_PATTERN) if begin >= 0 else -1

    def _aligned(self, sync_expected: bool) -> Answer | NoiseError | None:
        pattern = self._pattern() if sync_expected else -1
        try:
            one = read(self._bytes, self._at, pattern if pattern >= 0 else len(self._bytes))
        except NoiseError as noise:
            self.aligned = False
            return noise
        if one is not None:
            answer, self._at = one
            return answer
        if pattern < 0:
            return None
        self.aligned = False
        return NoiseError("swallowed_sync")

    def _searched(self, in_flight: Iterable[int]) -> Answer | None:
        pattern = self._pattern()
        end = pattern if pattern >= 0 else len(self._bytes)
        sent = min(
            (one for number in in_flight if (one := self._confirmation(number, end)) is not None),
            default=None,
        )
        if sent is not None:
            begin, answer = sent
            self._skip_to(begin)
            self._at = begin + SENT_SIZE
            return answer
        if pattern >= 0:
            self._skip_to(max(pattern - len(SYNC_PATTERN), self._at))
            self._at = pattern
            self.aligned = True
            return Synchronised()
        self._skip_to(max(end - _BEHIND, self._at))
        return None

    def _skip_to(self, at: int) -> None:
        self.junk_bytes += at - self._at
        self._at = at

    def _confirmation(self, number: int, end: int) -> tuple[int, PacketSent] | None:
        """The first whole confirmation of that packet before `end`."""
        wanted = SENT_TYPE + number.to_bytes(4, "little")
        begin = self._at
        while (begin := self._bytes.find(wanted, begin, end - 1)) >= 0:
            status = self._bytes[begin + SENT_SIZE - 1]
            if status <= 1:
                return begin, PacketSent(number, bool(status))
            begin += 1
        return None
