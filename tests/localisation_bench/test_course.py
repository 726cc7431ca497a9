from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.messages import NO_ECHO_MM
from actors.randomness import generator
from actors.world.sensing import RangeSensors
from benchmarks.localisation.course import Course, CourseSetup, made
from benchmarks.localisation.crowd import CrowdParameters
from benchmarks.localisation.route import SUBSTEP, WanderingRoute, site
from tests.localisation_bench.scenes import APARTMENT, CORRIDOR, course

CROWDED = CourseSetup(CORRIDOR, 3, robots=10, base="kobuki", seconds=40)
BODY = 0.177


def off_walls(a: Course, points: NDArray[np.float64]) -> float:
    return min(a.grid.clearance_at(Point(*xy), 1.0) for xy in points.tolist())


@pytest.mark.parametrize(("plan", "seed"), [(CORRIDOR, 1), (CORRIDOR, 2), (APARTMENT, 1), (APARTMENT, 2)])
def test_the_robot_drives_within_its_drive_and_off_all_walls(plan: str, seed: int) -> None:
    place = site(plan, "chapter")
    draws = generator(seed, "test", "robot")
    route = WanderingRoute(place, Pose(*place.point(draws), 0.0), draws)
    track = np.concatenate([route.advance()[0] for _ in range(600)])
    ways = np.diff(track[:, :2], axis=0)
    along = (ways * np.stack([np.cos(track[:-1, 2]), np.sin(track[:-1, 2])], axis=1)).sum(axis=1)
    speed = np.hypot(*ways.T) / SUBSTEP
    assert speed.max() <= 0.5 + 1e-9 and (along > -1e-12).all()
    assert np.abs(np.diff(speed)).max() / SUBSTEP <= 1.0 + 1e-6
    turns = np.diff(np.unwrap(track[:, 2])) / SUBSTEP
    assert np.abs(np.diff(turns)).max() / SUBSTEP <= 3.5 + 1e-6
    assert speed.mean() > 0.35
    assert min(place.grid.clearance_at(Point(*xy), 1.0) for xy in track[::5, :2].tolist()) >= BODY


def test_a_crowd_keeps_near_and_overlaps_nothing() -> None:
    a, told = course(CROWDED), CrowdParameters()
    here = ~np.isnan(a.peers[:, :, 0])
    assert here.mean() > 0.95  # where there is no room, nobody is
    apart = np.hypot(*np.moveaxis(a.peers - a.truth[:, None, :2], 2, 0))
    assert apart[here].min() >= told.nearest and apart[here].max() <= told.farthest
    assert off_walls(a, a.peers[here]) >= BODY
    between = np.hypot(*np.moveaxis(a.peers[:, :, None] - a.peers[:, None, :], 3, 0))
    between[:, np.arange(10), np.arange(10)] = np.inf
    assert np.nanmin(between) >= 2 * BODY
    steps = np.hypot(*np.moveaxis(np.diff(a.peers, axis=0), 2, 0))
    driven = steps[here[1:] & here[:-1]]
    assert np.mean(driven <= told.speed * 0.1 + 1e-9) > 0.99  # few come in anew, all others drive there
    assert np.median(driven) > 0.02


def test_at_the_realistic_dose_the_others_are_near_for_15_s_of_a_minute() -> None:
    a = course(CourseSetup(CORRIDOR, 1, robots=4, at_times=True, seconds=120))
    near = (~np.isnan(a.peers[:, :, 0])).any(axis=1)
    assert abs(near.mean() - 0.25) < 0.01
    assert np.abs(np.diff(near.astype(int))).sum() == 4  # in one piece per minute


def test_equal_setups_give_equal_courses_and_the_dose_leaves_route_and_odometry_alone() -> None:
    once, again = course(CROWDED), made(CROWDED)
    for name in ("truth", "odometry", "scans", "peers"):
        np.testing.assert_array_equal(getattr(once, name), getattr(again, name))
    alone = course(replace(CROWDED, robots=0))
    np.testing.assert_array_equal(once.truth, alone.truth)
    np.testing.assert_array_equal(once.odometry, alone.odometry)
    assert (once.scans != alone.scans).mean() > 0.2
    assert (course(replace(CROWDED, seed=4)).truth != once.truth).any()


def test_an_exact_odometry_leads_from_the_start_along_the_truth_and_a_kobuki_s_does_not() -> None:
    exact = course(replace(CROWDED, robots=0, base="exact"))
    led = np.array([exact.origin.compose(Pose(*pose)) for pose in exact.odometry.tolist()])
    np.testing.assert_allclose(led, exact.truth, atol=1e-9)
    kobuki = course(CROWDED)
    led = np.array([kobuki.origin.compose(Pose(*pose)) for pose in kobuki.odometry.tolist()])
    assert 0.002 < np.hypot(*(led - kobuki.truth)[-1, :2]) < 0.5


def test_the_scans_are_those_of_the_world_s_sensor_at_the_true_poses() -> None:
    a = course(CROWDED)
    place = site(CORRIDOR, "chapter")
    sensors = RangeSensors(place.grid, [place.model], [np.random.default_rng(0)])
    for step in (0, 57, 400):
        there = a.peers[step][~np.isnan(a.peers[step, :, 0])]
        discs = np.column_stack([there, np.full(len(there), BODY)])
        true = sensors.ranges([0], a.truth[step][None], discs)[0]
        echo = a.scans[step] != NO_ECHO_MM
        np.testing.assert_array_equal(echo, true <= a.sensor.range_max)
        np.testing.assert_allclose(a.scans[step][echo] / 1000, true[echo], atol=6e-4)


def test_who_is_carried_away_is_elsewhere_and_its_odometry_does_not_notice() -> None:
    a = course(CourseSetup(APARTMENT, 2, base="kobuki", seconds=8, carried_at=5))
    jumps = np.hypot(*np.diff(a.truth[:, :2], axis=0).T)
    told = np.hypot(*np.diff(a.odometry[:, :2], axis=0).T)
    assert np.flatnonzero(jumps > 0.06).tolist() == [49] and told.max() < 0.06
    assert off_walls(a, a.truth[:, :2]) >= BODY
