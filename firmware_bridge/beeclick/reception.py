"""Decoding of what a board sends: bytes to answers, answers to events.

The line has no checksum, so position decides what is accepted. After a SYNC answer the bytes are *aligned*:
each answer begins where the last one ended, until an impossible one. From there on the reader *searches*: it
accepts only the next SYNC answer and confirmations of packets in flight, whose 32-bit numbers identify them.
The result does not depend on how the bytes are cut into reads.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Final

from actors.board_readings import BoardNote, Fix, Humidity, Info, Temperature
from actors.instant import Instant
from actors.messages import AccessFailure, Heard, Overflow, Refused, Sent
from actors.radio.frame import DataFrame, rssi_dbm
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.wire import (
    SENT_SIZE,
    SENT_TYPE,
    SYNC_PATTERN,
    Answer,
    Moisture,
    NoiseError,
    Notes,
    PacketSent,
    ReceivedPacket,
    Sentence,
    Synchronised,
    Warmth,
    read_answer,
)

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
            one = read_answer(self._bytes, self._at, pattern if pattern >= 0 else len(self._bytes))
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


_FRAME: Final = re.compile(rb"\$(GPRMC,[\x20-\x29\x2b-\x7e]*)\*([0-9A-F]{2})")
_ANGLE: Final = re.compile(r"(\d+)(\d\d(?:\.\d+)?)")
_LEAST_FIELDS: Final = 10
"""Type, time, status, latitude, N or S, longitude, E or W, speed, course, date."""


@dataclass(frozen=True)
class RecommendedMinimum:
    """What a sentence says; degrees, north and east positive."""

    valid: bool
    """True if the receiver vouches for the position, which is then there."""
    latitude: float | None
    longitude: float | None


def parse_rmc(text: bytes) -> RecommendedMinimum | None:
    """The sentence in `text`; None if it is none: checksum, fields, ranges and digits must be right."""
    frame = _FRAME.fullmatch(text)
    if frame is None or reduce(xor, frame[1]) != int(frame[2], 16):
        return None
    fields = frame[1].decode().split(",")
    if len(fields) < _LEAST_FIELDS or fields[2] not in ("A", "V"):
        return None
    try:
        latitude = _degrees(fields[3], fields[4], 2, "NS", 90.0)
        longitude = _degrees(fields[5], fields[6], 3, "EW", 180.0)
    except ValueError:
        return None
    valid = fields[2] == "A"
    if valid and (latitude is None or longitude is None):
        return None
    return RecommendedMinimum(valid, latitude, longitude)


def _degrees(angle: str, side: str, digits: int, sides: str, most: float) -> float | None:
    """From degrees of so many digits and minutes `mm.m…` with any number of decimals."""
    if not angle and not side:
        return None
    parts = _ANGLE.fullmatch(angle)
    if parts is None or len(parts[1]) != digits or len(side) != 1 or side not in sides:
        raise ValueError
    minutes = float(parts[2])
    degrees = int(parts[1]) + minutes / 60.0
    if minutes >= 60.0 or degrees > most:
        raise ValueError
    return math.copysign(degrees, 1.0 if side == sides[0] else -1.0)


NAMES: Final = (
    # What became of packets.
    *("sent", "failed", "unconfirmed", "overflowed", "refused", "forgotten"),
    # What was heard, and heard and not passed on, or damaged.
    *("heard", "other_pan", "own_address", "bad_fcs", "fixes", "bad_sentence", "temperatures", "humidities"),
    *("bad_sensor", "infos"),
    # Keeping in step.
    *("answers", "syncs", "ups", "probes", "silent", "lost", "junk_bytes"),
    # Signs of noise: bytes that no board sends, then answers that are missing or that nobody asked for.
    *("unknown_type", "bad_length", "bad_pattern", "bad_status", "bad_channel", "bad_power", "bad_text"),
    *(
        "bad_temperature",
        "swallowed_sync",
        "stalled",
        "no_confirmation",
        "no_echo",
        "echo_skipped",
        "answer_skipped",
    ),
    *("strange_confirmation", "strange_echo", "late_sync", "late_confirmation", "late_echo"),
)
"""All that a link counts, in the order in which it is shown."""


class LinkCounters(dict[str, int]):
    """The counters of one link, by name."""

    def __init__(self) -> None:
        super().__init__(dict.fromkeys(NAMES, 0))

    def add(self, name: str, more: int = 1) -> None:
        """Count one more, or several, of a name that there is."""
        self[name] += more


@dataclass(frozen=True)
class UnconfirmedPacket:
    """Nobody knows whether the packet `tag` has left: the board had it and never said."""

    instant: Instant
    tag: int
    cause: str
    """One word or two, as in the counters."""


PacketEnd = Sent | AccessFailure | UnconfirmedPacket | Overflow | Refused
"""What becomes of a packet: every one that is sent comes to exactly one of these."""
Event = PacketEnd | Heard | BoardNote


_NO_SENSOR: Final = -397
"""Tenths of a degree, from the number 0: the data line is held low."""
_HOTTEST: Final = 1238
"""Tenths of a degree: the end of the SHT1x's range (Sensirion, data sheet SHT1x); a data line that is held
high gives 615.6 degrees."""
_WETTEST: Final = 1000


def news(
    now: Instant, answer: Answer, settings: BoardSettings, counters: LinkCounters, drop_bad_fcs: bool
) -> list[Event]:
    """The event that an unasked message is; none for what is to be dropped."""
    match answer:
        case ReceivedPacket():
            return _heard(now, answer, settings, counters, drop_bad_fcs)
        case Sentence(text):
            return _fix(now, text, counters)
        case Warmth(tenths):
            valid = _NO_SENSOR < tenths <= _HOTTEST
            counters.add("temperatures" if valid else "bad_sensor")
            return [Temperature(now, tenths / 10, valid)]
        case Moisture(tenths):
            valid = 0 <= tenths <= _WETTEST
            counters.add("humidities" if valid else "bad_sensor")
            return [Humidity(now, tenths / 10, valid)]
        case Notes(text):
            counters.add("infos")
            return [Info(now, text.decode())]
        case _:
            raise AssertionError(answer)


def _heard(
    now: Instant, packet: ReceivedPacket, settings: BoardSettings, counters: LinkCounters, drop_bad_fcs: bool
) -> list[Event]:
    if packet.fcs != DataFrame(packet.pan, packet.address, packet.data).check:
        counters.add("bad_fcs")
        if drop_bad_fcs:
            return []
    if packet.pan != settings.pan:
        counters.add("other_pan")
        return []
    if packet.address == settings.address:
        counters.add("own_address")  # another robot has it, too
    counters.add("heard")
    return [Heard(now, packet.address, rssi_dbm(packet.rssi_code), packet.lqi, packet.data)]


def _fix(now: Instant, text: bytes, counters: LinkCounters) -> list[Event]:
    position = parse_rmc(text)
    if position is None:
        counters.add("bad_sentence")
        return []
    counters.add("fixes")
    return [Fix(now, position.valid, position.latitude, position.longitude)]
