"""Decoding of a board's output: bytes to answers, answers to events; settings and parameters of the link.

The line has no checksum, so position decides what is accepted. After a SYNC answer the bytes are *aligned*:
each answer begins where the last one ended, until an invalid one. Then the reader *searches*: it accepts only
the next SYNC answer and confirmations of packets in flight, identified by their 32-bit numbers. The result
does not depend on the boundaries of reads.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from functools import reduce
from operator import xor
from typing import Annotated, Final

from msgspec import Meta

from actors.instant import Instant
from actors.messages import (
    AccessFailure,
    BoardNote,
    BoardText,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    GpsFix,
    Humidity,
    Temperature,
)
from actors.radio.frame import DataFrame, rssi_dbm
from actors.settings import ParameterError, Settings
from firmware_bridge.beeclick.board_messages import (
    CONFIRMATION_SIZE,
    CONFIRMATION_TYPE,
    SYNC_PATTERN,
    Answer,
    BoardInfo,
    GpsSentence,
    HumidityReading,
    NoiseError,
    PacketConfirmation,
    ReceivedPacket,
    SetAddress,
    SetChannel,
    SetPower,
    Setting,
    SyncAnswer,
    TemperatureReading,
    read_answer,
)

POWERS: Final = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
"""Valid powers, for error messages."""
_LARGE_STEP: Final = 100
"""Tenths of a dB (DS39776C, register RFCON3)."""


def actual_power(tenths: int) -> int:
    """Return the transmit power that the firmware sets for a request, in tenths of a dBm, 0 to -363.

    Whole tens of dB are exact. A unit error leaves two of the small steps: a remainder of -0.5 or -0.6 dB
    gives -0.5, all below give -6.3 (MRF24J40.cpp, setTxPower).
    """
    large, rest = divmod(-tenths, _LARGE_STEP)
    small = 0 if rest < 5 else 5 if rest < 7 else 63
    return -(large * _LARGE_STEP + small)


def power_setting(power_dbm: float) -> int:
    """Return the request, tenths of a dBm, for a transmit power of `power_dbm`.

    Raises ParameterError for a power that the firmware would change.
    """
    tenths = round(power_dbm * 10)
    if abs(tenths - power_dbm * 10) < 1e-6 and -363 <= tenths <= 0 and actual_power(tenths) == tenths:
        return tenths
    raise ParameterError("board.power_dbm", power_dbm, POWERS)


FIRST_CHANNEL: Final = 11
"""Channel with code 0."""
_LAST_CHANNEL: Final = 26


class BoardSettings(Settings, frozen=True):
    """Settings of a board. Raises ParameterError for invalid ones."""

    address: Annotated[int, Meta(ge=0, le=0xFFFD)]
    """Short address of the robot's transceiver, unique, 0 to 0xFFFD."""
    channel: Annotated[int, Meta(ge=FIRST_CHANNEL, le=_LAST_CHANNEL)] = 26
    """Channel of IEEE 802.15.4 at 2.4 GHz, 11 to 26. Default: least interference from Wi-Fi."""
    pan: Annotated[int, Meta(ge=0, le=0xFFFE)] = 0xBABA
    """PAN identifier, 0 to 0xFFFE; frames of others are dropped. Default: as the original robots
    (d3scomp/beeclickarmROS)."""
    power_dbm: float = -10.0
    """Transmit power, dBm. Default: as set by the firmware at start (MRF24J40.cpp: RFCON3 = 0x40)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        power_setting(self.power_dbm)

    def commands(self) -> tuple[Setting, ...]:
        """Return the set-up commands; the address first, which also serves as probe."""
        return (
            SetAddress(self.pan, self.address),
            SetChannel(self.channel - FIRST_CHANNEL),
            SetPower(power_setting(self.power_dbm)),
        )


_LOOKBACK: Final = len(SYNC_PATTERN) - 1
"""Number of bytes stored before the read position: a SYNC pattern may start in an apparent answer."""


class AnswerReader:
    """Incremental parser of answers; buffers less than 300 bytes."""

    def __init__(self) -> None:
        self.aligned = False
        """Set it to False to search for the next SYNC answer."""
        self.junk_bytes = 0
        """Number of bytes skipped while searching."""
        self._bytes = bytearray()
        self._position = 0

    @property
    def is_partial(self) -> bool:
        """True if an answer is incomplete."""
        return self.aligned and self._position < len(self._bytes)

    def feed(self, data: bytes) -> None:
        """Append bytes; then call `next` until it returns None."""
        self._bytes += data

    def reset(self) -> None:
        """Discard all bytes, before a new connection."""
        self.aligned = False
        self._bytes.clear()
        self._position = 0

    def next(self, sync_expected: bool, in_flight: Iterable[int]) -> Answer | NoiseError | None:
        """Return the next answer, or noise (the reader then searches); None: more bytes needed.

        While a SYNC answer is expected, its pattern is found also inside an apparent answer, whose length
        byte may be damaged. `in_flight`: packet numbers whose confirmations are accepted while searching.
        """
        found: Answer | NoiseError | None
        found = self._next_aligned(sync_expected) if self.aligned else self._find_next(in_flight)
        if found is None or self._position > 4 * _LOOKBACK:
            consumed = max(self._position - _LOOKBACK, 0)
            del self._bytes[:consumed]
            self._position -= consumed
        return found

    def _pattern(self) -> int:
        """Return the end of the next SYNC pattern at or after the read position; -1: none."""
        begin = self._bytes.find(SYNC_PATTERN, max(self._position - _LOOKBACK, 0))
        return begin + len(SYNC_PATTERN) if begin >= 0 else -1

    def _next_aligned(self, sync_expected: bool) -> Answer | NoiseError | None:
        pattern = self._pattern() if sync_expected else -1
        try:
            one = read_answer(self._bytes, self._position, pattern if pattern >= 0 else len(self._bytes))
        except NoiseError as noise:
            self.aligned = False
            return noise
        if one is not None:
            answer, self._position = one
            return answer
        if pattern < 0:
            return None
        self.aligned = False
        return NoiseError("swallowed_sync")

    def _find_next(self, in_flight: Iterable[int]) -> Answer | None:
        pattern = self._pattern()
        end = pattern if pattern >= 0 else len(self._bytes)
        sent = min(
            (one for number in in_flight if (one := self._confirmation(number, end)) is not None),
            default=None,
        )
        if sent is not None:
            begin, answer = sent
            self._skip_to(begin)
            self._position = begin + CONFIRMATION_SIZE
            return answer
        if pattern >= 0:
            self._skip_to(max(pattern - len(SYNC_PATTERN), self._position))
            self._position = pattern
            self.aligned = True
            return SyncAnswer()
        self._skip_to(max(end - _LOOKBACK, self._position))
        return None

    def _skip_to(self, at: int) -> None:
        self.junk_bytes += at - self._position
        self._position = at

    def _confirmation(self, number: int, end: int) -> tuple[int, PacketConfirmation] | None:
        """Return position and value of the packet's first complete confirmation before `end`."""
        pattern = CONFIRMATION_TYPE + number.to_bytes(4, "little")
        begin = self._position
        while (begin := self._bytes.find(pattern, begin, end - 1)) >= 0:
            status = self._bytes[begin + CONFIRMATION_SIZE - 1]
            if status <= 1:
                return begin, PacketConfirmation(number, bool(status))
            begin += 1
        return None


_SENTENCE_FORMAT: Final = re.compile(rb"\$(GPRMC,[\x20-\x29\x2b-\x7e]*)\*([0-9A-F]{2})")
_ANGLE_FORMAT: Final = re.compile(r"(\d+)(\d\d(?:\.\d+)?)")
_MIN_FIELDS: Final = 10
"""Fields: type, time, status, latitude, N or S, longitude, E or W, speed, course, date."""


def parse_rmc(now: Instant, text: bytes) -> GpsFix | None:
    """Return the position in an RMC sentence; None for a wrong checksum, field, range or digit."""
    frame = _SENTENCE_FORMAT.fullmatch(text)
    if frame is None or reduce(xor, frame[1]) != int(frame[2], 16):
        return None
    fields = frame[1].decode().split(",")
    if len(fields) < _MIN_FIELDS or fields[2] not in ("A", "V"):
        return None
    try:
        latitude = _degrees(fields[3], fields[4], 2, "NS", 90.0)
        longitude = _degrees(fields[5], fields[6], 3, "EW", 180.0)
    except ValueError:
        return None
    valid = fields[2] == "A"  # status A: the position is valid and present
    return (
        None if valid and (latitude is None or longitude is None) else GpsFix(now, valid, latitude, longitude)
    )


def _degrees(angle: str, hemisphere: str, digits: int, hemispheres: str, limit: float) -> float | None:
    """Convert degrees (`digits` digits) and minutes `mm.m…` to degrees; None if both are empty."""
    if not angle and not hemisphere:
        return None
    parts = _ANGLE_FORMAT.fullmatch(angle)
    if parts is None or len(parts[1]) != digits or len(hemisphere) != 1 or hemisphere not in hemispheres:
        raise ValueError
    minutes = float(parts[2])
    degrees = int(parts[1]) + minutes / 60.0
    if minutes >= 60.0 or degrees > limit:
        raise ValueError
    return math.copysign(degrees, 1.0 if hemisphere == hemispheres[0] else -1.0)


COUNTER_NAMES: Final = (
    # Outcomes of packets.
    "sent", "failed", "unconfirmed", "overflowed", "refused", "forgotten",
    # Received messages: passed on, dropped or damaged.
    "heard", "other_pan", "own_address", "bad_fcs", "fixes", "bad_sentence", "temperatures", "humidities",
    "bad_sensor", "infos",
    # Synchronisation.
    "answers", "syncs", "ups", "probes", "silent", "lost", "junk_bytes",
    # Noise: invalid bytes, then missing and unexpected answers.
    "unknown_type", "bad_length", "bad_pattern", "bad_status", "bad_channel", "bad_power", "bad_text",
    "bad_temperature", "swallowed_sync", "stalled", "no_confirmation", "no_echo", "echo_skipped",
    "answer_skipped", "strange_confirmation", "strange_echo", "late_sync", "late_confirmation", "late_echo",
)  # fmt: skip
"""Counters of a link, in the order of output."""


PacketOutcome = FrameSent | AccessFailure | FrameUnconfirmed | FrameOverflow | FrameRefused
"""Outcome of a packet; each packet has exactly one."""
BoardEvent = PacketOutcome | FrameReceived | BoardNote


_NO_SENSOR_TENTHS: Final = -397
"""Temperature for the raw value 0 (data line low), tenths of a degree."""
_MAX_TEMPERATURE: Final = 1238
"""Upper end of the SHT1x's range, tenths of a degree (Sensirion, data sheet SHT1x); a data line held high
gives 615.6 degrees."""
_MAX_HUMIDITY: Final = 1000


def board_events(
    now: Instant, answer: Answer, settings: BoardSettings, counters: Counter[str], drop_bad_fcs: bool
) -> list[BoardEvent]:
    """Convert an unsolicited message to events; [] if it is dropped."""
    match answer:
        case ReceivedPacket():
            return _packet_events(now, answer, settings, counters, drop_bad_fcs)
        case GpsSentence(text):
            fix = parse_rmc(now, text)
            counters["bad_sentence" if fix is None else "fixes"] += 1
            return [] if fix is None else [fix]
        case TemperatureReading(tenths):
            valid = _NO_SENSOR_TENTHS < tenths <= _MAX_TEMPERATURE
            counters["temperatures" if valid else "bad_sensor"] += 1
            return [Temperature(now, tenths / 10, valid)]
        case HumidityReading(tenths):
            valid = 0 <= tenths <= _MAX_HUMIDITY
            counters["humidities" if valid else "bad_sensor"] += 1
            return [Humidity(now, tenths / 10, valid)]
        case BoardInfo(text):
            counters["infos"] += 1
            return [BoardText(now, text.decode())]
        case _:
            raise AssertionError(answer)


def _packet_events(
    now: Instant, packet: ReceivedPacket, settings: BoardSettings, counters: Counter[str], drop_bad_fcs: bool
) -> list[BoardEvent]:
    if packet.fcs != DataFrame(packet.pan, packet.address, packet.data).check:
        counters["bad_fcs"] += 1
        if drop_bad_fcs:
            return []
    if packet.pan != settings.pan:
        counters["other_pan"] += 1
        return []
    counters["own_address"] += packet.address == settings.address  # duplicate address
    counters["heard"] += 1
    return [FrameReceived(now, packet.address, rssi_dbm(packet.rssi_code), packet.lqi, packet.data)]
