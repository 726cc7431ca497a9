"""A robot on board: the program of the simulation, its last pose, and which processes are started again."""

import re
import socket
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from actors.geometry import Pose
from actors.installation.usage import OptionError
from actors.instant import Instant, seconds
from actors.messages import Odometry, ProcessOrder
from actors.processes.launch import Child, Program
from actors.robot.assembly import RobotSetup
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import SETUP, setup_bytes
from deploy.fleet import keys as fleet_keys
from deploy.fleet import onboard
from deploy.fleet import onboard as layout
from deploy.fleet.fleet_file import FleetRobot
from deploy.fleet.onboard import Onboard, Ports, onboard_robot_program
from deploy.fleet.onboard_run import (
    AT_START,
    OnboardOptions,
    OnboardSupervisor,
    OperatorLink,
    _link_fault,
    _told,
    prepare,
)
from deploy.run import plan, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.scenario_file import load_scenario
from firmware_bridge.onboard import base, last_pose
from firmware_bridge.onboard.last_pose import SPREAD, LastPose, PoseKeeper
from tests.fleet.texts import fleet, robot
from tests.swarm.command import leftovers

ROOT = Path(__file__).parents[2]
PORTS = Ports("/dev/kobuki", "/dev/beeclick", "/dev/rplidar", 0xBABA, 26, 0.0)


@pytest.fixture
def alone(tmp_path: Path) -> RunPlan:
    """The head-on scenario, for r1 only."""
    whole = swarm.plan(load_scenario(ROOT / "scenarios" / "head_on.toml"), RunOptions(tmp_path / "out"))
    return replace(whole, world=msgspec.structs.replace(whole.world, robots=whole.world.robots[:1]))


def test_set_up_and_module_are_those_of_the_simulation(alone: RunPlan) -> None:
    robot = alone.world.robots[0]
    on_board = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0), start=0)
    simulated = plan.robot_program(alone, robot, ProcessOrder("r1", 0), first_step=0)
    assert simulated.setup is not None and on_board.setup is not None
    spares = msgspec.structs.replace(simulated.setup.process, spares_record=True)
    outlives = msgspec.structs.replace(simulated.setup, process=spares)
    assert on_board == replace(simulated, setup=outlives), "it outlives a full disk"


def test_a_debugger_changes_who_runs_it_and_nothing_else(alone: RunPlan) -> None:
    plain = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0), start=0)
    debugged = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0, debug_port=5678), start=0)
    assert debugged.module == "debugpy"
    assert debugged.argv == ("--listen", "5678", "-m", plain.module, *plain.argv)


def test_what_the_robot_reads_is_the_same_and_base_and_bridge_lie_beside_it(
    alone: RunPlan, tmp_path: Path
) -> None:
    simulated = replace(alone, options=replace(alone.options, out=tmp_path / "simulated"))
    plan.lay_out(simulated)
    onboard.lay_out(Onboard(alone, PORTS, lambda: 0))
    assert sorted(path.name for path in alone.out.iterdir()) == ["r1", "r1.base", "r1.radio"]
    for path in filter(Path.is_file, (simulated.out / "r1").iterdir()):
        assert (alone.out / "r1" / path.name).read_bytes() == path.read_bytes()
    with pytest.raises(OptionError) as refused:
        onboard.lay_out(Onboard(alone, PORTS, lambda: 0))
    assert str(refused.value) == f"--out: {alone.out} has a folder of r1; must be a folder without"


def test_each_start_of_the_program_is_in_an_epoch_of_its_own_and_named_by_its_number(alone: RunPlan) -> None:
    epochs = iter((7, 8, 12))
    prepared = Onboard(alone, PORTS, lambda: next(epochs))
    programs = [onboard.onboard_robot_program(prepared, start) for start in range(3)]
    assert [one.setup.actor.epoch for one in programs if one.setup is not None] == [7, 8, 12]
    names = [one.record.name for one in programs if one.record is not None]
    assert names == ["r1.mcap", "r1.1.mcap", "r1.2.mcap"]


def test_a_port_that_is_taken_is_said_in_the_log_and_nothing_stays(
    alone: RunPlan, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        listen = f"tls/127.0.0.1:{taken.getsockname()[1]}"
        keys = alone.out.parent / "keys"
        keys.mkdir()
        for name in ("authority.pem", "certificate.pem", "key.pem"):
            (keys / name).touch()
        prepared = Onboard(alone, replace(PORTS, listen=listen, keys=str(keys)), lambda: 0)
        onboard.lay_out(prepared)
        onboard.issue(prepared)
        program = onboard.base_program(prepared, 0)
        assert program.setup is not None
        process = msgspec.structs.replace(program.setup.process, with_parent=False)
        file = program.log.parent / SETUP
        file.write_bytes(setup_bytes(msgspec.structs.replace(program.setup, process=process)))
        assert base.main(program.argv) == 2
    assert capsys.readouterr().err == (
        f"{listen}: no laptop can be awaited there: address already in use; end the program that has the "
        "port, or name another address as `listen` in the fleet file\n"
    )
    assert leftovers(alone.out) == []


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


class Robot:
    """Stands for what is laid out; nothing of it is on the disk."""

    id = "r1"


class Played:
    """A launcher whose processes end when the test says so; `wait` lets the next ones end."""

    def __init__(self) -> None:
        self.started: list[str] = []
        self.children: dict[str, Child] = {}
        self.ends: list[dict[str, int]] = []
        self.said: list[str] = []

    def withdraw(self, router: Path) -> None:
        """Nothing is laid out."""

    def start(self, program: Program) -> Child:
        self.started.append(program.actor)
        self.children[program.actor] = Child(program, pid=2**22 + len(self.started))
        return self.children[program.actor]

    def wait(self, _timeout_s: float) -> None:
        for name, code in (self.ends.pop(0) if self.ends else {}).items():
            self.children[name].exit_code = code


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[OnboardSupervisor, Played]:
    """A robot whose base, bridge and program run."""

    issued = SimpleNamespace(sockets={layout.BRIDGE: tmp_path})

    def program(name: str) -> object:
        return lambda _onboard, _start: Program(
            name, name, (), tmp_path / f"{name}.log", tmp_path / f"{name}.mcap"
        )

    monkeypatch.setattr(OnboardSupervisor, "GRACE_S", 0.05)  # nothing is really waited for
    monkeypatch.setattr(layout, "issue", lambda _onboard: issued)
    monkeypatch.setattr(layout, "base_program", program(layout.BASE))
    monkeypatch.setattr(layout, "bridge_program", program(layout.BRIDGE))
    monkeypatch.setattr(layout, "onboard_robot_program", program("r1"))
    onboard: Onboard = type("One", (), {"robot": Robot, "router": Path("router.json")})()
    launcher = Played()
    watch = OnboardSupervisor(onboard, launcher, launcher.said.append)  # type: ignore[arg-type]
    watch.start()
    assert launcher.started == [layout.BASE, layout.BRIDGE, "r1"]
    return watch, launcher


def test_a_robot_that_has_finished_is_not_started_again_while_its_base_still_ends(
    played: tuple[OnboardSupervisor, Played],
) -> None:
    watch, launcher = played
    launcher.ends = [{"r1": 0}, {}, {layout.BRIDGE: 0}, {layout.BASE: 0}]
    assert not watch.look(0.0), "told to stop"
    assert launcher.started == [layout.BASE, layout.BRIDGE, "r1"]
    assert watch.restarts == 0


TAKEN = "base failed in step 0: /dev/kobuki: another program has the port open"


def test_why_a_process_has_ended_is_said_each_time_and_in_the_end(
    played: tuple[OnboardSupervisor, Played], tmp_path: Path
) -> None:
    watch, launcher = played
    (tmp_path / "r1.log").write_text(f"what it prints\n{TAKEN}\n")
    launcher.ends = [{"r1": 1}] * 6
    with pytest.raises(AcrcError) as caught:
        while True:
            watch.look(0.0)
    assert launcher.said == [f"r1 has ended with exit code 1: {TAKEN}"] * 6
    assert str(caught.value) == (
        "r1: its processes were started 5 times within 60 s, and r1 has ended once more with exit code 1: "
        f"{TAKEN}"
    )


def test_a_recording_that_is_not_whole_is_told_once_for_each_thing_that_its_process_says(
    played: tuple[OnboardSupervisor, Played], tmp_path: Path
) -> None:
    watch, launcher = played
    full = f"{tmp_path}/r1.mcap: cannot be written: no space left on device"
    log = tmp_path / "r1.log"
    later = "and this was said after it, before anybody looked\n"
    for text in ("a line of the strategy\n", f"{full}; records are lost from here on\n{later}", "", ""):
        log.write_text((log.read_text() if log.exists() else "") + text)
        assert watch.look(0.0)
    log.write_text(log.read_text() + f"{full}; 1234 records are missing\n")
    launcher.ends = [{"r1": 0, layout.BRIDGE: 0, layout.BASE: 0}]
    assert not watch.look(0.0)
    assert launcher.said == [
        f"r1: {full}; records are lost from here on",
        f"r1: {full}; 1234 records are missing",
    ]
