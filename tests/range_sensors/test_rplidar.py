"""RPLIDAR A1: protocol, start, scans along a model's rays, noise and failures."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import START, Instant, milliseconds
from actors.messages import NO_ECHO_MM, Scan
from actors.robot_model import RangeSensor as SensorModel
from actors.robot_model import load_model, scan_angles
from firmware_bridge.device_lines import NO_NOISE, LineNoise
from firmware_bridge.range_sensors.rplidar import (
    HEALTH,
    SCANNING,
    Health,
    LidarPhase,
    LidarRequest,
    Rplidar,
    Sample,
    SampleReader,
)
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidar, RangeFunction
from firmware_bridge.range_sensors.sensor import ScanRays
from tests.kobuki.rig import Room

CHAPTER = load_model("turtlebot2", "chapter").sensor
ROOM = Room(6.0, 4.0)
HERE = Pose(2.0, 1.2, 0.4)


def room(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return ROOM.ranges(HERE, angles)


def test_bytes() -> None:
    assert LidarRequest.SCAN.bytes == bytes.fromhex("a5 20")
    assert LidarRequest.STOP.bytes == bytes.fromhex("a5 25")
    assert bytes.fromhex("a5 5a 05 00 00 40 81") == SCANNING
    assert bytes.fromhex("a5 5a 03 00 00 00 06") == HEALTH
    # 90 degrees = 5760/64: 5760 * 2 + 1 = 2d01; 1 m = 4000/4 mm = 0fa0; quality 15, turn's start: 3c | 1
    assert Sample(True, 15, 5760, 4000).encode() == bytes.fromhex("3d 01 2d a0 0f")
    assert Sample(False, 15, 5760, 4000).encode() == bytes.fromhex("3e 01 2d a0 0f")
    assert Health(1, 0x1234).encode() == bytes.fromhex("01 34 12")
    assert Health.decode(bytes.fromhex("01 34 12")) == Health(1, 0x1234)


STEPS = st.tuples(st.booleans(), st.integers(0, 63), st.integers(-320, 1280), st.integers(0, 65535))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 23039), st.lists(STEPS, min_size=6, max_size=60), st.integers(1, 30))
def test_boundaries_of_reads_do_not_matter(
    angle: int, steps: list[tuple[bool, int, int, int]], chunk: int
) -> None:
    samples = []
    for start, quality, on, distance in steps:
        angle = (angle + on) % 23040
        samples.append(Sample(start, quality, angle, distance))
    wire = b"".join(sample.encode() for sample in samples)
    reader = SampleReader()
    read = [s for at in range(0, len(wire), chunk) for s in reader.take(wire[at : at + chunk])]
    assert read == samples
    assert reader.skipped == 0


def test_a_reader_resynchronises_after_a_lost_byte() -> None:
    samples = [Sample(k == 0, 15, 64 * k, 4000 + 7 * k) for k in range(300)]
    wire = b"".join(sample.encode() for sample in samples)
    reader = SampleReader()
    broken = wire[:502] + wire[503:]  # one byte lost within the 101st
    read = reader.take(broken)
    assert read[:100] == samples[:100]
    assert len(read) >= 295
    assert len([sample for sample in read if sample not in samples]) <= 1
    assert reader.skipped >= 4


class Rig:
    """Emulated lidar and driver, served every 5 ms."""

    def __init__(self, sight: RangeFunction = room) -> None:
        self.now = START
        self.device = EmulatedRplidar(sight)
        self.lidar = Rplidar(CHAPTER, START)
        self.scans: list[Scan] = []
        self.noise = np.random.default_rng(3)
        self.line = NO_NOISE

    def run(self, seconds: float) -> None:
        end = self.now + round(seconds * 1e6)
        while self.now < end:
            self.now = Instant(self.now + milliseconds(5))
            self.lidar.take(self.now, self.line.apply(self.device.run(self.now), self.noise))
            self.device.take(self.now, self.lidar.due(self.now))
            scan = self.lidar.scan()
            if scan is not None:
                self.scans.append(scan)


def metres(scan: Scan) -> NDArray[np.float64]:
    ranges = np.frombuffer(scan.ranges_mm, "<u2")
    found: NDArray[np.float64] = np.where(ranges == NO_ECHO_MM, np.nan, ranges / 1000)
    return found


def test_it_starts_and_scans_a_room_along_the_models_rays() -> None:
    rig = Rig()
    rig.device.take(START, LidarRequest.SCAN.bytes)  # already scanning: stopped first
    rig.run(3.0)
    assert rig.lidar.health == Health(0)
    assert 14 <= len(rig.scans) <= 16  # 5.5 turns per second, the first one incomplete
    truth = room(ScanRays(CHAPTER).angles)
    seen = metres(rig.scans[-1])
    within = truth < 6.4
    assert np.isfinite(seen[within]).all()  # 364 samples reach all 640 rays
    assert np.nanmedian(np.abs(seen - truth)) < 0.01
    # A sample is used for rays within half the sample distance, 0.5 degrees.
    assert np.nanmax(np.abs(seen - truth)[within]) < 0.12
    assert rig.lidar.counts.starts == 1
    assert rig.lidar.samples.skipped == 0
    apart = np.diff([scan.stamp for scan in rig.scans])
    assert np.abs(apart - 1e6 / 5.5).max() <= 5000
    middles = [scan.stamp / 1e6 * 5.5 % 1 for scan in rig.scans]  # it rotates from the instant 0 on
    assert middles == pytest.approx([0.5] * len(middles), abs=0.04)


def test_an_object_on_the_left_is_on_the_correct_rays() -> None:
    def post(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        aside = np.remainder(angles - math.radians(60) + math.pi, math.tau) - math.pi
        return np.where(np.abs(aside) < math.radians(2), 1.0, np.inf)

    rig = Rig(post)
    rig.run(1.5)
    rays = np.degrees(ScanRays(CHAPTER).angles)
    hit = rays[np.isfinite(metres(rig.scans[-1]))]
    assert hit.mean() == pytest.approx(60.0, abs=0.6)
    assert hit.max() - hit.min() < 6
    for _ in range(100):
        rig.run(0.01)
        assert rig.lidar.is_measuring(rig.now), "one echo is enough"


def test_noise_loses_samples_but_no_scans() -> None:
    rig = Rig()
    rig.run(1.0)
    rig.line = LineNoise(drop=0.002)
    rig.run(10.0)
    assert len(rig.scans) > 50
    assert rig.lidar.samples.skipped > 50
    assert rig.lidar.counts.starts == 1
    truth = room(ScanRays(CHAPTER).angles)
    assert np.nanmedian(np.abs(metres(rig.scans[-1]) - truth)) < 0.01


def test_a_lidar_that_reports_an_error_is_reset() -> None:
    rig = Rig()
    rig.device.health = Health(2, 7)
    rig.run(3.0)
    assert rig.lidar.health == Health(2, 7)
    assert rig.scans == []
    rig.device.health = Health(0)  # after the reset
    rig.run(4.0)
    assert len(rig.scans) > 3


def test_turns_with_a_gap_or_few_samples_are_discarded() -> None:
    lidar = Rplidar(CHAPTER, START)
    lidar.phase = LidarPhase.SCANNING
    for turn, (step, lost) in enumerate(((1, 5), (1, 15), (5, 5), (1, 5), (1, 5))):
        kept = (k for k in range(0, 360, step) if not 100 <= k < 100 + lost)
        samples = [Sample(k == 0, 15, 64 * k, 4000) for k in kept]
        lidar.take(Instant(182_000 * turn), b"".join(sample.encode() for sample in samples))
    assert lidar.counts.scans == 2
    assert lidar.counts.thin == 2, "one with a gap, one with 72 samples"


def test_noise_raises_nothing_and_buffers_are_limited() -> None:
    rig = Rig()
    for _ in range(2000):
        rig.now = Instant(rig.now + milliseconds(5))
        rig.lidar.take(rig.now, rig.noise.bytes(100))
        rig.lidar.due(rig.now)
    assert len(rig.lidar._pending) < 50
    assert len(rig.lidar.samples._pending) < 200


@pytest.mark.parametrize("fault", ["dark", "stuck", "silent"])
def test_missing_data_is_detected_within_a_quarter_of_a_second(
    fault: str,
) -> None:
    rig = Rig()
    assert not rig.lidar.is_measuring(rig.now)
    rig.run(2.0)
    assert rig.lidar.is_measuring(rig.now)
    setattr(rig.device, fault, True)
    begun = rig.now
    while rig.lidar.is_measuring(rig.now):
        rig.run(0.005)
    assert rig.now - begun <= milliseconds(260)
    rig.run(0.2)  # the last turn is still a scan
    rig.scans.clear()
    rig.run(0.5)
    assert rig.scans == [] and not rig.lidar.is_measuring(rig.now)
    assert (rig.lidar.counts.blind > 1) == (fault == "dark")
    rig.run(2.0)
    assert (rig.lidar.phase is LidarPhase.SCANNING) == (fault != "silent")
    setattr(rig.device, fault, False)
    rig.run(3.0)
    assert rig.lidar.is_measuring(rig.now) and len(rig.scans) > 5
    assert rig.lidar.counts.starts == 1 + (fault == "silent")


def sensor(view_deg: float, rays: int, range_min: float = 0.0) -> SensorModel:
    view = {"field_of_view_deg": view_deg, "rays": rays, "range_min": range_min}
    return SensorModel(**view, range_max=5.0, rate=10.0)  # type: ignore[arg-type]


CIRCLE = sensor(360.0, 8, range_min=0.1)
"""Rays at -135, -90, -45, 0, 45, 90, 135 and 180 degrees."""
VIEW = sensor(90.0, 3)
"""Rays at -45, 0 and 45 degrees."""
NONE = NO_ECHO_MM


def seen(model: SensorModel, samples: Sequence[tuple[float, float]]) -> list[int]:
    """Return the ranges of a scan from samples (degrees, m)."""
    angles, ranges = np.array(samples, np.float64).reshape(-1, 2).T
    scan = ScanRays(model, math.radians(1.0)).scan(Instant(5), np.radians(angles), ranges)
    assert scan.stamp == 5
    found: list[int] = np.frombuffer(scan.ranges_mm, "<u2").tolist()
    return found


@pytest.mark.parametrize("model", [CIRCLE, VIEW, sensor(360.0, 7)])
def test_the_rays_are_those_of_the_model(model: SensorModel) -> None:
    turned: NDArray[np.float64] = ScanRays(model).angles - scan_angles(model)
    assert np.abs(np.sin(turned / 2)).max() < 1e-12
    one_each = [(math.degrees(angle), 1.0 + k) for k, angle in enumerate(ScanRays(model).angles.tolist())]
    wanted = [1000 * (1 + k) if 1 + k <= 5 else NONE for k in range(model.rays)]
    assert seen(model, one_each) == wanted
    shifted = [(degrees - 720.0, metres) for degrees, metres in one_each]
    assert seen(model, shifted) == wanted


def test_invalid_and_out_of_range_values_are_no_echo() -> None:
    samples = [(0, 0.0), (45, math.inf), (90, math.nan), (135, -1.0), (180, 5.001), (-135, 5.0)]
    assert seen(CIRCLE, samples) == [5000, NONE, NONE, NONE, NONE, NONE, NONE, NONE]
    assert seen(CIRCLE, []) == [NONE] * 8


def test_objects_too_near_occlude_others() -> None:
    assert seen(CIRCLE, [(0, 0.099), (1, 2.0), (45, 0.1)])[3:5] == [NONE, 100]
    assert seen(CIRCLE, [(0, 1.2344), (45, 1.2346)])[3:5] == [1234, 1235]


def by_hand(model: SensorModel, samples: list[tuple[float, float]], reach: float) -> list[int]:
    """Return the ranges by a simple reference implementation."""
    found = []
    for ray in ScanRays(model).angles.tolist():
        aside = [(abs(math.remainder(angle - ray, math.tau)), metres) for angle, metres in samples]
        own = [metres for angle, metres in aside if angle < model.increment / 2]
        angle, nearest = min(aside)
        best = min(own) if own else nearest if angle <= reach else math.inf
        found.append(math.floor(1000 * best + 0.5) if model.range_min <= best <= model.range_max else NONE)
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "model", [sensor(360.0, 97), sensor(360.0, 8), sensor(120.0, 50, 0.3), sensor(58.0, 7)]
)
def test_random_samples_agree_with_the_reference_implementation(model: SensorModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples = np.column_stack((rng.uniform(-7, 7, 60), rng.uniform(0.01, 6.0, 60)))
    scan = ScanRays(model, reach=0.05).scan(Instant(0), samples[:, 0], samples[:, 1])
    pairs = [(angle, metres) for angle, metres in samples.tolist()]
    assert np.frombuffer(scan.ranges_mm, "<u2").tolist() == by_hand(model, pairs, 0.05)
