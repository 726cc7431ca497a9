"""In-memory swarm with the real world and radio, and scripted robots."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from actors.items import ItemGivenUp, ItemKey
from actors.messages import (
    DRIVE,
    FLOOR_CHANGED,
    PROGRESS,
    RADIO_READY,
    READY,
    RECEIVED,
    ROSTER,
    SENSES,
    TRANSMIT,
    TRUTH,
    Drive,
    FloorChanged,
    OutgoingFrame,
    Progress,
    RadioEvents,
    Ready,
    Roster,
    SensorData,
    Transmit,
    Truth,
)
from actors.orders import Order
from actors.radio.program import build as build_radio
from actors.radio.radio_model import RadioSetup
from actors.runtime.codec import decode
from actors.runtime.core import Address, Core, Delivery, Inputs, Output, at, read, to
from actors.runtime.recording import NullJournal
from actors.runtime.shell import MemoryBus, Shell, run_digest, run_shells
from actors.task import Judge
from actors.task.checked_judge import CheckedJudge
from actors.task.loading import task_setup
from actors.topic import MessagePart
from actors.world.program import build as build_world
from actors.world.world_setup import BodySetup, TimedOrder, WorldSetup
from cleaning.referee import PlaceOutcome, Referee

M = TypeVar("M")
STEP = 100_000
STARTS = {"r1": (12.0, 13.0, 0.0), "r2": (17.0, 13.0, 0.0), "r3": (20.0, 11.0, 0.0)}


@dataclass(frozen=True)
class ScriptedAnswer:
    reports: tuple[MessagePart, ...] = ()
    given_up: tuple[ItemGivenUp, ...] = ()
    route: tuple[ItemKey, ...] | None = None


class ScriptedRobot:
    def __init__(
        self, robot: str, first_step: int, drive: Callable[[SensorData], tuple[float, float]]
    ) -> None:
        self.step = first_step
        self.finished = False
        self.senses: list[SensorData] = []
        self.received: list[RadioEvents] = []
        self.talks = False
        self.says: dict[int, ScriptedAnswer] = {}
        self.lies: dict[int, Drive] = {}
        """Fixed answers by step."""
        self._robot = robot
        self._drive = drive

    def missing(self, have: Inputs) -> Sequence[Address]:
        if SENSES.key(self._robot) not in have:
            return (at(SENSES, self._robot),)
        events = read(have, SENSES, self._robot).events
        wanted = RECEIVED.key(self._robot)
        return (at(RECEIVED, self._robot),) if events and wanted not in have else ()

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        senses = read(inputs, SENSES, self._robot)
        self.senses.append(senses)
        if senses.events:
            received = read(inputs, RECEIVED, self._robot)
            assert len(received.events) == senses.events
            self.received.append(received)
        self.step = senses.step
        if senses.halt:
            self.finished = True
            return ()
        v, omega = self._drive(senses)
        frames = (OutgoingFrame(senses.step, senses.instant, b"x" * 20),) if self.talks else ()
        outputs = [to(TRANSMIT, Transmit(senses.step, frames), self._robot)] if frames else []
        says = self.says.get(senses.step, ScriptedAnswer())
        drive = Drive(senses.step, v, 0.0, omega, len(frames), says.reports, says.given_up, says.route)
        drive = self.lies.get(senses.step, drive)
        self.step += 1
        return [*outputs, to(DRIVE, drive, self._robot)]


class FloorRecorder(NullJournal):
    """Recorder of the changes of the floor."""

    def __init__(self) -> None:
        self.changes: list[FloorChanged] = []

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        if key == FLOOR_CHANGED.key():
            message = decode(at(FLOOR_CHANGED).topic, key, payload)
            assert isinstance(message, FloorChanged) and message.step == step
            self.changes.append(message)


class ScriptedSwarm:
    def __init__(
        self,
        seconds: float,
        events: Sequence[tuple[float, Order]] = (),
        robots: Sequence[str] = ("r1", "r2"),
        drive: Callable[[SensorData], tuple[float, float]] = lambda senses: (0.2, 0.0),
        talks: Sequence[str] = (),
        kernels: Mapping[str, str] | None = None,
        places: tuple[tuple[float, float], ...] = ((15.0, 12.5),),
        charge: float | None = None,
        task: str = "cleaning",
        settings: Mapping[str, object] | None = None,
    ) -> None:
        setup = self.setup_of(robots, seconds, events, places, charge, task, settings)
        self.bus = MemoryBus()
        self.floor = FloorRecorder()
        self.core = build_world(setup)
        self.bodies = self.core._bodies
        self.world = self._shell(self.core, self.core.listens(), "world", self.core.optional_inputs)
        addresses = tuple((robot, number + 1) for number, robot in enumerate(robots))
        self.radio = build_radio(RadioSetup(seed=1, step_us=STEP, robots=addresses))
        radio = self._shell(self.radio, (at(TRUTH), at(TRANSMIT, "*")), "radio")
        self.shells = [self.world, radio]
        self.truths: list[Truth] = []
        self.progress: list[Progress] = []
        self.rosters = 0
        self.acts: dict[str, ScriptedRobot] = {}
        self._drive, self._talks = drive, talks
        self.bus.listen(at(ROSTER), self._start_ordered)
        self.bus.listen(at(TRUTH), lambda d: self.truths.append(told(d, Truth)))
        self.bus.listen(at(PROGRESS), lambda d: self.progress.append(told(d, Progress)))
        radio.send(to(RADIO_READY, Ready(0, "radio", 0, "")))
        for robot in robots:
            self.start(robot, 0, 0, (kernels or {}).get(robot, "k"))

    @staticmethod
    def setup_of(
        robots: Sequence[str],
        seconds: float = 1.0,
        events: Sequence[tuple[float, Order]] = (),
        places: tuple[tuple[float, float], ...] = (),
        charge: float | None = None,
        task: str = "cleaning",
        settings: Mapping[str, object] | None = None,
    ) -> WorldSetup:
        setups = tuple(
            BodySetup(robot, "turtlebot2", None, STARTS[robot], places, odometry="exact", battery=charge)
            for robot in robots
        )
        timed = tuple(TimedOrder(round(when * 1e6), order) for when, order in events)
        return WorldSetup(
            map="maps/corridor.yaml",
            seed=1,
            step_us=STEP,
            duration_us=round(seconds * 1e6),
            robots=setups,
            task=task_setup(task, settings or {}),
            events=timed,
        )

    def start(self, robot: str, epoch: int, step: int, kernels: str = "k") -> None:
        name = f"{robot}.{epoch}" if epoch else robot
        core = ScriptedRobot(robot, step, self._drive)
        core.talks = robot in self._talks
        self.acts[name] = core
        shell = self._shell(core, (at(SENSES, robot), at(RECEIVED, robot)), name)
        self.shells.append(shell)
        shell.send(to(READY, Ready(step, robot, epoch, kernels), robot))

    @property
    def places(self) -> tuple[PlaceOutcome, ...]:
        referee = self.judge
        assert isinstance(referee, Referee)
        return tuple(referee.places(self.core._participants.present))

    @property
    def judge(self) -> Judge:
        """The task's judge."""
        checked = self.core.judge
        assert isinstance(checked, CheckedJudge)
        return checked.judge

    def run(self) -> "ScriptedSwarm":
        run_shells(self.shells)
        return self

    @property
    def digest(self) -> str:
        return run_digest([shell.counts.hash.digest(shell.actor) for shell in self.shells])

    @property
    def undelivered(self) -> int:
        return sum(s.counts.published - s.counts.received for s in self.shells) - self.rosters

    def _shell(
        self,
        core: Core,
        listens: Sequence[Address],
        name: str,
        optional_inputs: Callable[[], Sequence[Address]] = tuple,
    ) -> Shell:
        shell = Shell(core, self.bus, self.floor, actor=name, optional_inputs=optional_inputs)
        for address in listens:
            self.bus.listen(address, shell.deliver)
        return shell

    def _start_ordered(self, delivery: Delivery) -> None:
        roster = told(delivery, Roster)
        self.rosters += 1
        for order in roster.start:
            old = next(shell for shell in self.shells[::-1] if shell.actor.split(".")[0] == order.robot)
            while not old.finished and old.pump() is None:
                pass
            self.bus.leave(old.deliver)
            self.start(order.robot, order.epoch, roster.step)


def told(delivery: Delivery, kind: type[M]) -> M:
    message = decode(delivery.topic, delivery.key, delivery.payload)
    assert isinstance(message, kind)
    return message
