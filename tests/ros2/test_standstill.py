"""Robots with a ROS 2 base stop after failures of their processes and topics; wall time, real processes."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.onboard.standstill_rig import held, killed, stopped
from tests.onboard.test_standstill import BASE, NEAR_M, PROCESSES, SOON_S, commanded_to_stand
from tests.ros2.standstill import ROS2_GUARDIAN, Ros2Rig

pytestmark = pytest.mark.claim("standstill")
WORDS = {**PROCESSES, "guardian": ROS2_GUARDIAN}
DRIVES_ON = {"supervisor stopped", "supervisor held", "bridge killed", "bridge stopped", "bridge held"}
TOPICS = {
    "scans stop": "scan r1 stopped",
    "scans repeat one": "scan r1 repeated",
    "odometry stops": "odom r1 stopped",
    "clock set forward": "clock r1 5",
    "another node publishes": "rival r1 teleop 0.1",
    "base ignores commands": "ignore r1 on",
}
CREATE3 = {"bumper": "hazard r1 bump on", "wheel drop": "hazard r1 wheel_drop on", "docked": "dock r1 on"}
FEW = ("base killed", "base stopped", "scans stop")


def events(model: str) -> dict[str, Callable[[Ros2Rig], object]]:
    """Return the failures by name."""
    made: dict[str, Callable[[Ros2Rig], object]] = {
        f"{name} {way}": lambda rig, word=word, act=act: act(rig.processes(word))  # type: ignore[misc]
        for name, word in WORDS.items()
        for way, act in {"killed": killed, "stopped": stopped, "held": held}.items()
    }
    made["base and guardian stopped"] = lambda rig: stopped(
        [*rig.processes(BASE), *rig.processes(ROS2_GUARDIAN)]
    )
    lines = TOPICS | (CREATE3 if model == "turtlebot4" else {})
    return made | {name: lambda rig, line=line: rig.expect_ok(line) for name, line in lines.items()}


@pytest.mark.nightly
@pytest.mark.timeout(0)
@pytest.mark.parametrize("model", ["turtlebot4", "turtlebot3_burger"])
def test_a_ros_2_robot_stops_after_any_failure(
    full: bool, model: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Full size: each failure three times; limits as in docs/turtlebot4.md."""
    missed = []
    for name, event in events(model).items():
        for trial in range(3 if full else int(name in FEW)):
            folder = tmp_path / f"{len(list(tmp_path.iterdir()))}"
            folder.mkdir()
            with Ros2Rig(folder, model) as rig:
                before, *after = commanded_to_stand(rig, event)  # type: ignore[arg-type]
            told, stood = (one and (one.time - before.time, one.way - before.way) for one in after)
            record_property(f"{model}, {name}, trial {trial}: told, stood (s, m)", (told, stood))
            seconds, metres = (0.6 if "ignores" in name else 0.4, 0.15) if full else (SOON_S, NEAR_M)
            time_s, way = told or (math.inf, math.inf)
            if (time_s > seconds or way > metres) and name not in DRIVES_ON:
                missed.append((name, told))
    assert missed == []
