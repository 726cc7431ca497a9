"""Robot on board: the program of the simulation, epochs, last pose, and supervisor."""

import socket
import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Pose
from actors.installation.usage import OptionError
from actors.instant import Instant, seconds
from actors.messages import Odometry, ProcessOrder
from actors.processes.launcher import ChildProcess, Program
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.node_host import node_of
from actors.robot.program import actor_process_of
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials
from actors.runtime.process import RunNote
from actors.runtime.process_setup import SETUP
from actors.runtime.recording import Recorder
from deeco.aes_ccm import AesCcmAuthenticator
from deeco.fragments import Reassembly
from deeco.packet import verified_packet
from deploy.fleet import keys as fleet_keys
from deploy.fleet import onboard_processes
from deploy.fleet.onboard_processes import EpochCounter, OnboardRobot, Ports, onboard_robot_program
from deploy.fleet.onboard_run import (
    OnboardSupervisor,
    OperatorAccessCheck,
    _link_fault,
    _parse_pose,
    prepare,
)
from deploy.run import plan, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.scenario_file import load_scenario
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.onboard import base, last_pose
from firmware_bridge.onboard.last_pose import SPREAD, LastPose, PoseWriter
from tests.fleet.fleet_texts import fleet, robot
from tests.swarm.command import leftovers

TODAY = 1_800_000_000.0
"""2027-01-15."""
BY_CLOCK = 222_163_200
"""Seconds from 2020-01-01 to TODAY."""


class Computer:
    """One robot's computer."""

    def __init__(self, folder: Path, now: float = TODAY) -> None:
        self.state, self.runs, self.now = folder / "state", folder / "runs", now
        self.said: list[str] = []

    @property
    def file(self) -> Path:
        return self.state / "r1.epochs"

    def counter(self, runs: Path | None = None, robot: str = "r1") -> EpochCounter:
        return EpochCounter(robot, runs or self.runs, self.said.append, self.state, lambda: self.now)

    def claim(self) -> int:
        """Claim an epoch with a new counter."""
        return self.counter().claim()

    def record(self, epoch: int, run: str = "one", robot: str = "r1") -> None:
        """Write an incomplete recording of that epoch."""
        path = self.runs / run / robot / f"{robot}.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        setup = msgspec.Raw(msgspec.json.encode({"id": robot, "epoch": epoch, "seed": 1}))
        with Recorder(path, 100_000) as recorder:
            recorder.note("run", RunNote(robot, 1, 100_000, "", setup))


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


def test_epochs_are_counted_independently_of_the_folder_of_runs(computer: Computer, tmp_path: Path) -> None:
    assert [computer.counter(tmp_path / f"runs{number}").claim() for number in range(20)] == list(range(20))
    assert computer.counter(robot="r2").claim() == 0
    assert computer.said == []
    assert len(computer.file.read_bytes()) < 100


@given(st.integers(0, 12), st.integers(16, 12 * 8 - 1))
@settings(max_examples=40)
def test_a_truncated_or_damaged_file_never_repeats_an_epoch(left: int, bit: int) -> None:
    """Test a file of `left` bytes with one bit flipped."""
    with TemporaryDirectory() as folder:
        robot = Computer(Path(folder))
        for _ in range(12):
            last = robot.claim()
        content = bytearray(robot.file.read_bytes())
        assert len(content) == 12
        content[bit // 8] ^= 1 << bit % 8
        robot.file.write_bytes(content[:left])
        first, second = robot.claim(), robot.claim()
        assert last < first < second


def test_after_a_damaged_file_the_epoch_is_derived_from_the_clock(computer: Computer) -> None:
    for _ in range(3):
        computer.claim()
    computer.file.write_bytes(b"")
    assert [computer.claim(), computer.claim()] == [BY_CLOCK, BY_CLOCK + 1]
    (said,) = computer.said
    assert said.endswith(f"damaged; r1 continues with epoch {BY_CLOCK}, derived from the clock")
    computer.file.write_bytes(b"\0" * 10_000)
    computer.now += 60
    assert computer.claim() == BY_CLOCK + 60
    computer.file.write_bytes(b"")
    computer.record(BY_CLOCK + 1000)
    assert computer.claim() == BY_CLOCK + 1001, "the later one of recordings and clock"
    computer.file.write_bytes(b"")
    computer.now = 100.0
    with pytest.raises(AcrcError, match="and the clock shows 1970-01-01, so it was never set"):
        computer.claim()


def test_after_a_lost_file_the_epoch_follows_the_latest_recording(computer: Computer) -> None:
    computer.record(4)
    computer.record(41, "two")
    computer.record(99, "two", "r2")
    (computer.runs / "two" / "r1" / "r1.1.mcap").write_bytes(b"no recording")
    assert [computer.claim(), computer.claim()] == [42, 43]


def test_concurrent_claims_differ(computer: Computer) -> None:
    claimed: list[int] = []
    threads = [threading.Thread(target=lambda: claimed.append(computer.claim())) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(claimed) == list(range(16))


ROOT = Path(__file__).parents[2]
PORTS = Ports("/dev/kobuki", "/dev/beeclick", "/dev/rplidar", BoardSettings(1))


@pytest.fixture
def alone(tmp_path: Path) -> RunPlan:
    """Return the plan of the head-on scenario for r1 only."""
    whole = swarm.plan(load_scenario(ROOT / "scenarios" / "head_on.toml"), RunOptions(tmp_path / "out"))
    return replace(whole, world=msgspec.structs.replace(whole.world, robots=whole.world.robots[:1]))


def test_set_up_and_module_are_as_in_simulation(alone: RunPlan) -> None:
    robot = alone.world.robots[0]
    on_board = onboard_processes.onboard_robot_program(OnboardRobot(alone, PORTS, lambda: 0), start=0)
    simulated = plan.robot_program(alone, robot, ProcessOrder("r1", 0), first_step=0)
    assert simulated.setup is not None and on_board.setup is not None
    spares = msgspec.structs.replace(simulated.setup.process, spares_record=True)
    outlives = msgspec.structs.replace(simulated.setup, process=spares)
    assert on_board == msgspec.structs.replace(simulated, setup=outlives), "it continues on a full disk"
    debugged = onboard_processes.onboard_robot_program(
        OnboardRobot(alone, PORTS, lambda: 0, debug_port=5678), start=0
    )
    assert debugged.module == "debugpy"
    assert debugged.argv == ("--listen", "5678", "-m", on_board.module, *on_board.argv)


def test_the_robots_files_are_as_in_simulation(alone: RunPlan, tmp_path: Path) -> None:
    simulated = replace(alone, options=msgspec.structs.replace(alone.options, out=tmp_path / "simulated"))
    plan.write_run_folder(simulated)
    onboard_processes.write_folders(OnboardRobot(alone, PORTS, lambda: 0))
    assert sorted(path.name for path in alone.out.iterdir()) == ["r1", "r1.base", "r1.radio"]
    for path in filter(Path.is_file, (simulated.out / "r1").iterdir()):
        assert (alone.out / "r1" / path.name).read_bytes() == path.read_bytes()
    with pytest.raises(OptionError) as refused:
        onboard_processes.write_folders(OnboardRobot(alone, PORTS, lambda: 0))
    assert str(refused.value) == f"--out: {alone.out} already contains r1/; choose another directory"


def test_the_key_of_packets_is_in_no_recording_and_removed_at_the_end(alone: RunPlan, tmp_path: Path) -> None:
    key, file = "00112233445566778899aabbccddeeff", tmp_path / "packets.key"
    credentials.write_secret(file, key)
    prepared = OnboardRobot(alone, PORTS, lambda: 3, packet_key=file)
    onboard_processes.write_folders(prepared)
    onboard_processes.issue_passwords(prepared)
    copied = alone.folder("r1") / "packets.key"
    assert copied.read_text() == f"{key}\n" and copied.stat().st_mode & 0o777 == 0o600
    program = onboard_robot_program(prepared, 0)
    assert program.setup is not None and key not in str(typed_json.dump(program.setup))
    process = actor_process_of(program.setup.actor, alone.folder("r1"), "r1", "abc")
    assert process.run.setup is not None and key not in str(process.run)
    node = node_of(process.core.behaviour)  # type: ignore[attr-defined]
    assert node is not None
    (sent,) = node.advance(Instant(seconds(1)))
    (data,) = Reassembly().take(sent.instant, 1, sent.data)
    assert verified_packet(data, AesCcmAuthenticator(bytes.fromhex(key))) == data[:-8]
    onboard_processes.remove_passwords(prepared)
    assert not copied.exists() and file.exists()
    with pytest.raises(AcrcError, match=f"^{copied} cannot be read .* copy it from a robot's folder of "):
        actor_process_of(program.setup.actor, alone.folder("r1"), "r1", "abc")


def test_each_start_has_its_own_epoch_and_recording(alone: RunPlan) -> None:
    epochs = iter((7, 8, 12))
    prepared = OnboardRobot(alone, PORTS, lambda: next(epochs))
    programs = [onboard_processes.onboard_robot_program(prepared, start) for start in range(3)]
    assert [one.setup.actor.epoch for one in programs if one.setup is not None] == [7, 8, 12]
    names = [one.record.name for one in programs if one.record is not None]
    assert names == ["r1.mcap", "r1.1.mcap", "r1.2.mcap"]


def test_a_port_in_use_is_reported_and_no_files_are_left(
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
        prepared = OnboardRobot(alone, PORTS._replace(listen=listen, keys=str(keys)), lambda: 0)
        onboard_processes.write_folders(prepared)
        onboard_processes.issue_passwords(prepared)
        program = onboard_processes.base_program(prepared, 0)
        assert program.setup is not None
        process = msgspec.structs.replace(program.setup.process, with_parent=False)
        file = program.log.parent / SETUP
        file.write_bytes(typed_json.dump(msgspec.structs.replace(program.setup, process=process)))
        assert base.main(program.argv) == 2
    assert capsys.readouterr().err == (
        f"{listen}: cannot listen there: address already in use; stop the program that uses the port, or "
        "change `listen` in the fleet file\n"
    )
    assert leftovers(alone.out) == []


NOW = Instant(1_000_000)


def told(prepared: OnboardRobot, start: int) -> RobotSetup:
    """Return the robot's set-up at that start."""
    setup = onboard_robot_program(prepared, start).setup
    assert setup is not None and isinstance(setup.actor, RobotSetup)
    return setup.actor


def test_the_pose_is_stored_twice_per_second_and_read_by_the_next_process(tmp_path: Path) -> None:
    path = tmp_path / "r1.pose"
    keeper = PoseWriter(path, NOW)
    assert keeper.initial is None
    for step in range(8):
        at = Instant(NOW + seconds(0.1) * step)
        keeper.store(at, Pose(2.0, 3.0, 0.1 * step), Odometry(1.0 * step, 0.0, 0.0, 0.0, 0.0, 0.0))
    keeper.close()
    kept = LastPose((2.0, 3.0, 0.5), (5.0, 0.0, 0.0))
    assert last_pose.read(path) == kept
    assert kept.origin.compose(Pose(5.0, 0.0, 0.0)) == pytest.approx((2.0, 3.0, 0.5))
    successor = PoseWriter(path, NOW)
    assert successor.initial == kept
    successor.add_spread(1.0)
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
def test_damaged_pose_files_are_ignored(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "r1.pose"
    path.write_bytes(text)
    assert (last_pose.read(path) is None) == (len(text) < 4096)
    assert last_pose.read(tmp_path / "none") is None


def test_a_restarted_robot_has_an_uncertain_pose(alone: RunPlan, tmp_path: Path) -> None:
    path = tmp_path / "r1.pose"
    prepared = OnboardRobot(alone, PORTS, lambda: 0, last_pose=path)
    assert told(prepared, 0).doubt is None
    last_pose.write(path, LastPose((2.0, 3.0, 0.0), (1.0, 0.5, 0.0)))
    assert (told(prepared, 1).doubt, told(prepared, 1).start) == (0.3, (1.0, 2.5, 0.0))
    assert replace(prepared, last_pose=None).pose_file == alone.out / "r1.base" / "last.pose"


@pytest.mark.parametrize(("at", "start"), [("start", (12.0, 5.0, 0.0)), ("12.5,5.5,-1", (12.5, 5.5, -1.0))])
def test_a_given_pose_is_certain(at: str, start: tuple[float, float, float], tmp_path: Path) -> None:
    stands = fleet(robot(2))
    pose = tmp_path / "runs" / "r2.pose"
    pose.parent.mkdir()
    last_pose.write(pose, LastPose((2.0, 3.0, 0.0), (1.0, 0.5, 0.0)))
    prepared = prepare(stands, "r2", RunOptions(tmp_path / "runs" / "one"), lambda sentence: None, at=at)
    assert prepared.robot.start == start
    assert not pose.exists() and told(prepared, 0).doubt is None
    for wrong in ("here", "1,2", "1,2,3,4", "nan,0,0"):
        with pytest.raises(OptionError, match=f"^--at: {wrong}; must be start, or X,Y,HEADING in m and rad"):
            _parse_pose(wrong, stands.robot_named("r2"))


def test_each_fault_of_the_keys_is_reported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = robot(1, 'listen = "tls/127.0.0.1:7447"')
    one = fleet(text, head=f'keys = "{tmp_path}/keys"\nmap = "m.yaml"\n')
    faults, said = ["", "it is over", "it is over", "", "the clock is wrong"], list[str]()
    monkeypatch.setattr(OperatorAccessCheck, "PERIOD_S", 0.0)
    link = OperatorAccessCheck(lambda: faults.pop(0), said.append)
    while faults:
        link.check_if_due()
    refused = "laptops cannot connect to watch or stop the robot"
    assert said == [f"{refused}: {why}" for why in ("it is over", "the clock is wrong")]
    assert _link_fault(one, one.robot_named("r1")).startswith(
        f"{tmp_path}/keys/r1/authority.pem cannot be read (No "
    )
    fleet_keys.create_keys(one, tmp_path / "keys", {}, now=datetime.now(UTC) - timedelta(days=3), days=1)
    assert ", today is " in _link_fault(one, one.robot_named("r1"))


class FakeLauncher:
    """A launcher whose processes exit as scripted, at calls of `wait`."""

    arriving = False

    def __init__(self) -> None:
        self.started: list[str] = []
        self.children: dict[str, ChildProcess] = {}
        self.ends: list[dict[str, int]] = []
        self.said: list[str] = []

    def withdraw(self, router: Path) -> None:
        """Do nothing."""

    def start(self, program: Program) -> ChildProcess:
        self.started.append(program.actor)
        self.children[program.actor] = ChildProcess(program, pid=2**22 + len(self.started))
        return self.children[program.actor]

    def wait(self, _timeout_s: float) -> None:
        for name, code in (self.ends.pop(0) if self.ends else {}).items():
            self.children[name].exit_code = code


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[OnboardSupervisor, FakeLauncher]:
    """Return a supervisor with running base, bridge and program."""

    issued = SimpleNamespace(sockets={onboard_processes.BRIDGE: tmp_path})

    def program(name: str) -> object:
        return lambda _one, _start: Program(
            name, name, (), tmp_path / f"{name}.log", tmp_path / f"{name}.mcap"
        )

    monkeypatch.setattr(OnboardSupervisor, "GRACE_S", 0.05)  # no real processes
    monkeypatch.setattr(onboard_processes, "issue_passwords", lambda _: issued)
    monkeypatch.setattr(onboard_processes, "base_program", program(onboard_processes.BASE))
    monkeypatch.setattr(onboard_processes, "bridge_program", program(onboard_processes.BRIDGE))
    monkeypatch.setattr(onboard_processes, "onboard_robot_program", program("r1"))
    plan = SimpleNamespace(options=RunOptions(tmp_path))
    one = SimpleNamespace(robot=SimpleNamespace(id="r1"), router=Path("router.json"), plan=plan)
    launcher = FakeLauncher()
    watch = OnboardSupervisor(one, launcher, launcher.said.append)  # type: ignore[arg-type]
    watch.start_robot()
    assert launcher.started == [onboard_processes.BASE, onboard_processes.BRIDGE, "r1"]
    return watch, launcher


def test_a_finished_robot_is_not_restarted_while_its_base_exits(
    played: tuple[OnboardSupervisor, FakeLauncher],
) -> None:
    watch, launcher = played
    launcher.ends = [{"r1": 0}, {}, {onboard_processes.BRIDGE: 0}, {onboard_processes.BASE: 0}]
    assert not watch.restart_exited(0.0), "stopped by the operator"
    assert launcher.started == [onboard_processes.BASE, onboard_processes.BRIDGE, "r1"]
    assert watch.restarts == 0


TAKEN = "base failed in step 0: /dev/kobuki: in use by another program"


def test_the_cause_of_each_exit_is_reported(
    played: tuple[OnboardSupervisor, FakeLauncher], tmp_path: Path
) -> None:
    watch, launcher = played
    (tmp_path / "r1.log").write_text(f"what it prints\n{TAKEN}\n")
    launcher.ends = [{"r1": 1}] * 6
    with pytest.raises(AcrcError) as caught:
        while True:
            watch.restart_exited(0.0)
    assert launcher.said == [f"r1 exited with exit code 1: {TAKEN}"] * 6
    assert str(caught.value).endswith(
        f"started 5 times within 60 s, and r1 has ended again with exit code 1: {TAKEN}"
    )


def test_each_warning_about_an_incomplete_recording_is_reported_once(
    played: tuple[OnboardSupervisor, FakeLauncher], tmp_path: Path
) -> None:
    watch, launcher = played
    full = f"{tmp_path}/r1.mcap: cannot be written: no space left on device"
    log = tmp_path / "r1.log"
    later = "and this was said after it, before anybody looked\n"
    for text in ("a line of the strategy\n", f"{full}; all further records are lost\n{later}", "", ""):
        log.write_text((log.read_text() if log.exists() else "") + text)
        assert watch.restart_exited(0.0)
    log.write_text(log.read_text() + f"{full}; 1234 records lost\n")
    launcher.ends = [{"r1": 0, onboard_processes.BRIDGE: 0, onboard_processes.BASE: 0}]
    assert not watch.restart_exited(0.0)
    assert launcher.said == [
        f"r1: {full}; all further records are lost",
        f"r1: {full}; 1234 records lost",
    ]
