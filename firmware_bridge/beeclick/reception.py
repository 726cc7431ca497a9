"""Decoding of what a board sends: bytes to answers, answers to events.

The line has no checksum, so position decides what is accepted. After a SYNC answer the bytes are *aligned*:
each answer begins where the last one ended, until an impossible one. From there on the reader *searches*: it
accepts only the next SYNC answer and confirmations of packets in flight, whose 32-bit numbers identify them.
The result does not depend on how the bytes are cut into reads.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from functools import reduce
from operator import xor
from typing import Annotated, Final

from msgspec import Meta

from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import (
    AccessFailure,
    BoardNote,
    Fix,
    Heard,
    Humidity,
    Info,
    Overflow,
    Refused,
    Sent,
    Temperature,
    Unconfirmed,
)
from actors.radio.frame import DataFrame, rssi_dbm
from actors.settings import ParameterError, Settings
from firmware_bridge.beeclick.wire import (
    LONGEST_COMMAND,
    SENT_SIZE,
    SENT_TYPE,
    SYNC_PATTERN,
    Answer,
    HumidityReading,
    NoiseError,
    Notes,
    PacketSent,
    ReceivedPacket,
    Sentence,
    SetAddress,
    SetChannel,
    SetPower,
    Setting,
    Synchronised,
    TemperatureReading,
    read_answer,
)

POWERS: Final = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
"""Which there are, in words that go on after "must be"."""
_LARGE_STEP: Final = 100
"""Tenths of a dB (DS39776C, register RFCON3)."""


def radiated(asked: int) -> int:
    """The transmit power, tenths of a dBm, that the firmware sets when asked for `asked`, 0 to -363.

    Whole tens of dB are right. Of the small steps -0.5 to -6.3 dB a mistake of units leaves two: a remainder
    of -0.5 or -0.6 dB gives -0.5, everything from -0.7 on gives -6.3 (MRF24J40.cpp, setTxPower).
    """
    large, rest = divmod(-asked, _LARGE_STEP)
    small = 0 if rest < 5 else 5 if rest < 7 else 63
    return -(large * _LARGE_STEP + small)


def power_setting(power_dbm: float) -> int:
    """What to ask the board for, tenths of a dBm, so that it sends with `power_dbm`. Raises ParameterError.

    A power that the firmware would make another one of is refused.
    """
    asked = round(power_dbm * 10)
    if abs(asked - power_dbm * 10) < 1e-6 and -363 <= asked <= 0 and radiated(asked) == asked:
        return asked
    raise ParameterError("board.power_dbm", power_dbm, POWERS)


FIRST_CHANNEL: Final = 11
"""The channel whose code is 0."""
_LAST_CHANNEL: Final = 26
_Time = Annotated[Duration, Meta(ge=1, le=2**40)]
_Number = Annotated[int, Meta(ge=1, le=10_000)]


class BoardSettings(Settings, frozen=True):
    """How a board is set up. Raises ParameterError for what it cannot be."""

    address: Annotated[int, Meta(ge=0, le=0xFFFD)]
    """Short address of the robot's transceiver, 0 to 0xFFFD; each robot needs its own."""
    channel: Annotated[int, Meta(ge=FIRST_CHANNEL, le=_LAST_CHANNEL)] = 26
    """Of IEEE 802.15.4 in the 2.4 GHz band, 11 to 26. Default: the one that Wi-Fi leaves alone most."""
    pan: Annotated[int, Meta(ge=0, le=0xFFFE)] = 0xBABA
    """PAN id, 0 to 0xFFFE; frames of others are not passed on. Default: that of the original robots
    (d3scomp/beeclickarmROS)."""
    power_dbm: float = -10.0
    """Transmit power, dBm. Default: what the firmware sets at its start (MRF24J40.cpp: RFCON3 = 0x40)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        power_setting(self.power_dbm)

    def commands(self) -> tuple[Setting, ...]:
        """What the board is to be told; the address first, with which it can be asked whether it listens."""
        return (
            SetAddress(self.pan, self.address),
            SetChannel(self.channel - FIRST_CHANNEL),
            SetPower(power_setting(self.power_dbm)),
        )


class BeeClickParameters(Settings, frozen=True):
    """Time-outs and bounds of the link to a board."""

    in_flight: Annotated[int, Meta(ge=1, le=6)] = 4
    """Packets that the board has and has not confirmed. Default: as the original host library
    (AbstractComm.java); with nine the firmware confirms one that never left."""
    transmit_queue: Annotated[int, Meta(ge=0, le=10_000)] = 7
    """Packets that may wait behind the one in the air, on the board and here. Default: as in the simulated
    radio (actors.radio.medium.state)."""
    answer_timeout: _Time = seconds(1.0)
    """For an echo or a confirmation, µs. Default: the board's button holds everything up for 0.70 s, and four
    packets take 0.17 s where every one finds the channel busy to the last try."""
    doubt: _Time = milliseconds(250)
    """After so long without an answer a SYNC is sent behind what was asked, µs; no more packets until it is
    answered. Default: own choice, above the 0.17 s of four packets in a busy channel."""
    ring: int = 6
    """Commands that a board may have and not have answered, packets and SYNCs included. Default: its ring has
    room for seven, but seven answers behind the button's notes would fill that of the answers and hang it."""
    sync_interval: _Time = milliseconds(80)
    """Between two SYNCs while bytes come, µs. Default: noise over, one comes within 100 ms; an answer that
    waits behind four packets, 22 ms, is there before the next."""
    quick_syncs: _Number = 4
    """So many SYNCs are sent at that interval though no byte comes. Default: a board that its button holds up
    gets five in 0.70 s; at the seventh it would hang, its answers filling their ring."""
    slow_sync_interval: _Time = milliseconds(800)
    """Between the SYNCs after them, µs. Default: a little longer than the button holds a board up."""
    noisy_sync_interval: _Time = milliseconds(320)
    """Between SYNCs once the ring may be full and noise comes, µs. Default: own choice; three in a second."""
    deaf_sync_interval: _Time = seconds(10.0)
    """Between SYNCs to a board whose ring is full and that talks all the same, µs. Default: own choice; one
    that was reset is found within that, and the ring of one that is wedged runs over once in a minute."""
    give_up: _Time = seconds(1.0)
    """A board that has answered no SYNC for so long counts as silent, and what it has as unknown, µs.
    Default: as answer_timeout."""
    probe_interval: _Time = milliseconds(250)
    """After so long without an answer the board is asked whether it still listens, µs. Default: own choice; a
    board that has restarted, or lost bytes, is set up again within that and `doubt`."""
    stall: _Time = milliseconds(50)
    """A message that stops in its middle for so long never goes on, µs. Default: own choice, above the 16 ms
    for which USB adapters keep bytes back."""
    filler: _Number = LONGEST_COMMAND
    """Bytes that are no command, ahead of each SYNC. Default: as many as end whatever command the board
    believes to be in; 2.8 ms on the line."""
    drop_bad_fcs: bool = True
    """Drop packets whose frame check sequence does not hold any more when they arrive here, and count them.
    Default: the line has damaged them. That the sequence is handed on right is taken from the firmware's
    source, not from a board; if `bad_fcs` counts every packet of a real one, this must be False."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.in_flight < self.ring <= 7:
            raise self.wrong("ring", f"from {self.in_flight + 1} to 7")


DEFAULTS: Final = BeeClickParameters()
"""Of a link that is given no others."""


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


def parse_rmc(now: Instant, text: bytes) -> Fix | None:
    """Return the position in a sentence; None unless checksum, fields, ranges and digits are right."""
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
    valid = fields[2] == "A"  # the receiver vouches for the position, which is then there
    return None if valid and (latitude is None or longitude is None) else Fix(now, valid, latitude, longitude)


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


PacketEnd = Sent | AccessFailure | Unconfirmed | Overflow | Refused
"""What becomes of a packet: every one that is sent comes to exactly one of these."""
Event = PacketEnd | Heard | BoardNote


_NO_SENSOR: Final = -397
"""Tenths of a degree, from the number 0: the data line is held low."""
_HOTTEST: Final = 1238
"""Tenths of a degree: the end of the SHT1x's range (Sensirion, data sheet SHT1x); a data line that is held
high gives 615.6 degrees."""
_WETTEST: Final = 1000


def news(
    now: Instant, answer: Answer, settings: BoardSettings, counters: Counter[str], drop_bad_fcs: bool
) -> list[Event]:
    """Return the event that an unasked message is; none for what is to be dropped."""
    match answer:
        case ReceivedPacket():
            return _heard(now, answer, settings, counters, drop_bad_fcs)
        case Sentence(text):
            fix = parse_rmc(now, text)
            counters["bad_sentence" if fix is None else "fixes"] += 1
            return [] if fix is None else [fix]
        case TemperatureReading(tenths):
            valid = _NO_SENSOR < tenths <= _HOTTEST
            counters["temperatures" if valid else "bad_sensor"] += 1
            return [Temperature(now, tenths / 10, valid)]
        case HumidityReading(tenths):
            valid = 0 <= tenths <= _WETTEST
            counters["humidities" if valid else "bad_sensor"] += 1
            return [Humidity(now, tenths / 10, valid)]
        case Notes(text):
            counters["infos"] += 1
            return [Info(now, text.decode())]
        case _:
            raise AssertionError(answer)


def _heard(
    now: Instant, packet: ReceivedPacket, settings: BoardSettings, counters: Counter[str], drop_bad_fcs: bool
) -> list[Event]:
    if packet.fcs != DataFrame(packet.pan, packet.address, packet.data).check:
        counters["bad_fcs"] += 1
        if drop_bad_fcs:
            return []
    if packet.pan != settings.pan:
        counters["other_pan"] += 1
        return []
    counters["own_address"] += packet.address == settings.address  # another robot has it, too
    counters["heard"] += 1
    return [Heard(now, packet.address, rssi_dbm(packet.rssi_code), packet.lqi, packet.data)]
