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
from actors.robot.localisation import PRESETS, Amcl, AmclParameters, Estimate, likelihood_field
from actors.robot.sweep import Sweep
from tests.localisation.scenes import (
    APARTMENT,
    FIELD,
    ROOM,
    STEP,
    TURTLEBOT,
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


def test_finds_itself_from_anywhere(full: bool) -> None:
    """At least 9 of 10 within a minute; lost until then, and then no more."""
    found, seeds = 0, 10 if full else 3
    for seed in range(seeds):
        localiser = amcl(ROBUST, None, apartment(), seed)
        assert localiser.particles.shape == (ROBUST.max_particles, 3)
        assert localiser.update(Pose(0.0, 0.0, 0.0), None).lost > 0.99
        track = list(Drive(APARTMENT, anywhere(seed), seed).sweeps(60.0))
        for _, sweep in track:
            told = localiser.update(sweep.pose, sweep)
        truth = track[-1][0]
        turned = abs(wrap(told.pose.heading - truth.heading))
        found += error(told.pose, truth) < 0.5 and turned < math.radians(15) and told.lost < 0.05
    assert found >= 0.9 * seeds


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


def test_finds_itself_again_after_it_was_carried_elsewhere_and_only_with_a_search(full: bool) -> None:
    """At least 5 of 6 within a minute with it; without it at most 1 of 4, by a chance meeting."""
    assert sum(is_right(carried(ROBUST, seed)[1]) for seed in range(6 if full else 2)) >= (5 if full else 2)
    assert sum(is_right(carried(UNSEARCHED, seed)[1]) for seed in range(4 if full else 2)) <= 1


@pytest.mark.parametrize("parameters", [ROBUST, UNSEARCHED], ids=["search", "no search"])
@pytest.mark.parametrize("seed", sampled(range(6), every_day=range(2)))
def test_who_is_carried_away_says_so_within_5_s_and_not_before(parameters: AmclParameters, seed: int) -> None:
    before, after = carried(parameters, seed)
    assert max(told.lost for _, told in before) < 0.05
    assert max(told.lost for _, told in after[: round(5.0 / STEP)]) > 0.5


@pytest.mark.parametrize("seed", sampled(range(6), every_day=range(2)))
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
@pytest.mark.parametrize("seed", sampled(range(4), every_day=(0,)))
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
@pytest.mark.parametrize(
    ("plan", "here"),
    [(TWINS, WEST), pytest.param(CORRIDOR, OFFICE, marks=pytest.mark.nightly)],
    ids=["twins", "corridor"],
)
def test_in_one_of_two_rooms_that_are_alike_it_stays_lost(plan: OccupancyGrid, here: Pose, seed: int) -> None:
    """No scan says in which: who is sure of one is wrong as often as right."""
    localiser = amcl(ROBUST, None, likelihood_field(plan, 2.0), seed)
    for _, sweep in turning(plan, here):
        told = localiser.update(sweep.pose, sweep)
        assert told.lost >= 0.5


TRUTH = Pose(3.2, 4.5, 0.6)
HERE = Pose(40.0, -7.0, 2.0)
"""What the odometry says; its origin is far away, as after a long drive."""


def stand(believed: Pose, doubt: float, preset: str, seed: int, scans: int = 60) -> tuple[int | None, Pose]:
    """Scans until it was located, None if it was not; and its pose then."""
    start = believed.compose(HERE.relative(Pose(0.0, 0.0, 0.0)))
    parameters, generator = PRESETS[preset], np.random.default_rng(seed)
    localiser = Amcl(FIELD, TURTLEBOT.sensor, start, generator, parameters, doubt)
    seen = scan(ROOM, TRUTH)
    before = localiser.update(HERE, None)
    assert not before.located and before.lost == 1.0
    for number in range(1, scans + 1):
        estimate = localiser.update(HERE, Sweep(seen, HERE))
        if estimate.located:
            assert estimate.lost < 0.1
            return number, estimate.pose
    return None, estimate.pose


@pytest.mark.parametrize(("preset", "seed"), [("chapter", 0), ("robust", 1)])
def test_near_to_where_it_last_was_it_is_located_while_it_stands(preset: str, seed: int) -> None:
    believed = Pose(TRUTH.x + 0.3, TRUTH.y - 0.25, TRUTH.heading + 0.25)
    scans, pose = stand(believed, 0.3, preset, seed)
    assert scans is not None
    assert error(pose, TRUTH) < 0.2 and abs(pose.heading - TRUTH.heading) < 0.1


@pytest.mark.parametrize(("preset", "seed"), [("chapter", 0), ("robust", 1)])
def test_carried_elsewhere_it_is_not_located(preset: str, seed: int) -> None:
    scans, _ = stand(Pose(6.8, 1.5, -2.0), 0.3, preset, seed)
    assert scans is None, "rooms are alike: what is far from what it knew it has to be told"


def test_it_has_particles_everywhere_says_that_it_is_lost_and_comes_back() -> None:
    here = anywhere(1, 0)
    robot = amcl(ROBUST, here, apartment(), 1)
    drive = list(Drive(APARTMENT, here, 1).sweeps(60.0))
    for _, sweep in drive[:50]:
        estimate = robot.update(sweep.pose, sweep)
    assert estimate.lost < 0.05 and np.ptp(robot.particles[:, 0]) < 2.0
    robot.relocalise()
    assert len(robot.particles) == ROBUST.max_particles and np.ptp(robot.particles[:, 0]) > 5.0
    assert robot.update(drive[50][1].pose, None).lost > 0.99
    for _, sweep in drive[50:]:
        estimate = robot.update(sweep.pose, Sweep(sweep.ranges_mm, sweep.pose))
    assert error(estimate.pose, drive[-1][0]) < 0.5 and estimate.lost < 0.05
