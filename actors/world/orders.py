"""Carries out the scenario's events and a person's orders at a step boundary."""

from collections import deque
from collections.abc import Iterable

from actors.geometry import Pose, wrap
from actors.instant import Instant, in_seconds
from actors.messages import (
    Freeze,
    Jam,
    Kill,
    Move,
    Obstacle,
    Order,
    Pause,
    ProcessOrder,
    Restart,
    Resume,
    StartJam,
    Stop,
    Thaw,
)  # fmt: skip
from actors.order_limits import OrderLimits, fault
from actors.runtime.errors import AcrcError
from actors.world.body import Bodies
from actors.world.participants import Participants, Standing
from actors.world.world_setup import TimedOrder


class OrderError(AcrcError):
    """An order that cannot be carried out."""


class Orders:
    """What is due, and what carrying it out has left for the world to send."""

    def __init__(self, events: tuple[TimedOrder, ...], roster: Participants, bodies: Bodies) -> None:
        self._events = deque(events)
        self._roster = roster
        self._bodies = bodies
        self._now = Instant(0)
        self.paused = False
        self.stop = False
        self.starts: list[ProcessOrder] = []
        self.ends: list[str] = []
        self.jams: list[Jam] = []
        self._limits = OrderLimits()
        self._obstacles = 0
        self._refused: list[str] = []
        self._refused_later = 0

    @property
    def pending(self) -> bool:
        """True while events of the scenario lie ahead."""
        return bool(self._events)

    @property
    def refused(self) -> tuple[str, ...]:
        """Orders from outside that could not be carried out, a sentence each; the last may count the rest."""
        more = (f"and {self._refused_later} more",) if self._refused_later else ()
        return (*self._refused, *more)

    def due(self, now: Instant) -> None:
        """Carry out every event of the scenario up to `now`."""
        self._now = now
        while self._events and self._events[0].instant <= now:
            try:
                self._carry_out(self._events.popleft().order)
            except AcrcError as error:
                raise OrderError(f"the event {self._when()} cannot happen: {error}") from error

    def take(self, orders: Iterable[Order]) -> tuple[str, ...]:
        """Carry out orders that have just come in; gives a sentence for each that makes no sense.

        It is noted, too, and nothing else becomes of it.
        """
        refusals = []
        for order in orders:
            try:
                self._carry_out(order)
            except AcrcError as error:
                refusals.append(f"{self._when()}: {error}")
        room = self._limits.refusals - len(self._refused)
        self._refused += refusals[:room]
        self._refused_later += len(refusals[room:])
        return tuple(refusals)

    def _carry_out(self, order: Order) -> None:
        if wrong := fault(order, self._limits):
            raise OrderError(wrong)
        match order:
            case Kill() | Freeze() | Thaw() | Restart() | Move():
                self._to_robot(order)
            case StartJam():
                self.jams.append(Jam(order.x, order.y, order.radius, self._now + order.duration))
            case Obstacle():
                self._add_obstacle(order)
            case Pause():
                self.paused = True
            case Resume():
                self.paused = False
            case Stop():
                self.stop = True

    def _to_robot(self, order: Kill | Freeze | Thaw | Restart | Move) -> None:
        if order.robot not in self._roster:
            raise OrderError(f"there is no robot {order.robot!r} to {_verb(order)}")
        member = self._roster[order.robot]
        match order:
            case Kill():
                self._end(order.robot)
            case Freeze() if member.standing is Standing.STEPPING:
                member.standing = Standing.FROZEN
            case Thaw() if member.standing is Standing.FROZEN:
                member.standing = Standing.STEPPING
            case Restart():
                self._end(order.robot)
                member.begin_anew()
                self.starts.append(ProcessOrder(member.id, member.epoch))
            case Move():
                self._bodies.place(member.index, Pose(order.x, order.y, wrap(order.heading)))
            case _:
                raise OrderError(f"cannot {_verb(order)} {order.robot}, which is {member.standing.value}")

    def _add_obstacle(self, order: Obstacle) -> None:
        if self._obstacles >= self._limits.obstacles:
            raise OrderError(f"there are {self._obstacles} obstacles already; at most that many may be put")
        self._bodies.add_obstacle(order.x, order.y, order.radius)
        self._obstacles += 1

    def _end(self, robot: str) -> None:
        member = self._roster[robot]
        self.starts = [start for start in self.starts if start.robot != robot]
        if member.standing in (Standing.STEPPING, Standing.FROZEN):
            self.ends.append(robot)
        member.standing = Standing.ENDED

    def _when(self) -> str:
        return f"at {in_seconds(self._now):g} s"


def _verb(order: Order) -> str:
    return type(order).__name__.lower()
