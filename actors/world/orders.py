"""Carries out the scenario's events and a person's orders at a step boundary."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from actors.geometry import Point, Pose, wrap
from actors.instant import Instant, in_seconds
from actors.message_limits import OrderLimits, fault
from actors.messages import Jam, Loss, ProcessOrder
from actors.orders import (
    CloseDoor,
    Freeze,
    Give,
    Kill,
    Lose,
    Move,
    Obstacle,
    OpenDoor,
    Order,
    Pause,
    Restart,
    Resume,
    Speed,
    StartJam,
    Step,
    Stop,
    Thaw,
    Wall,
)
from actors.runtime.errors import AcrcError
from actors.task.task import Task
from actors.world.body import Bodies, wall_posts
from actors.world.world_setup import BarrierStanding, Member, Participants, TimedOrder


@dataclass(frozen=True)
class Effects:
    """What carrying out the orders of one step boundary has come to: what the world is to send, and do."""

    starts: tuple[ProcessOrder, ...] = ()
    """Processes to begin."""
    ends: tuple[str, ...] = ()
    """Robots whose processes are to be told that this was all."""
    jams: tuple[Jam, ...] = ()
    losses: tuple[Loss, ...] = ()
    paused: bool = False
    """The world is to stay at this boundary until it is False."""
    steps: int | None = None
    """After so many steps it is to stay again; 0: it is not; None: as before."""
    speed: float | None = None
    """Simulated seconds per second from now on, 0: no limit; None: as before."""
    stop: bool = False
    """The run is over."""


class Orders:
    """What is due, and who carries it out."""

    def __init__(
        self, events: tuple[TimedOrder, ...], roster: Participants, bodies: Bodies, task: Task
    ) -> None:
        self._events = deque(events)
        self._roster = roster
        self._bodies = bodies
        self._task = task
        self._now = Instant(0)
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

    def due(self, now: Instant) -> Effects:
        """Carry out every event of the scenario up to `now`, at which a boundary begins."""
        self._now = now
        effects = Effects()
        while self._events and self._events[0].instant <= now:
            try:
                effects = self._carry_out(self._events.popleft().order, effects)
            except AcrcError as error:
                raise AcrcError(f"the event {self._when()} cannot happen: {error}") from error
        return effects

    def take(self, orders: Iterable[Order], before: Effects) -> tuple[Effects, tuple[str, ...]]:
        """Carry out orders that have just come in, at the boundary that has come to `before` so far.

        Gives what it has come to now, and a sentence for each order that makes no sense. That is noted, too,
        and nothing else becomes of it.
        """
        effects, refusals = before, []
        for order in orders:
            try:
                effects = self._carry_out(order, effects)
            except AcrcError as error:
                refusals.append(f"{self._when()}: {error}")
        room = self._limits.refusals - len(self._refused)
        self._refused += refusals[:room]
        self._refused_later += len(refusals[room:])
        return effects, tuple(refusals)

    def _carry_out(self, order: Order, before: Effects) -> Effects:
        if wrong := fault(order, self._limits):
            raise AcrcError(wrong)
        match order:
            case Kill() | Freeze() | Thaw() | Restart() | Move() | Give():
                return self._to_robot(order, before)
            case StartJam():
                jam = Jam(order.x, order.y, order.radius, self._now + order.duration)
                return replace(before, jams=(*before.jams, jam))
            case Lose():
                return replace(before, losses=(*before.losses, self._loss(order)))
            case Obstacle() | CloseDoor() | OpenDoor():
                self._to_floor(order)
                return before
            case Wall():
                self._add_wall(order)
                return before
            case Pause() | Resume() | Step() | Speed() | Stop():
                return _to_run(order, before)

    def _to_robot(self, order: Kill | Freeze | Thaw | Restart | Move | Give, before: Effects) -> Effects:
        if order.robot not in self._roster:
            raise AcrcError(f"there is no robot {order.robot!r} to {_verb(order)}")
        member = self._roster[order.robot]
        match order:
            case Kill():
                return _ended(member, before)
            case Freeze() if member.standing is BarrierStanding.STEPPING:
                member.standing = BarrierStanding.FROZEN
            case Thaw() if member.standing is BarrierStanding.FROZEN:
                member.standing = BarrierStanding.STEPPING
            case Restart():
                effects = _ended(member, before)
                member.begin_anew()
                return replace(effects, starts=(*effects.starts, ProcessOrder(member.id, member.epoch)))
            case Move():
                self._bodies.place(member.index, Pose(order.x, order.y, wrap(order.heading)))
            case Give():
                self._give(member, order)
            case _:
                raise AcrcError(f"cannot {_verb(order)} {order.robot}, which is {member.standing.value}")
        return before

    def _loss(self, order: Lose) -> Loss:
        for robot in (order.robot, order.sender):
            if robot not in self._roster:
                raise AcrcError(f"there is no robot {robot!r} to lose a frame")
        if order.robot == order.sender:
            raise AcrcError(f"{order.robot} receives no frames of its own that it could lose")
        return Loss(order.robot, order.sender)

    def _give(self, member: Member, order: Give) -> None:
        """Its process hears of them with its next Senses; without one nobody does."""
        if len(member.given) + len(order.places) > self._limits.places:
            raise AcrcError(
                f"{member.id} was given {len(member.given)} places since the start already; "
                f"it may be at most {self._limits.places}"
            )
        self._bodies.check_places(order.places)
        member.given += order.places
        self._task.give(self._now, member.id, order.places)

    def _to_floor(self, order: Obstacle | CloseDoor | OpenDoor) -> None:
        match order:
            case Obstacle():
                self._add_obstacle(order)
            case CloseDoor():
                self._bodies.close_door(order.x, order.y)
            case OpenDoor():
                self._bodies.open_door(order.x, order.y)

    def _add_obstacle(self, order: Obstacle) -> None:
        if self._obstacles >= self._limits.obstacles:
            raise AcrcError(f"there are {self._obstacles} obstacles already; at most that many may be put")
        self._bodies.add_obstacle(order.x, order.y, order.radius)
        self._obstacles += 1

    def _add_wall(self, order: Wall) -> None:
        start, end = Point(order.x, order.y), Point(order.to_x, order.to_y)
        posts = len(wall_posts(start, end))
        if self._obstacles + posts > self._limits.obstacles:
            raise AcrcError(
                f"a wall of {posts} posts beside {self._obstacles} obstacles; "
                f"at most {self._limits.obstacles} may stand on the floor"
            )
        self._obstacles += self._bodies.add_wall(start, end)

    def _when(self) -> str:
        return f"at {in_seconds(self._now):g} s"


def _to_run(order: Pause | Resume | Step | Speed | Stop, before: Effects) -> Effects:
    match order:
        case Pause():
            return replace(before, paused=True, steps=0)
        case Resume():
            return replace(before, paused=False, steps=0)
        case Step(steps):
            return replace(before, paused=False, steps=steps)
        case Speed(factor):
            return replace(before, speed=factor)
        case Stop():
            return replace(before, stop=True)


def _ended(member: Member, before: Effects) -> Effects:
    """What it has come to once the robot's process, begun or about to begin, has ended."""
    effects = replace(before, starts=tuple(start for start in before.starts if start.robot != member.id))
    if member.standing in (BarrierStanding.STEPPING, BarrierStanding.FROZEN):
        effects = replace(effects, ends=(*effects.ends, member.id))
    member.standing = BarrierStanding.ENDED
    return effects


def _verb(order: Order) -> str:
    return type(order).__name__.lower()
