"""The chapter's failures: robots block one another and find no trajectory; none is lost."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binomtest

from acrc_testbed.experiments.paired_tests import mean_interval
from acrc_testbed.explanation.episodes import Episode, lost_intervals, standing_mask, true_intervals
from acrc_testbed.explanation.time_accounting import account_time
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.explanation.true_floor import Passages
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.installation.repository import REPOSITORY, SHIPPED
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.helpers import in_memory, in_order

WINDOW = 10
ALWAYS = np.ones(60, np.bool_)


class Failures(NamedTuple):
    lost_s: float
    no_trajectory: int
    """Spells without a valid trajectory that ended by themselves."""
    aborted_without_plan: int
    blocked: int
    at_end: int
    """Blockings that last to the end of the run."""
    in_passages: int
    deadlocks: int
    places_left: int
    contacts: int


def failures(task: tuple[int, int, float]) -> Failures:
    """Count failures of one run of `chapter` without adaptation: robots, seed, s."""
    robots, seed, duration = task
    overrides = Overrides(robots=robots, seed=seed, duration=duration, strategy="none")
    with in_memory(load_scenario(SHIPPED / "scenarios" / "chapter.toml", overrides)) as (plan, result):
        spent = account_time(plan.out)
    assert spent.deadlocks is not None
    places: dict[str, Any] = dict(result.task)
    return Failures(
        lost_s=sum(each[Cause.LOST.value] for each in spent.robots.values()),
        no_trajectory=result.navigation.no_valid_trajectory.get("itself", 0),
        aborted_without_plan=result.navigation.aborted.get("no plan", 0),
        blocked=len(spent.blockings),
        at_end=sum(one.at_end for one in spent.blockings),
        in_passages=sum(one.place != "open floor" for one in spent.blockings),
        deadlocks=spent.deadlocks.pairs,
        places_left=places["places_total"] - (places["places_done"] or 0),
        contacts=result.contacts or 0,
    )


@pytest.mark.claim("failures")
@pytest.mark.timeout(600)
def test_failures_occur_by_themselves(full: bool, record_property: Callable[[str, object], None]) -> None:
    seeds, duration = (20, 600.0) if full else (1, 60.0)
    for robots in (4, 8) if full else (4,):
        tasks = [(robots, seed, duration) for seed in range(1, seeds + 1)]
        found = list(in_order(failures, tasks))
        for name in Failures._fields:
            values = [float(getattr(one, name)) for one in found]
            bounds = binomtest(sum(value > 0 for value in values), seeds).proportion_ci(method="wilson")
            record_property(f"{robots} robots, {name}: share of runs", (bounds.low, bounds.high))
            record_property(f"{robots} robots, {name}: per run", mean_interval(values))
        assert any(one.blocked or one.no_trajectory for one in found)
        assert not any(one.lost_s for one in found)


def track(*stretches: tuple[int, float, float]) -> NDArray[np.float64]:
    """Return (samples, 2): the given number of samples at each x, y."""
    return np.array([(x, y) for count, x, y in stretches for _ in range(count)])


def test_runs_of_true() -> None:
    mask = np.array([True, True, False, True, False, True, True, True])
    assert true_intervals(mask) == [(0, 2), (3, 4), (5, 8)]
    assert true_intervals(mask, 2) == [(0, 2), (5, 8)]
    assert true_intervals(np.zeros(4, np.bool_)) == [] == true_intervals(np.zeros(0, np.bool_))


def test_lost_begins_above_one_metre_and_ends_below_half_a_metre() -> None:
    unknown = np.nan
    assert lost_intervals(np.array([0.2, 0.9, 1.0, 1.1, 0.7, 1.2, 0.5, 0.49, 0.9])) == [Episode(3, 7)]
    assert lost_intervals(np.array([1.5, 0.1, 0.1, 3.0, 4.0])) == [Episode(0, 1), Episode(3, 5)]
    assert lost_intervals(np.array([unknown, 1.5, unknown, 0.6, unknown, 0.2, unknown])) == [Episode(1, 5)]


def test_standing_needs_a_whole_window_within_the_distance() -> None:
    stood = standing_mask(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.11, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert true_intervals(stood) == [Episode(10, 20)]
    stood = standing_mask(track((9, 0, 0), (1, 5, 0), (10, 9, 0), (5, 9.09, 0)), ALWAYS[:25], WINDOW, 0.1)
    assert true_intervals(stood) == [Episode(10, 25)]
    creeping = np.column_stack([np.arange(60) * 0.012, np.zeros(60)])
    assert not standing_mask(creeping, ALWAYS, WINDOW, 0.1).any()
    assert not standing_mask(track((5, 0, 0)), ALWAYS[:5], WINDOW, 0.1).any()

    pursuing = ALWAYS.copy()
    pursuing[25] = False
    assert true_intervals(standing_mask(track((60, 0, 0)), pursuing, WINDOW, 0.1)) == [
        Episode(0, 25),
        Episode(26, 60),
    ]


def test_passages_are_where_one_robot_closes_the_way() -> None:
    passages = Passages(load_map(REPOSITORY / "maps" / "corridor.yaml"), 0.177)
    assert passages.is_closed_by(Point(12.4, 9.0)) and passages.is_closed_by(Point(17.2, 10.0))
    for open_floor in (Point(15.0, 11.0), Point(14.8, 11.2), Point(12.4, 5.0), Point(14.2, 4.9)):
        assert not passages.is_closed_by(open_floor), "corridor, beside a cabinet, office, niche"
    assert passages.is_near_passage(Point(12.4, 10.9)) and not passages.is_closed_by(Point(12.4, 10.9))
    assert not passages.is_near_passage(Point(12.4, 11.5))
