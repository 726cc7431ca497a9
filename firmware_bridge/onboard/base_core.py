"""The base of a robot as an actor: conducts the robot's steps by the clock, as the world does in simulation.

The same keys and messages as the world's, with one difference: nobody is waited for. A step begins at its
instant on a fixed grid. If the robot has not answered the step before, this one is left out and counted; if
the bridge does not say in time what it has heard, the robot hears it a step later.

The core is told the time, an input that a recording does not hold: what is replayed is the robot, from
what it received.
"""

from collections.abc import Sequence
from typing import Final, Protocol

import msgspec

from actors.geometry import Pose
from actors.instant import Duration, Instant, in_seconds, milliseconds
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    PROGRESS,
    RADIO_READY,
    READY,
    SENSES,
    TRUTH,
    Aired,
    Control,
    Drive,
    Odometry,
    Progress,
    Ready,
    RobotTruth,
    Scan,
    Senses,
    Truth,
)
from actors.orders import Pause, Resume, Stop
from actors.portable import cos_sin
from actors.runtime.core import Address, Inputs, Output, at, to
from actors.runtime.errors import AcrcError
from actors.topic import Message
from firmware_bridge.onboard.device_loop import TimedCore


class BaseReport(msgspec.Struct):
    """Counts of a base, its last record."""

    steps: int = 0
    overruns: int = 0
    """Steps that it left out because the robot had not answered."""
    late_air: int = 0
    """Steps for which the bridge did not report in time what it heard."""
    stale_drives: int = 0
    """Answers to a step that was over."""
    lateness_ms: dict[int, int] = {}
    """Steps by whole ms from a step's instant to the robot's answer."""


AIR_PATIENCE: Final[Duration] = milliseconds(20)
"""How long a step waits for the bridge: a fifth of a step; a bridge on the same machine takes about one."""


class Vehicle(Protocol):
    """What the base can sense and do."""

    def odometry(self) -> Odometry:
        """Pose since it was switched on, and velocity."""

    def bumper(self) -> int:
        """Bits as in Senses, of the time since the last call."""

    def scan(self) -> Scan | None:
        """The last sweep, once."""

    def command(self, now: Instant, issued: Instant, vx: float, omega: float) -> None:
        """Want a velocity, m/s and rad/s, by what was sensed at `issued`: one that is too old is not driven.

        What else stops it is the vehicle's own affair.
        """

    def held(self) -> tuple[str, ...]:
        """What keeps it from driving as it is told, or soon will, in words; empty: nothing."""


class BaseCore(TimedCore):
    """One robot's steps."""

    def __init__(
        self, robot: str, step_us: int, begin: Instant, start: Pose, places: int, vehicle: Vehicle
    ) -> None:
        """`begin`: the instant of step 0; `start`: where the base was switched on, in the map frame.

        `places`: how many the robot has to clean at first.
        """
        super().__init__()
        self.now = begin
        self.counts = BaseReport()
        self._robot = robot
        self._step_us = step_us
        self._begin = begin
        self._start = start
        self._vehicle = vehicle
        self._sensed: int | None = None
        """The step whose Senses went out last."""
        self._robot_there = self._radio_there = self._busy = self._asked = self._paused = False
        self._opening: int | None = None
        """The step that waits for the bridge."""
        self._air_due = begin
        self._events = 0
        self._epoch = 0
        """Of the robot's process."""
        self._unanswered = self._void = 0
        """Truths that the bridge has not answered, and how many of them concern a robot that has ended."""
        self._transmits = 0
        self.patience: Duration | None = None
        """A robot or bridge that does not answer for so long hangs; None: it may."""
        self._asked_at = begin
        """When the bridge was asked what it has not answered yet."""
        self._odometry = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        """As the robot was told last."""
        self.held: tuple[Pose, Odometry] | None = None
        """Where the robot held itself to be, map frame, and the odometry there; None: it has never known."""
        self._stopping = False
        self._reports = 0
        self._left = places

    @property
    def next_tick(self) -> Instant:
        """When the next step begins."""
        return Instant(self._begin + (self.step + 1) * self._step_us)

    @property
    def wake(self) -> Instant:
        """When an advance is due, if no message comes before."""
        return min(self.next_tick, self._air_due) if self._opening is not None else self.next_tick

    def listens(self) -> Sequence[Address]:
        """Every address that a message may come in on."""
        robot = self._robot
        return (at(READY, robot), at(RADIO_READY), at(DRIVE, robot), at(AIRED), at(CONTROL))

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take in one message, or the passing of time."""
        self._expected = None
        if not inputs:
            return self._time()
        (key,) = inputs
        message: Message = inputs[key]
        match message:
            case Drive():
                return self._drive(message)
            case Aired():
                return self._aired(message)
            case Ready():
                return self._ready(message)
            case Control():
                return self._control(message)
            case _:
                return ()

    def stop(self) -> None:
        """The next advance without a message is the last."""
        self._stopping = True

    def _halt(self) -> Sequence[Output]:
        """The last messages: to the robot, and to the bridge."""
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

    def _time(self) -> Sequence[Output]:
        if self._stopping:
            return self._halt()
        outputs: list[Output] = []
        if self._opening is not None and self.now >= self._air_due:
            self.counts.late_air += 1
            outputs += self._open(self._opening)
        if self.now >= self.next_tick:
            self.step = (self.now - self._begin) // self._step_us
            outputs += self._tick()
        return outputs

    def _tick(self) -> Sequence[Output]:
        if not self._robot_there or self._paused:
            return ()
        self._check_answers()
        if self._busy or self._opening is not None:
            self.counts.overruns += 1
            return ()
        waits = self._radio_there and self._sensed is not None and not self._events
        if not waits:
            return self._open(self.step)
        self._opening, self._air_due = self.step, Instant(self.now + AIR_PATIENCE)
        if self._asked:
            return ()
        self._asked, self._asked_at = True, self.now
        assert self._sensed is not None
        self._unanswered += 1
        truth = Truth(self._sensed, self._instant(self._sensed), (self._truth(),))
        return (to(TRUTH, truth),)

    def _check_answers(self) -> None:
        """Raises AcrcError for a robot or bridge that was asked too long ago."""
        if self.patience is None or self._sensed is None:
            return
        for waits, since, who in (
            (self._busy, self._instant(self._sensed), self._robot),
            (self._asked, self._asked_at, "the radio's bridge"),
        ):
            if waits and self.now - since > self.patience:
                raise AcrcError(
                    f"step {self.step}: {who} has not answered for {in_seconds(self.patience):g} s"
                )

    def _open(self, step: int) -> list[Output]:
        self._opening, self._busy, self._sensed = None, True, step
        outputs = [to(SENSES, self._senses_of(step), self._robot)]
        if self._instant(step) % 1_000_000 < self._step_us:
            outputs.append(to(PROGRESS, self._progress()))
        return outputs

    def _senses_of(self, step: int, halt: bool = False) -> Senses:
        vehicle, events = self._vehicle, self._events
        self._events = 0
        scan = None if halt else vehicle.scan()
        instant = self._instant(step)
        self._odometry = vehicle.odometry()
        return Senses(step, instant, events, self._odometry, vehicle.bumper(), scan, halt)

    def _drive(self, drive: Drive) -> Sequence[Output]:
        if drive.step != self._sensed or not self._busy:
            self.counts.stale_drives += 1
            return ()
        self._busy = False
        late_ms = (self.now - self._instant(drive.step)) // 1000
        self.counts.lateness_ms[late_ms] = self.counts.lateness_ms.get(late_ms, 0) + 1
        if not self._paused:
            self._vehicle.command(self.now, self._instant(drive.step), drive.vx, drive.omega)
        if drive.pose is not None:
            self.held = Pose(*drive.pose), self._odometry
        self._transmits = drive.transmits
        self._reports += len(drive.reports)
        self._left = self._left if drive.route is None else len(drive.route)
        return ()

    def _aired(self, aired: Aired) -> Sequence[Output]:
        self._unanswered = max(0, self._unanswered - 1)
        if self._void:
            self._void -= 1
            return ()
        self._asked = False
        self._events += sum(int(count.events) for count in aired.counts if count.id == self._robot)
        return self._open(self._opening) if self._opening is not None else ()

    def _ready(self, ready: Ready) -> Sequence[Output]:
        if ready.actor == self._robot:
            self._robot_there, self._busy, self._opening, self._events = True, False, None, 0
            # The next Truth tells the bridge of the epoch, ahead of the robot's first frames.
            self._epoch, self._asked, self._void = ready.epoch, False, self._unanswered
        else:
            self._radio_there, self._asked, self._unanswered, self._void = True, False, 0, 0
        return ()

    def _control(self, control: Control) -> Sequence[Output]:
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
        return (to(PROGRESS, self._progress()),)  # whoever gave the order learns that it was obeyed

    def _truth(self) -> RobotTruth:
        """What stands in truth's place, for those who watch: where odometry alone holds the robot to be."""
        odometry = self._vehicle.odometry()
        x, y, heading = self._start.compose(Pose(odometry.x, odometry.y, odometry.heading))
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
            stepping=True,
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
            self._left,
            self._reports,
            self.finished,
            self._paused,
            held=self._vehicle.held(),
        )
