"""Robots with navigation `robust` reach random goals on three maps without contact."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.installation.repository import REPOSITORY
from actors.instant import Instant
from actors.items import ItemGivenUp
from actors.randomness import generator
from actors.robot.behaviour import Decision, GoalStatus, Start, View
from actors.robot_model import load_model
from cleaning.place import VisitReport, points
from deploy.scenario.scenario_file import Overrides, parse
from deploy.scenario.tables import Scenario, toml_document
from tests.recorded_runs import record

MODEL = "turtlebot2"
MARGIN = 0.1
"""Minimum distance of goals and starts from walls beyond the body's radius, m."""
PATIENCE = 120.0
"""Timeout per goal, simulated s: more than twice the time of the longest path on these maps."""


class GoalSequence:
    """Visit and report the places in order; then continue without reports, as an obstacle for others."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._places = points(start.items)
        self._taken = 0

    def advance(self, view: View, until: Instant) -> Decision:
        if self._taken == 0:
            return self._next(())
        if view.goal is None or view.goal.status is GoalStatus.ACTIVE:
            return Decision()
        place = self._taken - 1
        if place >= len(self._places):
            return self._next(())
        if view.goal.status is GoalStatus.SUCCEEDED:
            return self._next((VisitReport(self._start.robot, place, view.instant),))
        reason = "" if view.goal.reason is None else view.goal.reason.value
        return self._next((), (ItemGivenUp(self._start.robot, place, view.instant, f"navigation: {reason}"),))

    def _next(self, reports: tuple[VisitReport, ...], given_up: tuple[ItemGivenUp, ...] = ()) -> Decision:
        goal = self._places[self._taken % len(self._places)]
        self._taken += 1
        return Decision(goal=goal, reports=reports, given_up=given_up)


def scenario(map_file: Path, robots: int, goals: int, seed: int) -> Scenario:
    grid, radius = load_map(map_file), load_model(MODEL, None).footprint.circumradius
    rng = generator(seed, "course", map_file.stem)
    room: dict[str, Any] = {"rng": rng, "clearance": radius + MARGIN, "passage": radius + MARGIN / 2}
    tables = []
    for number, start in enumerate(draw_points(grid, robots, apart=1.0, **room), start=1):
        places = draw_points(grid, goals, apart=0.0, start=start, **room)
        pose = (*start, float(rng.uniform(-np.pi, np.pi)))
        tables.append({"id": f"r{number}", "start": pose, "places": tuple(map(tuple, places))})
    strategy = "tests.navigation.test_goals:GoalSequence"
    content = {
        "map": str(map_file),
        "run": {"duration": PATIENCE * goals, "seed": seed, "strategy": strategy},
        "robots": {"count": robots, "model": MODEL},
        "places": {"preset": "listed"},
        "navigation": {"preset": "robust"},
        "robot": tables,
    }
    return parse(toml_document(content), map_file, Overrides())


@pytest.mark.claim("navigation")
@pytest.mark.parametrize("robots", [1, pytest.param(4, marks=pytest.mark.nightly)])
@pytest.mark.parametrize(
    "name", ["corridor", *(pytest.param(n, marks=pytest.mark.nightly) for n in ("maze", "apartment"))]
)
def test_random_goals_are_reached_without_contact(
    name: str, robots: int, full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    goals, runs = (4 if robots == 1 else 3, 20) if full else (2, 1)
    results = [
        record(tmp_path / str(seed), scenario(REPOSITORY / "maps" / f"{name}.yaml", robots, goals, seed))
        for seed in range(1, runs + 1)
    ]
    done, total = (sum(int(one.task[f"places_{name}"] or 0) for one in results) for name in ("done", "total"))
    record_property(f"reached on {name} by {robots}", f"{done} of {total}")
    assert total == robots * goals * runs
    assert done == total or (robots > 1 and done >= 0.96 * total - 2)
    assert sum(one.contacts or 0 for one in results) == 0
