"""Localisation error of the particle filter on simulated courses, and properties of the courses."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from acrc_testbed.benchmarks.localisation_comparison import root_mean_square
from acrc_testbed.benchmarks.localisation_tracking import (
    FilterRun,
    Preset,
    errors_against_truth,
    localisation,
    replay,
)
from actors.geometry import Point
from actors.world.uncertainty import Uncertainty
from tests.localisation.courses import APARTMENT, CORRIDOR, MAZE, NEAREST, RADIUS, Setup, drive

Record = Callable[[str, object], None]
ALONE: Final = Setup()
KOBUKI: Final = Setup(base="kobuki")
AT_TIMES: Final = Setup(base="kobuki", robots=4, at_times=True)
CROWD: Final = Setup(APARTMENT, base="kobuki", robots=10)
NIGHTLY: Final = pytest.mark.nightly
GOALS: Final[dict[str, tuple[Setup, Preset, float, float]]] = {
    "alone/chapter": (ALONE, "chapter", 0.08, 0.0),
    "alone/robust": (ALONE, "robust", 0.08, 0.0),
    "at-times/robust": (AT_TIMES, "robust", 0.15, 0.0),
    **{
        f"crowd/{name}/{view}/robust": (replace(CROWD, plan=plan, view=view), "robust", 0.15, 0.05)
        for name, plan in {"apartment": APARTMENT, "corridor": CORRIDOR, "maze": MAZE}.items()
        for view in ("chapter", "kinect")
    },
}
"""Setup, preset, largest rmse, m, and largest share of lost runs."""
SUITE: Final = ("alone/chapter", "crowd/apartment/chapter/robust")
DOSES: Final = (
    *(replace(KOBUKI, dose=Uncertainty(drift=times)) for times in (5.0, 20.0)),
    *(replace(ALONE, dose=Uncertainty(map_error=error)) for error in (0.05, 0.1, 0.2)),
    *(replace(ALONE, dose=Uncertainty(glass=share)) for share in (0.2, 0.5)),
    *(replace(ALONE, dose=Uncertainty(furniture=pieces)) for pieces in (10, 30)),
    replace(KOBUKI, dose=Uncertainty(0.1, 0.2, 10, 5.0)),
)
CAUSES: Final = (
    ALONE,
    replace(ALONE, base="stage"),
    KOBUKI,
    *(replace(ALONE, robots=4, at_times=at_times) for at_times in (True, False)),
    *(replace(KOBUKI, robots=robots) for robots in (4, 10)),
    replace(ALONE, robots=10),
    *DOSES,
)
"""One cause of localisation errors at a time."""


def runs_of(
    setup: Setup, preset: Preset, count: int, seconds: float, *, placed: bool = True
) -> list[FilterRun]:
    found = []
    for seed in range(1, count + 1):
        course = drive(replace(setup, seed=seed, seconds=seconds))
        track = replay(course, localisation(course, preset, seed, placed=placed))
        found.append(errors_against_truth(seed, course.truth, course.odometry, track))
    return found


def record(report: Record, runs: Sequence[FilterRun], name: str) -> tuple[float, int]:
    """Report the root mean square error, m, and the number of lost runs; return both."""
    rmse, lost = root_mean_square(runs).value, sum(run.lost for run in runs)
    report(f"{name} rmse (m)", round(rmse, 3))
    report(f"{name} lost", f"{lost} of {len(runs)}")
    return rmse, lost


@pytest.mark.claim("localisation")
@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in SUITE else [NIGHTLY]) for n in GOALS])
def test_the_localisation_keeps_track(name: str, full: bool, record_property: Record) -> None:
    setup, preset, largest_rmse, lost_share = GOALS[name]
    count = (20 if setup.robots == 10 else 100) if full else 1
    runs = runs_of(setup, preset, count, 240.0 if full else 60.0)
    rmse, lost = record(record_property, runs, name)
    assert rmse <= largest_rmse
    assert lost <= lost_share * count


@pytest.mark.claim("localisation")
@pytest.mark.nightly
@pytest.mark.parametrize("setup", CAUSES, ids=str)
def test_what_loses_the_localisation(setup: Setup, full: bool, record_property: Record) -> None:
    for view in ("chapter", "kinect"):
        for preset in ("chapter", "robust"):
            seen = replace(setup, view=view)
            runs = runs_of(seen, preset, 20 if full else 1, 240.0 if full else 30.0)
            rmse, lost = record(record_property, runs, f"{view} {preset}")
            if preset == "robust" and setup.dose.glass == 0:
                assert lost == 0
                assert rmse < 0.2


@pytest.mark.claim("localisation")
@pytest.mark.nightly
@pytest.mark.parametrize("plan", [CORRIDOR, APARTMENT, MAZE])
@pytest.mark.parametrize("carried_at", [None, 30.0], ids=["anywhere", "carried"])
def test_a_lost_robot_finds_itself(
    plan: str, carried_at: float | None, full: bool, record_property: Record
) -> None:
    begin = carried_at or 0.0
    setup = replace(KOBUKI, plan=plan, carried_at=carried_at)
    runs = runs_of(setup, "robust", 20 if full else 1, begin + 60.0, placed=carried_at is not None)
    found = [sum(run.found(round(10 * (begin + after))) for run in runs) for after in (10.0, 30.0, 60.0)]
    record_property("found after 10, 30, 60 s", f"{found} of {len(runs)}")
    assert found[-1] >= 0.9 * len(runs)


def test_courses_keep_off_walls_and_other_robots() -> None:
    course = drive(replace(CROWD, plan=CORRIDOR, seconds=40.0))
    again = drive.__wrapped__(replace(CROWD, plan=CORRIDOR, seconds=40.0))
    for name in ("truth", "odometry", "scans"):
        np.testing.assert_array_equal(getattr(course, name), getattr(again, name))
    clearances = [course.grid.clearance_at(Point(*pose[:2]), 1.0) for pose in course.truth.tolist()]
    assert min(clearances) >= RADIUS
    alone = drive(replace(CROWD, plan=CORRIDOR, robots=0, seconds=40.0))
    np.testing.assert_array_equal(course.truth, alone.truth)
    assert (course.scans != alone.scans).mean() > 0.2
    nearest = (NEAREST - RADIUS - math.hypot(course.sensor.x, course.sensor.y)) * 1000
    assert course.scans[course.scans != alone.scans].min() > nearest - 1
