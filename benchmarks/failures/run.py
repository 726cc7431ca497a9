"""One run, and how often the chapter's three failures (7.2.1) come about in it, from ground truth.

Lost: the robot holds itself to be more than 1 m from where it is. No valid trajectory: its local planner
finds none for a while, and then does, all by itself. Mutual blocking: robots with goals not reached yet stand
in each other's way. The exact thresholds stand in EpisodeParameters.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.installation.usage import OptionError
from actors.instant import in_seconds, seconds
from actors.robot_model import load_model
from benchmarks.navigation import goal_log
from benchmarks.navigation.course import WatchedRun, watch
from benchmarks.navigation.goal_log import LoggedGoal
from cleaning.strategies import entry
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.stack_tables import stack_fault
from deploy.scenario.tables import Scenario
from observation.accounting.episodes import Blocking, EpisodeParameters, blockings, lost
from observation.accounting.passage import Passages
from observation.accounting.tracks import Tracks

_ITSELF: Final = "itself"
"""How a spell without a valid trajectory ended that resolved."""


@dataclass(frozen=True)
class LostEpisode:
    """A robot that was lost."""

    robot: str
    begin_s: float
    end_s: float
    at_end: bool
    """It was at the end of the run."""


@dataclass(frozen=True)
class NoTrajectorySpell:
    """A while in which a robot's local planner found no valid trajectory."""

    robot: str
    begin_s: float
    end_s: float
    ended_by: str
    """As in NavigationOutcome."""
    nearest: float | None
    """How near another robot came meanwhile, centre to centre, m; None without others."""

    @property
    def resolved(self) -> bool:
        """True if it passed by itself."""
        return self.ended_by == _ITSELF


@dataclass(frozen=True)
class BlockingEpisode:
    """Robots that stood in each other's way."""

    robots: tuple[str, ...]
    begin_s: float
    end_s: float
    at_end: bool
    """They did to the end of the run; otherwise it resolved."""
    x: float
    y: float
    """The middle of them at its end, m, map frame."""
    passage: bool
    """One of them stood in or just before a door or narrow passage, which one robot closes (see Passages)."""


@dataclass(frozen=True)
class FailureRun:
    """What came about in one run."""

    robots: int
    seed: int
    simulated_s: float
    lost: tuple[LostEpisode, ...]
    lost_share: float | None
    """Share of the robots' time with an error above the threshold; None if no robot said where it holds
    itself to be."""
    lost_at_end: int
    """Robots."""
    spells: tuple[NoTrajectorySpell, ...] | None
    """None if no robot's navigation says anything."""
    spells_unlisted: int
    blockings: tuple[BlockingEpisode, ...]
    restless_blockings: tuple[BlockingEpisode, ...]
    """The same if robots that move a little count as standing, too (EpisodeParameters.restless)."""
    blocked_at_end: int
    """Robots in a blocking at the end."""
    aborted: dict[str, int]
    """Goals that navigation gave up, by reason."""
    goals: int
    places: int
    left: int
    """Places not truly visited and reported by the end."""
    contacts: int
    digest: str
    motion: str
    """Hash of the robots' true tracks: equal for runs in which the same happened."""


_PARAMETERS: Final = EpisodeParameters()


@dataclass(frozen=True)
class FailureTask:
    """One run."""

    scenario: Path
    strategy: str
    robots: int
    seed: int
    duration: float | None = None
    """s; None: as in the scenario."""
    localisation: str | None = None
    """Name of a preset, in place of the scenario's table; None: as in the scenario."""
    navigation: str | None = None


def examine(task: FailureTask, parameters: EpisodeParameters = _PARAMETERS) -> FailureRun:
    """Run, and look for failures."""
    done = watch(_scenario(task))
    tracks, result = done.tracks, done.result
    errors = np.hypot(*np.moveaxis(tracks.held[..., :2] - tracks.true[..., :2], -1, 0))
    known = errors[np.isfinite(errors)]
    lost_episodes = _lost(tracks, errors, parameters)
    blocked = _blockings(done, parameters)
    goals = [goal for log in done.goals.values() for goal in log]
    return FailureRun(
        robots=task.robots,
        seed=task.seed,
        simulated_s=result.simulated_s,
        lost=lost_episodes,
        lost_share=float((known > parameters.lost).mean()) if known.size else None,
        lost_at_end=sum(one.at_end for one in lost_episodes),
        spells=_spells(done),
        spells_unlisted=sum(said.no_valid_trajectory_unlisted for said in done.navigation.values()),
        blockings=blocked,
        restless_blockings=_blockings(done, replace(parameters, still=parameters.restless)),
        blocked_at_end=len({robot for one in blocked if one.at_end for robot in one.robots}),
        aborted=dict(sorted(Counter(goal.how for goal in goals if goal.given_up).items())),
        goals=len(goals),
        places=result.places_total,
        left=result.places_total - result.places_done,
        contacts=result.contacts,
        digest=result.digest,
        motion=hashlib.sha256(tracks.true.tobytes()).hexdigest(),
    )


def _scenario(task: FailureTask) -> Scenario:
    """The scenario with every robot's goals logged. Raises OptionError for a preset that there is not."""
    overrides = Overrides(robots=task.robots, seed=task.seed, duration=task.duration, strategy=task.strategy)
    plain = load_scenario(task.scenario, overrides)
    settings = {**plain.strategy, goal_log.LOGGED: entry(plain.run.strategy)}
    logged = plain.run.model_copy(update={"strategy": goal_log.ENTRY})
    named = {"localisation": task.localisation, "navigation": task.navigation}
    tables = {name: {"preset": preset} for name, preset in named.items() if preset is not None}
    scenario = plain.model_copy(update={"run": logged, "strategy": settings, **tables})
    if fault := stack_fault(scenario):
        raise OptionError(fault)
    return scenario


def _lost(
    tracks: Tracks, errors: NDArray[np.float64], parameters: EpisodeParameters
) -> tuple[LostEpisode, ...]:
    return tuple(
        LostEpisode(robot, *_span(tracks, episode.begin, episode.end), episode.end == len(errors))
        for index, robot in enumerate(tracks.robots)
        for episode in lost(errors[:, index], parameters)
    )


def _spells(done: WatchedRun) -> tuple[NoTrajectorySpell, ...] | None:
    if not done.navigation:
        return None
    tracks = done.tracks
    return tuple(
        NoTrajectorySpell(
            robot, in_seconds(begin), in_seconds(end), ended_by,
            _nearest(tracks, tracks.robots.index(robot), begin, end),
        )
        for robot, said in done.navigation.items()
        for begin, end, ended_by in said.no_valid_trajectory
    )  # fmt: skip


def _nearest(tracks: Tracks, robot: int, begin: int, end: int) -> float | None:
    """How near another robot came between two instants, m."""
    if len(tracks.robots) < 2:
        return None
    while_ = tracks.true[tracks.index(begin) : tracks.index(end) + 1, :, :2]
    others = np.delete(while_, robot, axis=1) - while_[:, robot : robot + 1]
    return float(np.hypot(others[..., 0], others[..., 1]).min())


def _blockings(done: WatchedRun, parameters: EpisodeParameters) -> tuple[BlockingEpisode, ...]:
    tracks = done.tracks
    pursuing = np.column_stack([pursuit(done.goals[robot], tracks) for robot in tracks.robots])
    window = seconds(parameters.window_s) // tracks.step_us
    found = blockings(tracks.true[..., :2], pursuing, window, parameters)
    if not found:
        return ()
    radius = max(load_model(robot.model, None).footprint.circumradius for robot in done.world.robots)
    passages = Passages(load_map(done.world.map), radius, parameters.neck)
    return tuple(_episode(tracks, one, passages) for one in found)


def pursuit(goals: Sequence[LoggedGoal], tracks: Tracks) -> NDArray[np.bool_]:
    """(steps,): when a robot has a goal that it has not reached.

    A goal that navigation gave up counts until the next one, or until the end of the run: nobody has told the
    robot that it need not go there any more.
    """
    pursuing = np.zeros(len(tracks.true), np.bool_)
    for number, goal in enumerate(goals, start=1):
        end = goal.end
        if goal.given_up:
            end = goals[number].begin if number < len(goals) else None
        last = len(pursuing) if end is None else end // tracks.step_us
        pursuing[goal.begin // tracks.step_us : last] = True
    return pursuing


def _episode(tracks: Tracks, one: Blocking, passages: Passages) -> BlockingEpisode:
    points = [Point(*xy) for xy in tracks.true[one.end - 1, list(one.robots), :2].tolist()]
    begin_s, end_s = _span(tracks, one.begin, one.end)
    return BlockingEpisode(
        robots=tuple(tracks.robots[robot] for robot in one.robots),
        begin_s=begin_s,
        end_s=end_s,
        at_end=one.end == len(tracks.true),
        x=round(mean(point.x for point in points), 3),
        y=round(mean(point.y for point in points), 3),
        passage=bool(passages.at(np.array(points), _PARAMETERS.beside).any()),
    )


def _span(tracks: Tracks, begin: int, end: int) -> tuple[float, float]:
    return in_seconds(begin * tracks.step_us), in_seconds(end * tracks.step_us)
