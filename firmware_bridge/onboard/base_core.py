"""The base as an actor: conducts the robot's steps in real time, with the world's keys and messages.

In contrast to the world it does not wait. Steps begin at fixed intervals. If the robot has not answered the
previous step, a step is skipped and counted; if the bridge reports events late, the robot receives them a
step later. The time is an input that is not recorded, so the robot can be replayed, the base cannot.
"""

from collections.abc import Sequence
from typing import Final, Protocol

import msgspec

from actors.geometry import Pose
from actors.instant import Duration, Instant, in_seconds, milliseconds, seconds
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    PROGRESS,
    RADIO_READY,
    READY,
    SENSES,
    TRUTH,
    Control,
    Drive,
    Odometry,
    Progress,
    RadioAdvanced,
    Ready,
    RobotTruth,
    Scan,
    SensorData,
    Truth,
)
from actors.orders import Pause, Resume, Stop
from actors.portable import cos_sin
from actors.runtime.core import Address, Inputs, Output, at, to
from actors.runtime.errors import AcrcError
from firmware_bridge.onboard.device_loop import TimedCore


class BaseReport(msgspec.Struct):
    """Counts of a base; the last entry of its recording."""

    steps: int = 0
    overruns: int = 0
    """Steps skipped because the robot had not answered."""
    late_air: int = 0
    """Steps for which the bridge's report was late."""
    stale_drives: int = 0
    """Answers to earlier steps."""
    lateness_ms: dict[int, int] = {}
    """Number of steps by latency of the robot's answer, ms."""


BRIDGE_TIMEOUT: Final = milliseconds(20)
"""Timeout of the bridge's report: a fifth of a step; typical is 1 ms."""
ESTIMATE_TIMEOUT: Final = seconds(1.0)
"""Age after which a simulated radio does not use a pose estimate; own choice: ten steps."""


class Vehicle(Protocol):
    """Sensors and actuators of the base."""

    def odometry(self) -> Odometry:
        """Return the pose since the start, and the velocity."""

    def bumper(self) -> int:
        """Return the bits set since the last call, as in SensorData."""

    def scan(self) -> Scan | None:
        """Return the latest scan, once."""

    def charge(self) -> float | None:
        """Return the charge of the battery, 0 to 1; None: unknown."""

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        """Command a velocity, m/s and rad/s, based on data sensed at `issued`; too old ones are ignored.

        The vehicle may refuse it for other causes.
        """

    def stop_reasons(self) -> tuple[str, ...]:
        """Return causes that prevent motion now or soon, in words."""


class BaseCore(TimedCore):
    """Conductor of one robot's steps."""

    def __init__(
        self, robot: str, step_us: int, begin: Instant, start: Pose, items: int, vehicle: Vehicle
    ) -> None:
        """Create it.

        `begin`: the instant of step 0; `start`: pose of the base at its start, map frame; `items`: initial
        number of items of the task.
        """
        super().__init__()
        self.now = begin
        self.counts = BaseReport()
        self._robot = robot
        self._step_us = step_us
        self._begin = begin
        self._vehicle = vehicle
        self._sensed: int | None = None
        """Last step whose SensorData were sent."""
        self._robot_ready = self._bridge_ready = self._robot_busy = self._bridge_asked = self._paused = False
        self._opening: int | None = None
        """Step that waits for the bridge."""
        self._bridge_due = begin
        self._events = 0
        self._epoch = 0
        """Epoch of the robot's process."""
        self._unanswered = self._obsolete = 0
        """Number of Truths not answered by the bridge, and of those for an exited robot."""
        self._transmits = 0
        self.answer_timeout: Duration | None = None
        """Timeout of answers of robot and bridge; None: no limit."""
        self._asked_at = begin
        """Time of the unanswered request to the bridge."""
        self._odometry = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        """Odometry in the last SensorData."""
        self._origin = start, self._odometry
        self._estimated_at = begin - ESTIMATE_TIMEOUT
        self.last_estimate: tuple[Pose, Odometry] | None = None
        """Latest pose estimate of the robot, map frame, with its odometry; None before the first."""
        self._stopping = False
        self._items_done = 0
        self._items_left = items

    @property
    def next_tick(self) -> Instant:
        """Time of the next step."""
        return Instant(self._begin + (self.step + 1) * self._step_us)

    @property
    def wake(self) -> Instant:
        """Time of the next advance without a message."""
        return min(self.next_tick, self._bridge_due) if self._opening is not None else self.next_tick

    @property
    def has_news(self) -> bool:
        """True if a step or the end is due."""
        return self._stopping or self.now >= self.wake

    def listens(self) -> Sequence[Address]:
        """Return the addresses of incoming messages."""
        robot = self._robot
        return (at(READY, robot), at(RADIO_READY), at(DRIVE, robot), at(AIRED), at(CONTROL))

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Process one message, or the passing of time."""
        self._expected = None
        if not inputs:
            return self._on_time()
        (message,) = inputs.values()
        match message:
            case Drive():
                return self._on_drive(message)
            case RadioAdvanced():
                return self._on_radio_advanced(message)
            case Ready():
                return self._on_ready(message)
            case Control():
                return self._on_control(message)
            case _:
                return ()

    def stop(self) -> None:
        """Make the next advance without a message the last one."""
        self._stopping = True

    def _halt(self) -> Sequence[Output]:
        """Return the last messages, to robot and bridge."""
        self.finished = True
        self._vehicle.command(self.now, self.now, 0.0, 0.0)
        last = self.step if self._sensed is None else max(self.step, self._sensed + 1)
        senses = self._senses_of(last, halt=True)
        truth = Truth(last, self._instant(last), (), halt=True)
        return (to(SENSES, senses, self._robot), to(TRUTH, truth), to(PROGRESS, self._progress()))

    def report(self) -> BaseReport:
        """Return the counts so far."""
        lateness_ms = dict(sorted(self.counts.lateness_ms.items()))
        return msgspec.structs.replace(self.counts, steps=self.step, lateness_ms=lateness_ms)

    def _on_time(self) -> Sequence[Output]:
        if self._stopping:
            return self._halt()
        outputs: list[Output] = []
        if self._opening is not None and self.now >= self._bridge_due:
            self.counts.late_air += 1
            outputs += self._open(self._opening)
        if self.now >= self.next_tick:
            self.step = (self.now - self._begin) // self._step_us
            outputs += self._tick()
        return outputs

    def _tick(self) -> Sequence[Output]:
        if not self._robot_ready or self._paused:
            return ()
        self._check_answers()
        if self._robot_busy or self._opening is not None:
            self.counts.overruns += 1
            return ()
        is_waiting = self._bridge_ready and self._sensed is not None and not self._events
        if not is_waiting:
            return self._open(self.step)
        self._opening, self._bridge_due = self.step, Instant(self.now + BRIDGE_TIMEOUT)
        if self._bridge_asked:
            return ()
        self._bridge_asked, self._asked_at = True, self.now
        assert self._sensed is not None
        self._unanswered += 1
        truth = Truth(self._sensed, self._instant(self._sensed), (self._truth(),))
        return (to(TRUTH, truth),)

    def _check_answers(self) -> None:
        """Raise AcrcError if the answer of robot or bridge has timed out."""
        if self.answer_timeout is None or self._sensed is None:
            return
        for is_waiting, since, name in (
            (self._robot_busy, self._instant(self._sensed), self._robot),
            (self._bridge_asked, self._asked_at, "the radio's bridge"),
        ):
            if is_waiting and self.now - since > self.answer_timeout:
                raise AcrcError(
                    f"step {self.step}: no answer from {name} for {in_seconds(self.answer_timeout):g} s"
                )

    def _open(self, step: int) -> list[Output]:
        self._opening, self._robot_busy, self._sensed = None, True, step
        outputs = [to(SENSES, self._senses_of(step), self._robot)]
        if self._instant(step) % 1_000_000 < self._step_us:
            outputs.append(to(PROGRESS, self._progress()))
        return outputs

    def _senses_of(self, step: int, halt: bool = False) -> SensorData:
        vehicle, events = self._vehicle, self._events
        self._events = 0
        scan = None if halt else vehicle.scan()
        instant = self._instant(step)
        self._odometry = vehicle.odometry()
        bumper, charge = vehicle.bumper(), vehicle.charge()
        return SensorData(step, instant, events, self._odometry, bumper, scan, halt, battery=charge)

    def _on_drive(self, drive: Drive) -> Sequence[Output]:
        if drive.step != self._sensed or not self._robot_busy:
            self.counts.stale_drives += 1
            return ()
        self._robot_busy = False
        late_ms = (self.now - self._instant(drive.step)) // 1000
        self.counts.lateness_ms[late_ms] = self.counts.lateness_ms.get(late_ms, 0) + 1
        if not self._paused:
            self._vehicle.command(self.now, self._instant(drive.step), drive.vx, drive.omega)
        if drive.pose is not None:
            self.last_estimate, self._estimated_at = (Pose(*drive.pose), self._odometry), self.now
        self._transmits = drive.transmits
        self._items_done += len(drive.reports)
        self._items_left = self._items_left if drive.route is None else len(drive.route)
        return ()

    def _on_radio_advanced(self, report: RadioAdvanced) -> Sequence[Output]:
        self._unanswered = max(0, self._unanswered - 1)
        if self._obsolete:
            self._obsolete -= 1
            return ()
        self._bridge_asked = False
        self._events += sum(int(count.events) for count in report.counts if count.id == self._robot)
        return self._open(self._opening) if self._opening is not None else ()

    def _on_ready(self, ready: Ready) -> Sequence[Output]:
        if ready.actor == self._robot:
            self._robot_ready, self._robot_busy, self._opening, self._events = True, False, None, 0
            # The next Truth passes the epoch to the bridge before the robot's first frames.
            self._epoch, self._bridge_asked, self._obsolete = ready.epoch, False, self._unanswered
        else:
            self._bridge_ready, self._bridge_asked, self._unanswered, self._obsolete = True, False, 0, 0
        return ()

    def _on_control(self, control: Control) -> Sequence[Output]:
        for order in control.orders:
            match order:
                case Stop():
                    return self._halt()
                case Pause():
                    self._paused = True
                    self._vehicle.command(self.now, self.now, 0.0, 0.0)
                case Resume():
                    self._paused = False
                case _:
                    pass  # orders to a simulated world
        return (to(PROGRESS, self._progress()),)  # confirms the order

    def _truth(self) -> RobotTruth:
        """Return the latest pose estimate, moved by odometry since, in place of ground truth.

        `stepping`: the estimate is younger than ESTIMATE_TIMEOUT.
        """
        odometry, (estimate, then) = self._vehicle.odometry(), self.last_estimate or self._origin
        moved = Pose(then.x, then.y, then.heading).relative(Pose(odometry.x, odometry.y, odometry.heading))
        x, y, heading = estimate.compose(moved)
        c, s = cos_sin(heading)
        vx, vy = c * odometry.vx - s * odometry.vy, s * odometry.vx + c * odometry.vy
        return RobotTruth(
            id=self._robot,
            x=x,
            y=y,
            heading=heading,
            vx=vx,
            vy=vy,
            omega=odometry.omega,
            stepping=self.now < self._estimated_at + ESTIMATE_TIMEOUT,
            powered=True,
            transmits=self._transmits,
            epoch=self._epoch,
        )

    def _instant(self, step: int) -> Instant:
        return Instant(self._begin + step * self._step_us)

    def _progress(self) -> Progress:
        return Progress(
            self.step,
            self._instant(self.step),
            self._items_left,
            self._items_done,
            self.finished,
            self._paused,
            held=self._vehicle.stop_reasons(),
        )
