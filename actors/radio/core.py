"""The radio as an actor: takes ground truth and frames to send, returns events of transceivers."""

from collections.abc import Mapping, Sequence

from actors.introspection import PERIOD
from actors.message_limits import transmit_fault
from actors.messages import (
    AIRED,
    FRAME_OUTCOMES,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    EventCount,
    FrameOutcomes,
    FrameRefused,
    OutgoingFrame,
    RadioAdvanced,
    RadioEvent,
    RadioEvents,
    RobotTruth,
    Truth,
)
from actors.radio.frame import size_fault
from actors.radio.radio_model import DirectReach, RadioModel
from actors.radio.robot_medium import FrameCounters, RobotMedium, SubmittedFrame, TransceiverTruth
from actors.runtime.core import Address, Inputs, Output, at, read, to
from actors.runtime.errors import AcrcError


class EventBuffer:
    """Holds up to `buffer` events for a robot that is not stepping; further events are dropped and
    counted."""

    def __init__(self, buffer: int, outcomes: FrameCounters) -> None:
        self._buffer = buffer
        self._outcomes = outcomes
        self.held: list[RadioEvent] = []
        """Events held until the robot steps."""
        self._epoch: int | None = None

    def deliver(
        self, events: list[RadioEvent], powered: bool, stepping: bool, epoch: int = 0
    ) -> list[RadioEvent]:
        """Return the events for the robot now: held and new ones if it steps, otherwise none.

        Events for a robot without power, and events held for an earlier epoch, are discarded and counted.
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
    """Core of the radio's process (see `actors.runtime.core.Core`).

    In step k it waits for Truth(k) and the Transmit(k) of each stepping robot that has frames. It returns
    RadioEvents(k+1) of each stepping robot that has events, then RadioAdvanced(k) with their counts. The
    events are before the end of the step.
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
        """Create the core; `records_outcomes`: also send FrameOutcomes, once per PERIOD and at the end."""
        self._records_outcomes = records_outcomes
        self._step = 0
        self._step_us = step_us
        self._finished = False
        self._outcomes = FrameCounters(len(robots))
        addresses = [address for _, address in robots]
        self._medium = RobotMedium(addresses, model, seed, keeps_outcomes=records_outcomes)
        self._airtimes: dict[str, int] = {}
        """Airtime of each robot at the last `_take_airtimes`, ns."""
        self._reach = DirectReach(model.parameters, model.propagation)
        self._number = {robot: number for number, (robot, _) in enumerate(robots)}
        self._ids = [robot for robot, _ in robots]
        self._buffers = {
            robot: EventBuffer(model.parameters.host_buffer, self._outcomes) for robot in self._ids
        }

    @property
    def step(self) -> int:
        """Number of the current step."""
        return self._step

    @property
    def finished(self) -> bool:
        """True after the world has halted the run."""
        return self._finished

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return Truth, then the Transmit of each robot that announced frames, in Truth's order."""
        if TRUTH.pattern not in have:
            return _TRUTH_ONLY
        truth = read(have, TRUTH)
        if truth.halt:
            return ()
        return [at(TRANSMIT, r.id) for r in _senders(truth) if TRANSMIT.key(r.id) not in have]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Simulate the medium over the step."""
        truth = read(inputs, TRUTH)
        if truth.halt:
            self._finished = True
            outcomes = self._medium.take_outcomes()
            return [to(FRAME_OUTCOMES, FrameOutcomes(self._step, outcomes))] if outcomes else ()
        if truth.step != self._step:
            raise AcrcError(
                f"step {self._step}: the world sent Truth of step {truth.step}; expected step {self._step}"
            )
        delivered = self._deliver_events(truth, self._events(truth, inputs))
        outputs = [
            to(RECEIVED, RadioEvents(self._step + 1, tuple(robot_events)), robot)
            for robot, robot_events in delivered.items()
        ]
        if self._records_outcomes and self._step * self._step_us % PERIOD < self._step_us:
            outputs.append(to(FRAME_OUTCOMES, FrameOutcomes(self._step, self._medium.take_outcomes())))
        counts = tuple([EventCount(robot, len(robot_events)) for robot, robot_events in delivered.items()])
        airtimes = self._take_airtimes(truth) if truth.charges else ()
        outputs.append(to(AIRED, RadioAdvanced(self._step, counts, airtimes)))
        self._step += 1
        return outputs

    def _take_airtimes(self, truth: Truth) -> tuple[int, ...]:
        """Return the airtime since the last call, ns, of each robot of `truth`."""
        before, now = self._airtimes, dict(zip(self._ids, self._medium.medium.airtimes_ns, strict=True))
        self._airtimes = now
        return tuple([now.get(robot.id, 0) - before.get(robot.id, 0) for robot in truth.robots])

    def _deliver_events(
        self, truth: Truth, events: Mapping[str, list[RadioEvent]]
    ) -> dict[str, list[RadioEvent]]:
        """Return the events delivered now, by robot."""
        delivered: dict[str, list[RadioEvent]] = {}
        for robot in truth.robots:
            if robot.id in events:
                received = events[robot.id]
            elif robot.id in self._buffers and self._buffers[robot.id].held:
                received = []
            else:
                continue
            if robot.id in self._buffers:  # a robot without transceiver gets refusals only
                buffer = self._buffers[robot.id]
                received = buffer.deliver(received, robot.powered, robot.stepping, robot.epoch)
            if received:
                delivered[robot.id] = received
        return delivered

    def counters(self) -> dict[str, int]:
        """Return counts of frames and events (`FrameCounters.counters`).

        `frames_pending`: frames still in progress. Includes pairs of robots in direct reach
        (`DirectReach.counters`).
        """
        medium = self._medium.medium
        counters = self._outcomes.counters(medium.counters()) | {"frames_pending": medium.pending}
        counters["events_discarded"] += self._medium.discarded
        return counters | self._reach.counters()

    def counters_by_robot(self) -> dict[str, dict[str, int]]:
        """Return counts of each robot's frames and of others' frames at it (`FrameCounters.by_robot`)."""
        return self._outcomes.by_robot(self._ids, self._medium.medium.counters())

    def _events(self, truth: Truth, inputs: Inputs) -> dict[str, list[RadioEvent]]:
        """Return the step's events by robot, in order of time."""
        requests, refusals = self._requests(truth, inputs)
        robots: Sequence[RobotTruth | None] = truth.robots
        if [robot.id for robot in truth.robots] != self._ids:
            by_id = {robot.id: robot for robot in truth.robots}
            robots = [by_id.get(robot) for robot in self._ids]
        transceivers = TransceiverTruth(truth.instant, robots)
        if self._reach.is_due(truth.instant):
            self._reach.count_pairs(truth.instant, transceivers.places[list(transceivers.powered)])
        until = truth.instant + self._step_us
        for loss in truth.losses:
            if loss.robot in self._number and loss.sender in self._number:
                self._medium.medium.withhold(self._number[loss.sender], self._number[loss.robot])
        notices = self._medium.advance(transceivers, truth.jams, requests, until)
        events = {robot: new for robot, new in zip(self._ids, notices, strict=True) if new}
        for robot_id, refused in refusals:
            events.setdefault(robot_id, []).append(refused)
        for robot_id in dict.fromkeys(robot_id for robot_id, _ in refusals):
            events[robot_id].sort(key=lambda event: event.instant)
        return events

    def _requests(
        self, truth: Truth, inputs: Inputs
    ) -> tuple[list[SubmittedFrame], list[tuple[str, FrameRefused]]]:
        """Return the frames for the medium, and the refused ones."""
        requests: list[SubmittedFrame] = []
        refusals: list[tuple[str, FrameRefused]] = []
        for robot in _senders(truth):
            transmit = read(inputs, TRANSMIT, robot.id)
            if wrong := transmit_fault(transmit, self._step, robot.transmits):
                raise AcrcError(f"step {self._step}: {robot.id} {wrong}")
            for frame in transmit.frames:
                fault = self._refusal(robot.id, frame, truth.instant)
                if fault:
                    nearest = min(max(frame.instant, truth.instant), truth.instant + self._step_us - 1)
                    refusals.append((robot.id, FrameRefused(nearest, frame.tag, fault)))
                elif robot.powered:
                    requests.append(
                        SubmittedFrame(frame.instant, self._number[robot.id], frame.tag, frame.data)
                    )
                else:
                    self._outcomes.discarded[self._number[robot.id]] += 1
        self._outcomes.refused += len(refusals)
        return requests, refusals

    def _refusal(self, robot: str, frame: OutgoingFrame, start: int) -> str:
        """Return why the frame is refused, as a sentence; empty if it is accepted."""
        if robot not in self._number:
            return f"Robot {robot} has no transceiver; it is not in the radio's set-up."
        if not start <= frame.instant < start + self._step_us:
            return (
                f"The frame's instant {frame.instant} µs is outside step {self._step}; "
                f"it must be {start} to {start + self._step_us - 1} µs."
            )
        return size_fault(len(frame.data))


def _senders(truth: Truth) -> list[RobotTruth]:
    return [robot for robot in truth.robots if robot.stepping and robot.transmits > 0]
