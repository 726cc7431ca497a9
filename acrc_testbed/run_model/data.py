"""Data of a run: columns with their schema, events and description.

The same types describe finished, truncated and running runs, simulated or on hardware. Reading them replays
nothing, so no strategy code runs.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from acrc_testbed.recordings.run_recordings import RecordedOrder
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.floor import FloorState
from acrc_testbed.run_model.frame_outcomes import NO_COPIES, FrameCopies
from acrc_testbed.run_model.robot_introspection import RecordedProcess, RobotInternals
from actors.array_types import Flags, Floats, Int64s
from actors.floor.grid import OccupancyGrid
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.messages import ItemMark, Jam, SensorData, TaskEvent
from actors.orders import (
    CloseDoor,
    ItemAssignment,
    LoseFrame,
    Move,
    Obstacle,
    OpenDoor,
    Order,
    StartJam,
    Wall,
)
from actors.robot.behaviour.decisions import AdaptationDecision
from actors.robot.navigation.navigation_counts import GoalRecord
from actors.runtime.errors import AcrcError, printable
from actors.task.task import TaskDeclaration, Value


class RunDataError(AcrcError):
    """Files or messages that do not describe one run."""


class StepColumn(NamedTuple):
    """One quantity per step and robot."""

    name: str
    dtype: Any
    unit: str
    meaning: str
    width: int = 1
    """Values per step and robot."""
    missing: float = 0
    """Fill value where nothing was recorded."""


STEP_COLUMNS: Final = (
    StepColumn("true", np.float64, "m, m, rad", "true pose at the start of the step, map frame", 3),
    StepColumn("estimated", np.float64, "m, m, rad", "the robot's estimate; NaN: not reported", 3, np.nan),
    StepColumn("commanded", np.float64, "m/s, m/s, rad/s", "commanded velocity, robot's frame; NaN: none",
           3, np.nan),
    StepColumn("powered", np.bool_, "", "the robot's process is alive"),
    StepColumn("stepping", np.bool_, "", "the robot takes part in the step: it is neither frozen nor off"),
    StepColumn("items_left", np.int64, "", "items of the task that the robot still intends to do"),
    StepColumn("frames_sent", np.int64, "", "frames that the robot handed to its transceiver in the step"),
    StepColumn("frames_heard", np.int64, "", "frames that the robot received in the step"),
    StepColumn("charge", np.float64, "", "share of the battery's capacity left; NaN: not simulated",
               1, np.nan),
)  # fmt: skip
"""Columns of `RunData` per step and robot, each of shape (steps, robots) or (steps, robots, `width`)."""


def step_columns(steps: int, robots: int) -> dict[str, NDArray[Any]]:
    """Return the columns per step and robot, filled with their missing values."""
    return {
        one.name: np.full((steps, robots) if one.width == 1 else (steps, robots, one.width), one.missing,
                          one.dtype)
        for one in STEP_COLUMNS
    }  # fmt: skip


class ItemEvent(NamedTuple):
    """A robot's report about one item: adopted or given up."""

    robot: str
    second: float
    key: ItemKey


class Route(NamedTuple):
    """Items that a robot intends to do from an instant on."""

    robot: str
    second: float
    items: tuple[ItemKey, ...]


class Trajectory(msgspec.Struct, frozen=True, eq=False):
    """One robot over time, sampled at n instants of its own."""

    seconds: Floats
    """(n,)"""
    poses: Floats
    """(n, 3): true x, y, m, and heading, rad; estimated ones without ground truth."""
    estimated: Floats
    """(n, 3): the robot's own estimates; NaN where it reported none."""
    commanded: Floats
    """(n, 3): commanded velocity in the robot's frame, m/s, m/s, rad/s; NaN: none."""
    states: tuple[tuple[float, str], ...]
    """State changes: the time, s, and the new state: "" (active), "frozen", "off" or "not heard"."""


class RobotReport(msgspec.Struct, frozen=True):
    """Final records of one robot's processes; instants in µs."""

    goals: tuple[GoalRecord, ...] | None = ()
    """None: no process wrote a final record, as in a truncated run."""
    planless: tuple[tuple[int, int], ...] = ()
    """Intervals in which navigation found no path."""
    paused: tuple[tuple[int, int | None], ...] = ()
    """Intervals in which the strategy had paused navigation; None: to the end of the run."""
    blocked: tuple[tuple[int, int | None], ...] | None = None
    """Intervals in which the component detected that it was blocked; None: it has no such detection."""
    decisions: tuple[AdaptationDecision, ...] = ()
    unlisted: int = 0
    """Number of decisions beyond those listed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunDescription:
    """Properties that are constant during a run."""

    out: Path
    """The run's folder."""
    title: str
    robots: tuple[str, ...]
    grid: OccupancyGrid
    """The robots' map."""
    step_us: int
    task: TaskDeclaration
    item_counts: Mapping[str, int]
    """Initial number of items of each robot."""
    addresses: Mapping[int, str] = field(default_factory=dict)
    """Robots by short address."""
    radius: float = 0.0
    """Radius of the largest robot, m."""
    has_truth: bool = True
    """False: ground truth was not recorded; poses are estimates."""
    records_frames: bool = False
    """The radio recorded the outcomes of frames."""
    seed: int | None = None
    has_batteries: bool = False
    """Batteries are simulated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunData:
    """A run, or the next part of a running one, from `since` to `end`.

    The columns per step and robot are STEP_COLUMNS; they have no rows without ground truth.
    """

    description: RunDescription
    since: float = 0.0
    """Start of the part, s."""
    end: float
    """End of the part, s; for a running run, the start of its last complete step."""
    seconds: Floats
    """(steps,): start of each step, s."""
    true: Floats
    estimated: Floats
    commanded: Floats
    powered: Flags
    stepping: Flags
    items_left: Int64s
    frames_sent: Int64s
    frames_heard: Int64s
    charge: Floats
    people: Floats = field(default_factory=lambda: np.zeros((0, 0, 4)))
    """(steps, people, 4): true x, y, m, and vx, vy, m/s, of each person, map frame."""
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)
    """By robot, in scenario order."""
    heard: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    """(k, 4): frames received from known senders, by instant: s, index of sender, of receiver, RSSI, dBm."""
    marks: tuple[tuple[float, ItemMark], ...] = ()
    """New states of items by the task's judge, each with its time, s, in order of time."""
    task_events: tuple[TaskEvent, ...] = ()
    """Events of robots in their task by its judge, in order of time."""
    taken_over: tuple[ItemEvent, ...] = ()
    """Items of other robots that robots added to their routes."""
    given_up: tuple[ItemEvent, ...] = ()
    routes: tuple[Route, ...] = ()
    """In order of time; before its first route each robot intends to do its own initial items."""
    jams: tuple[tuple[float, Jam], ...] = ()
    """Jammers, each with its switch-on time, s."""
    orders: tuple[RecordedOrder, ...] = ()
    """Orders of the scenario and of operators, by step, including rejected ones."""
    floor: tuple[tuple[float, FloorState], ...] = ()
    """Changes of the floor: time, s, and all objects not on the map from then on."""
    records_floor: bool = True
    """False: orders changed the floor, but the changes were not recorded."""
    copies: FrameCopies = NO_COPIES
    """Copies of completed frames, if the radio recorded them."""
    processes: tuple[RecordedProcess, ...] = ()
    """Robot processes whose recordings have begun."""
    internals: tuple[RobotInternals, ...] = ()
    """Introspection of the robots' processes, if requested."""
    senses: Mapping[str, Sequence[SensorData]] = field(default_factory=dict)
    """Sensor data by actor, for a part of a running run, if requested."""
    reports: Mapping[str, RobotReport] = field(default_factory=dict)
    """By robot; only for a whole simulated run."""
    notes: tuple[str, ...] = ()
    """Missing or unknown data, a sentence each."""
    items: tuple[Mapping[str, Value], ...] = ()
    """Rows of the task's table of items (`TaskDeclaration.columns`); only for a whole run."""
    result: RunResult | None = None
    """None if the run did not end as planned, and for a part."""

    @property
    def out(self) -> Path:
        """The run's folder."""
        return self.description.out

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots in scenario order."""
        return self.description.robots

    @property
    def grid(self) -> OccupancyGrid:
        """The robots' map."""
        return self.description.grid

    @property
    def step_us(self) -> int:
        """Length of a step, µs."""
        return self.description.step_us

    @property
    def busy(self) -> Flags:
        """(steps, robots): False once a robot has no items left."""
        return self.items_left > 0

    @property
    def frozen(self) -> Flags:
        """(steps, robots): the process is alive, but does not step."""
        return self.powered & ~self.stepping

    def index(self, instant: int) -> int:
        """Return the row of the step that begins at an instant, µs, or of the last one."""
        return min(instant // self.step_us, len(self.true) - 1)

    def duration(self, steps: int) -> float:
        """Return the duration of a number of steps, s."""
        return in_seconds(steps * self.step_us)


_ARRIVAL_DISTANCE: Final = 0.1
"""Distance between a carried robot and the ordered point at that step, at most, m."""


class AppliedOrder(NamedTuple):
    """An order that changed the world."""

    second: float
    robot: str
    """The affected robot; empty: none."""
    words: str


def ordered_changes(run: RunData) -> list[AppliedOrder]:
    """Return the orders that took effect and have no other mark, by step.

    A move is listed only if the robot arrived: the world may have rejected the order.
    """
    found = []
    for step, order in run.orders:
        if words := _order_text(order, run.description.task):
            robot = order.robot if isinstance(order, ItemAssignment | Move | LoseFrame) else ""
            if not isinstance(order, Move) or _has_arrived(run, step, order):
                found.append(AppliedOrder(in_seconds(step * run.step_us), robot, words))
    return found


def _has_arrived(run: RunData, step: int, order: Move) -> bool:
    if order.robot not in run.robots or not len(run.seconds):
        return False
    row = step - round(run.seconds[0] * 1e6) // run.step_us
    x, y = run.true[min(max(row, 0), len(run.true) - 1), run.robots.index(order.robot), :2].tolist()
    return math.dist((x, y), (order.x, order.y)) < _ARRIVAL_DISTANCE


def _order_text(order: Order, task: TaskDeclaration) -> str:
    """Describe an order; "" for one with other marks."""
    words = ""
    match order:
        case Obstacle(x, y, radius):
            words = f"obstacle of {2 * radius:g} m placed at ({x:.1f}, {y:.1f})"
        case Wall(x, y, to_x, to_y):
            words = f"wall placed from ({x:.1f}, {y:.1f}) to ({to_x:.1f}, {to_y:.1f})"
        case CloseDoor(x, y):
            words = f"door at ({x:.1f}, {y:.1f}) is closing"
        case OpenDoor(x, y):
            words = f"door at ({x:.1f}, {y:.1f}) opens"
        case StartJam(x, y, radius, duration):
            words = f"jammer of {radius:g} m at ({x:.1f}, {y:.1f}) for {in_seconds(duration):g} s"
        case ItemAssignment(_, items):
            words = f"receives {len(items)} more {printable(task.item if len(items) == 1 else task.items)}"
        case Move(_, x, y, _):
            words = f"is carried to ({x:.1f}, {y:.1f})"
        case LoseFrame(_, sender):
            words = f"loses the next frame of {sender}"
    return words
