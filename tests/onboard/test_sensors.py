"""Sensor faults are reported and stop the robot in time; sensors without faults are never reported."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from actors.geometry import Pose
from actors.instant import Instant, milliseconds
from firmware_bridge.kobuki.kobuki_motion import METRES_PER_TICK, TRACK, BaseFeedback
from firmware_bridge.kobuki.kobuki_packets import BasicSensorData, InertialSensorData
from firmware_bridge.onboard.contradictions import REST, ContradictionMonitor, ScanChecks, large_objects
from firmware_bridge.onboard.motion_checks import Movement
from firmware_bridge.range_sensors.sensor import SensorSweep
from firmware_bridge.safety import HoldCause
from tests.helpers import in_order
from tests.kobuki.rig import Room
from tests.onboard.sensor_cases import (
    FAULTS,
    FLOORS,
    SITUATIONS,
    SensorFault,
    plain_floor,
    reports,
    starts_on,
)
from tests.onboard.sensor_rig import SensorRig, Straight

SPEEDS = (0.5, 0.5, 0.3, 0.4)
"""m/s, by seed."""
PATIENCE_S = 4.0
EXPECTED = {
    "lidar: repeats one turn": HoldCause.REPEATED_DATA,
    "lidar: half of each turn repeated": HoldCause.REPEATED_DATA,
    "lidar: every other beam repeated": HoldCause.SCAN_PART,
    "lidar: one turn, with fresh noise": HoldCause.SCAN_STILL,
    "lidar: turned by 90°": HoldCause.SCAN_ROTATED,
    "lidar: mirrored": HoldCause.SCAN_MIRRORED,
    "both encoders: stand still": HoldCause.BLOCKED,
    "both encoders: count double": HoldCause.WHEELS,
    "left encoder: stands still": HoldCause.LEFT_WHEEL,
    "gyro: turns at 0.5 rad/s for ever": HoldCause.GYRO,
    "base's clock: stands still": HoldCause.BASE_CLOCK,
    "line to the base: 30% noise, both": HoldCause.NOISE,
    "lidar: dark": HoldCause.NO_RANGE_DATA,
    "base: silent": HoldCause.NO_FEEDBACK,
    "base: motor over-current": HoldCause.OVERCURRENT,
    "base: battery nearly empty": HoldCause.BATTERY,
    "guardian: gone": HoldCause.NO_GUARDIAN,
}


class Reaction(NamedTuple):
    """Time until the stop command, s (None: none), distance until then, m, and its causes."""

    time_s: float | None
    way_m: float
    causes: frozenset[str]

    def is_in_time(self, fault: SensorFault) -> bool:
        if fault.limit is None:
            return True
        time_s, way_m = fault.limit
        return self.time_s is not None and self.time_s <= time_s + 1e-6 and self.way_m <= way_m


def reaction(task: tuple[str, int]) -> Reaction:
    """Inject a fault, by name and seed, into a driving robot and measure the reaction."""
    fault, seed = FAULTS[task[0]], task[1]
    floor, speed = FLOORS[seed % len(FLOORS)], SPEEDS[seed % len(SPEEDS)]
    rig = SensorRig(floor, starts_on(floor, seed, 1), seed, speed)
    vehicle = rig.vehicles["r1"]
    pilot = vehicle.pilot
    assert pilot is not None
    pilot.straight = not fault.in_arc
    if fault.from_start:
        vehicle.pilot = None
        rig.run(2.0)
        fault.act(rig)
        rig.run(2.0)  # delayed scans arrive
        vehicle.pilot = pilot
        rig.run(PATIENCE_S, lambda: rig.speed() > 0.02)
    else:
        rig.run(120.0, lambda: rig.cruises(0.9 * speed, fault.in_arc))
        fault.act(rig)
    began, way, before = rig.now, rig.laboratory.travelled("r1"), len(vehicle.held)
    rig.run(PATIENCE_S, rig.commanded_to_stand)
    causes = vehicle.held[-1].causes if len(vehicle.held) > before else frozenset()
    return Reaction(
        (rig.now - began) / 1e6 if rig.commanded_to_stand() else None,
        rig.laboratory.travelled("r1") - way,
        frozenset(cause.name for cause in causes),
    )


def false_reports(name: str, seed: int, folder: Path, time_s: float) -> tuple[list[object], float]:
    """Return the reports in a situation without a fault, and the distance of all robots, m."""
    situation = SITUATIONS[name]
    rig = situation.build(seed, folder)
    rig.run(time_s / 2)
    if situation.event is not None:
        situation.event(rig)
    rig.run(time_s / 2)
    return list(reports(rig)), sum(map(rig.laboratory.travelled, rig.vehicles))


@pytest.mark.claim("sensors")
@pytest.mark.parametrize("name", EXPECTED)
def test_a_fault_is_reported_and_stops_the_robot_in_time(name: str) -> None:
    found = reaction((name, 0))
    assert found.is_in_time(FAULTS[name]), found
    assert EXPECTED[name].name in found.causes


@pytest.mark.claim("sensors")
@pytest.mark.parametrize(
    ("name", "time_s"),
    [
        ("1 wander in the maze at 0.5 m/s", 10.0),
        ("a convoy of 5 in a corridor without features", 4.0),
        ("a long corridor without features", 6.0),
        ("pushed by two others", 6.0),
        ("carried elsewhere while it drives", 12.0),
    ],
)
def test_sensors_without_a_fault_are_not_reported(name: str, time_s: float, tmp_path: Path) -> None:
    found, way_m = false_reports(name, 0, tmp_path, time_s)
    assert found == []
    assert way_m > 0


@pytest.mark.claim("sensors")
@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_many_faults_and_hours_without_a_fault(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Test all faults; full size: 20 trials each and two hours of driving, as in docs/deployment.md."""
    tasks = [(name, seed) for name in FAULTS for seed in range(20 if full else 1)]
    late = Counter[str]()
    for (name, seed), found in zip(tasks, in_order(reaction, tasks), strict=True):
        record_property(f"{name}, seed {seed}", (found.time_s, round(found.way_m, 3), sorted(found.causes)))
        late[name] += not found.is_in_time(FAULTS[name])
    assert +late == {}
    hours, seed, false = 0.0, 0, []
    while hours < (2.0 if full else 0.02):
        for name, situation in SITUATIONS.items():
            false += false_reports(name, seed, tmp_path, situation.time_s)[0]
            hours += situation.time_s * situation.robots / 3600
            if hours >= (2.0 if full else 0.02):
                break
        seed += 1
    record_property("hours of robots without a fault", round(hours, 2))
    assert false == []


def test_a_robot_retries_twice_and_then_stands(tmp_path: Path) -> None:
    rig = driving(tmp_path)
    rig.laboratory.robots["r1"].base.faults.left_scale = 0.0
    rig.run(16.0)
    way = rig.laboratory.travelled("r1")
    rig.run(4.0)
    assert rig.laboratory.travelled("r1") == pytest.approx(way, abs=1e-3)
    vehicle = rig.vehicles["r1"]
    assert len([one for one in vehicle.held if HoldCause.LEFT_WHEEL in one.causes]) == 3
    assert vehicle.bot.stop_reasons() == ("left wheel contradicts gyro and command",)
    assert any("LEFT_WHEEL" in line for line in vehicle.log)


def test_a_frozen_gyro_is_replaced_by_wheels_confirmed_by_scans(tmp_path: Path) -> None:
    rig = driving(tmp_path, omega=0.5)
    rig.laboratory.robots["r1"].base.faults.gyro = "frozen"
    rig.run(4.0)
    vehicle = rig.vehicles["r1"]
    assert vehicle.kobuki.odometry.uses_wheel_heading
    assert vehicle.bot.stop_reasons() == ()
    assert any("gyro frozen: heading computed from the wheels" in line for line in vehicle.log)


def driving(folder: Path, omega: float = 0.0) -> SensorRig:
    """Return a robot driving at 0.4 m/s in a room of 12 m."""
    rig = SensorRig(plain_floor(folder, 12.0, 8.0), [(2.0, 3.0, 0.1)], 1)
    rig.vehicles["r1"].pilot = Straight(0.4, omega)
    rig.run(3.0)
    assert rig.speed() > 0.35
    return rig


class Wheels:
    """Feedbacks of a base without errors."""

    def __init__(self) -> None:
        self.now, self.left, self.right, self.angle = Instant(0), 0.0, 0.0, 0.0
        self.judge = ContradictionMonitor(None, TRACK)

    def drive(
        self, time_s: float, left: float, right: float, turn: float, told: tuple[float, float], **basic: int
    ) -> frozenset[HoldCause]:
        """Simulate wheel speeds, m/s, the gyro's `turn`, rad/s, and commanded v and omega; return causes."""
        for _ in range(round(time_s / 0.02)):
            self.now = Instant(self.now + milliseconds(20))
            self.left, self.right = self.left + 0.02 * left, self.right + 0.02 * right
            self.angle += 0.02 * turn
            left_ticks = int(self.left / METRES_PER_TICK) & 0xFFFF
            right_ticks = int(self.right / METRES_PER_TICK) & 0xFFFF
            pressed, dropped = basic.get("bumper", 0), basic.get("wheel_drop", 0)
            stamp = self.now // 1000 & 0xFFFF
            said = BasicSensorData(stamp, pressed, dropped, 0, left_ticks, right_ticks, 0, 0, 0, 0, 160, 0)
            self.judge.set_command(*told)
            gyro = InertialSensorData(round(np.degrees(self.angle) * 100), 0)
            self.judge.feedback(BaseFeedback(self.now, said, gyro))
        return self.judge.causes(self.now)


@pytest.mark.parametrize(
    ("left", "right", "turn", "told", "basic", "causes"),
    [
        (0.4, 0.4, 0.0, (0.4, 0.0), {}, set()),
        (0.4, -0.4, 0.0, (0.0, 0.0), {}, set()),  # a standing robot may be pushed
        (0.0, 0.0, 1.0, (0.0, 0.0), {}, set()),  # and turned by hand
        (0.1, -0.1, 0.0, (-0.1, 0.0), {"bumper": 2}, set()),  # wheels may slip at a wall
        (0.5, 0.2, 0.0, (0.5, 0.0), {"wheel_drop": 3}, set()),
        (0.0, 0.3, -1.0, (0.3, 0.0), {}, {HoldCause.TURN_MISMATCH}),  # the command agrees with neither
    ],
)
def test_checks_apply_to_a_moving_robot_on_the_floor_only(
    left: float, right: float, turn: float, told: tuple[float, float], basic: dict[str, int], causes: object
) -> None:
    assert Wheels().drive(1.0 if causes else 5.0, left, right, turn, told, **basic) == causes


def test_a_bumper_pressed_after_backing_off_30_cm_is_stuck() -> None:
    wheels = Wheels()
    assert wheels.drive(1.4, -0.2, -0.2, 0.0, (-0.2, 0.0), bumper=2) == frozenset()
    assert wheels.drive(0.3, -0.2, -0.2, 0.0, (-0.2, 0.0), bumper=2) == {HoldCause.BUMPER_STUCK}


def test_a_blocked_base_is_retried_at_growing_intervals() -> None:
    wheels, held = Wheels(), 0
    causes: frozenset[HoldCause] = frozenset()
    for _ in range(1500):
        causes = wheels.drive(0.1, 0.0, 0.0, 0.0, (0.0 if causes else 0.3, 0.0))
        held += HoldCause.BLOCKED in causes
    assert 1470 < held < 1495, "six attempts of 0.3 s in 150 s"


def test_a_contradiction_ends_after_a_rest() -> None:
    wheels = Wheels()
    assert wheels.drive(0.5, 0.0, 0.4, 0.0, (0.4, 0.0)) == {HoldCause.LEFT_WHEEL}
    assert wheels.drive(REST / 1e6 + 0.1, 0.0, 0.0, 0.0, (0.0, 0.0)) == frozenset()


ROOM = Room(6.0, 5.0)
ANGLES = np.radians(np.arange(360.0))


def seen(pose: Pose, at_us: int, random: np.random.Generator) -> SensorSweep:
    """Return a sweep of a standing sensor."""
    ranges = ROOM.ranges(pose, ANGLES) * (1 + 0.0025 * random.standard_normal(360))
    return SensorSweep(np.full(360, at_us), ANGLES, ranges)


def judged(truth: Pose, forward: float) -> set[HoldCause | None]:
    """Return the results of four sweeps from `truth` while the wheels report `forward` m between sweeps."""
    checks, random = ScanChecks(Pose(0.0, 0.0, 0.0), TRACK), np.random.default_rng(1)
    moves: list[Movement] = []
    said: set[HoldCause | None] = set()
    for at in range(4):
        for step in range(5):
            instant = Instant(180_000 * at + 36_000 * (step + 1))
            way, speed = forward / 5, forward / 0.18
            moves.append(Movement(instant, milliseconds(36), way, way, 0.0, speed, 0.0))
        said.add(checks.take(seen(truth, 180_000 * (at + 1), random), moves))
    return said


def test_a_frozen_scan_with_noise_contradicts_turning_wheels() -> None:
    assert HoldCause.SCAN_STILL in judged(Pose(3.0, 2.5, 0.1), 0.1)


def test_wheels_that_slip_at_a_wall_are_no_contradiction() -> None:
    assert judged(Pose(5.75, 2.5, 0.0), 0.1) == {None}
    assert judged(Pose(0.25, 2.5, 0.0), -0.1) == {None}


def test_only_large_objects_are_compared() -> None:
    sweep = seen(Pose(3.0, 2.5, 0.0), 0, np.random.default_rng(1))
    assert large_objects(sweep).ranges.size == 360
    ranges = np.array(sweep.ranges)
    ranges[80:110] = 1.0  # half a metre wide
    left = large_objects(sweep._replace(ranges=ranges))
    assert left.ranges.size == 330 and not (left.ranges == 1.0).any()
    empty = SensorSweep(np.empty(0, np.int64), np.empty(0), np.empty(0))
    assert large_objects(empty).ranges.size == 0
