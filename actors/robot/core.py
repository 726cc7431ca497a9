"""The robot without I/O: it localises, drives, lets the behaviour decide, and sends what follows.

One step: Senses (and Received, if Senses counts events) in; Transmit (if there are frames) and Drive out.
Transmit goes first, so that it is under way when Drive lets the world, and after it the radio, go on.
The order within: localisation, navigation, behaviour. What the behaviour decides lies after the step's start,
so a new goal moves the base from the next step on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, in_seconds
from actors.message_limits import senses_fault
from actors.messages import (
    DRIVE,
    INTROSPECTION,
    RECEIVED,
    SENSES,
    TRANSMIT,
    Drive,
    RadioEvent,
    Received,
    Senses,
    Transmit,
)
from actors.robot.behaviour.decisions import RobotLimits, fault, outcome_fault
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.ports import Behaviour, Decision, View
from actors.robot.introspection import Introspector
from actors.robot.localisation import Localisation
from actors.robot.navigation.navigator import Navigator
from actors.robot.sweep import Sweeps
from actors.runtime.core import Address, Inputs, Output, at
from actors.runtime.errors import AcrcError
from deeco.knowledge import made
from deeco.node import looking_on

_LIMITS: Final = RobotLimits()


@dataclass(frozen=True)
class MotionThresholds:
    """From when on a base counts as moving; own choices, above the noise of wheel encoders."""

    speed: float = 0.01
    """m/s."""
    turn_rate: float = 0.02
    """rad/s."""

    def exceeded_by(self, velocity: Twist) -> bool:
        """True if the base moves."""
        vx, vy, omega = velocity
        most, turn = self.speed, self.turn_rate
        return not (-most <= vx <= most and -most <= vy <= most and -turn <= omega <= turn)


@dataclass(frozen=True)
class RobotParts:
    """What a robot is made of."""

    sweeps: Sweeps
    localisation: Localisation
    navigation: Navigator
    behaviour: Behaviour
    moving: MotionThresholds = MotionThresholds()
    introspector: Introspector | None = None
    """None: only results and causes are recorded."""


class RobotCore:
    """One robot, from its first step on: 0, or that of a restart."""

    def __init__(
        self,
        robot: str,
        parts: RobotParts,
        *,
        entry: str,
        first_step: int,
        step_us: int,
        limits: RobotLimits = _LIMITS,
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
        self._drive, self._transmit = at(DRIVE, robot), at(TRANSMIT, robot)
        self._introspection = at(INTROSPECTION, robot)
        self._introspector = parts.introspector

    @property
    def navigation(self) -> Navigator:
        """What drives the robot."""
        return self._parts.navigation

    @property
    def localisation(self) -> Localisation:
        """What tells the robot where it is."""
        return self._parts.localisation

    @property
    def behaviour(self) -> Behaviour:
        """The user's part; for those who execute a robot again to look into it."""
        return self._parts.behaviour

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
        senses: Senses = have[self._senses.key]  # type: ignore[assignment]  # as `read` gives it
        if senses.events > 0 and self._received.key not in have:
            return (self._received,)
        return ()

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take one step."""
        senses: Senses = inputs[self._senses.key]  # type: ignore[assignment]  # as `read` gives it
        self._catch_up(senses)
        events: tuple[RadioEvent, ...] = ()
        if senses.events > 0:
            received: Received = inputs[self._received.key]  # type: ignore[assignment]
            self._check_received(received, senses.events)
            events = received.events
        if senses.halt:
            self._finished = True
            return ()
        if self._introspector is None:
            outputs = self._outputs(*self._act(senses, events))
        else:
            with looking_on(self._introspector):  # a successor's node is made in a later step
                outputs = self._outputs(*self._act(senses, events))
            told = self._introspector.end(self._step, self._parts.behaviour)
            outputs += () if told is None else (Output(self._introspection, told),)
        self._step += 1
        return outputs

    def outcome(self) -> dict[str, object]:
        """What there is to say about the run, by subject: the robot's own, and what its behaviour adds."""
        parts = self._parts
        own: dict[str, object] = {
            "localisation": parts.localisation.outcome(),
            "navigation": parts.navigation.report(),
        }
        say = getattr(parts.behaviour, "outcome", None)
        if say is None:
            return own
        outcome = say()
        if wrong := outcome_fault(outcome, tuple(own)):
            raise BehaviourError(f"step {self._step}: behaviour {self._entry!r} of {self._robot} {wrong}")
        return own | cast(dict[str, object], outcome)

    def _act(self, senses: Senses, events: tuple[RadioEvent, ...]) -> tuple[Decision, Twist, Pose | None]:
        parts, odometry, instant = self._parts, senses.odometry, Instant(senses.instant)
        here = made(Pose, (odometry.x, odometry.y, odometry.heading))
        sweep = parts.sweeps.take(instant, here, senses.scan)
        newest = sweep
        for scan in senses.earlier_scans:
            earlier = parts.sweeps.placed(scan)
            newest = earlier if sweep is None else sweep
            parts.localisation.update(here, earlier)
            parts.navigation.sense(instant, here, earlier)
        estimate = parts.localisation.update(here, sweep)
        if self._introspector is not None:
            self._introspector.begin(instant, here, estimate, newest)
        pose = estimate.pose
        velocity = made(Twist, (odometry.vx, odometry.vy, odometry.omega))
        parts.navigation.sense(instant, here, sweep)
        twist = STILL
        if estimate.located:  # else it stands: navigation waits, too
            twist = parts.navigation.advance(instant, here, pose, velocity, senses.bumper != 0)
        moving = parts.moving.exceeded_by(velocity)
        driven = parts.navigation
        view = View(
            instant=instant,
            pose=pose,
            moving=moving,
            goal=driven.goal,
            radio=events,
            covariance=estimate.covariance,
            lost=estimate.lost,
            plan=driven.plan,
            backing_out=driven.backing_out,
            places=tuple(Point(*place) for place in senses.places) if senses.places else (),
        )
        decision = self._decide(view, Instant(instant + self._step_us))
        driven.take(decision.goal, decision.paused, decision.back_out)
        if decision.relocalise:
            parts.localisation.relocalise()
        if decision.peers is not None:
            parts.localisation.mask(decision.peers)
        return decision, twist, pose if estimate.located else None

    def _decide(self, view: View, until: Instant) -> Decision:
        try:
            decision = self._parts.behaviour.advance(view, until)
        except Exception as error:
            error.add_note(f"in {self._where(view.instant)}")
            raise
        if wrong := fault(decision, view.instant, until, self._limits):
            raise BehaviourError(f"{self._where(view.instant)} {wrong}")
        return decision

    def _where(self, instant: int) -> str:
        return f"step {self._step} ({in_seconds(instant):g} s): behaviour {self._entry!r} of {self._robot}"

    def _outputs(self, decision: Decision, twist: Twist, pose: Pose | None) -> list[Output]:
        said = (decision.reports, decision.given_up, decision.route)
        frames = len(decision.frames)
        drive = Drive(
            self._step, *twist, frames, *said, None if pose is None else (pose.x, pose.y, pose.heading)
        )
        if not frames:
            return [Output(self._drive, drive)]
        return [Output(self._transmit, Transmit(self._step, decision.frames)), Output(self._drive, drive)]

    def _catch_up(self, senses: Senses) -> None:
        """The step is the world's to say: steps are missing while the robot is frozen."""
        if senses.step < self._step:
            raise AcrcError(
                f"step {self._step}: {self._robot} got Senses of step {senses.step}; "
                f"it should be of step {self._step} or later"
            )
        self._step = senses.step
        if wrong := senses_fault(senses):
            raise AcrcError(f"step {self._step}: {self._robot} got {wrong}")

    def _check_received(self, received: Received, events: int) -> None:
        if received.step > self._step:  # an earlier one was kept while the robot was frozen
            raise AcrcError(
                f"step {self._step}: {self._robot} got Received of step {received.step}; "
                f"it should be of step {self._step} or earlier"
            )
        if len(received.events) != events:
            raise AcrcError(
                f"step {self._step}: {self._robot} got {len(received.events)} radio events; "
                f"Senses counts {events}"
            )
