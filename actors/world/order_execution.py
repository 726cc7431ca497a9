"""Carries out the scenario's events and operators' orders at a step boundary."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Final

import msgspec

from actors.geometry import Point, Pose, wrap
from actors.instant import Instant, in_seconds
from actors.message_limits import OrderLimits, order_fault
from actors.messages import Drive, Jam, Loss, ProcessOrder
from actors.orders import (
    CloseDoor,
    Freeze,
    ItemAssignment,
    Kill,
    LoseFrame,
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
from actors.task.loading import decode_items
from actors.task.task import Judge, Task, TaskError
from actors.world.body import Bodies, wall_posts
from actors.world.world_setup import BarrierState, Member, Participants, TimedOrder

STOP: Final = Drive(0, 0.0, 0.0, 0.0, 0)
"""Command of a base whose battery is empty: its geared wheels brake."""


class OrderEffects(msgspec.Struct):
    """Effects of the orders of one step boundary on messages and the run."""

    starts: list[ProcessOrder] = msgspec.field(default_factory=list)
    """Processes to start."""
    ends: list[str] = msgspec.field(default_factory=list)
    """Robots whose processes must end."""
    jams: list[Jam] = msgspec.field(default_factory=list)
    losses: list[Loss] = msgspec.field(default_factory=list)
    paused: bool = False
    """True: pause at this boundary."""
    steps: int | None = None
    """Number of steps until the next pause; 0: none; None: unchanged."""
    speed: float | None = None
    """New speed, simulated seconds per second, 0: unlimited; None: unchanged."""
    stop: bool = False
    """True: end the run."""


class Orders:
    """Carries out orders and keeps the effects of the current boundary."""

    def __init__(
        self,
        events: tuple[TimedOrder, ...],
        roster: Participants,
        bodies: Bodies,
        task: Task,
        judge: Judge,
    ) -> None:
        self.effects = OrderEffects()
        self._events = deque(events)
        self._roster = roster
        self._bodies = bodies
        self._task = task
        self._judge = judge
        self._now = Instant(0)
        self._limits = OrderLimits()
        self._obstacles = 0
        self._refused: list[str] = []
        self._further_refusals = 0

    @property
    def pending(self) -> bool:
        """True while events of the scenario remain."""
        return bool(self._events)

    @property
    def refused(self) -> tuple[str, ...]:
        """Messages of refused orders; the last one may count further refusals."""
        further = (f"and {self._further_refusals} more",) if self._further_refusals else ()
        return (*self._refused, *further)

    def begin(self, now: Instant, empty: Iterable[int] = ()) -> None:
        """Begin a boundary: switch off robots with an empty battery, carry out all events up to `now`."""
        self._now = now
        self.effects = OrderEffects()
        for index in empty:
            self._bodies.command(index, STOP, now)
            self._end_process(self._roster.members[index])
        while self._events and self._events[0].instant <= now:
            try:
                self._execute(self._events.popleft().order)
            except AcrcError as error:
                raise AcrcError(f"event {self._time_text()} failed: {error}") from error

    def take(self, orders: Iterable[Order]) -> tuple[str, ...]:
        """Carry out orders from outside; record and return a message for each refused one."""
        refusals = []
        for order in orders:
            try:
                self._execute(order)
            except TaskError:  # a fault of the judge, not of the order
                raise
            except AcrcError as error:
                refusals.append(f"{self._time_text()}: {error}")
        room = self._limits.refusals - len(self._refused)
        self._refused += refusals[:room]
        self._further_refusals += len(refusals[room:])
        return tuple(refusals)

    def _execute(self, order: Order) -> None:
        if fault := order_fault(order, self._limits):
            raise AcrcError(fault)
        effects = self.effects
        match order:
            case Kill() | Freeze() | Thaw() | Restart() | Move() | ItemAssignment():
                self._apply_to_robot(order)
            case StartJam() | LoseFrame():
                self._apply_to_radio(order)
            case Obstacle() | Wall() | CloseDoor() | OpenDoor():
                self._apply_to_floor(order)
            case Pause() | Resume():
                effects.paused, effects.steps = isinstance(order, Pause), 0
            case Step(steps):
                effects.paused, effects.steps = False, steps
            case Speed(factor):
                effects.speed = factor
            case Stop():
                effects.stop = True

    def _apply_to_robot(self, order: Kill | Freeze | Thaw | Restart | Move | ItemAssignment) -> None:
        if order.robot not in self._roster:
            raise AcrcError(f"cannot {_verb(order)} {order.robot!r}: no such robot")
        member = self._roster[order.robot]
        match order:
            case Kill():
                self._end_process(member)
            case Freeze() if member.state is BarrierState.STEPPING:
                member.state = BarrierState.FROZEN
            case Thaw() if member.state is BarrierState.FROZEN:
                member.state = BarrierState.STEPPING
            case Restart():
                self._end_process(member)
                member.restart()
                self.effects.starts.append(ProcessOrder(member.id, member.epoch))
            case Move():
                self._bodies.place(member.index, Pose(order.x, order.y, wrap(order.heading)))
            case ItemAssignment():
                self._give(member, order)
            case _:
                raise AcrcError(f"cannot {_verb(order)} {order.robot}, which is {member.state.value}")

    def _end_process(self, member: Member) -> None:
        """End the robot's process, running or about to start."""
        effects = self.effects
        effects.starts = [start for start in effects.starts if start.robot != member.id]
        if member.state in (BarrierState.STEPPING, BarrierState.FROZEN):
            effects.ends.append(member.id)
        member.state = BarrierState.ENDED

    def _give(self, member: Member, order: ItemAssignment) -> None:
        """Give items; the robot's process receives them with its next SensorData."""
        items = decode_items(self._task, order.items, "give.items")
        check_room(member, items)
        if fault := self._judge.give(self._now, member.id, items):
            raise AcrcError(fault)
        member.given_items += items

    def _apply_to_radio(self, order: StartJam | LoseFrame) -> None:
        if isinstance(order, StartJam):
            self.effects.jams.append(Jam(order.x, order.y, order.radius, self._now + order.duration))
            return
        for robot in (order.robot, order.sender):
            if robot not in self._roster:
                raise AcrcError(f"cannot lose a frame of {robot!r}: no such robot")
        if order.robot == order.sender:
            raise AcrcError(f"cannot lose a frame of {order.robot} at itself: robot and sender must differ")
        self.effects.losses.append(Loss(order.robot, order.sender))

    def _apply_to_floor(self, order: Obstacle | Wall | CloseDoor | OpenDoor) -> None:
        match order:
            case Obstacle():
                if self._obstacles >= self._limits.obstacles:
                    raise AcrcError(f"there are {self._obstacles} obstacles; this is the limit")
                self._bodies.add_obstacle(order.x, order.y, order.radius)
                self._obstacles += 1
            case Wall():
                start, end = Point(order.x, order.y), Point(order.to_x, order.to_y)
                posts = len(wall_posts(start, end))
                if self._obstacles + posts > self._limits.obstacles:
                    raise AcrcError(
                        f"a wall of {posts} posts and {self._obstacles} obstacles; "
                        f"the limit is {self._limits.obstacles} in total"
                    )
                self._bodies.add_wall(start, end)
                self._obstacles += posts
            case CloseDoor():
                self._bodies.close_door(order.x, order.y)
            case OpenDoor():
                self._bodies.open_door(order.x, order.y)

    def _time_text(self) -> str:
        return f"at {in_seconds(self._now):g} s"


def check_room(member: Member, items: Sequence[Any]) -> None:
    """Raise AcrcError if a robot cannot be given so many further items."""
    if len(member.given_items) + len(items) > OrderLimits.items:
        raise AcrcError(
            f"{member.id} has been given {len(member.given_items)} items since the start; "
            f"the limit is {OrderLimits.items}"
        )


def _verb(order: Order) -> str:
    return str(order.__struct_config__.tag)
