"""Where a robot last held itself to be: the file, and what a robot is started with by it."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from actors.geometry import Pose
from actors.installation.usage import OptionError
from actors.instant import Instant, seconds
from actors.messages import Odometry
from actors.robot.assembly import RobotSetup
from deploy.fleet import keys as fleet_keys
from deploy.fleet.fleet_file import FleetRobot
from deploy.fleet.onboard import Onboard, onboard_robot_program
from deploy.fleet.onboard_run import AT_START, OnboardOptions, OperatorLink, _link_fault, _told, prepare
from deploy.run.plan import RunPlan
from firmware_bridge.onboard import last_pose
from firmware_bridge.onboard.last_pose import SPREAD, LastPose, PoseKeeper
from tests.fleet.texts import fleet, robot
from tests.onboard.test_same_robot import PORTS, alone

__all__ = ["alone"]
NOW = Instant(1_000_000)


def told(prepared: Onboard, start: int) -> RobotSetup:
    """What the robot is told at that start."""
    setup = onboard_robot_program(prepared, start).setup
    assert setup is not None and isinstance(setup.actor, RobotSetup)
    return setup.actor


def test_it_is_kept_twice_a_second_and_is_its_successors_whose_odometry_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "r1.pose"
    keeper = PoseKeeper(path, NOW)
    assert keeper.begun is None
    for step in range(8):
        at = Instant(NOW + seconds(0.1) * step)
        keeper.keep(at, Pose(2.0, 3.0, 0.1 * step), Odometry(1.0 * step, 0.0, 0.0, 0.0, 0.0, 0.0))
    keeper.close()
    kept = LastPose((2.0, 3.0, 0.5), (5.0, 0.0, 0.0))
    assert last_pose.read(path) == kept
    assert kept.origin.compose(Pose(5.0, 0.0, 0.0)) == pytest.approx((2.0, 3.0, 0.5))
    successor = PoseKeeper(path, NOW)
    assert successor.begun == kept
    successor.doubt(1.0)
    assert last_pose.read(path) == LastPose((2.0, 3.0, 0.5), (0.0, 0.0, 0.0), SPREAD + 1.0)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{",
        b'{"pose": [1, 2, 1e300], "odometry": [0, 0, 0]}',
        b'{"pose": [1, 2, 3], "odometry": [0, 0, 0], "spread": -1}',
        b'{"pose": [1, 2, 3], "odometry": [0, 0, 0]}' + 5000 * b" ",
    ],
)
def test_a_damaged_file_is_none(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "r1.pose"
    path.write_bytes(text)
    assert (last_pose.read(path) is None) == (len(text) < 4096)
    assert last_pose.read(tmp_path / "none") is None


def test_a_robot_that_was_on_before_is_started_in_doubt(alone: RunPlan, tmp_path: Path) -> None:
    path = tmp_path / "r1.pose"
    prepared = Onboard(alone, PORTS, lambda: 0, last_pose=path)
    assert told(prepared, 0).doubt is None
    last_pose.write(path, LastPose((2.0, 3.0, 0.0), (1.0, 0.5, 0.0)))
    assert (told(prepared, 1).doubt, told(prepared, 1).start) == (0.3, (1.0, 2.5, 0.0))
    assert replace(prepared, last_pose=None).pose_file == alone.out / "r1.base" / "last.pose"


def test_it_can_be_told_where_it_is() -> None:
    stands: FleetRobot = fleet(robot(2)).robot("r2")
    assert _told(AT_START, stands) == stands.start
    assert _told("1,2.5,-0.5", stands) == (1.0, 2.5, -0.5)
    for wrong in ("here", "1,2", "1,2,3,4", "nan,0,0"):
        with pytest.raises(OptionError, match=f"^--at: {wrong}; must be start, or X,Y,HEADING in m and rad"):
            _told(wrong, stands)


@pytest.mark.parametrize(("at", "start"), [("start", (12.0, 5.0, 0.0)), ("12.5,5.5,-1", (12.5, 5.5, -1.0))])
def test_a_robot_that_is_told_where_it_is_begins_there_without_doubt(
    at: str, start: tuple[float, float, float], tmp_path: Path
) -> None:
    stands = fleet(robot(2))
    pose = tmp_path / "runs" / "r2.pose"
    pose.parent.mkdir()
    last_pose.write(pose, LastPose((2.0, 3.0, 0.0), (1.0, 0.5, 0.0)))
    prepared = prepare(stands, "r2", OnboardOptions(tmp_path / "runs" / "one", at=at), lambda sentence: None)
    assert prepared.robot.start == start
    assert not pose.exists() and told(prepared, 0).doubt is None


def test_why_no_laptop_can_watch_is_told_once_for_each_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    then = datetime.now(UTC) - timedelta(days=3)
    text = robot(1, 'listen = "tls/127.0.0.1:7447"')
    one = fleet(text, head=f'keys = "{tmp_path}/keys"\nmap = "m.yaml"\n')
    faults, said = ["", "it is over", "it is over", "", "the clock is wrong"], list[str]()
    monkeypatch.setattr(OperatorLink, "PERIOD_S", 0.0)
    link = OperatorLink(lambda: faults.pop(0), said.append)
    while faults:
        link.look()
    assert said == [f"no laptop can watch or stop it: {why}" for why in ("it is over", "the clock is wrong")]
    missing = _link_fault(one, one.robot("r1"))
    assert missing.startswith(
        f"{tmp_path}/keys/r1/authority.pem cannot be read (No such file or directory); "
    )
    fleet_keys.issue(one, tmp_path / "keys", {}, now=then, days=1)
    ended = (then + timedelta(days=1)).date()
    assert re.fullmatch(
        rf"{tmp_path}/keys/r1/certificate\.pem holds from \S+ to {ended}, but it is \S+ here; set the clock, "
        "or make new keys with `acrc fleet keys`",
        _link_fault(one, one.robot("r1")),
    )
