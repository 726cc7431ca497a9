"""The two rings of the board's firmware, with what it does when they are too small.

Source: d3scomp/beeclickarm, TODQueue.cpp and TOHQueue.cpp. Both have eight slots, of which seven are of use:
where the writer meets the reader the firmware believes the ring to be empty.
"""

from typing import Final

from actors.instant import Instant
from firmware_bridge.beeclick.commands import SEND_PACKET, SET_ADDRESS, SET_CHANNEL, SET_POWER
from firmware_bridge.beeclick.wire import SYNC_PATTERN, byte_time, bytes_in

SLOTS: Final = 8
SLOT_BYTES: Final = 134
"""Of a command: type, length, number, 128 bytes of data."""
_SIZES: Final = {SET_CHANNEL: 2, SET_POWER: 3, SET_ADDRESS: 5}


class CrashError(Exception):
    """What the firmware would not survive; only a reset helps."""


class CommandRing:
    """What has come from the host: a receiver that writes byte by byte into the ring of commands.

    Out of step it compares with the SYNC pattern and drops a byte that does not fit without trying it as the
    pattern's first. In step a command of an unknown type puts it out of step. Lengths are not checked: a long
    packet runs into the next slot.
    """

    def __init__(self) -> None:
        self.in_step = False
        self.overflows = 0
        """How often eight commands have vanished, or one has been written over the packet in the air."""
        self._memory = bytearray(SLOTS * SLOT_BYTES)
        self._read = self._write = self._at = 0

    @property
    def available(self) -> bool:
        """True if the firmware believes that there is a command."""
        return self._read != self._write

    def take(self, byte: int) -> bool:
        """One byte from the line; True if it ends a command. Raises CrashError beyond the last slot."""
        base = self._write * SLOT_BYTES
        if base + self._at >= len(self._memory):
            raise CrashError
        self._memory[base + self._at] = byte
        self._at += 1
        ended = self._in_step(base) if self.in_step else self._out_of_step(byte)
        if ended:
            self._at = 0
            self._write = (self._write + 1) % SLOTS
            self.overflows += self._write == self._read
        return ended

    def current(self) -> bytes:
        """The command at the reader's place, with whatever lies behind it."""
        base = self._read * SLOT_BYTES
        return bytes(self._memory[base : base + 6 + 255])

    def advance(self) -> None:
        """The current command is done with."""
        self._read = (self._read + 1) % SLOTS

    def _out_of_step(self, byte: int) -> bool:
        if byte != SYNC_PATTERN[self._at - 1]:
            self._at = 0
            return False
        self.in_step = self._at == len(SYNC_PATTERN)
        return self.in_step

    def _in_step(self, base: int) -> bool:
        kind = self._memory[base]
        if kind == 0:
            self.in_step = False  # the pattern's first byte has been there
            return False
        if kind > SET_ADDRESS:
            self._at = 0
            self.in_step = False
            return False
        size = 6 + self._memory[base + 1] if kind == SEND_PACKET else _SIZES[kind]
        return self._at == size


class AnswerRing:
    """What goes to the host, byte by byte at the line's pace."""

    def __init__(self, now: Instant) -> None:
        self._slots = [b""] * SLOTS
        self._read = self._write = self._at = 0
        self._burst: int = now
        """When the first of the bytes left the last of which are on the line."""
        self._burst_bytes = 0
        self._left = bytearray()

    def put(self, now: Instant, answer: bytes) -> None:
        """An answer to be sent. Raises CrashError if all slots are taken: the firmware hangs in its
        interrupt.
        """
        self.settle(now)
        if self._read == self._write:
            self._burst = max(now, self._burst + byte_time(self._burst_bytes))
            self._burst_bytes = 0
        self._slots[self._write] = answer
        self._write = (self._write + 1) % SLOTS
        if self._write == self._read:
            raise CrashError

    def settle(self, now: Instant) -> None:
        """Let the bytes leave that are through by `now`."""
        through = bytes_in(now - self._burst) - self._burst_bytes
        while through > 0 and self._read != self._write:
            part = self._slots[self._read][self._at : self._at + through]
            self._left += part
            through -= len(part)
            self._burst_bytes += len(part)
            self._at += len(part)
            if self._at == len(self._slots[self._read]):
                self._at = 0
                self._read = (self._read + 1) % SLOTS

    def collect(self, now: Instant) -> bytes:
        """The bytes that have left since the last time."""
        self.settle(now)
        left, self._left = bytes(self._left), bytearray()
        return left

    def wake(self) -> Instant | None:
        """When the answer that is leaving has left."""
        if self._read == self._write:
            return None
        rest = len(self._slots[self._read]) - self._at
        return Instant(self._burst + byte_time(self._burst_bytes + rest))
