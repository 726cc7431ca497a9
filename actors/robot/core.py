"""The robot without I/O: localisation, navigation and behaviour, step by step.

Inputs of a step: SensorData, and RadioEvents if SensorData counts events; outputs: Transmit if there are
frames, and Drive. Transmit is sent first: the Drive lets world and radio continue. Order in a
step: localisation, navigation, behaviour; a new goal moves the base from the next step on.
"""

from collections.abc import Sequence
from typing import Final, cast

import msgspec

from actors.geometry import STILL, Pose, Twist
from actors.instant import Instant, in_seconds
from actors.messages import (
    DRIVE,
    INTROSPECTION,
    RECEIVED,
    SENSES,
    TRANSMIT,
    Drive,
    RadioEvent,
    RadioEvents,
    SensorData,
    Transmit,
)
from actors.robot.behaviour.decisions import RobotLimits, fault, outcome_fault
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.ports import Behaviour, Decision, View
from actors.robot.introspector import Introspector
from actors.robot.localisation import Localisation
from actors.robot.navigation.navigator import Navigator
from actors.robot.sweep import OdometryBuffer
from actors.runtime.core import Address, Inputs, Output, at
from actors.runtime.errors import AcrcError
from deeco.knowledge import new_tuple
from deeco.node import observing_nodes

_LIMITS: Final = RobotLimits()


_SPEED: Final = 0.01
"""Speed above which a base counts as moving, m/s; own choice, above the noise of wheel encoders."""
_TURN_RATE: Final = 0.02
"""Turn rate above which it counts as moving, rad/s; own choice as above."""


def _is_moving(velocity: Twist) -> bool:
    vx, vy, omega = velocity
    return not (-_SPEED <= vx <= _SPEED and -_SPEED <= vy <= _SPEED and -_TURN_RATE <= omega <= _TURN_RATE)


class RobotParts(msgspec.Struct, frozen=True):
    """Components of a robot."""

    sweeps: OdometryBuffer
    localisation: Localisation
    navigation: Navigator
    behaviour: Behaviour
    introspector: Introspector | None = None
    """None: only results and causes are recorded."""


class RobotCore:
    """One robot, from step 0 or from the step of its restart."""

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
        self.localisation, self.navigation = parts.localisation, parts.navigation
        self.behaviour = parts.behaviour
        self.step = first_step
        """Number of the current step."""
        self.finished = False
        """True after SensorData with `halt`."""
        self._robot, self._entry, self._limits = robot, entry, limits
        self._step_us = step_us
        self._sweeps, self._introspector = parts.sweeps, parts.introspector
        self._senses, self._received = at(SENSES, robot), at(RECEIVED, robot)
        self._drive, self._transmit = at(DRIVE, robot), at(TRANSMIT, robot)
        self._introspection = at(INTROSPECTION, robot)

    def listens(self) -> Sequence[Address]:
        """Return the addresses of all inputs."""
        return (self._senses, self._received)

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return the addresses of missing inputs: SensorData, then RadioEvents if it counts any."""
        if self._senses.key not in have:
            return (self._senses,)
        senses: SensorData = have[self._senses.key]  # type: ignore[assignment]  # as `read` gives it
        if senses.events > 0 and self._received.key not in have:
            return (self._received,)
        return ()

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Process one step."""
        senses: SensorData = inputs[self._senses.key]  # type: ignore[assignment]  # as `read` gives it
        self._catch_up(senses)
        events: tuple[RadioEvent, ...] = ()
        if senses.events > 0:
            received: RadioEvents = inputs[self._received.key]  # type: ignore[assignment]
            self._check_received(received, senses.events)
            events = received.events
        if senses.halt:
            self.finished = True
            rest = None if self._introspector is None else self._introspector.rest(self.step)
            return () if rest is None else (Output(self._introspection, rest),)
        if self._introspector is None:
            outputs = self._outputs(*self._advance(senses, events))
        else:
            with observing_nodes(self._introspector):  # the node of a later behaviour is created in a step
                outputs = self._outputs(*self._advance(senses, events))
            record = self._introspector.end(self.step, self.behaviour)
            outputs += () if record is None else (Output(self._introspection, record),)
        self.step += 1
        return outputs

    def outcome(self) -> dict[str, object]:
        """Return results of the run by subject: the robot's and its behaviour's."""
        own: dict[str, object] = {
            "localisation": self.localisation.outcome(),
            "navigation": self.navigation.report(),
        }
        behaviour_outcome = getattr(self.behaviour, "outcome", None)
        if behaviour_outcome is None:
            return own
        outcome = behaviour_outcome()
        if error := outcome_fault(outcome, tuple(own)):
            raise BehaviourError(f"step {self.step}: behaviour {self._entry!r} of {self._robot} {error}")
        return own | cast(dict[str, object], outcome)

    def _advance(
        self, senses: SensorData, events: tuple[RadioEvent, ...]
    ) -> tuple[Decision, Twist, Pose | None]:
        odometry, instant = senses.odometry, Instant(senses.instant)
        localisation, navigation = self.localisation, self.navigation
        here = new_tuple(Pose, (odometry.x, odometry.y, odometry.heading))
        sweep = self._sweeps.take(instant, here, senses.scan)
        newest = sweep
        for scan in senses.earlier_scans:
            earlier = self._sweeps.sweep_of(scan)
            newest = earlier if sweep is None else sweep
            localisation.update(here, earlier)
            navigation.sense(instant, here, earlier)
        estimate = localisation.update(here, sweep)
        if self._introspector is not None:
            self._introspector.begin(instant, estimate, newest)
        velocity = new_tuple(Twist, (odometry.vx, odometry.vy, odometry.omega))
        navigation.sense(instant, here, sweep)
        twist = STILL
        if estimate.located:  # otherwise the robot stands and navigation waits
            twist = navigation.advance(instant, here, estimate.pose, velocity, senses.bumper != 0)
        values = (
            *(instant, estimate.pose, _is_moving(velocity), navigation.goal, events),
            *(estimate.covariance, estimate.lost, navigation.plan, navigation.backing_out),
            *(senses.items, senses.battery),
        )
        view = new_tuple(View, values)
        decision = self._decide(view, Instant(instant + self._step_us))
        navigation.take(decision.goal, decision.paused, decision.back_out)
        if decision.relocalise:
            localisation.relocalise()
        if decision.peers is not None:
            localisation.mask(decision.peers)
        return decision, twist, estimate.pose if estimate.located else None

    def _decide(self, view: View, until: Instant) -> Decision:
        try:
            decision = self.behaviour.advance(view, until)
        except Exception as error:
            error.add_note(f"in {self._location(view.instant)}")
            raise
        if wrong := fault(decision, view.instant, until, self._limits):
            raise BehaviourError(f"{self._location(view.instant)} {wrong}")
        return decision

    def _location(self, instant: int) -> str:
        return f"step {self.step} ({in_seconds(instant):g} s): behaviour {self._entry!r} of {self._robot}"

    def _outputs(self, decision: Decision, twist: Twist, pose: Pose | None) -> list[Output]:
        task = (decision.reports, decision.given_up, decision.route)
        frames = len(decision.frames)
        drive = Drive(
            self.step, *twist, frames, *task, None if pose is None else (pose.x, pose.y, pose.heading)
        )
        if not frames:
            return [Output(self._drive, drive)]
        return [Output(self._transmit, Transmit(self.step, decision.frames)), Output(self._drive, drive)]

    def _catch_up(self, senses: SensorData) -> None:
        """Take the step number from the world: a frozen robot misses steps."""
        if senses.step < self.step:
            raise AcrcError(
                f"step {self.step}: {self._robot} received SensorData of step {senses.step}; "
                f"it should be of step {self.step} or later"
            )
        self.step = senses.step

    def _check_received(self, received: RadioEvents, events: int) -> None:
        if received.step > self.step:  # earlier ones were queued while the robot was frozen
            raise AcrcError(
                f"step {self.step}: {self._robot} received RadioEvents of step {received.step}; "
                f"it should be of step {self.step} or earlier"
            )
        if len(received.events) != events:
            raise AcrcError(
                f"step {self.step}: {self._robot} received {len(received.events)} radio events; "
                f"SensorData counts {events}"
            )
