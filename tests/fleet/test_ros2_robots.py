"""`acrc fleet doctor` at emulated TurtleBots, whose topics go through an independent implementation."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.robot_model import load_model
from deploy.fleet import ros2_check
from firmware_bridge.ros2.settings import Ros2Base
from tests.ros2.emulation import TurtlebotProcess, robots_world

MODELS = {"r1": "turtlebot4", "r2": "turtlebot3_burger"}


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TurtlebotProcess]:
    folder: Path = tmp_path_factory.mktemp("robots")
    with TurtlebotProcess(folder, robots_world([*MODELS.values()]), r1={"bridge": "ros2dds"}) as running:
        while running.where("r1").time_s < 1.0:  # kernels are compiled at the first scan
            time.sleep(0.1)
        yield running


def findings(robots: TurtlebotProcess, robot: str, **changes: object) -> dict[str, tuple[bool, str]]:
    """Return the findings about a robot, by subject."""
    bridge = "ros2dds" if robot == "r1" else "rmw_zenoh"
    keys = {"kind": "ros2", "router": robots.router, "namespace": f"/{robot}", "bridge": bridge}
    base = Ros2Base(**keys | changes)  # type: ignore[arg-type]
    found = ros2_check.findings(base, load_model(MODELS[robot]), ros2_check.observe(base))
    return {one.subject: (one.ok, one.text) for one in found}


@pytest.fixture(autouse=True)
def short_observation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2_check, "_LISTENING_S", 2.0)


def test_both_robots_are_found_and_described(robots: TurtlebotProcess) -> None:
    for name, qos in (("r1", ":1:0:0,10"), ("r2", "2::,5")):
        for _ in range(3):  # a busy computer emulates too slowly at times
            found = findings(robots, name)
            if all(ok for ok, _ in found.values()):
                break
        assert all(ok for ok, _ in found.values()), found
        assert found["scan"][1].startswith(f"/{name}/scan: sensor_msgs/msg/LaserScan, ")
        assert found["scan"][1].endswith(f" (RIHS01_64c19139, QoS {qos})")
        assert found["command"][1].startswith(f"/{name}/cmd_vel: geometry_msgs/msg/TwistStamped, ")
        assert found["charge"][1].startswith("80% at ")


def test_faults_of_a_robot_are_found(robots: TurtlebotProcess) -> None:
    for order in (
        "scan r1 stopped",
        "dock r1 on",
        "clock r1 -30",
        "battery r1 0.05",
        "rival r1 joystick 0.1",
    ):
        robots.order(order)
    failed = {subject: text for subject, (ok, text) in findings(robots, "r1").items() if not ok}
    assert set(failed) == {"scan", "robot clock", "charge", "dock state", "other commands"}
    assert failed["scan"].startswith("/r1/scan: no message within 2 s; restart the lidar's driver")
    assert failed["other commands"].endswith(" publishes /r1/cmd_vel; stop that node")
    robots.order("repair r1")


def test_wrong_settings_are_named(robots: TurtlebotProcess) -> None:
    wrong = {"bridge": "rmw_zenoh", "namespace": ""}
    assert findings(robots, "r2", **wrong)["graph"][1].endswith('set base.namespace = "/r2"')
    assert findings(robots, "r2", domain=9)["graph"][1] == "no topic in domain 9; set base.domain = 0"
