"""Faults of sensors are reported and stop the robot in time; sensors without a fault are never reported."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from firmware_bridge.kobuki.safety import HoldCause
from tests.onboard.sensor_cases import FAULTS, FLOORS, SITUATIONS, SensorFault, reports, starts_on
from tests.onboard.sensor_rig import SensorRig
from tests.parallel import in_order

pytestmark = pytest.mark.claim("sensors")
SPEEDS = (0.5, 0.5, 0.3, 0.4)
"""m/s, by seed."""
PATIENCE_S = 4.0
EXPECTED = {
    "lidar: repeats one turn": HoldCause.REPEATS,
    "lidar: repeats 5 turns": HoldCause.REPEATS,
    "lidar: half of each turn repeated": HoldCause.REPEATS,
    "lidar: every other beam repeated": HoldCause.SCAN_PART,
    "lidar: one turn, with fresh noise": HoldCause.SCAN_STILL,
    "lidar: turned by 90°": HoldCause.SCAN_TURNED,
    "lidar: mirrored": HoldCause.SCAN_MIRRORED,
    "both encoders: stand still": HoldCause.BLOCKED,
    "both encoders: count double": HoldCause.WHEELS,
    "left encoder: stands still": HoldCause.LEFT_WHEEL,
    "gyro: turns at 0.5 rad/s for ever": HoldCause.GYRO,
    "base's clock: stands still": HoldCause.BASE_CLOCK,
    "line to the base: 30% noise, both": HoldCause.NOISE,
}


class Reaction(NamedTuple):
    """Time, s, until the command to stand (None: none came), the way until then, m, and its causes."""

    time_s: float | None
    way_m: float
    causes: frozenset[str]

    def is_in_time(self, fault: SensorFault) -> bool:
        if fault.limit is None:
            return True
        time_s, way_m = fault.limit
        return self.time_s is not None and self.time_s <= time_s + 1e-6 and self.way_m <= way_m


def reaction(task: tuple[str, int]) -> Reaction:
    """Let one robot drive, cause the fault of this name, and measure the reaction; with a seed."""
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
    rig.run(PATIENCE_S, rig.told_to_stand)
    causes = vehicle.held[-1].causes if len(vehicle.held) > before else frozenset()
    return Reaction(
        (rig.now - began) / 1e6 if rig.told_to_stand() else None,
        rig.laboratory.travelled("r1") - way,
        frozenset(cause.name for cause in causes),
    )


def false_reports(name: str, seed: int, folder: Path, time_s: float) -> tuple[list[object], float]:
    """Reports of a situation without a fault, and the way of all robots, m."""
    situation = SITUATIONS[name]
    rig = situation.build(seed, folder)
    rig.run(time_s / 2)
    if situation.event is not None:
        situation.event(rig)
    rig.run(time_s / 2)
    return list(reports(rig)), sum(map(rig.laboratory.travelled, rig.vehicles))


@pytest.mark.parametrize("name", EXPECTED)
def test_a_fault_is_reported_and_stops_the_robot_in_time(name: str) -> None:
    found = reaction((name, 0))
    assert found.is_in_time(FAULTS[name]), found
    assert EXPECTED[name].name in found.causes


@pytest.mark.parametrize(
    ("name", "time_s"),
    [
        ("1 wander in the maze at 0.5 m/s", 15.0),
        ("a convoy of 5 in a corridor without features", 6.0),
        ("a long corridor without features", 10.0),
        ("pushed by two others", 10.0),
        ("carried elsewhere while it drives", 12.0),
        ("standing", 8.0),
    ],
)
def test_sensors_without_a_fault_are_not_reported(name: str, time_s: float, tmp_path: Path) -> None:
    found, way_m = false_reports(name, 0, tmp_path, time_s)
    assert found == []
    assert way_m > 0 or name == "standing"


@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_many_faults_and_hours_without_a_fault(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """20 trials of each fault and two hours of robots, as docs/deployment.md reports."""
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
