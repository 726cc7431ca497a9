"""Runs that measure navigation: robots strewn over a floor plan, each with random goals, as scenarios."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.randomness import generator
from actors.robot_model import RobotModel, load_model
from benchmarks.navigation import goal_log, goal_orders
from deploy.scenario.scenario_file import parse
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import document

MODEL: Final = "turtlebot2"
"""The chapter's robot, a disc."""


@dataclass(frozen=True)
class NavigationCourse:
    """One run."""

    map: Path
    robots: int
    goals: int
    """Of each robot."""
    seed: int
    localisation: str | None = None
    """Name of a preset; None: as scenarios have it that say nothing."""
    navigation: str | None = None
    margin: float = 0.1
    """Goals and starts lie at least so far beyond the body's radius from walls, m; own choice: a little more
    than what planning keeps."""
    apart: float = 1.0
    """Robots start so far apart, m; own choice."""
    patience: float = 120.0
    """The run ends after so many simulated s per goal of a robot, whatever came of them; own choice: twice
    the longest way across the largest map, and as much again."""


def body() -> RobotModel:
    """The robots' model."""
    return load_model(MODEL, None)


def scenario(course: NavigationCourse) -> Scenario:
    """The run as a scenario: its starts and goals drawn from its seed, uniformly on the floor there is."""
    grid, radius = load_map(course.map), body().footprint.circumradius
    clearance, passage = radius + course.margin, radius + course.margin / 2
    rng = generator(course.seed, "course", course.map.stem)
    starts = draw_points(
        grid, course.robots, rng=rng, clearance=clearance, apart=course.apart, passage=passage
    )
    tables: list[dict[str, Any]] = []
    for number, start in enumerate(starts, start=1):
        goals = draw_points(
            grid, course.goals, rng=rng, clearance=clearance, apart=0.0, start=start, passage=passage
        )
        pose = (*start, float(rng.uniform(-np.pi, np.pi)))
        tables.append({"id": f"r{number}", "start": pose, "places": tuple(map(tuple, goals))})
    content: dict[str, Any] = {
        "map": str(course.map.resolve()),
        "run": {
            "duration": course.patience * course.goals,
            "seed": course.seed,
            "strategy": goal_log.ENTRY,
        },
        "strategy": {goal_log.LOGGED: goal_orders.ENTRY},
        "robots": {"count": course.robots, "model": MODEL},
        "places": {"preset": "listed"},
        **_presets(course),
        "robot": tables,
    }
    return parse(document(content), course.map)


def _presets(course: NavigationCourse) -> dict[str, Any]:
    named = {"localisation": course.localisation, "navigation": course.navigation}
    return {table: {"preset": preset} for table, preset in named.items() if preset is not None}
