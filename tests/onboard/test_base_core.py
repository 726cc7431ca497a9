"""Base process and bridge: steps in real time, and ports that are lost and reopened."""

import math
from collections.abc import Sequence
from typing import Any

import pytest

from actors.geometry import Pose
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    RADIO_READY,
    READY,
    TRANSMIT,
    TRUTH,
    Board,
    Control,
    Drive,
    EventCount,
    FrameOverflow,
    FrameReceived,
    FrameSent,
    FrameUnconfirmed,
    LinkState,
    Odometry,
    OutgoingFrame,
    Progress,
    RadioAdvanced,
    RadioEvents,
    Ready,
    RobotTruth,
    Scan,
    SensorData,
    Temperature,
    Transmit,
    Truth,
)
from actors.orders import Order, Pause, Resume, Stop
from actors.robot_model import load_model
from actors.runtime.core import Address, Output, at
from actors.runtime.errors import AcrcError
from actors.topic import Message
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.beeclick.board_link import BoardLink
from firmware_bridge.onboard.base_core import BRIDGE_TIMEOUT, BaseCore
from firmware_bridge.onboard.bridge import MAX_PLANNED, Bridge, BridgeCore
from firmware_bridge.onboard.device_loop import BridgeSetup, Clock, ReconnectingPort
from firmware_bridge.onboard.vehicle import GuardianLink, TurtleBot
from firmware_bridge.serial_port import PortError, SerialPort
from tests.beeclick.lab import boards
from tests.kobuki.rig import Rig

STEP = 100_000
START = Pose(10.0, 5.0, math.pi / 2)
BEGIN = 1_700_000_000_000_000


class Vehicle:
    def __init__(self) -> None:
        self.commands: list[tuple[int, float, float]] = []
        self.issued: list[int] = []
        self.sweep: Scan | None = None
        self.causes: tuple[str, ...] = ()
        self.level: float | None = None

    def charge(self) -> float | None:
        return self.level

    def stop_reasons(self) -> tuple[str, ...]:
        return self.causes

    def odometry(self) -> Odometry:
        return Odometry(1.0, 2.0, 0.5, 0.1, 0.0, 0.2)

    def bumper(self) -> int:
        return 2

    def scan(self) -> Scan | None:
        sweep, self.sweep = self.sweep, None
        return sweep

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        self.commands.append((now - BEGIN, vx, omega))
        self.issued.append(issued - BEGIN)


class BaseHarness:
    """A base core whose messages come from the test; times are µs after BEGIN."""

    def __init__(self) -> None:
        self.vehicle = Vehicle()
        self.core = BaseCore("r1", STEP, Instant(BEGIN), START, 10, self.vehicle)

    def at(self, time_us: int, address: Address | None = None, message: Any = None) -> list[Message]:
        self.core.now = Instant(BEGIN + time_us)
        inputs: dict[str, Message] = {}
        if address is not None and message is not None:
            self.core.expect(address.key)
            assert [one.key for one in self.core.missing({})] == [address.key]
            inputs[address.key] = message
        assert list(self.core.missing(inputs)) == []
        return shown(self.core.advance(inputs))

    def ready(self) -> None:
        assert self.at(10, at(READY, "r1"), Ready(0, "r1", 0, "")) == []
        assert self.at(20, at(RADIO_READY), Ready(0, "radio", 0, "")) == []

    def drive(self, time_us: int, step: int, vx: float = 0.3, transmits: int = 0) -> list[Message]:
        return self.at(time_us, at(DRIVE, "r1"), Drive(step, vx, 0.0, 0.1, transmits))

    def aired(self, time_us: int, step: int, events: int = 0) -> list[Message]:
        counts = (EventCount("r1", events),) if events else ()
        return self.at(time_us, at(AIRED), RadioAdvanced(step, counts))


def shown(outputs: Sequence[Output]) -> list[Message]:
    return [output.message for output in outputs if isinstance(output.message, SensorData | Truth)]


def first_step(stage: BaseHarness) -> None:
    """Run step 1, the first one after robot and bridge are ready; it is answered in 4 ms."""
    stage.ready()
    sweep = stage.vehicle.sweep
    (senses,) = stage.at(STEP)
    assert senses == SensorData(1, BEGIN + STEP, 0, Odometry(1.0, 2.0, 0.5, 0.1, 0.0, 0.2), 2, sweep)
    assert stage.drive(STEP + 4_000, 1, transmits=3) == []


def test_a_timeout_of_robot_or_bridge_is_reported() -> None:
    robot, bridge = BaseHarness(), BaseHarness()
    for stage in (robot, bridge):
        stage.core.answer_timeout = seconds(1.0)
        first_step(stage)
        stage.at(2 * STEP)
    robot.aired(2 * STEP + 1000, 1)
    with pytest.raises(AcrcError) as hung:
        for step in range(3, 20):
            robot.at(step * STEP)
    assert str(hung.value) == "step 13: no answer from r1 for 1 s"
    with pytest.raises(AcrcError) as hung:
        for step in range(2, 20):
            bridge.at(step * STEP + 25_000)
            bridge.drive(step * STEP + 27_000, step)
            bridge.at((step + 1) * STEP)
    assert str(hung.value) == "step 13: no answer from the radio's bridge for 1 s"


def test_steps_begin_at_their_instants_and_answers_are_executed_at_once() -> None:
    stage = BaseHarness()
    stage.vehicle.sweep = Scan(5, b"\x01\x02")
    first_step(stage)
    assert stage.vehicle.commands == [(104_000, 0.3, 0.1)]
    assert stage.vehicle.issued == [STEP], "as old as the sensed data"
    (truth,) = stage.at(2 * STEP)
    assert isinstance(truth, Truth)
    assert (truth.step, truth.instant, truth.robots[0].transmits) == (1, BEGIN + STEP, 3)
    (robot,) = truth.robots
    assert (robot.x, robot.y) == pytest.approx((8.0, 6.0)), "odometry from the start pose"
    assert robot.heading == pytest.approx(math.pi / 2 + 0.5)
    assert math.hypot(robot.vx, robot.vy) == pytest.approx(0.1)
    (senses,) = stage.aired(2 * STEP + 1_000, 1, events=2)
    assert isinstance(senses, SensorData)
    assert (senses.step, senses.instant, senses.events) == (2, BEGIN + 2 * STEP, 2)
    assert stage.core.report().lateness_ms == {4: 1}


def test_steps_of_a_late_robot_are_skipped() -> None:
    stage = BaseHarness()
    assert stage.at(STEP - 10) == [], "nothing is sent before the robot is ready"
    stage.ready()
    stage.at(STEP)
    assert stage.at(2 * STEP) == stage.at(3 * STEP) == []
    assert stage.core.counts.overruns == 2
    stage.drive(3 * STEP + 50_000, 1)
    assert [message.step for message in stage.at(4 * STEP)] == [1]
    assert [message.step for message in stage.aired(4 * STEP + 500, 1)] == [4]
    assert stage.core.report().lateness_ms == {250: 1}
    stage.drive(4 * STEP + 1_000, 4)
    stage.at(9 * STEP + 30_000)
    (senses,) = stage.aired(9 * STEP + 31_000, 4)
    assert isinstance(senses, SensorData) and (senses.step, senses.instant) == (9, BEGIN + 9 * STEP), (
        "at fixed intervals"
    )


def test_a_late_report_of_the_bridge_counts_for_the_next_step() -> None:
    stage = BaseHarness()
    first_step(stage)
    assert len(stage.at(2 * STEP)) == 1
    assert stage.core.wake == BEGIN + 2 * STEP + BRIDGE_TIMEOUT
    (senses,) = stage.at(2 * STEP + BRIDGE_TIMEOUT)
    assert isinstance(senses, SensorData) and senses.events == 0
    assert stage.core.counts.late_air == 1
    stage.drive(2 * STEP + 30_000, 2)
    assert stage.aired(2 * STEP + 40_000, 1, events=3) == [], "used in the next step"
    (senses,) = stage.at(3 * STEP)
    assert isinstance(senses, SensorData) and (senses.step, senses.events) == (3, 3)
    stage.drive(3 * STEP + 2_000, 3)
    assert [type(message) for message in stage.at(4 * STEP)] == [Truth], "all events have been passed on"


def test_steps_continue_without_answers_of_the_bridge() -> None:
    stage = BaseHarness()
    first_step(stage)
    stage.at(2 * STEP)
    for step in range(2, 6):
        (senses,) = stage.at(step * STEP + BRIDGE_TIMEOUT)
        assert isinstance(senses, SensorData) and (senses.step, senses.events) == (step, 0)
        stage.drive(step * STEP + BRIDGE_TIMEOUT + 1_000, step)
        assert stage.at((step + 1) * STEP) == []
    stage.at(6 * STEP + 1_000, at(RADIO_READY), Ready(0, "radio", 1, ""))
    stage.at(6 * STEP + BRIDGE_TIMEOUT)
    stage.drive(6 * STEP + 50_000, 6)
    assert [type(message) for message in stage.at(7 * STEP)] == [Truth], "a new bridge gets a request"


def test_a_restarted_robot_gets_the_next_step() -> None:
    stage = BaseHarness()
    first_step(stage)
    stage.at(2 * STEP)
    stage.aired(2 * STEP + 100, 1)
    stage.at(2 * STEP + 50_000, at(READY, "r1"), Ready(0, "r1", 1, ""))
    assert stage.drive(2 * STEP + 60_000, 2) == [], "answer of its predecessor"
    assert stage.core.counts.stale_drives == 1
    assert len(stage.at(3 * STEP)) == 1 and stage.core.counts.overruns == 0


def test_a_late_report_for_an_exited_robot_does_not_count_for_its_successor() -> None:
    """Otherwise it would wait forever for RadioEvents that was sent to its predecessor."""
    stage = BaseHarness()
    first_step(stage)
    assert len(stage.at(2 * STEP)) == 1
    stage.at(2 * STEP + 60_000, at(READY, "r1"), Ready(0, "r1", 1, ""))
    (truth,) = stage.at(3 * STEP)
    assert isinstance(truth, Truth) and truth.robots[0].epoch == 1, "new request for the new robot"
    assert stage.aired(3 * STEP + 100, 1, events=4) == [], "answer to the first request"
    (senses,) = stage.aired(3 * STEP + 200, 1)
    assert isinstance(senses, SensorData) and senses.events == 0


@pytest.mark.parametrize("how", ["order", "signal"])
def test_the_last_messages_halt_robot_and_bridge_and_stop_the_vehicle(how: str) -> None:
    stage = BaseHarness()
    first_step(stage)
    if how == "signal":
        stage.core.stop()
        last = stage.at(150_000)
    else:
        last = stage.at(150_000, at(CONTROL), Control(0, (Stop(),)))
    assert [(type(message), message.step) for message in last] == [(SensorData, 2), (Truth, 2)]
    assert all(isinstance(message, SensorData | Truth) and message.halt for message in last)
    assert stage.core.finished and stage.vehicle.commands[-1] == (150_000, 0.0, 0.0)


@pytest.mark.parametrize(
    ("order", "paused", "finished"), [(Pause(), True, False), (Resume(), False, False), (Stop(), False, True)]
)
def test_progress_reports_executed_orders_and_stop_causes(order: Order, paused: bool, finished: bool) -> None:
    stage = BaseHarness()
    stage.vehicle.causes = ("battery low",)
    first_step(stage)
    stage.core.now = Instant(BEGIN + 150_000)
    stage.core.expect(CONTROL.key())
    outputs = stage.core.advance({CONTROL.key(): Control(0, (order,))})
    (said,) = (output.message for output in outputs if isinstance(output.message, Progress))
    assert (said.paused, said.finished, said.held) == (paused, finished, ("battery low",))
    assert (stage.vehicle.commands[-1] == (150_000, 0.0, 0.0)) is not isinstance(order, Resume)
    assert finished or bool(stage.at(2 * STEP)) is not paused, "no steps while paused"


SECOND = 1_000_000


class FakeCable:
    """A cable: ports can be opened while it is plugged in, and are lost when it is unplugged."""

    def __init__(self) -> None:
        self.is_in, self.opened, self.tried = False, 0, 0
        self.said: list[str] = []

    def open(self) -> SerialPort:
        self.tried += 1
        if not self.is_in:
            raise PortError("no such port")
        self.opened += 1
        return FakePort(self)


class FakePort(SerialPort):
    def __init__(self, plug: FakeCable) -> None:
        self.plug, self.closed = plug, False

    def read(self) -> bytes:
        if not self.plug.is_in:
            raise PortError("connection lost")
        return b"hello"

    def fileno(self) -> int:
        return 77

    def close(self) -> None:
        self.closed = True


def test_a_lost_port_is_reopened_and_each_loss_reported() -> None:
    plug = FakeCable()
    line = ReconnectingPort(plug.open, plug.said.append)
    assert not any(line.connect(Instant(ms * 1000)) for ms in range(0, 3_500, 100))
    assert (plug.tried, plug.said) == (4, ["no such port"])
    plug.said.clear()
    for round_ in range(1, 3):
        plug.is_in = True
        assert line.connect(Instant(round_ * 10 * SECOND)) and not line.connect(Instant(round_ * 20 * SECOND))
        first = line.port
        assert isinstance(first, FakePort) and line.descriptors() == (77,)
        assert line.exchange(lambda port: port.read()) == b"hello"
        plug.is_in = False
        assert line.exchange(lambda port: port.read()) is None
        assert first.closed and line.port is None and line.descriptors() == ()
        assert (plug.opened, plug.said) == (round_, ["connection lost"] * round_)


@pytest.mark.parametrize(
    ("fault", "value", "told"),
    [
        ("battery", 16.0, ()),
        ("battery", 14.0, ("battery low",)),
        ("battery", 13.0, ("battery nearly empty",)),
        ("overcurrent", 1, ("over-current at a wheel: it may be blocked",)),
    ],
)
def test_stop_causes_are_reported(fault: str, value: float, told: tuple[str, ...]) -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    setattr(rig.base.faults, fault, value)
    rig.run(0.5, (0.1, 0.0))
    vehicle = TurtleBot(FakeCable().open, rig.driver, None, GuardianLink("base"), lambda line: None)
    assert vehicle.stop_reasons() == told


@pytest.mark.parametrize(
    ("volts", "charge"), [(16.8, 1.0), (14.0, 0.26), (14.1, 0.325), (13.2, 0.05), (9.9, 0.0)]
)
def test_the_charge_follows_from_the_voltage_of_the_base(volts: float, charge: float) -> None:
    rig = Rig()
    battery = load_model("turtlebot2").battery
    parts = FakeCable().open, rig.driver, None, GuardianLink("base"), lambda line: None
    assert TurtleBot(*parts, battery=battery).charge() is None, "before the first feedback"
    rig.base.faults.battery = volts
    rig.run(0.5, (0.1, 0.0))
    assert TurtleBot(*parts, battery=battery).charge() == pytest.approx(charge)
    assert TurtleBot(*parts).charge() is None


def test_the_robot_receives_the_charge_of_its_base() -> None:
    stage = BaseHarness()
    stage.ready()
    stage.vehicle.level = 0.4
    (senses,) = stage.at(STEP)
    assert isinstance(senses, SensorData) and senses.battery == 0.4


POLL = milliseconds(1)


class Room:
    """Bridges with boards in one room, in virtual time."""

    def __init__(self, robots: int = 2) -> None:
        self.now = Instant(0)
        self.air = boards(robots, spacing=1.0)
        self.bridges: list[BridgeCore] = []
        for number in range(robots):
            link = BoardLink(BoardSettings(number + 1))
            link.connect(self.now)
            self.bridges.append(BridgeCore(f"r{number + 1}", link))
        self.run(seconds(0.2))
        self.news = [[output.message for output in bridge.advance({})] for bridge in self.bridges]

    def run(self, duration: Duration) -> None:
        until = self.now + duration
        while self.now < until:
            self.now = Instant(self.now + POLL)
            self.air.advance(self.now)
            for bridge, board in zip(self.bridges, self.air.devices, strict=True):
                bridge.now = self.now
                bridge.receive(board.run(self.now))
                board.take(self.now, bridge.due())

    def give(self, robot: int, address: Address, message: Message) -> list[Message]:
        bridge = self.bridges[robot]
        bridge.expect(address.key)
        assert [one.key for one in bridge.missing({})] == [address.key]
        return [output.message for output in bridge.advance({address.key: message})]

    def transmit(self, robot: int, *frames: tuple[int, float, bytes]) -> None:
        planned = tuple(
            OutgoingFrame(tag, self.now + milliseconds(later), data) for tag, later, data in frames
        )
        assert self.give(robot, at(TRANSMIT, f"r{robot + 1}"), Transmit(1, planned)) == []

    def step(self, robot: int, step: int, epoch: int = 0) -> Sequence[Message]:
        here = RobotTruth(f"r{robot + 1}", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True, True, 0, epoch)
        return self.give(robot, at(TRUTH), Truth(step, self.now, (here,)))


def test_frames_are_sent_at_their_instants_and_received() -> None:
    room = Room()
    begun = room.now
    room.transmit(0, (7, 30, b"hello"))
    room.run(milliseconds(100))
    received, aired = room.step(0, 4)
    assert isinstance(received, RadioEvents) and received.step == 5
    (sent,) = received.events
    assert isinstance(sent, FrameSent) and sent.tag == 7
    assert 30_000 <= sent.instant - begun < 45_000
    assert aired == RadioAdvanced(4, (EventCount("r1", 1),))
    received, aired = room.step(1, 4)
    assert isinstance(received, RadioEvents)
    (heard,) = received.events
    assert isinstance(heard, FrameReceived) and (heard.sender, heard.data) == (1, b"hello")
    assert -90 < heard.rssi_dbm < -35 and 0 <= heard.lqi <= 255
    assert room.step(1, 5) == [RadioAdvanced(5, ())]
    assert room.give(0, at(TRUTH), Truth(5, room.now, (), halt=True)) == []
    assert room.bridges[0].finished


def test_frames_on_an_unplugged_board_are_unconfirmed() -> None:
    room = Room()
    room.transmit(0, (1, 0, bytes(118)), (2, 0, bytes(118)))
    room.run(milliseconds(3))
    room.bridges[0].now = room.now
    room.bridges[0].port_lost()
    received, _ = room.step(0, 1)
    assert isinstance(received, RadioEvents)
    assert {type(event) for event in received.events} == {FrameUnconfirmed}
    assert [event.tag for event in received.events if isinstance(event, FrameUnconfirmed)] == [1, 2]


def test_too_many_planned_frames_overflow() -> None:
    room = Room()
    room.transmit(0, *((tag, 1000.0 + tag, b"x") for tag in range(MAX_PLANNED + 2)))
    received, _ = room.step(0, 1)
    assert isinstance(received, RadioEvents)
    assert [event.tag for event in received.events if isinstance(event, FrameOverflow)] == [
        MAX_PLANNED,
        MAX_PLANNED + 1,
    ]
    assert room.bridges[0].dropped_frames == 2


def test_board_notes_are_published() -> None:
    room = Room(1)
    room.run(seconds(3))
    (bridge,) = room.bridges
    assert bridge.has_news
    (output,) = bridge.advance({})
    assert isinstance(output.message, Board)
    assert Temperature in [type(note) for note in output.message.notes]
    (board,) = room.news[0]
    assert isinstance(board, Board)
    (up,) = board.notes
    assert isinstance(up, LinkState) and up.up
    assert not bridge.has_news and list(bridge.advance({})) == []


def test_a_new_epoch_drops_frames_and_tags_of_the_previous_one() -> None:
    """The previous epoch has one reported frame, four on the board, two queued, one planned."""
    room = Room()
    room.step(0, 0, epoch=3)
    room.transmit(0, (1, 0, b"sent"))
    room.run(milliseconds(50))
    room.transmit(0, *((tag, 0, bytes(118)) for tag in range(2, 8)), (8, 40, b"later"))
    room.run(milliseconds(2))
    assert room.step(0, 1, epoch=4) == [RadioAdvanced(1, ())], "no events for the successor"
    room.transmit(0, (1, 0, b"the successor's first"))
    room.run(milliseconds(100))
    received, _ = room.step(0, 2, epoch=4)
    assert isinstance(received, RadioEvents)
    assert [
        (type(event), event.tag) for event in received.events if not isinstance(event, FrameReceived)
    ] == [(FrameSent, 1)]
    received, _ = room.step(1, 2)
    assert isinstance(received, RadioEvents)
    heard = [event.data for event in received.events if isinstance(event, FrameReceived)]
    assert heard == [b"sent", *[bytes(118)] * 4, b"the successor's first"]
    frames = room.bridges[0].outcome()["frames"]
    assert frames == {"events_dropped": 0, "events_forgotten": 5, "frames_dropped": 0, "frames_forgotten": 3}


def test_without_a_board_frames_overflow_and_nothing_is_due(capsys: pytest.CaptureFixture[str]) -> None:
    bridge = Bridge(BridgeSetup("r1", 100_000, "/nowhere/beeclick", BoardSettings(1)), Clock())
    core, now = bridge.core, Instant(10_000_000)
    core.now = now
    core.expect(TRANSMIT.key("r1"))
    frames = tuple(OutgoingFrame(tag, now, b"x") for tag in range(20))
    core.advance({at(TRANSMIT, "r1").key: Transmit(1, frames)})
    bridge.serve(now)
    bridge.serve(Instant(now + 5_000_000))
    assert core.wake is None, "it waits for the mesh, and retries the port periodically"
    core.expect(TRUTH.key())
    received = core.advance({at(TRUTH).key: Truth(1, now, ())})[0].message
    assert isinstance(received, RadioEvents)
    overflown = [event.tag for event in received.events if isinstance(event, FrameOverflow)]
    assert overflown == list(range(8, 20)), "one frame in transmission and seven queued"
    assert capsys.readouterr().err.count("/nowhere/beeclick: no such port") == 1
