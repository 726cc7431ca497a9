"""Runs that measure navigation: robots strewn over a floor plan, each with random goals, as scenarios."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.randomness import generator
from actors.robot_model import RobotModel, load_model
from actors.world.world_setup import WorldSetup
from benchmarks.navigation import goal_log
from benchmarks.navigation.goal_log import SUBJECT, LoggedGoal
from benchmarks.statistics.runs import in_memory
from deploy.scenario.scenario_file import Overrides, parse
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import document
from observation.accounting.tracks import Tracks, tracks_of
from observation.evidence.recorded import outcomes
from observation.evidence.run_reader import read_run
from observation.results.navigation_result import NavigationOutcome, navigation_outcome
from observation.results.result import RunResult

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
    settings: tuple[tuple[str, Any], ...] = ()
    """Keys of a scenario that are other than the presets have them."""
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
        "strategy": {goal_log.LOGGED: goal_log.ERRANDS},
        "robots": {"count": course.robots, "model": MODEL},
        "places": {"preset": "listed"},
        **_presets(course),
        "robot": tables,
    }
    return parse(document(content), course.map, Overrides(settings=course.settings))


def _presets(course: NavigationCourse) -> dict[str, Any]:
    named = {"localisation": course.localisation, "navigation": course.navigation}
    return {table: {"preset": preset} for table, preset in named.items() if preset is not None}


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """What there is to know about a run."""

    world: WorldSetup
    """What the world was told, with everything that was drawn."""
    result: RunResult
    tracks: Tracks
    goals: Mapping[str, list[LoggedGoal]]
    """The log of each robot's goals; none for a behaviour without such a log."""
    navigation: Mapping[str, NavigationOutcome]
    """What each robot's navigation has to say; robots without a word are absent."""


def watch(scenario: Scenario) -> WatchedRun:
    """Run a scenario in this process, and watch. Raises an AcrcError where it cannot be run."""
    with in_memory(scenario) as (plan, result):
        tracks = tracks_of(read_run(plan.out))
        records = {robot.id: plan.folder(robot.id) / f"{robot.id}.mcap" for robot in plan.world.robots}
        said = {robot: outcomes(record) for robot, record in records.items()}
    navigation = {robot: navigation_outcome(records[robot], outcome) for robot, outcome in said.items()}
    return WatchedRun(
        plan.world,
        result,
        tracks,
        {robot: _goals(outcome) for robot, outcome in said.items()},
        {robot: outcome for robot, outcome in navigation.items() if outcome is not None},
    )


def _goals(outcome: Mapping[str, msgspec.Raw]) -> list[LoggedGoal]:
    return msgspec.json.decode(outcome[SUBJECT], type=list[LoggedGoal]) if SUBJECT in outcome else []
