"""Interface of a task: what robots are to do, how a run is judged, and by which metrics runs are compared.

A task is a subclass of `Task` in an installed package, or in a file named on the command line. Its judge runs
in the world's process; robots communicate with it by items and reports. Recordings hold the task's
declaration, so that readers need no code of the task.
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar, Final, NamedTuple, Protocol, TypeVar

import msgspec
from numpy.random import Generator

from actors.array_types import Floats
from actors.floor.grid import OccupancyGrid
from actors.floor.placement import Area
from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.items import ItemKey, TaskReports
from actors.messages import ItemMark, TaskEvent
from actors.runtime.errors import AcrcError
from actors.settings import Place, Settings

T = TypeVar("T")
Value = bool | int | float | str | None
"""A value of a result or of a table."""


class TaskError(AcrcError):
    """A task that cannot be loaded, or that broke the contract."""


class Metric(NamedTuple):
    """A quantity of a run by which strategies are compared."""

    name: str
    description: str
    unit: str
    column: str
    """Column with its value in the table of results; names of nested values are joined by a dot."""
    better: str = "more"
    """"more" or "less"."""
    event: str = ""
    """For a time that is censored at the end of the run: state of the run after the event. Empty: not
    censored."""
    rank: int | None = None
    """Position in the order in which metrics decide a comparison; None: not in it."""
    worst: float | None = None
    """Value of a failed run; None: unknown, or the worst possible time of an event."""
    margin: float | None = None
    """Equivalence margin of the mean; None: equivalence is not tested."""
    total: str = ""
    """Column with the largest possible value of the run; empty: there is none."""
    reported: str = ""
    """Column with the value as reported by robots, for runs without ground truth; empty: there is none."""


SYMBOLS: Final = (
    "ring", "disc", "diamond", "cross", "square", "tick", "triangle", "heavy cross", "snowflake", "soft ring",
    "filled ring",
)  # fmt: skip
"""Symbols of items and events."""


class MarkStyle(NamedTuple):
    """Appearance of items in one state, or of one kind of events."""

    symbol: str
    """Symbol on floors and in lanes, one of SYMBOLS; a `disc` is the item's first symbol, filled with the
    colour of the robot responsible."""
    description: str
    """For legends."""
    is_open: bool = False
    """The item still has to be done."""


class Column(NamedTuple):
    """A column of the table of items."""

    name: str
    type: str
    """"text", "integer", "number" or "boolean"."""
    description: str
    exported: str = ""
    """Name in tables of `acrc export`; empty: as `name`."""


class TaskDeclaration(msgspec.Struct, frozen=True):
    """Declaration of a task, stored in recordings and results."""

    name: str
    """Name of the task, such as "cleaning"."""
    table: str
    """Name of its table in scenario files, of a robot's items there, and of its table of items."""
    item: str
    """Singular noun for an item, such as "place"."""
    items: str
    """Plural noun."""
    done: str
    """Participle for an item that is done, such as "cleaned"; also the kind of the event that counts it."""
    metrics: tuple[Metric, ...]
    """At least one with a rank. `column` is a name in `TaskOutcome.values`."""
    marks: Mapping[str, MarkStyle] = {}
    """Appearance of items on floors, by state (`ItemMark.state`)."""
    events: Mapping[str, MarkStyle] = {}
    """Appearance of events in lanes, by kind (`TaskEvent.kind`)."""
    columns: tuple[Column, ...] = ()
    """Columns of `TaskOutcome.items`."""
    schemas: Mapping[str, Any] = {}
    """JSON schemas of an "item" and a "report"."""
    causes: Mapping[str, tuple[str, str]] = {}
    """Own causes of a robot's lost time: colour such as "#4f5a70" and hatch of matplotlib, by name."""
    cells: Mapping[str, tuple[str, ...]] = {}
    """Columns of the printed result, by title: names of `TaskOutcome.robots` values, joined by "of"."""
    baseline: str = ""
    """Strategy of scenarios that name none, and for comparison; empty: scenarios must name one."""
    has_initial_work: bool = True
    """Items given at the start are to be done; False: they describe the problem, such as stations."""
    lists_items: bool = True
    """Robots report the items that they plan to do (`Decision.route`); a robot without any is done."""


def style_fault(style: tuple[str, str]) -> str | None:
    """Return the fault of a cause's colour and hatch, as text that continues "must"; None if valid."""
    if not re.fullmatch("#[0-9a-f]{6}", style[0]):
        return 'have a colour such as "#4f5a70"'
    return None if re.fullmatch(r"[/\\|+xoO.*-]{0,4}", style[1]) else "have a hatch of matplotlib"


class TaskOutcome(msgspec.Struct, frozen=True):
    """Result of a task at the end of a run."""

    summary: str
    """Predicate of a sentence about the robots, such as "cleaned all 40 places in 212 s"."""
    values: Mapping[str, Value]
    """Values by name: the columns of metrics, and further ones."""
    robots: Mapping[str, Mapping[str, Value]]
    """Values of each robot."""
    items: tuple[Mapping[str, Value], ...] = ()
    """Rows of the table of items, by column."""
    notes: tuple[str, ...] = ()
    """Further sentences, such as about false reports."""


class TaskProgress(NamedTuple):
    """Progress of a task, for display."""

    left: int
    """Items that running robots still plan to do."""
    done: int
    """Items reported as done."""


class TaskWorld(Protocol):
    """The simulated world, as a judge may use it."""

    def charge(self, robot: str, watts: float) -> None:
        """Charge the robot's battery with this power during the next step; without battery no effect."""

    def battery(self, robot: str) -> float | None:
        """Return the charge of the robot's battery, 0 to 1; None: not simulated."""

    def speed(self, robot: str) -> float:
        """Return the robot's true speed, m/s."""

    def give(self, robot: str, items: Sequence[Any]) -> None:
        """Send further items to the robot with its next SensorData, and again after each restart."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JudgeSetup:
    """Initial data of a judge."""

    robots: tuple[str, ...]
    """In scenario order."""
    items: Mapping[str, tuple[Any, ...]]
    """Initial items of each robot, of the task's item type."""
    settings: Any = None
    """The task's table, of type `Task.settings`."""
    grid: OccupancyGrid | None = None
    """The robots' map; None if it is unknown."""
    seed: int = 0
    """Seed for `actors.randomness.generator(seed, "task", ...)`, the only allowed randomness."""
    duration_us: int = 0
    """Longest duration of the run."""
    world: TaskWorld | None = None
    """None on hardware."""
    has_truth: bool = True
    """False: `watch` is never called and reports cannot be verified; hardware without emulated devices."""


class Judge:
    """Judge of a run: follows ground truth and reports, and determines the outcome.

    The world calls the methods of every step in a fixed order. A judge must be a function of these calls: no
    clock, no randomness but that of its seed. An exception ends the run.
    """

    def __init__(self) -> None:
        self._marks: dict[ItemKey, ItemMark] = {}
        self._events: list[TaskEvent] = []

    @property
    def settled(self) -> bool:
        """True once the task is finished, which ends the run."""
        return False

    def watch(self, instant: Instant, positions: Floats) -> None:
        """Process the true positions, (n, 2) m, in the order of the robots, at the start of a step."""

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Process a robot's reports of the step from `begin` to `end`, µs.

        Form and number have been checked (`task_reports_fault`). Return an error that continues the robot's
        name, such as for an unknown item; None if valid. By default reports have no effect.
        """
        return None

    def restart(self, robot: str) -> None:
        """Process the restart of a robot, which loses its state and receives all its items again."""

    def give(self, instant: Instant, robot: str, items: Sequence[Any]) -> str | None:
        """Process an order that gives further items to a robot; return an error, None if valid."""
        return "this task takes no further items"

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Return the progress; `present`: robots with a process."""
        return TaskProgress(0, 0)

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        """Return the outcome at the instant `end`; `present`: robots with a process."""
        raise NotImplementedError

    def mark(self, key: ItemKey, point: tuple[float, float], state: str, by: str = "") -> None:
        """Show an item in a state at a point, m; `by`: the robot that is responsible for the state."""
        self._marks[key] = ItemMark(key.owner, key.number, point[0], point[1], state, by)

    def note(self, robot: str, instant: int, kind: str, key: ItemKey | None = None, text: str = "") -> None:
        """Show an event of a robot; `kind`: one of the declared events."""
        owner, number = ("", 0) if key is None else (key.owner, key.number)
        self._events.append(TaskEvent(robot, instant, kind, owner, number, text))

    def take_changes(self) -> tuple[tuple[ItemMark, ...], tuple[TaskEvent, ...]]:
        """Remove and return the marks and events since the last call."""
        if not self._marks and not self._events:
            return (), ()
        marks, events = tuple(self._marks.values()), tuple(self._events)
        self._marks, self._events = {}, []
        return marks, events


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawInput:
    """Input of a task that draws a robot's items."""

    robot: str
    index: int
    """Index of the robot in the scenario."""
    start: Pose
    radius: float
    """Radius of its body, m."""
    grid: OccupancyGrid
    map: str
    """The map's name in the scenario, for errors."""
    areas: tuple[Area, ...]
    """Named areas of the scenario."""
    generator: Callable[..., Generator]
    """Returns the random stream of some names: strings and numbers."""


class Task:
    """A model problem. All methods are functions of their arguments."""

    declaration: ClassVar[TaskDeclaration]
    settings: ClassVar[type[Settings]] = Settings
    """Type of its table in the scenario file."""
    item: ClassVar[Any] = Place
    """Type of an item in scenario files and messages; at most ITEM_LIMIT bytes."""
    report: ClassVar[Any] = None
    """Type of a report, a subclass of MessagePart or a union of tagged ones; None: there are no reports."""
    reach: ClassVar[float] = 0.5
    """Distance from which a robot can do an item, m."""
    kernels: ClassVar[tuple[ModuleType, ...]] = ()
    """Modules with numeric kernels that the judge uses."""

    def judge(self, setup: JudgeSetup) -> Judge:
        """Return the judge of a run."""
        raise NotImplementedError

    def draw(self, settings: Any, placing: DrawInput) -> tuple[Any, ...]:
        """Return the initial items of a robot without listed ones. Raises AcrcError without room."""
        return ()

    def check(self, item: Any, grid: OccupancyGrid) -> str | None:
        """Return the fault of a listed item, as text that continues "must"; None if valid."""
        return None

    def point(self, item: Any) -> Point | None:
        """Return the point to which a robot must drive for an item, m; None: there is none."""
        return None

    def listed(self, settings: Any) -> Any:
        """Return the settings that apply once every robot has listed items."""
        return settings

    def settings_fault(
        self, settings: Any, robots: Sequence[str], listed: Collection[str], areas: Sequence[str]
    ) -> str | None:
        """Return the first fault of the settings with respect to other tables; None if valid.

        `listed`: robots with listed items; `areas`: names of the scenario's areas.
        """
        return None

    def draw_keys(self, settings: Any, *, has_areas: bool) -> Mapping[str, Any]:
        """Return keys and values that draw the items which the settings fix for one map; empty: none.

        `has_areas`: the scenario has named areas.
        """
        return {}

    def areas(self, settings: Any, areas: Sequence[tuple[str, T]]) -> Sequence[tuple[str, T]]:
        """Return those named areas in which items are drawn; empty: on all free floor."""
        return areas
