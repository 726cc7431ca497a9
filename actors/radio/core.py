"""The radio as an actor: ground truth and frames to send in, what the transceivers say out."""

from collections.abc import Mapping, Sequence

from actors.introspection import PERIOD
from actors.message_limits import transmit_fault
from actors.messages import (
    AIRED,
    FRAME_OUTCOMES,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    Aired,
    EventCount,
    FrameOutcomes,
    Outgoing,
    RadioEvent,
    Received,
    Refused,
    RobotTruth,
    Truth,
)
from actors.radio.frame import size_fault
from actors.radio.radio_model import DirectReach, RadioModel
from actors.radio.robot_medium import FrameCounters, Handed, RobotMedium, TransceiverTruth
from actors.runtime.core import Address, Inputs, Output, at, read, to
from actors.runtime.errors import AcrcError


class Host:
    """Holds up to `buffer` events for a robot that does not step; what comes later is dropped and counted."""

    def __init__(self, buffer: int, outcomes: FrameCounters) -> None:
        self._buffer = buffer
        self._outcomes = outcomes
        self.held: list[RadioEvent] = []
        """What waits until the robot steps."""
        self._epoch: int | None = None

    def deliver(
        self, events: list[RadioEvent], powered: bool, stepping: bool, epoch: int = 0
    ) -> list[RadioEvent]:
        """What the robot is given now: all that is held and the new events if it steps, otherwise nothing.

        A robot without power is given nothing, and what was held for it is discarded and counted; so is in a
        new epoch what was held for the one before.
        """
        if epoch != self._epoch:
            self._outcomes.events("discarded", len(self.held))
            self.held, self._epoch = [], epoch
        if not powered:
            self._outcomes.events("discarded", len(self.held) + len(events))
            self.held = []
            return []
        if stepping:
            held, self.held = self.held, []
            return held + events if held else events
        room = self._buffer - len(self.held)
        self.held += events[:room]
        self._outcomes.events("dropped", len(events) - min(room, len(events)))
        return []


_TRUTH_ONLY = (at(TRUTH),)


class RadioCore:
    """The core of the radio's process (see `actors.runtime.core.Core`).

    In step k it awaits Truth(k) and the Transmit(k) of each robot that steps and has frames. It gives
    Received(k+1) of each robot that has events and steps by Truth(k), then Aired(k), which counts them. The
    events lie before the step's end.
    """

    def __init__(
        self,
        robots: Sequence[tuple[str, int]],
        step_us: int,
        model: RadioModel,
        seed: int,
        *,
        records_outcomes: bool = False,
    ) -> None:
        """`records_outcomes`: give FrameOutcomes too, once per PERIOD and at the end."""
        self._records_outcomes = records_outcomes
        self._step = 0
        self._step_us = step_us
        self._finished = False
        self._outcomes = FrameCounters(len(robots))
        addresses = [address for _, address in robots]
        self._medium = RobotMedium(addresses, model, seed, keeps_outcomes=records_outcomes)
        self._reach = DirectReach(model.parameters, model.propagation)
        self._number = {robot: number for number, (robot, _) in enumerate(robots)}
        self._ids = [robot for robot, _ in robots]
        self._hosts = {robot: Host(model.parameters.host_buffer, self._outcomes) for robot in self._ids}

    @property
    def step(self) -> int:
        """The step that the radio is in."""
        return self._step

    @property
    def finished(self) -> bool:
        """True once the world has halted the run."""
        return self._finished

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Truth, then the Transmit of each robot that announced frames, in Truth's order."""
        if TRUTH.pattern not in have:
            return _TRUTH_ONLY
        truth = read(have, TRUTH)
        if truth.halt:
            return ()
        return [at(TRANSMIT, r.id) for r in _senders(truth) if TRANSMIT.key(r.id) not in have]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Compute the medium over the step."""
        truth = read(inputs, TRUTH)
        if truth.halt:
            self._finished = True
            outcomes = self._medium.take_outcomes()
            return [to(FRAME_OUTCOMES, FrameOutcomes(self._step, outcomes))] if outcomes else ()
        if truth.step != self._step:
            wrong = f"gives Truth of step {truth.step}; it should be of step {self._step}"
            raise AcrcError(f"Step {self._step}: the world {wrong}.")
        given = self._delivered(truth, self._events(truth, inputs))
        outputs = [
            to(RECEIVED, Received(self._step + 1, tuple(some)), robot) for robot, some in given.items()
        ]
        if self._records_outcomes and self._step * self._step_us % PERIOD < self._step_us:
            outputs.append(to(FRAME_OUTCOMES, FrameOutcomes(self._step, self._medium.take_outcomes())))
        counts = tuple([EventCount(robot, len(some)) for robot, some in given.items()])
        outputs.append(to(AIRED, Aired(self._step, counts)))
        self._step += 1
        return outputs

    def _delivered(self, truth: Truth, events: Mapping[str, list[RadioEvent]]) -> dict[str, list[RadioEvent]]:
        """What each robot that is given anything is given now."""
        given: dict[str, list[RadioEvent]] = {}
        for robot in truth.robots:
            if robot.id in events:
                received = events[robot.id]
            elif robot.id in self._hosts and self._hosts[robot.id].held:
                received = []
            else:
                continue
            if robot.id in self._hosts:  # one without a transceiver hears of refusals alone
                host = self._hosts[robot.id]
                received = host.deliver(received, robot.powered, robot.stepping, robot.epoch)
            if received:
                given[robot.id] = received
        return given

    def counters(self) -> dict[str, int]:
        """What became of all frames and events (`FrameCounters.counters`).

        `frames_pending` are still under way. And how many pairs of robots were in direct reach
        (`DirectReach.counters`).
        """
        medium = self._medium.medium
        counters = self._outcomes.counters(medium.counters()) | {"frames_pending": medium.pending}
        counters["events_discarded"] += self._medium.discarded
        return counters | self._reach.counters()

    def counters_by_robot(self) -> dict[str, dict[str, int]]:
        """What became of each robot's frames, and of the others' at it (`FrameCounters.by_robot`)."""
        return self._outcomes.by_robot(self._ids, self._medium.medium.counters())

    def _events(self, truth: Truth, inputs: Inputs) -> dict[str, list[RadioEvent]]:
        """The step's events by robot, in order of their instants."""
        requests, refusals = self._requests(truth, inputs)
        robots: Sequence[RobotTruth | None] = truth.robots
        if [robot.id for robot in truth.robots] != self._ids:
            by_id = {robot.id: robot for robot in truth.robots}
            robots = [by_id.get(robot) for robot in self._ids]
        transceivers = TransceiverTruth(truth.instant, robots)
        if self._reach.due(truth.instant):
            self._reach.see(truth.instant, transceivers.places[list(transceivers.powered)])
        until = truth.instant + self._step_us
        for loss in truth.losses:
            if loss.robot in self._number and loss.sender in self._number:
                self._medium.medium.withhold(self._number[loss.sender], self._number[loss.robot])
        notices = self._medium.advance(transceivers, truth.jams, requests, until)
        events = {robot: said for robot, said in zip(self._ids, notices, strict=True) if said}
        for robot_id, refused in refusals:
            events.setdefault(robot_id, []).append(refused)
        for robot_id in dict.fromkeys(robot_id for robot_id, _ in refusals):
            events[robot_id].sort(key=lambda event: event.instant)
        return events

    def _requests(self, truth: Truth, inputs: Inputs) -> tuple[list[Handed], list[tuple[str, Refused]]]:
        """The frames for the medium, and those that it is not given."""
        requests: list[Handed] = []
        refusals: list[tuple[str, Refused]] = []
        for robot in _senders(truth):
            transmit = read(inputs, TRANSMIT, robot.id)
            if wrong := transmit_fault(transmit, self._step, robot.transmits):
                raise AcrcError(f"Step {self._step}: {robot.id} {wrong}.")
            for frame in transmit.frames:
                fault = self._fault(robot.id, frame, truth.instant)
                if fault:
                    nearest = min(max(frame.instant, truth.instant), truth.instant + self._step_us - 1)
                    refusals.append((robot.id, Refused(nearest, frame.tag, fault)))
                elif robot.powered:
                    requests.append(Handed(frame.instant, self._number[robot.id], frame.tag, frame.data))
                else:
                    self._outcomes.discarded[self._number[robot.id]] += 1
        self._outcomes.refused += len(refusals)
        return requests, refusals

    def _fault(self, robot: str, frame: Outgoing, start: int) -> str:
        """One sentence on why the frame is not accepted; empty if it is."""
        if robot not in self._number:
            return f"Robot {robot} has no transceiver; the radio was set up without it."
        if not start <= frame.instant < start + self._step_us:
            return (
                f"The frame's instant {frame.instant} µs lies outside step {self._step}; "
                f"it must be {start} to {start + self._step_us - 1} µs."
            )
        return size_fault(len(frame.data))


def _senders(truth: Truth) -> list[RobotTruth]:
    return [robot for robot in truth.robots if robot.stepping and robot.transmits > 0]
