"""Laboratory: time, determinism and faults without a clock, and its process in real time."""

import math
import os
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import START, Instant
from actors.messages import NO_ECHO_MM, Scan
from actors.orders import Obstacle, StartJam
from actors.radio.radio_model import RadioSetup
from actors.runtime.errors import AcrcError
from actors.world.body import Bodies
from actors.world.physics import SUBSTEP
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import TimedOrder
from firmware_bridge.beeclick.board_messages import SendPacket, SyncCommand
from firmware_bridge.beeclick.board_messages import encode_command as encode_for_board
from firmware_bridge.device_lines import BASE, DEVICES, RADIO, RANGE, DevicePort, EmulatedLines
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.kobuki_motion import base_control
from firmware_bridge.kobuki.kobuki_packets import encode_command, encode_frame
from firmware_bridge.laboratory.__main__ import main
from firmware_bridge.laboratory.laboratory import LIDAR, FaultInjector, Laboratory, LaboratorySetup
from firmware_bridge.range_sensors.rplidar import LidarRequest
from firmware_bridge.safety import HoldCause
from firmware_bridge.serial_port import PortError
from tests.laboratory.hosts import ROOT, STARTS, BaseHost, LidarHost, Running, setup, until

FAST = encode_frame(encode_command(base_control(0.4, 0.3)))


USUAL = Uncertainty()


class Wire:
    """Recorder of the sent bytes."""

    def __init__(self) -> None:
        self.bytes: dict[DevicePort, bytes] = defaultdict(bytes)

    def __call__(self, port: DevicePort, data: bytes) -> None:
        self.bytes[port] += data


def driven(round_ms: int, dose: Uncertainty = USUAL) -> tuple[Laboratory, Wire]:
    """Run 2 s with one command to drive and to scan for r1, advancing by `round_ms`."""
    room = setup(2, "kobuki")
    world = msgspec.structs.replace(room.world, uncertainty=dose)
    laboratory, wire = Laboratory(msgspec.structs.replace(room, world=world)), Wire()
    laboratory.take(DevicePort("r1", BASE), START, FAST)
    laboratory.take(DevicePort("r1", RANGE), START, LidarRequest.SCAN.bytes)
    for robot in ("r1", "r2"):
        packets = b"".join(encode_for_board(SendPacket(number, bytes(118))) for number in range(4))
        laboratory.take(DevicePort(robot, RADIO), START, b"\xff" + encode_for_board(SyncCommand()) + packets)
    for at in range(0, 2001, round_ms):
        laboratory.advance(Instant(1000 * at), wire)
    return laboratory, wire


def test_the_voltage_of_a_base_follows_the_charge_of_its_battery() -> None:
    room = setup(2)
    first, second = room.world.robots
    charged = msgspec.structs.replace(first, battery=0.26)
    world = msgspec.structs.replace(room.world, robots=(charged, second))
    laboratory = Laboratory(msgspec.structs.replace(room, world=world))
    assert [one.base.faults.battery for one in laboratory.robots.values()] == [14.0, 16.0]
    laboratory.advance(Instant(60_000_000), Wire())
    slope = (14.0 - 13.7) / (0.26 - 0.16)  # V per charge, of the model's curve
    used = (9.2 + 5.1 + 0.063) * 60.0 / (32.56 * 3600)
    voltages = [one.base.faults.battery for one in laboratory.robots.values()]
    assert voltages == pytest.approx([14.0 - slope * used, 16.0], abs=1e-6)


def test_results_do_not_depend_on_the_interval_of_calls() -> None:
    alone = Laboratory(setup(1))
    alone.advance(Instant(SUBSTEP + 3000), Wire())
    assert (alone.now, alone.instant) == (Instant(SUBSTEP), Instant(SUBSTEP + 3000))
    assert alone.wake == Instant(1_370_000), "the board's first temperature"
    (often, by_often), (seldom, by_seldom) = driven(1), driven(40)
    assert often.now == seldom.now == Instant(2_000_000)
    assert often.pose("r1") == seldom.pose("r1")
    assert by_often.bytes == by_seldom.bytes
    assert len(by_often.bytes[DevicePort("r1", RANGE)]) == 7 + 5 * 3960
    assert often.medium.counters() == seldom.medium.counters()
    assert often.medium.counters()["frames_sent"] == 8


def echoes(wire: Wire) -> float:
    """Return the share of r1's lidar samples with an echo; 5 bytes each, after a descriptor of 7."""
    samples = np.frombuffer(wire.bytes[DevicePort("r1", RANGE)][7:], np.uint8).reshape(-1, 5)
    return float(np.mean(samples[:, 3:].any(axis=1)))


def test_doses_affect_lidars_and_bases() -> None:
    (_, usual), (_, glass), (_, drift) = (
        driven(40, dose) for dose in (USUAL, Uncertainty(glass=1.0), Uncertainty(drift=50.0))
    )
    assert echoes(usual) > 0.9 and 0 < echoes(glass) < 0.6  # from r2 and the edge of the map
    base, lidar = DevicePort("r1", BASE), DevicePort("r1", RANGE)
    assert usual.bytes[base] == glass.bytes[base] != drift.bytes[base]
    assert usual.bytes[lidar] == drift.bytes[lidar] != glass.bytes[lidar]


def test_events_for_radio_and_floor_are_executed() -> None:
    room = setup(2)
    orders = (
        TimedOrder(100_000, Obstacle(13.0, 12.5, 0.2)),
        TimedOrder(150_000, StartJam(12.0, 12.5, 1.0, 50_000)),
    )
    world = msgspec.structs.replace(room.world, events=orders)
    laboratory = Laboratory(msgspec.structs.replace(room, world=world))
    ahead, seen = np.array([0.0]), []
    for at in (90_000, 110_000):
        laboratory.advance(Instant(at), Wire())
        seen.append(float(laboratory._scanners.range_function(0)(ahead)[0]))
    assert seen == pytest.approx(
        [2.0 + 0.1 - 0.177, 1.0 + 0.1 - 0.2], abs=0.05
    )  # r2, then the obstacle before it
    for robot, at in (("r2", 160_000), ("r2", 260_000)):
        laboratory.advance(Instant(at), Wire())
        radio = laboratory.robots[robot].radio
        laboratory.medium.transmit(radio, laboratory.instant, 0, b"hello")
        laboratory.advance(Instant(at + 40_000), Wire())
    told = laboratory.medium.counters()
    assert (told["frames_sent"], told["copies_lost_disturbed"], told["copies_heard"]) == (2, 1, 1)


@pytest.fixture
def laboratory() -> Laboratory:
    return Laboratory(setup(2))


@pytest.fixture
def lines(tmp_path: Path) -> Iterator[EmulatedLines]:
    ports = [DevicePort(robot, device) for robot in ("r1", "r2") for device in DEVICES]
    with EmulatedLines(tmp_path, ports, np.random.default_rng(1)) as lines:
        yield lines


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("explode r1", "unknown command 'explode'; use one of battery, block-lidar, cliff, corrupt, "),
        ("lift r3", "unknown robot 'r3'; use one of r1, r2"),
        ("corrupt r1 base", "'corrupt r1 base': usage is 'corrupt ROBOT base|radio|range SHARE'"),
        ("corrupt r1 base nan", "'nan' is not a share; must be a number from 0 to 1"),
        ("press r1 nose", "invalid argument 'nose'; use one of bumper|left|centre|right|radio"),
        ("plug r1 base", "the base of r1 is plugged in already; unplug it first"),
    ],
)
def test_invalid_commands_are_refused(
    laboratory: Laboratory, lines: EmulatedLines, line: str, sentence: str
) -> None:
    with pytest.raises(AcrcError) as caught:
        FaultInjector(laboratory, lines).execute(line)
    assert str(caught.value).startswith(sentence)


def stops(laboratory: Laboratory, driver: KobukiDriver, duration_ms: int = 500) -> set[HoldCause]:
    """Drive r1 for `duration_ms` and return the active stop causes."""
    port, begun = DevicePort("r1", BASE), laboratory.now
    for at in range(begun, begun + 1000 * duration_ms, SUBSTEP):
        now, wire = Instant(at + SUBSTEP), Wire()
        laboratory.advance(now, wire)
        driver.take(now, wire.bytes[port])
        driver.command(now, 0.2, 0.0)
        laboratory.take(port, now, driver.due(now))
    return {stop.cause for stop in driver.allowed.stops}


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("press r1 bumper", HoldCause.BUMPER),
        ("lift r1", HoldCause.WHEEL_DROP),
        ("cliff r1", HoldCause.CLIFF),
        ("silence r1 base", HoldCause.NO_FEEDBACK),
        ("overcurrent r1 left", HoldCause.OVERCURRENT),
        ("battery r1 13", HoldCause.BATTERY),
    ],
)
def test_a_fault_stops_the_driver_until_it_is_removed(
    laboratory: Laboratory, lines: EmulatedLines, fault: str, cause: HoldCause
) -> None:
    bench, driver = FaultInjector(laboratory, lines), KobukiDriver(START)
    assert stops(laboratory, driver) == set()
    bench.execute(fault)
    assert cause in stops(laboratory, driver)
    bench.execute("repair r1")
    stops(laboratory, driver, 3000)
    driven_by_then = laboratory.travelled("r1")
    stops(laboratory, driver)
    assert laboratory.travelled("r1") > driven_by_then


def test_corruption_of_a_line_can_be_ended_and_unread_bytes_are_counted(lines: EmulatedLines) -> None:
    port, sent = DevicePort("r2", RANGE), bytes(range(256)) * 8
    lines.corrupt(port, 0.1)
    with lines.path(port).open("rb", buffering=0) as host:
        lines.send(port, sent)
        damaged = host.read(4096)
        lines.corrupt(port, 0.0)
        lines.send(port, sent)
        assert host.read(4096) == sent
    assert damaged != sent
    assert len(damaged) == pytest.approx(len(sent), rel=0.05)
    for _ in range(100):
        lines.send(port, bytes(4096))
    unread = lines.unread(port)
    assert unread > 200_000
    lines.unplug(port)
    lines.send(port, bytes(4096))
    assert lines.read(port) == b""
    lines.plug(port)
    assert lines.unread(port) == unread


def millimetres(scan: Scan) -> NDArray[np.int64]:
    return np.frombuffer(scan.ranges_mm, "<u2").astype(np.int64)


@pytest.fixture
def prioritised() -> Iterator[None]:
    """Raise the priority of this process and its children, if permitted."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    yield
    os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.mark.usefixtures("prioritised")
def test_scans_and_odometry_agree_with_ground_truth(tmp_path: Path) -> None:
    built_from = setup(2)
    with Running(tmp_path, built_from) as laboratory:
        lidar = LidarHost(laboratory.path("r1", "range"))
        base = BaseHost(laboratory.path("r1", "base"))
        until(lambda: len(lidar.scans) >= 2 and base.driver.found, lidar, base)
        base.wanted = (0.2, 0.4)
        until(lambda: base.driver.odometry.heading > 1.2, lidar, base)
        base.wanted = (-0.1, 0.0)
        until(lambda: base.driver.odometry.read().vx < -0.09, lidar, base)
        base.wanted = (0.0, 0.0)
        until(lambda: base.driver.odometry.read().vx == 0.0, lidar, base)
        began_waiting = base.driver.reception.frames
        until(lambda: base.driver.reception.frames > began_waiting + 10, lidar, base)
        odometry = base.driver.odometry.read()
        path = laboratory.path("r1", "range")
        assert laboratory.say("unplug r1 range") == "ok"
        assert not path.is_symlink()
        with pytest.raises(PortError):
            until(lambda: False, lidar)
        assert laboratory.say("unplug r1 range") == "the range of r1 is not plugged in; plug it first"
        assert laboratory.say("plug r1 range") == laboratory.say("reboot r1 radio") == "ok"
        assert path.is_symlink()
        lidar.close()
        base.close()
        result = laboratory.end(signal.SIGINT)
    assert not laboratory.links.exists()

    world = Bodies(built_from.world).senses(0, 0, START, 0, False).scan
    assert world is not None
    seen, true = millimetres(lidar.scans[0]), millimetres(world)
    true[true > 1000 * LIDAR.range_max] = NO_ECHO_MM
    both = (seen != NO_ECHO_MM) & (true != NO_ECHO_MM)
    assert both.sum() > 0.95 * (true != NO_ECHO_MM).sum() > 450
    assert np.median(np.abs(seen - true)[both]) <= 30
    ahead = 319  # ray that points to r2
    assert true[ahead] == pytest.approx(2000 + 100 - 177, abs=10)  # the sensor is 0.1 m behind the centre
    assert seen[ahead] == pytest.approx(true[ahead], abs=30)

    truth = result.robots["r1"]
    believed = Pose(*STARTS[0]).compose(Pose(odometry.x, odometry.y, odometry.heading))
    assert math.dist(believed.point, truth.pose[:2]) < 0.01 * truth.travelled + 0.002
    assert believed.heading == pytest.approx(truth.pose[2], abs=math.radians(0.5))
    assert truth.travelled > 0.5
    assert result.bases["r1"]["skipped"] == 0
    assert result.boards["r1"]["reboots"] == 1
    positions = np.frombuffer(result.positions, "<f4").reshape(-1, 2, 2)
    assert len(positions) == pytest.approx(10 * result.simulated_s, abs=1)
    assert positions[0] == pytest.approx(np.array([start[:2] for start in STARTS[:2]]))
    assert math.dist(positions[-1, 0], truth.pose[:2]) < 0.1
    assert result.robots["r2"].pose == STARTS[1]
    assert sum(result.behind_ms.values()) == round(100 * result.simulated_s)


@pytest.mark.usefixtures("prioritised")
def test_time_that_cannot_be_caught_up_is_skipped_and_counted(tmp_path: Path) -> None:
    with Running(tmp_path, setup(1), "--duration", "2") as laboratory:
        laboratory.pause(1.5)
        result = laboratory.end(None)
    assert result.lost_ms >= 900  # the pause minus half a second and some tolerance
    assert result.simulated_s == 2.0
    assert sum(result.behind_ms.values()) == 200
    assert "ms behind; " in laboratory.complaints
    assert not laboratory.links.exists()


def test_it_exits_with_its_parent_process(tmp_path: Path) -> None:
    file = tmp_path / "setup.json"
    file.write_bytes(msgspec.json.encode(setup(1)))
    words = f"--setup {file} --links {tmp_path}/links --result {tmp_path}/result.json --with-parent"
    command = f"{sys.executable} -m firmware_bridge.laboratory {words} & wait"
    with subprocess.Popen(["sh", "-c", command], cwd=ROOT, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"ready\n"
        assert (tmp_path / "links/r1/base").readlink().parent == Path("/dev/pts")
        parent.kill()
        assert parent.stdout.read() == b""  # closed: no process is left
    assert (tmp_path / "result.json").is_file()
    assert not (tmp_path / "links").exists()


@pytest.mark.parametrize(
    ("radio", "sentence"),
    [
        (None, "invalid set-up of a laboratory: world is missing"),
        ({"step_us": 100_000, "robots": [["r1", 1]]}, "robots r1, r2, but addresses of r1; give each robot"),
        ({"step_us": 1, "robots": [["r1", 1], ["r2", 2]], "preset": "loud"}, "preset 'loud' is unknown"),
    ],
)
def test_inconsistent_set_ups_are_refused(
    radio: dict[str, object] | None, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, whole = tmp_path / "setup.json", msgspec.json.decode(msgspec.json.encode(setup(2)))
    given = {} if radio is None else whole | {"radio": {"seed": 1} | radio}
    file.write_bytes(msgspec.json.encode(given))
    assert main(["--setup", str(file), "--links", str(tmp_path), "--result", str(tmp_path / "r")]) == 2
    assert sentence in capsys.readouterr().err


def test_robot_names_must_be_valid_folder_names() -> None:
    whole = setup(1).world
    world = msgspec.structs.replace(whole, robots=(msgspec.structs.replace(whole.robots[0], id="../r1"),))
    with pytest.raises(AcrcError, match=r"robot '../r1': invalid name; use"):
        LaboratorySetup(world, RadioSetup(seed=1, step_us=100_000, robots=(("../r1", 1),)))
