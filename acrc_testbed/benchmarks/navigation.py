"""Comparison of the navigation preset `chapter` with the original ROS stack on the same inputs.

A folder of reference data has local_*.npz, global_*.npz and inflation.npz. They contain, for each control
cycle, marks, plan, poses, velocity and the total cost of every sample in ROS Indigo; for pairs of points, the
plans of navfn; for marks, the costs of costmap_2d.
"""

import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from rich.table import Table

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, make_table
from actors.array_types import Floats, Octets
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, Cell, OccupancyGrid
from actors.geometry import Point, Pose, Twist
from actors.instant import Instant
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS, CostMap
from actors.robot.navigation.local_planner import DwaLocalPlanner
from actors.robot.navigation.navfn import NavfnPlanner, global_costs
from actors.robot.navigation.planning import PLANNER_PRESETS
from actors.robot.navigation.steering import DWA_PRESETS
from actors.robot_model import RobotModel, load_model
from actors.runtime.errors import AcrcError
from actors.settings import ParameterError

PRESET: Final = "chapter"
CATEGORIES: Final = ("free", "near_goal", "turning")
"""Categories of cycles, by their number in the data."""
MIN_SAME, MIN_WITHIN_ONE, MIN_EQUAL = 0.95, 0.99, 0.999
MAX_REGRET, MAX_LONGER = 1.0, 0.005
"""Limits of the claim: shares of cycles and cells, 90 % quantile of the regret, relative plan length."""
_SAME: Final = 1e-4
"""Maximum difference of equal velocities, m/s and rad/s."""
_NOW: Final = Instant(1)
Rows = Mapping[str, NDArray[Any]]
_T = TypeVar("_T")
_DATA_ERRORS: Final = (
    *(OSError, EOFError, zipfile.BadZipFile, zlib.error),
    *(ValueError, TypeError, IndexError, AttributeError, ParameterError),
)
"""Errors of files of another kind, or with inconsistent arrays."""


class ReferenceDataError(AcrcError):
    """Reference data that cannot be read."""


@dataclass(frozen=True)
class CycleComparison:
    """Comparison of one chosen velocity with the original's."""

    category: int
    here: bool
    """True if a valid trajectory exists here."""
    there: bool
    """True if a valid trajectory exists in the original."""
    same: bool = False
    within_one: bool = False
    """True if speed and turn rate differ by at most one sample."""
    refused: bool = False
    """True if the original rejects the velocity."""
    regret: float = math.nan
    """Cost of the velocity in the original, minus the original's minimum; nan if either is missing."""


@dataclass(frozen=True)
class CycleFigures:
    """Figures of several cycles; shares refer to cycles with a valid trajectory on both sides."""

    cycles: int
    same: float
    within_one: float
    regret_median: float
    regret_90: float
    refused: float
    only_ours: int
    only_theirs: int


@dataclass(frozen=True)
class PlanFigures:
    """Comparison of plans on one map."""

    pairs: int
    none: int
    """Pairs without a plan here."""
    length_ratio_median: float
    """Our length divided by the original's."""
    length_ratio_max: float
    farthest_apart: float
    """Maximum distance of our points from the original's plan, m."""


def _robot_model() -> RobotModel:
    return load_model("turtlebot2", None)


def check(folder: Path) -> BenchmarkResult:
    """Compare with all reference data in a folder. Raises ReferenceDataError."""
    logs = dict(_compare_files(folder, "local_*.npz", _compare_cycles))
    compared = [cycle for of_file in logs.values() for cycle in of_file]
    if not compared:
        raise ReferenceDataError(f"{folder}: contains no local_*.npz; give a folder of reference data")
    cycles = _by_category(compared)
    files = {name: _by_category(of_file) for name, of_file in logs.items()}
    costs = next((found for _, found in _compare_files(folder, "inflation.npz", _inflation)), None)
    plans = dict(found for _, found in _compare_files(folder, "global_*.npz", _compare_plans))
    own: dict[str, Any] = {**cycles, "files": files, "plans": plans, "inflation": costs}
    figures = msgspec.to_builtins(own)
    title = f"preset {PRESET} compared with dwa_local_planner of ROS Indigo"
    shown: list[Table | str] = [
        make_table([_cycles_row(name, one) for name, one in cycles.items()], title),
        make_table([_file_row(*one) for one in files.items()], "same, within one sample, of n cycles"),
        *_map_sentences(plans, costs),
    ]
    return BenchmarkResult(figures, shown, _is_claim_met(cycles, plans, costs))


def _by_category(cycles: Sequence[CycleComparison]) -> dict[str, CycleFigures]:
    """Return the figures of all cycles and of each category."""
    by_category = {
        name: [one for one in cycles if one.category == index] for index, name in enumerate(CATEGORIES)
    }
    return {name: _cycle_figures(cycles) for name, cycles in {"all": cycles, **by_category}.items()}


def _compare_files(folder: Path, pattern: str, compare: Callable[[Rows], _T]) -> Iterator[tuple[str, _T]]:
    """Compare each file, with any arrays. Raises ReferenceDataError."""
    for file in sorted(folder.glob(pattern)):
        try:
            with np.load(file, allow_pickle=False) as rows:
                found = compare({name: rows[name] for name in rows.files})
        except KeyError as error:
            raise ReferenceDataError(f"{file}: array {error} is missing; give reference data") from None
        except _DATA_ERRORS as error:
            raise ReferenceDataError(f"{file}: cannot be compared: {error}; give reference data") from None
        yield file.stem, found


def _compare_cycles(rows: Rows) -> list[CycleComparison]:
    """Choose the velocity of every cycle from the original's inputs, and compare."""
    model = _robot_model()
    local = CostMap(model.sensor, model.footprint.circumradius, LOCAL_MAP_PRESETS[PRESET])
    planner = DwaLocalPlanner(local, model.drive, DWA_PRESETS[PRESET])
    for name in ("plan_points", "pose_odometry", "pose_map", "velocity"):
        if not np.isfinite(rows[name]).all():  # kernels compute array indices from them
            raise ValueError(f"{name} must contain finite numbers")
    side = len(local.squared)
    if rows["costs"].shape[1:] != (side, side):
        raise ValueError(f"the windows of costs must have {side} by {side} cells")
    return [_compare_cycle(rows, index, local, planner) for index in range(len(rows["time"]))]


def _compare_cycle(rows: Rows, index: int, local: CostMap, planner: DwaLocalPlanner) -> CycleComparison:
    column, row = rows["corner"][index]
    local.restore(_NOW, Cell(int(row), int(column)), (rows["costs"][index] == 254).astype(np.uint8))
    begin, end = rows["plan_start"][rows["plan"][index] :][:2]
    planner.follow(np.ascontiguousarray(rows["plan_points"][begin:end]))
    here, estimate = (Pose(*map(float, rows[name][index])) for name in ("pose_odometry", "pose_map"))
    barred = np.array([False, False, *rows["barred"][index]])
    chosen = planner.dynamic_window(here, estimate, Twist(*map(float, rows["velocity"][index])), barred)
    category, there = int(rows["category"][index]), bool(rows["indigo_valid"][index])
    if chosen.cost < 0.0 or not there:
        return CycleComparison(category, chosen.cost >= 0.0, there)
    return _compare_choice(rows, index, category, (chosen.speed, chosen.turn))


def _compare_choice(rows: Rows, index: int, category: int, choice: tuple[float, float]) -> CycleComparison:
    """Return the comparison of a cycle in which both sides have a valid trajectory."""
    samples = [values[~np.isnan(values)] for values in (rows["vx"][index], rows["omega"][index])]
    spacing = [np.ptp(values) / (count - 1) for values, count in zip(samples, (15, 20), strict=True)]
    nearest = tuple(int(np.abs(values - one).argmin()) for values, one in zip(samples, choice, strict=True))
    distances = [
        abs(float(one) - other) for one, other in zip(rows["indigo_choice"][index], choice, strict=True)
    ]
    refused = bool(rows["indigo_refused"][index][nearest] != 0)
    regret = math.nan
    if not refused:
        # the data have 32-bit costs
        regret = round(float(rows["indigo_total"][index][nearest] - rows["indigo_cost"][index]), 3) + 0.0
    return CycleComparison(
        category,
        here=True,
        there=True,
        same=max(distances) < _SAME,
        within_one=all(gap <= 1.01 * step + _SAME for gap, step in zip(distances, spacing, strict=True)),
        refused=refused,
        regret=regret,
    )


def _cycle_figures(cycles: Sequence[CycleComparison]) -> CycleFigures:
    both = [one for one in cycles if one.here and one.there]
    regrets = [one.regret for one in both if not math.isnan(one.regret)] or [0.0]
    share = 1.0 / max(len(both), 1)
    return CycleFigures(
        cycles=len(cycles),
        same=share * sum(one.same for one in both),
        within_one=share * sum(one.within_one for one in both),
        regret_median=float(np.percentile(regrets, 50)),
        regret_90=float(np.percentile(regrets, 90)),
        refused=share * sum(one.refused for one in both),
        only_ours=sum(one.here and not one.there for one in cycles),
        only_theirs=sum(one.there and not one.here for one in cycles),
    )


def _compare_plans(rows: Rows) -> tuple[str, PlanFigures]:
    """Return the map's name, and the comparison of our plans with navfn's."""
    about = json.loads(str(rows["about"]))
    cells = np.where(rows["occupied"], OCCUPIED, np.where(rows["unknown"], UNKNOWN, FREE))
    grid = OccupancyGrid(cells.astype(np.uint8), about["resolution"], Point(*about["origin"]))
    parameters = PLANNER_PRESETS[PRESET]
    planner = NavfnPlanner(global_costs(grid, _robot_model().footprint.circumradius, parameters), parameters)
    ratios, distances = [], []
    theirs = np.split(rows["plan_points"], rows["plan_start"][1:-1])
    for start, goal, path in zip(rows["starts"], rows["goals"], theirs, strict=True):
        ours = planner.path(Point(*map(float, start)), Point(*map(float, goal)))
        if ours is not None:
            ratios.append(_length(ours) / _length(path))
            distances.append(max(map(min, np.hypot(*(ours[:, None] - path[None]).T))))
    if not ratios:
        raise ValueError("no pair of points has a plan")
    middle, most = float(np.median(ratios)), max(ratios)
    return about["map"], PlanFigures(
        len(theirs), len(theirs) - len(ratios), middle, most, float(max(distances))
    )


def _length(path: Floats) -> float:
    """Return the length of a path of (n, 2) points, m."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _inflation(rows: Rows) -> dict[str, float]:
    """Return the number of cells and the share with the original's cost."""
    about = json.loads(str(rows["about"]))
    marks = np.unpackbits(rows["marks"], axis=-1)
    parts = {"costs_local": "local", "costs_global": "glob"}
    equal = sum(_equal_costs(marks, rows[name], about[numbers]) for name, numbers in parts.items())
    return {"cells": 2 * marks.size, "equal": equal / (2 * marks.size)}


def _equal_costs(marks: Octets, theirs: Octets, numbers: Mapping[str, float]) -> int:
    model = _robot_model()
    parameters = replace(
        LOCAL_MAP_PRESETS[PRESET],
        inflation_radius=numbers["inflation_radius"],
        scaling=numbers["cost_scaling_factor"],
    )
    local = CostMap(model.sensor, model.footprint.circumradius, parameters)
    equal = 0
    for window, costs in zip(marks, theirs, strict=True):
        local.restore(_NOW, Cell(0, 0), np.ascontiguousarray(window))
        equal += int((local.costs() == costs).sum())
    return equal


def _is_claim_met(
    cycles: Mapping[str, CycleFigures], plans: Mapping[str, PlanFigures], costs: Mapping[str, float] | None
) -> bool:
    agree = all(
        one.same >= MIN_SAME and one.within_one >= MIN_WITHIN_ONE and one.regret_90 <= MAX_REGRET
        for one in cycles.values()
        if one.cycles
    )
    lengths = all(
        not one.none and abs(ratio - 1) <= MAX_LONGER
        for one in plans.values()
        for ratio in (one.length_ratio_median, one.length_ratio_max)
    )
    return agree and lengths and (costs is None or costs["equal"] >= MIN_EQUAL)


def _cycles_row(name: str, row: CycleFigures) -> dict[str, object]:
    return {
        "cycles": name.replace("_", " "), "n": row.cycles, "same": f"{row.same:.1%}",
        "within one sample": f"{row.within_one:.1%}", "regret: median": f"{row.regret_median:.3f}",
        "90 %": f"{row.regret_90:.3f}", "refused": f"{row.refused:.1%}", "only ours": row.only_ours,
        "only theirs": row.only_theirs,
    }  # fmt: skip


def _file_row(file: str, cycles: Mapping[str, CycleFigures]) -> dict[str, str]:
    cells = {name: f"{one.same:.1%}, {one.within_one:.1%}, {one.cycles}" for name, one in cycles.items()}
    return {"file": file} | {name.replace("_", " "): cell for name, cell in cells.items()}


def _map_sentences(plans: Mapping[str, PlanFigures], costs: Mapping[str, float] | None) -> list[str]:
    lines = []
    for name, plan in plans.items():
        lengths = f"median {plan.length_ratio_median:.4f}, maximum {plan.length_ratio_max:.4f}"
        lines.append(
            f"plans on {name}: {plan.pairs - plan.none} of {plan.pairs}; length relative to navfn: {lengths}"
            f"; distance at most {plan.farthest_apart:.3f} m"
        )
    if costs is not None:
        lines.append(f"costs after inflation: {costs['equal']:.2%} of {costs['cells']:.0f} cells are equal")
    return lines
