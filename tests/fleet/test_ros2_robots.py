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


def findings_with(robots: TurtlebotProcess, robot: str, *faults: str) -> dict[str, str]:
    """Return the texts of findings by subject, once exactly `faults` are found.

    A busy computer emulates too slowly at times, so robots are observed up to three times.
    """
    for _ in range(3):
        found = findings(robots, robot)
        if {subject for subject, (ok, _) in found.items() if not ok} == set(faults):
            return {subject: text for subject, (_, text) in found.items()}
    raise AssertionError(found)


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
        found = findings_with(robots, name)
        assert found["scan"].startswith(f"/{name}/scan: sensor_msgs/msg/LaserScan, ")
        assert found["scan"].endswith(f" (RIHS01_64c19139, QoS {qos})")
        assert found["command"].startswith(f"/{name}/cmd_vel: geometry_msgs/msg/TwistStamped, ")
        assert found["charge"].startswith("80% at ")


def test_faults_of_a_robot_are_found(robots: TurtlebotProcess) -> None:
    for order in (
        "scan r1 stopped",
        "dock r1 on",
        "clock r1 -30",
        "battery r1 0.05",
        "rival r1 joystick 0.1",
    ):
        robots.order(order)
    found = findings_with(robots, "r1", "scan", "robot clock", "charge", "dock state", "other commands")
    assert found["scan"].startswith("/r1/scan: no message within 2 s; restart the lidar's driver")
    assert found["other commands"].endswith(" publishes /r1/cmd_vel; stop that node")
    robots.order("repair r1")


def test_wrong_settings_are_named(robots: TurtlebotProcess) -> None:
    for changes, remedy in (({"namespace": ""}, 'namespace = "/r2"'), ({"domain": 9}, "domain = 0")):
        said: list[str] = []
        while not said or not said[-1].endswith(f"; set base.{remedy}"):
            assert len(said) < 3, said  # a busy computer loses links at times, and their topics with them
            said.append(findings(robots, "r2", **changes)["graph"][1])
