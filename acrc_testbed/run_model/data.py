"""Columns, events and description of a run, whole or in parts, and the schema of the columns.

One form for runs that have ended, were cut or are going on, simulated or on hardware. Nothing is replayed, so
no code of a strategy runs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.recordings.run_recordings import GivenOrder
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.floor import FloorState
from acrc_testbed.run_model.frames import NO_COPIES, Copies
from acrc_testbed.run_model.introspection import Floats, RecordedProcess, RobotInternals
from actors.floor.grid import OccupancyGrid
from actors.instant import in_seconds
from actors.messages import Jam
from actors.orders import CloseDoor, Give, Lose, Move, Obstacle, OpenDoor, Order, StartJam, Wall
from actors.robot.behaviour.decisions import AdaptationDecision
from actors.robot.navigation.navigation_counts import GivenGoal
from actors.runtime.errors import AcrcError
from actors.task.referee import PlaceOutcome
from actors.task.task import PlaceKey

Points = tuple[tuple[float, float], ...]


class RunDataError(AcrcError):
    """A folder or a stream of messages that does not describe one run."""


class StepColumn(NamedTuple):
    """One quantity per step and robot."""

    name: str
    dtype: Any
    unit: str
    meaning: str
    width: int = 1
    """Values per step and robot."""
    missing: float = 0
    """What stands where nothing was recorded."""


STEP_COLUMNS: Final = (
    StepColumn("true", np.float64, "m, m, rad", "true pose at the start of the step, map frame", 3),
    StepColumn("estimated", np.float64, "m, m, rad", "the robot's estimate; NaN: not reported", 3, np.nan),
    StepColumn("commanded", np.float64, "m/s, m/s, rad/s", "commanded velocity, robot's frame; NaN: none",
           3, np.nan),
    StepColumn("powered", np.bool_, "", "the robot's process is alive"),
    StepColumn("stepping", np.bool_, "", "the robot takes part in the step: it is neither frozen nor off"),
    StepColumn("places_left", np.int64, "", "places that the robot still intends to visit"),
    StepColumn("frames_sent", np.int64, "", "frames that the robot handed to its transceiver in the step"),
    StepColumn("frames_heard", np.int64, "", "frames that the robot received in the step"),
)  # fmt: skip
"""The table by step and robot: of a column `c` of `RunData` the shape is (steps, robots) or (steps, robots,
`width`)."""


def step_columns(steps: int, robots: int) -> dict[str, NDArray[Any]]:
    """Return the columns of the table by step and robot, filled with what stands for a missing value."""
    return {
        one.name: np.full((steps, robots) if one.width == 1 else (steps, robots, one.width), one.missing,
                          one.dtype)
        for one in STEP_COLUMNS
    }  # fmt: skip


class PlaceEvent(NamedTuple):
    """A robot's report about one place: cleaned, adopted or given up."""

    robot: str
    second: float
    place: PlaceKey


class Route(NamedTuple):
    """The places that a robot intends to visit from an instant on."""

    robot: str
    second: float
    places: tuple[PlaceKey, ...]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One robot over time, at its own n instants."""

    seconds: Floats
    """(n,)"""
    poses: Floats
    """(n, 3): x, y, m, and heading, rad: true poses; without ground truth estimated ones."""
    estimated: Floats
    """(n, 3): the robot's own estimates; NaN where it reported none."""
    commanded: Floats
    """(n, 3): commanded velocity in the robot's frame, m/s, m/s, rad/s; NaN: none."""
    states: tuple[tuple[float, str], ...]
    """State changes: "" (active), "frozen", "off" or "not heard", and from when on, s."""


@dataclass(frozen=True)
class RobotReport:
    """What one robot's processes report in their last records; instants in µs."""

    goals: tuple[GivenGoal, ...] | None = ()
    """None: none of them left a last record, as in a run that was cut."""
    planless: tuple[tuple[int, int], ...] = ()
    """Intervals in which navigation found no way."""
    paused: tuple[tuple[int, int | None], ...] = ()
    """Intervals in which the strategy had paused navigation; None: to the end of the run."""
    blocked: tuple[tuple[int, int | None], ...] | None = None
    """Intervals in which the component considered itself blocked; None: it never asks."""
    decisions: tuple[AdaptationDecision, ...] = ()
    unlisted: int = 0
    """Further decisions."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunDescription:
    """What does not change during a run."""

    out: Path
    """The run's folder."""
    title: str
    robots: tuple[str, ...]
    grid: OccupancyGrid
    """The robots' map."""
    step_us: int
    own_places: Mapping[str, Points]
    """By robot the places that it has at the start, m."""
    addresses: Mapping[int, str] = field(default_factory=dict)
    """Robots by short address."""
    radius: float = 0.0
    """Of the largest robot, m."""
    has_truth: bool = True
    """False: nobody recorded where the robots were; poses are estimates."""
    records_frames: bool = False
    """The radio recorded what became of frames."""
    seed: int | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class RunData:
    """A run, or the next part of one that grows: what was recorded from `since` to `end`.

    The columns by step and robot are STEP_COLUMNS; they have no rows where there is no ground truth.
    """

    description: RunDescription
    since: float = 0.0
    """Begin of the part, s."""
    end: float
    """End of the part, s; of a run that goes on, the beginning of its last complete step."""
    seconds: Floats
    """(steps,): when each step began, s."""
    true: Floats
    estimated: Floats
    commanded: Floats
    powered: NDArray[np.bool_]
    stepping: NDArray[np.bool_]
    places_left: NDArray[np.int64]
    frames_sent: NDArray[np.int64]
    frames_heard: NDArray[np.int64]
    trajectories: Mapping[str, Trajectory] = field(default_factory=dict)
    """By robot, in their order."""
    heard: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    """(k, 4): s, index of sender and of receiver, RSSI, dBm, of all frames received from known senders, by
    instant."""
    places: Mapping[str, Points] = field(default_factory=dict)
    """By owner, m: its own places, then those that it was given meanwhile."""
    reported: tuple[PlaceEvent, ...] = ()
    """Places that robots reported as cleaned, in order of the instants."""
    taken_over: tuple[PlaceEvent, ...] = ()
    """Places of other owners that robots added to their routes."""
    given_up: tuple[PlaceEvent, ...] = ()
    routes: tuple[Route, ...] = ()
    """In order of the instants; before its first route each robot intends to visit its own places."""
    jams: tuple[tuple[float, Jam], ...] = ()
    """Jammers, and when each was switched on, s."""
    orders: tuple[GivenOrder, ...] = ()
    """Orders of the scenario and of people, by step; refused ones are among them."""
    floor: tuple[tuple[float, FloorState], ...] = ()
    """Changes of the floor: from when on, s, these objects were on it beside the map."""
    records_floor: bool = True
    """False: the floor was changed by orders, and the recording does not show how."""
    copies: Copies = NO_COPIES
    """Of frames that ended, where the radio recorded them."""
    processes: tuple[RecordedProcess, ...] = ()
    """Of the robots, as far as their recordings have begun."""
    internals: tuple[RobotInternals, ...] = ()
    """What the robots' processes computed, where that is wanted."""
    reports: Mapping[str, RobotReport] = field(default_factory=dict)
    """By robot; only of a whole simulated run."""
    notes: tuple[str, ...] = ()
    """Missing or unknown data, a sentence each."""
    outcomes: tuple[PlaceOutcome, ...] = ()
    """Of each place, as judged by the referee; only of a whole run."""
    result: RunResult | None = None
    """None where the run did not end as planned, and of a part."""

    @property
    def out(self) -> Path:
        """The run's folder."""
        return self.description.out

    @property
    def robots(self) -> tuple[str, ...]:
        """In their order."""
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
    def busy(self) -> NDArray[np.bool_]:
        """(steps, robots): False from when on a robot intends to visit no place any more."""
        return self.places_left > 0

    @property
    def frozen(self) -> NDArray[np.bool_]:
        """(steps, robots): the process is alive and does not step."""
        return self.powered & ~self.stepping

    def index(self, instant: int) -> int:
        """Return the row of the step that begins at an instant, µs, or of the last one."""
        return min(instant // self.step_us, len(self.true) - 1)

    def duration(self, steps: int) -> float:
        """Return the length of so many steps, s."""
        return in_seconds(steps * self.step_us)


_THERE: Final = 0.1
"""A robot that was carried is within this of the ordered point at that step, m."""


class OrderedChange(NamedTuple):
    """A change of the world by an order."""

    second: float
    robot: str
    """The robot that is concerned; empty: none."""
    words: str


def ordered_changes(run: RunData) -> list[OrderedChange]:
    """Return the orders that took effect and that no other mark shows, by step.

    A robot that is to be carried is listed only if it was: the world may have refused.
    """
    found = []
    for step, order in run.orders:
        if words := _words(order):
            robot = order.robot if isinstance(order, Give | Move | Lose) else ""
            if not isinstance(order, Move) or _carried(run, step, order):
                found.append(OrderedChange(in_seconds(step * run.step_us), robot, words))
    return found


def _carried(run: RunData, step: int, order: Move) -> bool:
    if order.robot not in run.robots or not len(run.seconds):
        return False
    row = step - round(run.seconds[0] * 1e6) // run.step_us
    x, y = run.true[min(max(row, 0), len(run.true) - 1), run.robots.index(order.robot), :2].tolist()
    return math.dist((x, y), (order.x, order.y)) < _THERE


def _words(order: Order) -> str:
    """Describe an order; "" for one that other marks show."""
    words = ""
    match order:
        case Obstacle(x, y, radius):
            words = f"a thing of {2 * radius:g} m is put at ({x:.1f}, {y:.1f})"
        case Wall(x, y, to_x, to_y):
            words = f"a wall is put from ({x:.1f}, {y:.1f}) to ({to_x:.1f}, {to_y:.1f})"
        case CloseDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) is to close"
        case OpenDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) opens"
        case StartJam(x, y, radius, duration):
            words = f"a jammer of {radius:g} m at ({x:.1f}, {y:.1f}) for {in_seconds(duration):g} s"
        case Give(_, places):
            words = f"is given {len(places)} more place{'' if len(places) == 1 else 's'}"
        case Move(_, x, y, _):
            words = f"is carried to ({x:.1f}, {y:.1f})"
        case Lose(_, sender):
            words = f"is to lose the next frame of {sender}"
    return words
