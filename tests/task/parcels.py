"""A made-up task: robots collect parcels and bring them to their depot; and a strategy for it."""

from collections.abc import Collection, Sequence
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Coordinate, Point
from actors.instant import Instant, in_seconds
from actors.robot.behaviour import Behaviour, Decision, GoalOrder, GoalStatus, Start, View
from actors.task import (
    Column,
    DrawInput,
    ItemKey,
    Judge,
    JudgeSetup,
    MarkStyle,
    MessagePart,
    Metric,
    Settings,
    Task,
    TaskDeclaration,
    TaskOutcome,
    TaskProgress,
    TaskReports,
)


class Parcel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An item: where it is, and what it weighs."""

    x: Coordinate
    y: Coordinate
    kilograms: Annotated[float, msgspec.Meta(gt=0, le=50)] = 1.0


class Loaded(MessagePart, frozen=True, tag="loaded"):
    """The robot has taken a parcel."""

    number: int
    instant: int


class Delivered(MessagePart, frozen=True, tag="delivered"):
    """The robot has brought parcels to its depot."""

    numbers: tuple[int, ...]


class ParcelsTable(Settings, frozen=True):
    """[parcels]: settings of the task."""

    per_robot: Annotated[int, msgspec.Meta(ge=0, le=9)] = 1
    kilograms: Annotated[float, msgspec.Meta(gt=0)] = 2.5


class ParcelJudge(Judge):
    """Counts what is delivered."""

    def __init__(self, setup: JudgeSetup) -> None:
        super().__init__()
        self.items: dict[str, list[Parcel]] = {robot: [*setup.items[robot]] for robot in setup.robots}
        self.loaded: set[ItemKey] = set()
        self.delivered: dict[ItemKey, float] = {}
        self.positions: NDArray[np.float64] = np.zeros((0, 2))
        for robot, items in self.items.items():
            for number, item in enumerate(items):
                self.mark(ItemKey(robot, number), (item.x, item.y), "waiting")

    @property
    def settled(self) -> bool:
        return bool(self.delivered) and len(self.delivered) == sum(map(len, self.items.values()))

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        self.positions = positions

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        for report in answer.reports:
            numbers = report.numbers if isinstance(report, Delivered) else (report.number,)
            if wrong := [number for number in numbers if not 0 <= number < len(self.items[robot])]:
                return f"reports parcel {wrong[0]}, which it was not given"
            for key in (ItemKey(robot, number) for number in numbers):
                self._change(key, report, begin)
        return None

    def _change(self, key: ItemKey, report: Loaded | Delivered, instant: int) -> None:
        item = self.items[key.owner][key.number]
        if isinstance(report, Loaded):
            self.loaded.add(key)
            self.note(key.owner, report.instant, "waiting for a dock", key)
        else:
            self.delivered.setdefault(key, in_seconds(instant))
            self.note(key.owner, instant, "delivered", key, f"{item.kilograms:g} kg")
            self.note(key.owner, instant, "")
            self.mark(key, (item.x, item.y), "")

    def give(self, instant: Instant, robot: str, items: Sequence[Any]) -> str | None:
        self.items[robot] += items
        return None

    def progress(self, present: Collection[str]) -> TaskProgress:
        return TaskProgress(sum(map(len, self.items.values())) - len(self.delivered), len(self.delivered))

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        weights = {key: self.items[key.owner][key.number].kilograms for key in self.delivered}
        robots = {
            robot: {"kilograms": sum(weight for key, weight in weights.items() if key.owner == robot)}
            for robot in self.items
        }
        return TaskOutcome(
            summary=f"delivered {sum(weights.values()):g} kg",
            values={
                "kilograms": sum(weights.values()),
                "last_s": max(self.delivered.values(), default=None) if self.settled else None,
            },
            robots=robots,
            items=tuple(
                {
                    "parcel": str(ItemKey(robot, number)),
                    "delivered_s": self.delivered.get(ItemKey(robot, number)),
                }
                for robot, items in self.items.items()
                for number in range(len(items))
            ),
            notes=() if self.settled else ("Some parcels are left.",),
        )


class Parcels(Task):
    """Robots bring parcels to their start."""

    declaration = TaskDeclaration(
        name="parcels",
        table="parcels",
        item="parcel",
        items="parcels",
        done="delivered",
        metrics=(
            Metric("weight", "weight delivered", "kg", "kilograms", rank=1, worst=0.0),
            Metric("last", "time of the last delivery", "s", "last_s", "less", "delivered", rank=2),
        ),
        marks={"waiting": MarkStyle("diamond", "parcel", True)},
        events={"delivered": MarkStyle("tick", "parcel delivered")},
        causes={"waiting for a dock": ("#4f5a70", "//")},
        columns=(
            Column("parcel", "text", "Robot and number"),
            Column("delivered_s", "number", "Time of delivery, s"),
        ),
        cells={"delivered, kg": ("kilograms",), "finished at": ("last_s",)},
    )
    settings = ParcelsTable
    item = Parcel
    report = Loaded | Delivered

    def judge(self, setup: JudgeSetup) -> Judge:
        return ParcelJudge(setup)

    def draw(self, settings: ParcelsTable, placing: DrawInput) -> tuple[Parcel, ...]:
        here = placing.start.point
        return (Parcel(here.x, here.y, settings.kilograms),) * settings.per_robot

    def check(self, item: Parcel, grid: OccupancyGrid) -> str | None:
        return None if grid.is_free(Point(item.x, item.y)) else "be on free floor"

    def point(self, item: Parcel) -> Point:
        return Point(item.x, item.y)


class Carrier:
    """Fetches its parcels in order, and delivers each once it is back at its start."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._items = msgspec.convert(start.items, tuple[Parcel, ...])
        self._done = 0
        self._carries = False

    def advance(self, view: View, until: Instant) -> Decision:
        self._items += msgspec.convert(view.items, tuple[Parcel, ...])
        reports: tuple[MessagePart, ...] = ()
        if view.goal is not None and view.goal.status is GoalStatus.SUCCEEDED:
            self._carries = not self._carries
            reports = (Loaded(self._done, view.instant) if self._carries else Delivered((self._done,)),)
            self._done += not self._carries
        elif view.goal is not None:
            return Decision()
        if self._done == len(self._items):
            return Decision(reports=reports, goal=GoalOrder.CANCEL)
        parcel = self._items[self._done]
        goal = self._start.pose.point if self._carries else Point(parcel.x, parcel.y)
        return Decision(goal=goal, reports=reports)


def carrier(start: Start) -> Behaviour:
    return Carrier(start)
