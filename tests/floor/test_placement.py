from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, largest_region, reachable
from actors.floor.map_file import load_map, map_warnings
from actors.floor.placement import Area, PlacementError, areas_named, check_pose, draw_points
from actors.geometry import Point
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import parse
from tests.floor.maps import PUBLIC_MAPS, PublicMap, plan, random_plan, room
from tests.refusals import refused

ROOM = room(4.0)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_equal_seeds_draw_equal_points_and_more_points_begin_with_the_same() -> None:
    first = draw_points(ROOM, 5, rng=rng())
    assert first == draw_points(ROOM, 5, rng=rng())
    assert first == draw_points(ROOM, 6, rng=rng())[:5]
    assert first != draw_points(ROOM, 5, rng=rng(2))
    generator, counted = rng(), rng()
    draw_points(ROOM, 3, rng=generator, areas=[Area("west", 1, 1, 2, 3), Area("east", 2, 1, 3, 3)])
    counted.random(12)
    assert generator.random() == counted.random(), "four numbers for each point"


@settings(max_examples=50)
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.integers(1, 4))
def test_points_keep_their_distances(seed: int, clearance: float, apart: float, count: int) -> None:
    grid = random_plan(seed, 20, 20, 0.05)
    keep_off = (Point(-1.0, 9.0), Point(50.0, 50.0), Point(-50.0, -50.0))
    try:
        points = draw_points(grid, count, rng=rng(seed), clearance=clearance, apart=apart, keep_off=keep_off)
    except PlacementError as error:
        assert f"of {count} points" in str(error) or "the map has no reachable point" in str(error)
        return
    assert len(points) == count
    for index, point in enumerate(points):
        assert grid.is_free(point)
        assert grid.clearance_at(point, 1.0) >= clearance - 1e-9
        assert all(point.distance_to(other) >= apart - 1e-9 for other in (*points[:index], *keep_off))


def test_points_are_uniform_in_the_admitted_floor() -> None:
    # 0.6 m of clearance leaves, in whole cells of 0.1 m, the square from 0.7 to 3.3 m
    points = np.array(draw_points(ROOM, 4000, rng=rng(), apart=0.0))
    assert points.min() >= 0.7 and points.max() < 3.3
    for axis in (0, 1):
        assert stats.kstest(points[:, axis], stats.uniform(0.7, 2.6).cdf).pvalue > 0.01
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=10, range=[[0.7, 3.3]] * 2)
    assert stats.chisquare(counts.ravel()).pvalue > 0.01


def test_areas_are_picked_by_surface_and_cut_to_their_exact_edges() -> None:
    large, small = Area("large", 1.03, 1.01, 2.57, 2.99), Area("small", 2.612, 2.034, 2.655, 2.071)
    points = draw_points(ROOM, 4000, rng=rng(), apart=0.0, areas=[large, small])
    inside = [[a.x0 <= p.x <= a.x1 and a.y0 <= p.y <= a.y1 for p in points] for a in (large, small)]
    assert (np.sum(inside, axis=0) == 1).all()
    share = small.surface / (small.surface + large.surface)
    assert stats.binomtest(sum(inside[1]), 4000, share).pvalue > 0.01
    x = [p.x for p, within in zip(points, inside[0], strict=True) if within]
    assert stats.kstest(x, stats.uniform(1.03, 1.54).cdf).pvalue > 0.01, "the cut cells weigh less"
    y = [p.y for p, within in zip(points, inside[0], strict=True) if within]
    assert stats.kstest(y, stats.uniform(1.01, 1.98).cdf).pvalue > 0.01
    cell, wide = Area("cell", 1.0, 1.0, 1.1, 1.1), Area("wide", 2.0, 0.0, 4.0, 4.0)
    points = draw_points(ROOM, 5, rng=rng(), areas=[cell, wide])
    assert sum(point.x < 1.2 for point in points) <= 1


def test_only_reachable_floor_is_used() -> None:
    grid = plan("....#...", "....#...", "....#...", "#####...", "........")
    largest = draw_points(grid, 200, rng=rng(), clearance=0.0, apart=0.0)
    east = reachable(grid, Point(6.0, 4.0))
    assert all(east[grid.cell(point)] for point in largest)
    west = draw_points(grid, 200, rng=rng(), clearance=0.0, apart=0.0, start=Point(0.5, 4.5))
    assert all(point.x < 4 and point.y > 2 for point in west)
    narrow = draw_points(grid, 200, rng=rng(), clearance=0.0, apart=0.0, start=Point(6.5, 3.5), passage=0.7)
    assert all(5 < point.x < 8 and point.y > 1 for point in narrow), "the south strip is 1 m wide"


FEWER = "from each other; use fewer robots or points, or smaller distances."
FREE_FLOOR = "reduce clearance or move the area."
FAR = {"areas": [Area("Moon", 100, 100, 101, 101)]}
NARROW = {"areas": [Area("Hall", 1, 1, 2, 2), Area("Office1", 0, 0, 0.5, 4)]}


@pytest.mark.parametrize(
    ("count", "options", "sentence"),
    [
        (40, {}, f"only 13 of 40 points fit at least 0.6 m from walls and 0.6 m {FEWER}"),
        (1, {"clearance": 2.5}, f"the map has no reachable point at least 2.5 m from walls; {FREE_FLOOR}"),
        (1, NARROW, f"area 'Office1' has no reachable point at least 0.6 m from walls; {FREE_FLOOR}"),
        (1, FAR, f"area 'Moon' has no reachable point at least 0.6 m from walls; {FREE_FLOOR}"),
        (1, {"keep_off": [Point(2.0, 2.0)], "apart": 3.0},
         f"only 0 of 1 points fit at least 0.6 m from walls and 3 m {FEWER}"),
        (1, {"start": Point(0.1, 2.02), "passage": 0.18},
         "a disc of radius 0.18 m does not fit at the start (0.10, 2.02);"
         " the nearest point with room is (0.25, 2.05)."),
        (1, {"start": Point(-3.0, 2.0), "passage": 5.0},
         "a disc of radius 5 m does not fit at the start (-3.00, 2.00);"
         " no point of this map is that far from walls."),
    ],
)  # fmt: skip
def test_points_without_room_are_refused(count: int, options: dict[str, Any], sentence: str) -> None:
    with refused(sentence, PlacementError):
        draw_points(ROOM, count, rng=rng(), **options)


def test_areas_are_checked_and_found_by_name() -> None:
    hall, office = Area("Hall", 0, 0, 2, 1), Area("Office", 3, 0, 4, 1)
    assert areas_named([hall, office], ["Office", "Hall"]) == (office, hall)
    with refused("area 'Kitchen' is not defined; defined are 'Hall', 'Office'.", PlacementError):
        areas_named([hall, office], ["Kitchen"])
    with refused("area 'Kitchen' is not defined; defined are none.", PlacementError):
        areas_named([], ["Kitchen"])
    with refused(
        "area 'Hall' spans x 2 to 2 and y 0 to 1 m, but must have x0 < x1 and y0 < y1.",
        PlacementError,
    ):
        Area("Hall", 2.0, 0.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("point", "where"),
    [
        (Point(0.05, 2.02), "at (0.05, 2.02) is 0.050 m from a wall"),
        (Point(-0.05, 2.02), "at (-0.05, 2.02) is not on free floor"),
        (Point(-7.0, 2.02), "at (-7.00, 2.02) is outside the map"),
    ],
)
def test_an_invalid_pose_is_reported_with_a_valid_one(point: Point, where: str) -> None:
    with refused(
        f"robot 'r3' {where}, but must be at least 0.18 m from walls;"
        " the nearest point with room is (0.25, 2.05).",
        PlacementError,
    ):
        check_pose(ROOM, point, 0.18, "r3")
    check_pose(ROOM, Point(0.25, 2.05), 0.18, "r3")
    check_pose(ROOM, Point(0.5, 2.0), 0.5, "r0")
    with pytest.raises(PlacementError):
        check_pose(ROOM, Point(0.5, 2.0), 0.501, "r0")


each = pytest.mark.parametrize("public", PUBLIC_MAPS, ids=lambda one: one.name.replace("/", " "))


@each
def test_public_maps_are_read(public: PublicMap, tmp_path: Path) -> None:
    path = public.write(tmp_path)
    grid, pixels = load_map(path), np.flipud(public._pixels())
    assert grid.resolution == public.resolution and grid.cells.shape == public.size
    assert (grid.cells[pixels == 254] == FREE).all() and (grid.cells[pixels == 0] == OCCUPIED).all()
    assert (grid.cells[pixels == 205] == (FREE if public.warnings else UNKNOWN)).all()
    assert len(map_warnings(path)) == public.warnings
    floor = (pixels == 254).sum()
    assert largest_region(grid, 0.18).sum() > 0.5 * floor


@pytest.mark.nightly
@each
def test_robots_reach_places_on_public_maps(public: PublicMap, tmp_path: Path) -> None:
    public.write(tmp_path)
    text = (
        'map = "map.yaml"\nlocalisation.preset = "robust"\nnavigation.preset = "robust"\n'
        '[run]\nduration = 120.0\n[robots]\ncount = 2\n[places]\npreset = "free"\nper_robot = 3\n'
    )
    plan = swarm.plan(parse(text, tmp_path / "scenario.toml"), RunOptions(tmp_path / "out", bus="memory"))
    result = swarm.run_in_memory(plan, lambda progress: None)
    assert int(result.task["places_done"] or 0) >= 3 and result.task["places_given_up"] == 0
