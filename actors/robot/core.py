"""The robot without I/O: it localises, drives, lets the behaviour decide, and sends what follows.

One step: Senses (and Received, if Senses counts events) in; Transmit (if there are frames) and Drive out.
Transmit goes first, so that it is under way when Drive lets the world, and after it the radio, go on.
The order within: localisation, navigation, behaviour. What the behaviour decides lies after the step's start,
so a new goal moves the base from the next step on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from actors.geometry import Twist
from actors.instant import Instant, in_seconds
from actors.messages import (
    DRIVE,
    FRAME_DATA_LIMIT,
    RECEIVED,
    SENSES,
    TRANSMIT,
    Drive,
    Message,
    RadioEvent,
    Received,
    Senses,
    Transmit,
)
from actors.robot.behaviour import BehaviourError
from actors.robot.localisation import Localisation
from actors.robot.navigation import Navigation
from actors.robot.ports import Behaviour, Decision, GoalOrder, View
from actors.robot.surroundings import Surroundings
from actors.runtime.core import Address, Inputs, Output, at, read, to
from actors.runtime.errors import AcrcError

_TAGS: Final = 2**32


class StepError(AcrcError):
    """A message that does not belong to the robot's step."""


@dataclass(frozen=True)
class RobotLimits:
    """What a behaviour may ask for."""

    frames: int = 32
    """Frames per step: at 250 kbit/s no more than 32 of 10 bytes leave in 20 ms (IEEE 802.15.4-2006)."""
    reports: int = 1000
    """Place reports per step."""
    moving_speed: float = 0.01
    """The base counts as moving above so many m/s ..."""
    moving_turn_rate: float = 0.02
    """... or rad/s."""


@dataclass(frozen=True)
class Parts:
    """What a robot is made of."""

    localisation: Localisation
    surroundings: Surroundings
    navigation: Navigation
    behaviour: Behaviour


class RobotCore:
    """One robot, from its first step on: 0, or that of a restart."""

    def __init__(
        self,
        robot: str,
        parts: Parts,
        *,
        entry: str,
        first_step: int,
        step_us: int,
        limits: RobotLimits = RobotLimits(),
    ) -> None:
        """`entry` names the behaviour in errors."""
        self._robot = robot
        self._parts = parts
        self._entry = entry
        self._step = first_step
        self._step_us = step_us
        self._limits = limits
        self._finished = False
        self._senses, self._received = at(SENSES, robot), at(RECEIVED, robot)

    @property
    def step(self) -> int:
        """The step that the robot is in."""
        return self._step

    @property
    def finished(self) -> bool:
        """True once Senses with `halt` has been taken in."""
        return self._finished

    def listens(self) -> Sequence[Address]:
        """Every address that a message may come in on."""
        return (self._senses, self._received)

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Senses, and then Received if Senses counts events."""
        if self._senses.key not in have:
            return (self._senses,)
        if read(have, SENSES, self._robot).events > 0 and self._received.key not in have:
            return (self._received,)
        return ()

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take one step."""
        senses = read(inputs, SENSES, self._robot)
        self._check_step(senses)
        events: tuple[RadioEvent, ...] = ()
        if senses.events > 0:
            received = read(inputs, RECEIVED, self._robot)
            self._check_received(received, senses.events)
            events = received.events
        if senses.halt:
            self._finished = True
            return ()
        decision, twist = self._act(senses, events)
        outputs = self._outputs(decision, twist)
        self._step += 1
        return outputs

    def _act(self, senses: Senses, events: tuple[RadioEvent, ...]) -> tuple[Decision, Twist]:
        parts, odometry, instant = self._parts, senses.odometry, Instant(senses.instant)
        pose = parts.localisation.update(odometry, senses.scan).pose
        parts.surroundings.take(instant, odometry, senses.scan)
        velocity = Twist(odometry.vx, odometry.vy, odometry.omega)
        twist = parts.navigation.advance(instant, pose, velocity)
        moving = (
            max(abs(velocity.vx), abs(velocity.vy)) > self._limits.moving_speed
            or abs(velocity.omega) > self._limits.moving_turn_rate
        )
        view = View(instant, pose, moving, parts.navigation.goal, events)
        decision = self._decide(view, Instant(instant + self._step_us))
        parts.navigation.take(decision.goal)
        return decision, twist

    def _decide(self, view: View, until: Instant) -> Decision:
        try:
            decision = self._parts.behaviour.advance(view, until)
        except Exception as error:
            error.add_note(f"in {self._where(view.instant)}")
            raise
        if not isinstance(decision, Decision):
            raise self._fault(view, f"gives a {type(decision).__name__} where a Decision is due")
        if not isinstance(decision.goal, GoalOrder) and len(decision.goal) != 2:
            raise self._fault(
                view, f"gives {decision.goal!r} for a goal; it should be a Point or a GoalOrder"
            )
        if decision.frames:
            self._check_frames(decision, view, until)
        if len(decision.reports) > self._limits.reports:
            raise self._fault(
                view,
                f"reports {len(decision.reports)} places in one step; at most {self._limits.reports} may be",
            )
        return decision

    def _check_frames(self, decision: Decision, view: View, until: Instant) -> None:
        if len(decision.frames) > self._limits.frames:
            raise self._fault(
                view, f"sends {len(decision.frames)} frames in one step; at most {self._limits.frames} may be"
            )
        earliest = view.instant
        for frame in decision.frames:
            if not 0 < len(frame.data) <= FRAME_DATA_LIMIT:
                raise self._fault(
                    view, f"sends a frame of {len(frame.data)} bytes; it should have 1 to {FRAME_DATA_LIMIT}"
                )
            if not earliest <= frame.instant < until:
                raise self._fault(
                    view,
                    f"sends a frame at {frame.instant} µs; frames should be in order, "
                    f"from {view.instant} µs on and before {until} µs",
                )
            if not 0 <= frame.tag < _TAGS:
                raise self._fault(
                    view, f"sends a frame with the tag {frame.tag}; it should be 0 to {_TAGS - 1}"
                )
            earliest = Instant(frame.instant)

    def _outputs(self, decision: Decision, twist: Twist) -> list[Output]:
        frames = len(decision.frames)
        drive = Drive(
            self._step, twist.vx, twist.vy, twist.omega, frames, decision.tasks_left, decision.reports
        )
        if not frames:
            return [to(DRIVE, drive, self._robot)]
        transmit = Transmit(self._step, decision.frames)
        return [to(TRANSMIT, transmit, self._robot), to(DRIVE, drive, self._robot)]

    def _check_step(self, message: Message) -> None:
        if message.step != self._step:
            raise StepError(
                f"step {self._step}: {self._robot} got {type(message).__name__} of step {message.step}; "
                f"it should be of step {self._step}"
            )

    def _check_received(self, received: Received, events: int) -> None:
        self._check_step(received)
        if len(received.events) != events:
            raise StepError(
                f"step {self._step}: {self._robot} got {len(received.events)} radio events; "
                f"Senses counts {events}"
            )

    def _where(self, instant: int) -> str:
        return f"step {self._step} ({in_seconds(instant):g} s): behaviour {self._entry!r} of {self._robot}"

    def _fault(self, view: View, what: str) -> BehaviourError:
        return BehaviourError(f"{self._where(view.instant)} {what}")
