"""A robot that does not know where it is, or not even that: what it says of itself, and when it knows."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Pose, wrap
from actors.installation.repository import REPOSITORY
from actors.robot.localisation import PRESETS, AmclParameters, Estimate, likelihood_field
from actors.robot.sweep import Sweep
from tests.localisation.scenes import (
    APARTMENT,
    ROOM,
    STEP,
    Drive,
    amcl,
    anywhere,
    apartment,
    error,
    place,
    scan,
    twins,
)
from tests.seeds import sampled

CHAPTER, ROBUST = PRESETS["chapter"], PRESETS["robust"]
BOTH = pytest.mark.parametrize("parameters", [CHAPTER, ROBUST], ids=["chapter", "robust"])
UNSEARCHED = replace(ROBUST, search_poses=0)
START = Pose(1.0, 4.5, 0.0)
WEST = Pose(3.0, 1.0, 0.5)
Told = list[tuple[Pose, Estimate]]
"""The truth and the estimate, one per scan."""


def test_finds_itself_from_anywhere() -> None:
    """At least 9 of 10 within a minute; lost until then, and then no more."""
    found = 0
    for seed in range(10):
        localiser = amcl(ROBUST, None, apartment(), seed)
        assert localiser.particles.shape == (ROBUST.max_particles, 3)
        assert localiser.update(Pose(0.0, 0.0, 0.0), None).lost > 0.99
        track = list(Drive(APARTMENT, anywhere(seed), seed).sweeps(60.0))
        for _, sweep in track:
            told = localiser.update(sweep.pose, sweep)
        truth = track[-1][0]
        turned = abs(wrap(told.pose.heading - truth.heading))
        found += error(told.pose, truth) < 0.5 and turned < math.radians(15) and told.lost < 0.05
    assert found >= 9


@cache
def carried(parameters: AmclParameters, seed: int) -> tuple[Told, Told]:
    """A robot that somebody carries to another place in the apartment: before and a minute after."""
    here, there = anywhere(seed, 0), anywhere(seed, 1)
    localiser = amcl(parameters, here, apartment(), seed)
    before, after = [], []
    for truth, sweep in Drive(APARTMENT, here, seed).sweeps(15.0):
        before.append((truth, localiser.update(sweep.pose, sweep)))
        left = sweep.pose
    for truth, sweep in Drive(APARTMENT, there, seed).sweeps(60.0):
        odometry = left.compose(sweep.pose)
        after.append((truth, localiser.update(odometry, Sweep(sweep.ranges_mm, odometry))))
    return before, after


def is_right(told: Told) -> bool:
    truth, estimate = told[-1]
    return error(estimate.pose, truth) < 0.5


def test_finds_itself_again_after_it_was_carried_elsewhere_and_only_with_a_search() -> None:
    """At least 5 of 6 within a minute with it; without it at most 1 of 4, by a chance meeting."""
    assert sum(is_right(carried(ROBUST, seed)[1]) for seed in range(6)) >= 5
    assert sum(is_right(carried(UNSEARCHED, seed)[1]) for seed in range(4)) <= 1


@pytest.mark.parametrize("parameters", [ROBUST, UNSEARCHED], ids=["search", "no search"])
@pytest.mark.parametrize("seed", sampled(range(6), every_day=range(4)))
def test_who_is_carried_away_says_so_within_5_s_and_not_before(parameters: AmclParameters, seed: int) -> None:
    before, after = carried(parameters, seed)
    assert max(told.lost for _, told in before) < 0.05
    assert max(told.lost for _, told in after[: round(5.0 / STEP)]) > 0.5


@pytest.mark.parametrize("seed", sampled(range(6), every_day=range(4)))
def test_who_is_found_is_lost_no_more_and_who_is_not_stays_so(seed: int) -> None:
    _, after = carried(ROBUST, seed)
    assert is_right(after) and after[-1][1].lost < 0.05
    _, after = carried(UNSEARCHED, seed)
    assert is_right(after) or after[-1][1].lost > 0.5


def test_the_covariance_of_a_lost_robot_is_as_large_as_the_floor() -> None:
    before, after = carried(UNSEARCHED, 0)
    floor, told = apartment().anywhere, after[-1][1]
    assert max(told.covariance[i] for _, told in before for i in (0, 4)) < 0.01
    assert told.covariance[0] > 0.5 * floor[0] and told.covariance[4] > 0.5 * floor[4]


@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_in_a_crowd_it_is_never_thought_lost(parameters: AmclParameters, seed: int) -> None:
    """Bodies make beams shorter, and only longer ones speak against a pose."""
    crowd = [(*place(ROOM, np.random.default_rng([seed, i])), 0.18) for i in range(8)]
    localiser = amcl(parameters, START, seed=seed)
    for truth, sweep in Drive(ROOM, START, seed, crowd).sweeps(40.0):
        told = localiser.update(sweep.pose, sweep)
        assert told.lost < 0.05 and error(told.pose, truth) < 0.3
    assert (localiser.outcome()["lost"], localiser.outcome()["found"]) == (0, 0)


def turning(plan: OccupancyGrid, here: Pose) -> Iterator[tuple[Pose, Sweep]]:
    """20 s on one spot, at 1 rad/s."""
    for number in range(round(20.0 / STEP)):
        odometry = Pose(0.0, 0.0, wrap(STEP * number))
        pose = here.compose(odometry)
        yield pose, Sweep(scan(plan, pose), odometry)


TWINS = twins()
CORRIDOR, OFFICE = load_map(REPOSITORY / "maps" / "corridor.yaml"), Pose(12.5, 4.0, 0.0)


@pytest.mark.parametrize("seed", sampled(range(4), every_day=(0,)))
@pytest.mark.parametrize(("plan", "here"), [(TWINS, WEST), (CORRIDOR, OFFICE)], ids=["twins", "corridor"])
def test_in_one_of_two_rooms_that_are_alike_it_stays_lost(plan: OccupancyGrid, here: Pose, seed: int) -> None:
    """No scan says in which: who is sure of one is wrong as often as right."""
    localiser = amcl(ROBUST, None, likelihood_field(plan, 2.0), seed)
    for _, sweep in turning(plan, here):
        told = localiser.update(sweep.pose, sweep)
        assert told.lost >= 0.5
