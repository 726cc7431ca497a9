"""Whole runs in memory, and what their recordings show: where robots were, what they held and wanted."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.world.world_setup import WorldSetup
from benchmarks.navigation.goal_log import SUBJECT, LoggedGoal
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.tables import Scenario
from observation.accounting.tracks import Tracks, tracks_of
from observation.evidence.recorded import outcomes
from observation.evidence.run_reader import read_run
from observation.results.navigation_result import NavigationOutcome, navigation_outcome
from observation.results.result import RunResult


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
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus="memory", json=True)
        plan = swarm.plan(scenario, options)
        result = swarm.run_in_memory(plan, lambda progress: None)
        tracks = tracks_of(read_run(options.out))
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
