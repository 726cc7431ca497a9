"""The world: conductor of simulated time and source of ground truth.

A step has three phases. OPEN: at its start, carry out due orders and send SensorData. CLOSE: when every robot
has answered, send Truth. MOVE: run the physics to the end of the step. A roll call precedes the first step
and each restart.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Any, Final

import msgspec

from actors.instant import Instant, in_seconds
from actors.message_limits import drive_fault
from actors.messages import (
    AIRED,
    ANSWERED,
    CONTROL,
    DRIVE,
    FLOOR_CHANGED,
    FLOOR_NEWS,
    PROGRESS,
    RADIO_READY,
    READY,
    ROSTER,
    TASK_CHANGED,
    TASK_NEWS,
    TRUTH,
    Drive,
    FloorChanged,
    OrderOutcomes,
    Progress,
    RadioAdvanced,
    Ready,
    RobotTruth,
    Roster,
    TaskChanged,
    Truth,
)
from actors.runtime.core import Address, Inputs, Output, at, read, to
from actors.runtime.errors import AcrcError
from actors.runtime.processor import differing_kernels, first_names, parse_fingerprints
from actors.task.loading import ReportError, decode_reports
from actors.task.task import Judge, Task, TaskOutcome
from actors.wording import short_repr
from actors.world.body import Bodies
from actors.world.order_execution import OrderEffects, Orders
from actors.world.sensing import PoseErrorSum, WorldReport
from actors.world.world_setup import BarrierState, Member, Participants, WorldSetup

_MOST_CHANGES: Final = 200
"""Most marks and most events of the task in one message."""
_MAX_NAME: Final = 32
"""Maximum length of a received name in a message; names of this software are shorter."""


class WorldPhase(Enum):
    """Phase of the world within a step."""

    ROLL_CALL = "roll call"
    OPEN = "open"
    CLOSE = "close"
    MOVE = "move"
    PAUSED = "paused"


class WorldCore:
    """Conducts the steps; the module describes the phases."""

    def __init__(
        self, setup: WorldSetup, bodies: Bodies, participants: Participants, task: Task, judge: Judge
    ) -> None:
        self._setup = setup
        self._bodies = bodies
        self._participants = participants
        self._task = task
        self.judge = judge
        """Judge of the task."""
        self._pose_errors = [PoseErrorSum() for _ in setup.robots]
        self._orders = Orders(setup.events, participants, bodies, task, judge)
        self.step = 0
        """Number of the current step."""
        self._phase = WorldPhase.ROLL_CALL
        self.finished = False
        """True after Truth with `halt` was sent."""
        self._pause_at: int | None = None
        """Step at whose start to pause next."""
        self.speed: float | None = None
        """Last ordered speed, simulated seconds per second; 0: unlimited, None: never ordered."""
        self._awaits_radio = True
        self._restarting = False

    @property
    def instant(self) -> Instant:
        """Start of the current step."""
        return Instant(self.step * self._setup.step_us)

    @property
    def paused(self) -> bool:
        """True while the world waits for Resume or Stop."""
        return self._phase is WorldPhase.PAUSED

    @property
    def opening(self) -> bool:
        """True before the next step begins."""
        return self._phase is WorldPhase.OPEN

    @property
    def task_outcome(self) -> TaskOutcome:
        """Outcome of the task so far."""
        return self.judge.outcome(self._participants.present, self.instant)

    def report(self) -> WorldReport:
        """Return the ground truth so far."""
        members, driven = self._participants.members, self._bodies.driven
        energies = {member.id: self._bodies.batteries.report(member.index) for member in members}
        return WorldReport(
            contacts=self._bodies.contacts,
            pose_errors={member.id: self._pose_errors[member.index].error() for member in members},
            driven={member.id: round(driven[member.index], 3) for member in members},
            steps=self.step,
            refused_orders=self._orders.refused,
            energy={robot: energy for robot, energy in energies.items() if energy is not None},
            **self._bodies.people_contacts,
        )

    def listens(self) -> Sequence[Address]:
        """Return all subscribed addresses."""
        return (at(READY, "*"), at(RADIO_READY), at(DRIVE, "*"), at(AIRED), at(CONTROL))

    def optional_inputs(self) -> Sequence[Address]:
        """Return the addresses of optional inputs: orders, at the start of a step."""
        return (at(CONTROL),) if self._phase is WorldPhase.OPEN else ()

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return the addresses that the current phase still waits for."""
        return [address for address in self._awaited() if address.key not in have]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Complete the current phase."""
        match self._phase:
            case WorldPhase.ROLL_CALL:
                return self._call_roll(inputs)
            case WorldPhase.OPEN | WorldPhase.PAUSED:
                return self._open(inputs)
            case WorldPhase.CLOSE:
                return self._close(inputs)
            case WorldPhase.MOVE:
                return self._move()

    def _awaited(self) -> list[Address]:
        match self._phase:
            case WorldPhase.ROLL_CALL:
                robots = [
                    at(READY, member.id) for member in self._participants.members_in(BarrierState.AWAITED)
                ]
                return [*robots, at(RADIO_READY)] if self._awaits_radio else robots
            case WorldPhase.OPEN:
                return [at(AIRED)] if self.step else []
            case WorldPhase.CLOSE:
                return [member.drive for member in self._participants.members_in(BarrierState.STEPPING)]
            case WorldPhase.PAUSED:
                return [at(CONTROL)]
            case WorldPhase.MOVE:
                return []

    def _call_roll(self, inputs: Inputs) -> Sequence[Output]:
        for member in self._participants.members_in(BarrierState.AWAITED):
            self._admit(member, read(inputs, READY, member.id))
        self._awaits_radio = False
        if self._restarting:
            self._restarting = False
            return self._send_senses()
        self._phase = WorldPhase.OPEN
        self.judge.watch(self.instant, self._bodies.positions)
        return [to(FLOOR_CHANGED, FloorChanged(self.step)), *self._task_changes()]

    def _admit(self, member: Member, ready: Ready) -> None:
        if (ready.actor, ready.epoch, ready.step) != (member.id, member.epoch, self.step):
            raise AcrcError(
                f"step {self.step}: {ready.actor[:_MAX_NAME]} reports ready for step {ready.step} in epoch "
                f"{ready.epoch}; "
                f"expected {member.id} in epoch {member.epoch}"
            )
        first = self._participants.members[0]
        if first.kernels and ready.kernels != first.kernels:
            names = differing_kernels(parse_fingerprints(first.kernels), parse_fingerprints(ready.kernels))
            source = first_names(names) or "unknown kernels"
            raise AcrcError(
                f"{ready.actor} and {first.id} compute different results in {source}; "
                "run the same version of this software on compatible processors"
            )
        member.kernels = ready.kernels
        member.state = BarrierState.STEPPING

    def _open(self, inputs: Inputs) -> Sequence[Output]:
        effects = self._orders.effects
        if self._phase is WorldPhase.OPEN:
            empty = self._end_step(read(inputs, AIRED)) if self.step else ()
            self._orders.begin(self.instant, empty)
            effects = self._orders.effects
            if self._pause_at == self.step:
                effects.paused, effects.steps = True, 0
        outputs = self._take_orders(inputs) + self._floor_changes() + self._task_changes()
        if effects.speed is not None:
            self.speed = effects.speed
        if effects.steps is not None:
            self._pause_at = self.step + effects.steps if effects.steps else None
        for start in effects.starts:
            self.judge.restart(start.robot)
            self._bodies.batteries.replace_empty(self._participants[start.robot].index)
        if effects.paused and not effects.stop:
            self._phase = WorldPhase.PAUSED
            return [*outputs, to(PROGRESS, self._progress())]
        ended = [self._participants[robot] for robot in effects.ends]
        outputs += [self._senses(member, self.instant, halt=True) for member in ended]
        if self._is_over(effects):
            return [*outputs, *self._halt()]
        if effects.starts:
            self._restarting = True
            self._phase = WorldPhase.ROLL_CALL
            return [*outputs, to(ROSTER, Roster(self.step, tuple(effects.starts)))]
        return [*outputs, *self._send_senses()]

    def _take_orders(self, inputs: Inputs) -> list[Output]:
        """Carry out an operator's orders; answer if they have a ticket."""
        if at(CONTROL).key not in inputs:
            return []
        control = read(inputs, CONTROL)
        refusals = self._orders.take(control.orders)
        return [to(ANSWERED, OrderOutcomes(self.step, control.ticket, refusals))] if control.ticket else []

    def _end_step(self, aired: RadioAdvanced) -> Sequence[int]:
        """Add event counts and airtimes of the last step; return the robots whose battery is now empty."""
        if aired.step != self.step - 1:
            raise AcrcError(
                f"{self._time_text()}: the radio reports step {aired.step}; expected step {self.step - 1}"
            )
        for count in aired.counts:
            if count.id not in self._participants or count.events < 1:
                raise AcrcError(
                    f"{self._time_text()}: the radio reports {count.events} events for "
                    f"{short_repr(count.id)}; expected at least 1, for a robot of this run"
                )
            self._participants[count.id].events += count.events
        batteries = self._bodies.batteries
        return batteries.end(self.instant, self._bodies.truth, aired.airtimes_ns) if batteries.exist else ()

    def _is_over(self, effects: OrderEffects) -> bool:
        if effects.stop or self.instant >= self._setup.duration_us:
            return True
        return self.judge.settled and not self._orders.pending and not effects.starts

    def _halt(self) -> list[Output]:
        running = self._participants.members_in(BarrierState.STEPPING, BarrierState.FROZEN)
        outputs = [self._senses(member, self.instant, halt=True) for member in running]
        self.finished = True
        self.judge.outcome(self._participants.present, self.instant)  # may show final marks
        outputs += self._task_changes()
        outputs.append(to(TRUTH, Truth(self.step, self.instant, (), halt=True)))
        outputs.append(to(PROGRESS, self._progress()))
        return outputs

    def _send_senses(self) -> list[Output]:
        self._phase = WorldPhase.CLOSE
        instant = self.instant
        return [
            self._senses(member, instant) for member in self._participants.members_in(BarrierState.STEPPING)
        ]

    def _senses(self, member: Member, instant: Instant, halt: bool = False) -> Output:
        events, member.events = member.events, 0
        items: tuple[Any, ...] = ()
        if member.given_items and not halt:  # a restarted process gets them all
            items, member.sent_items = member.given_items[member.sent_items :], len(member.given_items)
        senses = self._bodies.senses(member.index, self.step, instant, events, halt, items)
        return Output(member.senses, senses)

    def _close(self, inputs: Inputs) -> Sequence[Output]:
        transmits: dict[str, int] = {}
        estimates: dict[int, tuple[float, float, float]] = {}
        begin, end = self.instant, self.instant + self._setup.step_us
        for member in self._participants.members_in(BarrierState.STEPPING):
            drive: Drive = inputs[member.drive.key]  # type: ignore[assignment]  # as `read` returns
            if wrong := drive_fault(drive, self.step, begin, end):
                raise AcrcError(f"{self._time_text()}: {member.id} {wrong}")
            self._bodies.command(member.index, drive, begin)
            if drive.reports or drive.given_up or drive.route is not None:
                self._take_reports(member, drive, begin, end)
            if drive.pose is not None:
                estimates[member.index] = drive.pose
            transmits[member.id] = drive.transmits
        truths = [self._truth(member, transmits.get(member.id, 0)) for member in self._participants.members]
        for robot, pose in estimates.items():
            self._pose_errors[robot].add(pose, truths[robot])
        self._phase = WorldPhase.MOVE
        jams, losses = self._orders.effects.jams, self._orders.effects.losses
        charges: tuple[float | None, ...] = ()
        if self._bodies.batteries.exist:
            self._bodies.batteries.begin(truths)
            charges = tuple(self._bodies.batteries.charges)
        people = self._bodies.people
        truth = Truth(
            self.step,
            begin,
            tuple(truths),
            tuple(jams),
            losses=tuple(losses),
            charges=charges,
            people=people,
        )
        return (to(TRUTH, truth),)

    def _take_reports(self, member: Member, drive: Drive, begin: int, end: int) -> None:
        try:
            answer = decode_reports(self._task, drive, begin, end)
        except ReportError as error:
            wrong: str | None = str(error)
        else:
            wrong = self.judge.take(member.id, answer, begin, end)
        if wrong:
            raise AcrcError(f"{self._time_text()}: {member.id} {wrong}")

    def _time_text(self) -> str:
        return f"step {self.step} ({in_seconds(self.instant):g} s)"

    def _truth(self, member: Member, transmits: int) -> RobotTruth:
        stepping = member.state is BarrierState.STEPPING
        powered = member.state is not BarrierState.ENDED
        state = self._bodies.truth(member.index)
        return RobotTruth(member.id, *state, stepping, powered, transmits, member.epoch)

    def _move(self) -> Sequence[Output]:
        self._bodies.move(self.instant, self._setup.step_us)
        outputs = self._floor_changes()
        self.step += 1
        self._phase = WorldPhase.OPEN
        self.judge.watch(self.instant, self._bodies.positions)
        is_new_second = self.instant % 1_000_000 < self._setup.step_us
        return [*outputs, to(PROGRESS, self._progress())] if is_new_second else outputs

    def _floor_changes(self) -> list[Output]:
        changed = self._bodies.floor_record.take(self.step)
        return [] if changed is None else [to(FLOOR_CHANGED, changed), to(FLOOR_NEWS, changed)]

    def _task_changes(self) -> list[Output]:
        """Return the changes of the task since the last call, in messages of bounded size."""
        marks, events = self.judge.take_changes()
        outputs = []
        for first in range(0, max(len(marks), len(events)), _MOST_CHANGES):
            part = slice(first, first + _MOST_CHANGES)
            changed = TaskChanged(self.step, marks[part], events[part])
            outputs += [to(TASK_CHANGED, changed), to(TASK_NEWS, changed)]
        return outputs

    def _progress(self) -> Progress:
        left, done = self.judge.progress(self._participants.present)
        return Progress(self.step, self.instant, left, done, self.finished, self.paused)

    def waiting(self, addresses: Sequence[Address]) -> Progress:
        """Return the progress while these messages are missing."""
        names = tuple(dict.fromkeys(address.robot or "radio" for address in addresses))
        wait = (
            self.describe_wait(addresses[0]) if addresses else f"step {self.step}: the world is not stepping"
        )
        starting = self._phase is WorldPhase.ROLL_CALL
        return msgspec.structs.replace(self._progress(), awaited=names, awaits=wait, starting=starting)

    def describe_wait(self, address: Address) -> str:
        """Describe a missing message and its sender."""
        return f"{self._time_text()}: no {address.topic.kind.__name__} from {address.robot or 'the radio'}"
