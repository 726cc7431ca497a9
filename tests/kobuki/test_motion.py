"""Kobuki: protocol, noisy line, motion, and odometry compared with ground truth."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import Generator

from actors.geometry import Pose, wrap
from actors.instant import START, Instant
from actors.robot_model import KobukiErrors
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.emulated_kobuki import BaseParameters
from firmware_bridge.kobuki.kobuki_motion import KOBUKI_LIMITS, BaseFeedback, base_control, velocity
from firmware_bridge.kobuki.kobuki_packets import (
    HEADER,
    LONGEST,
    BaseControl,
    BasicSensorData,
    Command,
    FeedbackPacket,
    FrameReader,
    GeneralOutput,
    InertialSensorData,
    MalformedError,
    SoundSequence,
    UnknownPacket,
    WireMisuseError,
    decode_commands,
    decode_feedback,
    encode_command,
    encode_feedback,
    encode_frame,
)
from firmware_bridge.wheel_odometry import WheelOdometry
from tests.kobuki.rig import Rig

COMMANDS = [
    # 06^01^04^64 = 67
    (BaseControl(100, 0), "aa 55 06 01 04 64 00 00 00 67"),
    # -100 = ff9c, 1: 06^01^04^9c^ff^01 = 61
    (BaseControl(-100, 1), "aa 55 06 01 04 9c ff 01 00 61"),
    (SoundSequence(4), "aa 55 03 04 01 04 02"),
    # rails and LED 1 green: 02f0: 04^0c^02^f0^02 = f8
    (GeneralOutput(0x02F0), "aa 55 04 0c 02 f0 02 f8"),
]
FEEDBACK = [
    (
        BasicSensorData(0x1234, 1, 2, 4, 0xFFFE, 3, -5, 6, 1, 6, 164, 2),
        "01 0f 34 12 01 02 04 fe ff 03 00 fb 06 01 06 a4 02",
    ),
    (UnknownPacket(3, b"\x01\x02\x10"), "03 03 01 02 10"),
    (InertialSensorData(-9000, 250), "04 07 d8 dc fa 00 00 00 00"),
    (UnknownPacket(5, bytes.fromhex("d0 07 d1 07 ff 0f")), "05 06 d0 07 d1 07 ff 0f"),
    (UnknownPacket(6, b"\x07\xff"), "06 02 07 ff"),
    (UnknownPacket(10, b"\x04\x00\x01\x00"), "0a 04 04 00 01 00"),
    (UnknownPacket(99, b"\x07"), "63 01 07"),
]


@pytest.mark.parametrize(("command", "wire"), COMMANDS)
def test_commands_are_encoded_and_decoded(command: Command, wire: str) -> None:
    assert encode_frame(encode_command(command)) == bytes.fromhex(wire)
    assert FrameReader(decode_commands).take(bytes.fromhex(wire)) == [[command]]


@pytest.mark.parametrize(("feedback", "wire"), FEEDBACK)
def test_feedback_packets_are_encoded_and_decoded(feedback: FeedbackPacket, wire: str) -> None:
    assert encode_feedback(feedback) == bytes.fromhex(wire)
    assert decode_feedback(bytes.fromhex(wire)) == [feedback]


@pytest.mark.parametrize("command", [BaseControl(0x8000, 0), BaseControl(0, -0x8001), SoundSequence(256)])
def test_numbers_out_of_range_are_a_programming_error(command: Command) -> None:
    with pytest.raises(WireMisuseError):
        encode_command(command)
    with pytest.raises(WireMisuseError, match=r"^payload of 161 bytes; must have 3 to 160$"):
        encode_frame(bytes(161))


INT16 = st.integers(-0x8000, 0x7FFF)
UINT16 = st.integers(0, 0xFFFF)
UINT8 = st.integers(0, 0xFF)
ANY_FEEDBACK: st.SearchStrategy[FeedbackPacket] = st.one_of(
    st.builds(
        BasicSensorData,
        UINT16,
        UINT8,
        UINT8,
        UINT8,
        UINT16,
        UINT16,
        *[st.integers(-128, 127)] * 2,
        *[UINT8] * 4,
    ),
    st.builds(InertialSensorData, INT16, INT16),
    st.builds(UnknownPacket, st.integers(30, 255), st.binary(min_size=1, max_size=20)),
)
ANY_COMMAND: st.SearchStrategy[Command] = st.one_of(
    st.builds(BaseControl, INT16, INT16), st.builds(SoundSequence, UINT8), st.builds(GeneralOutput, UINT16)
)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.lists(ANY_FEEDBACK, min_size=1, max_size=6), max_size=4),
    st.lists(ANY_COMMAND, min_size=1, max_size=5),
    st.integers(1, 40),
)
def test_boundaries_of_reads_do_not_matter(
    feedbacks: list[list[FeedbackPacket]], commands: list[Command], chunk: int
) -> None:
    wire = b"".join(encode_frame(b"".join(map(encode_feedback, packets))) for packets in feedbacks)
    reader = FrameReader(decode_feedback)
    heard = [p for at in range(0, len(wire), chunk) for p in reader.take(wire[at : at + chunk])]
    assert heard == feedbacks
    assert reader.reception.skipped == 0
    payload = b"".join(map(encode_command, commands))
    assert FrameReader(decode_commands).take(encode_frame(payload)) == [commands]


RIGHT = bytes.fromhex("aa 55 06 01 04 64 00 00 00 67")


def counts_of(wire: str | bytes) -> tuple[int, int, int, int, int]:
    reader = FrameReader(decode_commands)
    reader.take(bytes.fromhex(wire) if isinstance(wire, str) else wire)
    r = reader.reception
    return r.frames, r.noise, r.bad_length, r.bad_checksum, r.malformed


def test_noise_is_skipped_and_counted_by_its_cause() -> None:
    assert counts_of(b"\x00\xaa\x11" + RIGHT) == (1, 3, 0, 0, 0)
    # the header's first byte is skipped for its cause, what follows until the next header is noise
    assert counts_of(b"\xaa\x55\x00" + RIGHT) == (1, 2, 1, 0, 0)
    assert counts_of(b"\xaa\x55\xff" + RIGHT) == (1, 2, 1, 0, 0)
    assert counts_of(RIGHT[:-1] + b"\x66" + RIGHT) == (1, 9, 0, 1, 0)
    assert counts_of("aa 55 03 63 01 00 61" + RIGHT.hex()) == (1, 6, 0, 0, 1)  # unknown command 99
    with pytest.raises(MalformedError, match=r"^packet 3 has 4 bytes of data, not 3$"):
        decode_feedback(bytes((3, 4, 0, 0, 0, 0)))
    assert counts_of(b"\xaa\x55\x09" + RIGHT) == (1, 2, 0, 1, 0), "a frame within an apparent one"
    assert counts_of("aa 55 03 01 04 00 06" + RIGHT.hex()) == (1, 6, 0, 0, 1)  # longer than its payload


def test_at_most_one_incomplete_frame_is_buffered() -> None:
    reader = FrameReader(decode_commands)
    assert reader.take(RIGHT[:-1]) == []
    assert reader.pending == 9
    assert reader.take(RIGHT[-1:]) == [[BaseControl(100, 0)]]
    reader.take(b"\xaa\x55\xa0" + bytes(150))
    assert reader.pending == 153
    reader.take(bytes(10_000))
    assert reader.pending == 0


MARK = 19
"""Kind of the packet that carries a frame's number."""
PIECES = 200
"""Number of frames and pieces of noise per call."""


class Stream:
    """Random intact frames, damaged frames and noise; every frame carries its number."""

    def __init__(self, rng: Generator) -> None:
        self._rng = rng
        self._next = 0

    def pieces(self) -> tuple[bytes, set[int], int]:
        """Return bytes, the numbers of intact frames in them, and the number of damaged frames.

        Zeros at the end complete any apparent frame.
        """
        data, intact, damaged = bytearray(), set(), 0
        for kind in self._rng.integers(0, 10, PIECES).tolist():
            if kind < 5:
                intact.add(self._next)
                data += self._frame()
            elif kind < 8:
                damaged += 1
                data += self._damaged(bytearray(self._frame()))
            else:
                data += self._rng.bytes(int(self._rng.integers(1, 120)))
                data += HEADER[: int(self._rng.integers(0, 3))] + self._rng.bytes(1)
        return bytes(data) + bytes(LONGEST + 4), intact, damaged

    def _frame(self) -> bytes:
        numbers = self._rng.integers(0, 256, 8).tolist()
        basic = BasicSensorData(
            self._next & 0xFFFF, 0, 0, 0, *numbers[:2], *(n - 128 for n in numbers[2:4]), *numbers[4:]
        )
        inertial = InertialSensorData(*self._rng.integers(-0x8000, 0x8000, 2).tolist())
        packets: list[FeedbackPacket] = [
            basic,
            inertial,
            UnknownPacket(MARK, self._next.to_bytes(12, "little")),
        ]
        self._next += 1
        return encode_frame(b"".join(map(encode_feedback, packets)))

    def _damaged(self, data: bytearray) -> bytearray:
        """Replace, drop or double bytes until the frame differs."""
        before = bytes(data)
        while bytes(data) == before:
            for _ in range(int(self._rng.integers(1, 4))):
                at, how = int(self._rng.integers(0, len(data))), int(self._rng.integers(0, 3))
                data[at : at + 1] = (self._rng.bytes(1), b"", data[at : at + 1] * 2)[how]
        return data


def number(packets: list[FeedbackPacket]) -> int:
    """Return the number of a received frame; -1 if it was never generated."""
    kinds, last = [type(packet) for packet in packets], packets[-1]
    if (
        kinds == [BasicSensorData, InertialSensorData, UnknownPacket]
        and isinstance(last, UnknownPacket)
        and last.kind == MARK
    ):
        return int.from_bytes(last.data, "little")
    return -1


@pytest.mark.claim("boards")
def test_intact_frames_are_received_through_noise(
    full: bool, record_property: Callable[[str, object], None]
) -> None:
    """Test with tolerance: an XOR checksum misses some damage, and a false frame may hide the next one."""
    stream, cuts = Stream(np.random.default_rng(5)), np.random.default_rng(6)
    whole, cut, driver = FrameReader(decode_feedback), FrameReader(decode_feedback), KobukiDriver(START)
    size = intact = missed = false = damaged = 0
    now = START
    while size < (10_000_000 if full else 200_000):
        data, wanted, broken = stream.pieces()
        received, again, at = whole.take(data), [], 0
        while at < len(data):
            piece = data[at : at + int(cuts.integers(1, 200))]
            again += cut.take(piece)
            assert cut.pending <= LONGEST + 3
            now = Instant(now + 1000)
            driver.take(now, piece)
            driver.command(now, 0.1, 0.1)
            driver.due(now)
            at += len(piece)
        assert received == again, "boundaries of reads do not matter"
        numbers = {number(packets) for packets in received}
        size, damaged, intact = size + len(data), damaged + broken, intact + len(wanted)
        missed += len(wanted - numbers)
        false += len(received) - len(wanted & numbers)
    record_property("frames", {"intact": intact, "damaged": damaged, "missed": missed, "false": false})
    assert intact > 1500
    assert false <= max(3, damaged / 50)
    assert missed <= min(false, max(3, intact / 1000))
    reception = whole.reception
    assert min(reception.noise, reception.bad_length, reception.bad_checksum, reception.malformed) > 0


DRIVE = (
    (4.0, 0.5, 0.0), (6.0, 0.4, 0.8), (2.0, 0.0, -2.0),
    (5.0, -0.3, 0.4), (30.0, 0.4, 0.25), (2.0, 0.0, 0.0),
)  # fmt: skip
"""Seconds, m/s, rad/s: straight, arcs, in place, backward; 49 s, 17 m, 1.6 turns left."""
WRAPPING = BaseParameters(stamp_ms=60_000, left_ticks=65_000, right_ticks=200, angle=3.0)
"""All counters wrap: stamp once or twice, the encoders three times, the angle in each turn."""


def drive(rig: Rig) -> float:
    """Execute DRIVE; return the distance, m."""
    way = 0.0
    last = rig.body.truth().pose

    def follow() -> None:
        nonlocal way, last
        here = rig.body.truth().pose
        way += here.point.distance_to(last.point)
        last = here

    for seconds, v, omega in DRIVE:
        rig.run(seconds, (v, omega), follow)
    return way


def errors(rig: Rig, start: Pose) -> tuple[float, float]:
    """Return the errors of position, m, and heading, rad."""
    truth = start.relative(rig.body.truth().pose)
    odometry = rig.driver.odometry.read()
    return (
        math.hypot(odometry.x - truth.x, odometry.y - truth.y),
        abs(wrap(odometry.heading - truth.heading)),
    )


def test_odometry_of_an_exact_base_is_exact_over_all_wraps() -> None:
    rig = Rig(WRAPPING, pose=Pose(10.0, 8.0, 2.0))
    start = rig.body.truth().pose
    way = drive(rig)
    assert rig.driver.reception.skipped == 0
    assert way == pytest.approx(17.0, abs=2.0)
    position, heading = errors(rig, start)
    assert position < 0.001
    assert heading < 0.0005
    counts = rig.driver.odometry.counts
    assert (counts.implausible, counts.restarts, counts.gaps, counts.wheel_headings) == (0, 0, 0, 0)
    assert rig.driver.odometry.heading > 3 * math.pi  # unwrapped
    rig.run(3.0, (0.0, 0.0))
    assert counts.wheel_headings == 0, "the gyro of a standing base is not frozen"


def test_odometry_with_realistic_errors_stays_within_one_percent_of_the_distance() -> None:
    rig = Rig(dataclasses.replace(WRAPPING, errors=KobukiErrors()), pose=Pose(10.0, 8.0, 2.0))
    start = rig.body.truth().pose
    way = drive(rig)
    position, heading = errors(rig, start)
    assert position < 0.01 * way
    assert heading < 0.05
    assert rig.driver.odometry.counts.implausible == 0


@pytest.mark.parametrize("gyro", ["absent", "frozen"])
def test_without_a_gyro_the_heading_of_the_wheels_is_used_and_counted(gyro: str) -> None:
    rig = Rig(pose=Pose(10.0, 8.0, 2.0))
    start = rig.body.truth().pose
    counts = rig.driver.odometry.counts
    rig.run(2.0, (0.3, 0.5))
    assert counts.wheel_headings == 0
    rig.base.faults.gyro = gyro  # type: ignore[assignment]
    rig.run(0.55, (0.3, 0.5))
    assert rig.driver.odometry.gyro_is_constant == (gyro == "frozen")
    if gyro == "frozen":
        rig.driver.odometry.uses_wheel_heading = True
    rig.run(5.45, (0.3, 0.5))
    assert counts.wheel_headings > 200
    position, heading = errors(rig, start)
    assert position < 0.05
    assert heading < 0.02
    rig.base.faults.gyro = "works"
    rig.run(0.1, (0.3, 0.5))
    on_wheels = counts.wheel_headings
    rig.run(3.9, (0.3, 0.5))
    assert counts.wheel_headings == on_wheels
    assert errors(rig, start)[1] < 0.03
    assert (counts.implausible, counts.restarts) == (0, 0)


def test_a_noise_free_gyro_is_trusted_despite_drift_of_the_wheels() -> None:
    # 17 m; 0.2 rad by the wheels
    ticks = [(20 * k, 100 * k, 100 * k + k // 4, 0) for k in range(2000)]
    odometry = fed(ticks)
    assert odometry.counts.wheel_headings == 0
    assert odometry.heading == 0.0


def feedback(at_us: int, stamp_ms: int, left: int, right: int, angle: int) -> BaseFeedback:
    basic = BasicSensorData(stamp_ms, 0, 0, 0, left, right, 0, 0, 0, 0, 160, 0)
    return BaseFeedback(Instant(at_us), basic, InertialSensorData(angle, 0))


def fed(readings: list[tuple[int, int, int, int]]) -> WheelOdometry:
    odometry = WheelOdometry(KOBUKI_LIMITS)
    for ms, left, right, angle in readings:
        odometry.take(feedback(1000 * ms, ms & 0xFFFF, left, right, angle))
    return odometry


def test_damaged_feedback_is_ignored_without_losing_distance() -> None:
    odometry = fed([(0, 0, 0, 0), (20, 100, 100, 0), (40, 30_000, 200, 0), (60, 300, 300, 0)])
    assert odometry.counts.implausible == 1
    assert odometry.read().x == pytest.approx(300 * 85.292e-6, rel=1e-5)


def test_odometry_continues_after_a_restart_of_the_base() -> None:
    odometry = fed([(40_000, 0, 0, 0), (40_020, 100, 100, 0)])
    before = odometry.read().x
    for ms, ticks in ((5, 30_000), (25, 30_100), (45, 30_200)):
        odometry.take(feedback(41_000_000 + 1000 * ms, ms, ticks, ticks, 9000))
    assert odometry.counts.restarts == 1
    assert odometry.read().x == pytest.approx(before + 100 * 85.292e-6, rel=1e-5)
    assert odometry.read().heading == 0.0


def test_ticks_are_ignored_after_a_long_gap() -> None:
    odometry = fed([(0, 0, 0, 0), (3_020, 20_000, 20_000, 0), (3_040, 20_100, 20_100, 0)])
    assert odometry.counts.gaps == 1
    assert odometry.read().x == pytest.approx(100 * 85.292e-6, rel=1e-5)


@pytest.mark.parametrize(
    ("v", "omega", "speed", "radius"),
    [
        (0.0, 0.0, 0, 0),
        (0.5, 0.0, 500, 0),
        (0.0, 1.0, 115, 1),  # in place: 1000 * 0.23 * 1 / 2
        (0.0, -1.0, -115, 1),
        (0.0015, 1.0, 115, 1),  # radius 1.5 mm is sent as 1: in place
        (-0.0015, 1.0, 115, 1),
        (0.002, 1.0, 117, 2),  # smallest radius: 2 + 115
        (0.2, 0.5, 257, 400),  # 400 mm; (400 + 115) * 0.5 = 257.5 towards zero
        (0.2, -0.5, 257, -400),  # (-400 - 115) * -0.5
        (0.3, 0.7, 380, 428),  # 428.57 mm; speed from the unrounded radius: 380.5
        (0.5, 0.0153, 501, 32679),
        (0.5, 0.0152, 500, 0),  # 32894 mm is out of range: straight
        (-40.0, 0.0, -32768, 0),
    ],
)
def test_the_formula(v: float, omega: float, speed: int, radius: int) -> None:
    assert base_control(v, omega) == BaseControl(speed, radius)


@given(st.floats(-0.7, 0.7), st.floats(-math.pi, math.pi))
def test_velocities_are_exact_within_the_protocols_resolution(v: float, omega: float) -> None:
    back_v, back_omega = velocity(base_control(v, omega))
    # Rounding errors: 1 mm/s of the outer wheel, up to 2 mm of the radius.
    assert back_v == pytest.approx(v, abs=0.0012 + 0.0022 * abs(omega))
    if abs(omega) > 0.03:
        assert back_omega == pytest.approx(omega, abs=0.01 + 0.01 * abs(omega))
