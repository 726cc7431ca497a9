"""The chapter's failures: robots block one another and find no trajectory; none is lost."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.installation.repository import REPOSITORY, SHIPPED
from actors.instant import seconds
from benchmarks.measured import average, proportion
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.accounting.account import judge
from observation.accounting.tracks import ABORTED, STANDARD, Episode, Tracks, lost, runs, standing
from observation.accounting.true_floor import Passages
from observation.evidence.run_reader import read_run
from observation.results.outcome import GivenGoal
from tests.helpers import in_memory, in_order

BLOCKED_S = 30.0
"""Robots that stand for so long close to each other block each other."""
WINDOW = 10
ALWAYS = np.ones(60, np.bool_)


class Blocking(NamedTuple):
    robots: tuple[int, ...]
    begin: int
    end: int


def blockings(true: NDArray[np.float64], pursuing: NDArray[np.bool_], window: int = WINDOW) -> list[Blocking]:
    """Groups of robots that stand close to each other for a window of samples although they have goals.

    true: (samples, robots, 2), m; pursuing: (samples, robots).
    """
    count = true.shape[1]
    stood = [standing(true[:, one], pursuing[:, one], window, STANDARD.still) for one in range(count)]
    found: list[Blocking] = []
    for one in range(count):
        for other in range(one + 1, count):
            gap = np.hypot(*(true[:, one] - true[:, other]).T)
            together = runs(stood[one] & stood[other] & (gap <= STANDARD.near), window)
            for new in (Blocking((one, other), *episode) for episode in together):
                found = joined(found, new)
    return sorted(found, key=lambda blocking: (blocking.begin, blocking.robots))


def joined(found: list[Blocking], new: Blocking) -> list[Blocking]:
    """Merge `new` with those that share a robot and a sample with it."""
    left = []
    for one in found:
        if {*one.robots} & {*new.robots} and one.begin < new.end and new.begin < one.end:
            robots = tuple(sorted({*one.robots, *new.robots}))
            new = Blocking(robots, min(one.begin, new.begin), max(one.end, new.end))
        else:
            left.append(one)
    return [*left, new] if len(left) == len(found) else joined(left, new)


def pursuit(goals: Sequence[GivenGoal], tracks: Tracks) -> NDArray[np.bool_]:
    """(steps,): the robot has a goal that it has not reached; an aborted one counts until the next one."""
    pursuing = np.zeros(len(tracks.true), np.bool_)
    for number, goal in enumerate(goals, start=1):
        end = goal.end
        if goal.how in ABORTED:
            end = goals[number].begin if number < len(goals) else None
        last = len(pursuing) if end is None else end // tracks.step_us
        pursuing[goal.begin // tracks.step_us : last] = True
    return pursuing


class Failures(NamedTuple):
    lost: int
    no_trajectory: int
    """Spells without a valid trajectory that ended by themselves."""
    aborted_without_plan: int
    blocked: int
    at_end: int
    """Blockings that last to the end of the run."""
    in_passages: int
    places_left: int
    contacts: int


def failures(task: tuple[int, int, float]) -> Failures:
    """Count failures of one run of `chapter` without adaptation: robots, seed, s."""
    robots, seed, duration = task
    overrides = Overrides(robots=robots, seed=seed, duration=duration, strategy="none")
    with in_memory(load_scenario(SHIPPED / "scenarios" / "chapter.toml", overrides)) as (plan, result):
        tracks, floor, said, _ = judge(read_run(plan.out))
    pursuing = np.column_stack([pursuit(said[robot].goals or (), tracks) for robot in tracks.robots])
    blocked = blockings(tracks.true[..., :2], pursuing, seconds(BLOCKED_S) // tracks.step_us)
    errors = np.hypot(*np.moveaxis(tracks.held[..., :2] - tracks.true[..., :2], -1, 0))
    middles = [tracks.true[one.end - 1, list(one.robots), :2] for one in blocked]
    return Failures(
        lost=sum(len(lost(errors[:, robot])) for robot in range(robots)),
        no_trajectory=result.navigation.no_valid_trajectory.get("itself", 0),
        aborted_without_plan=result.navigation.aborted.get("no plan", 0),
        blocked=len(blocked),
        at_end=sum(one.end == len(tracks.true) for one in blocked),
        in_passages=sum(bool(floor.passages.at(each, STANDARD.beside).any()) for each in middles),
        places_left=result.places_total - result.places_done,
        contacts=result.contacts,
    )


@pytest.mark.claim("failures")
@pytest.mark.timeout(600)
def test_failures_occur_by_themselves(full: bool, record_property: Callable[[str, object], None]) -> None:
    seeds, duration = (20, 600.0) if full else (1, 200.0)
    for robots in (4, 8) if full else (4,):
        tasks = [(robots, seed, duration) for seed in range(1, seeds + 1)]
        found = list(in_order(failures, tasks))
        for name in Failures._fields:
            values = [float(getattr(one, name)) for one in found]
            share, mean = proportion(sum(value > 0 for value in values), seeds), average(values)
            record_property(f"{robots} robots, {name}: share of runs, per run", (share, mean))
        assert any(one.blocked or one.no_trajectory for one in found)
        assert not any(one.lost for one in found)


def track(*stretches: tuple[int, float, float]) -> NDArray[np.float64]:
    """(samples, 2): so many samples at each x, y."""
    return np.array([(x, y) for count, x, y in stretches for _ in range(count)])


def test_runs_of_true() -> None:
    mask = np.array([True, True, False, True, False, True, True, True])
    assert runs(mask) == [(0, 2), (3, 4), (5, 8)]
    assert runs(mask, 2) == [(0, 2), (5, 8)]
    assert runs(np.zeros(4, np.bool_)) == [] == runs(np.zeros(0, np.bool_))


def test_lost_begins_above_one_metre_and_ends_below_half_a_metre() -> None:
    unknown = np.nan
    assert lost(np.array([0.2, 0.9, 1.0, 1.1, 0.7, 1.2, 0.5, 0.49, 0.9])) == [Episode(3, 7)]
    assert lost(np.array([1.5, 0.1, 0.1, 3.0, 4.0])) == [Episode(0, 1), Episode(3, 5)]
    assert lost(np.array([unknown, 1.5, unknown, 0.6, unknown, 0.2, unknown])) == [Episode(1, 5)]


def test_standing_needs_a_whole_window_within_the_distance() -> None:
    stood = standing(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.11, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert runs(stood) == [Episode(10, 20)]
    stood = standing(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.09, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert runs(stood) == [Episode(10, 25)]
    creeping = np.column_stack([np.arange(60) * 0.012, np.zeros(60)])
    assert not standing(creeping, ALWAYS, WINDOW, 0.1).any()
    assert not standing(track((5, 0, 0)), ALWAYS[:5], WINDOW, 0.1).any()


def test_a_robot_without_a_goal_does_not_stand() -> None:
    pursuing = ALWAYS.copy()
    pursuing[25] = False
    assert runs(standing(track((60, 0, 0)), pursuing, WINDOW, 0.1)) == [Episode(0, 25), Episode(26, 60)]
    pursuing[30::9] = False
    assert runs(standing(track((60, 0, 0)), pursuing, WINDOW, 0.1)) == [Episode(0, 25)]


def test_a_chain_is_one_blocking_and_two_pairs_apart_are_two() -> None:
    pair = [track((30, 30, 0), (30, 20, 0)), track((60, 20.5, 0))]
    tracks = [*(track((60, x, 0)) for x in (0.0, 0.8, 1.6)), *pair, track((60, 40.0, 0))]
    true = np.stack(tracks, axis=1)
    found = blockings(true, np.ones(true.shape[:2], np.bool_))
    assert found == [Blocking((0, 1, 2), 0, 60), Blocking((3, 4), 30, 60)]


def test_passages_are_where_one_robot_closes_the_way() -> None:
    passages = Passages(load_map(REPOSITORY / "maps" / "corridor.yaml"), 0.177)
    assert passages.closed_by(Point(12.4, 9.0)) and passages.closed_by(Point(17.2, 10.0))
    for open_floor in (Point(15.0, 11.0), Point(14.8, 11.2), Point(12.4, 5.0), Point(14.2, 4.9)):
        assert not passages.closed_by(open_floor), "corridor, beside a cabinet, office, niche"
    assert passages.beside(Point(12.4, 10.9)) and not passages.closed_by(Point(12.4, 10.9))
    assert not passages.beside(Point(12.4, 11.5))
