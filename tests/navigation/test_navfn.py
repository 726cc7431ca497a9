"""Plans of navfn, compared with the original's point by point, and their properties."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.array_types import Floats, Octets
from actors.floor import raster
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.robot.assembly import shared_map_data
from actors.robot.navigation.navfn import NavfnPlanner, global_costs, static_costs
from actors.robot.navigation.planning import PLANNER_PRESETS, GridPlanner, PlanningParameters, planning_grid
from actors.robot.navigation.potential import IMPASSABLE, UNREACHED, steepest_descent, wave
from actors.robot.stack import Stack, stack
from actors.robot_model import load_model
from actors.settings import ParameterError
from tests.robot.base import TWO_ROOMS

RADIUS = 0.177
CHAPTER = PLANNER_PRESETS["chapter"]
MAPS = Path(__file__).parents[2] / "maps"
ROWS = Path(__file__).parent / "original"
START, GOAL = Point(1.0, 1.75), Point(8.0, 1.75)
DOOR = np.array([[4.7, 1.75], [4.75, 1.5], [4.75, 2.0]])  # marks of a robot in the door


def planner(floor: OccupancyGrid, parameters: PlanningParameters = CHAPTER) -> NavfnPlanner:
    return NavfnPlanner(global_costs(floor, RADIUS, parameters), parameters)


def length(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def is_on_free_cells(floor: OccupancyGrid, path: Floats) -> bool:
    costs = global_costs(floor, RADIUS, CHAPTER).costs
    column, row = np.rint((path - np.array(floor.origin)) / floor.resolution).astype(int).T[:, 1:-1]
    return bool((costs[row, column] < IMPASSABLE).all())


@pytest.fixture(params=["apartment", "corridor", "maze"])
def rows(request: pytest.FixtureRequest) -> dict[str, NDArray[Any]]:
    with np.load(ROWS / f"global_{request.param}.npz") as found:
        return {**found, "floor": np.array(load_map(MAPS / f"{request.param}.yaml"), object)}


def test_costs_potentials_and_plans_are_the_originals(rows: dict[str, NDArray[Any]]) -> None:
    floor = rows["floor"].item()
    on, field = planner(floor), global_costs(floor, RADIUS, CHAPTER)
    assert np.array_equal(static_costs(floor, field.inflation), rows["costs"])
    theirs = np.split(rows["plan_points"].astype(np.float64), rows["plan_start"][1:-1])
    assert len(theirs) == 6
    pairs = zip(rows["starts"].tolist(), rows["goals"].tolist(), strict=True)
    for (start, goal), path, potential in zip(pairs, theirs, rows["potential"], strict=True):
        ours, there = on.path(Point(*start), Point(*goal)), floor.cell(Point(*goal))
        assert ours is not None and ours.shape == path.shape
        assert np.abs(ours - path).max() < 1e-5
        assert wave(field.costs, floor.cell(Point(*start)), CHAPTER.neutral, there)[there] == potential


def gap(cells: int, resolution: float) -> OccupancyGrid:
    """Return two rooms of 2 m by 2 m, separated by a wall of one cell with a gap of some cells."""
    side = round(2.0 / resolution)
    walls = np.ones((side + 2, 2 * side + 3), dtype=bool)
    walls[1:-1, 1 : side + 1] = walls[1:-1, side + 2 : -1] = False
    walls[side // 2 : side // 2 + cells, side + 1] = False
    return OccupancyGrid(np.where(walls, OCCUPIED, FREE).astype(np.uint8), resolution)


@pytest.mark.parametrize(("resolution", "least"), [(0.05, 7), (0.03125, 11)])
def test_gaps_from_35_centimetres_on_are_passed(resolution: float, least: int) -> None:
    start, goal = Point(1.0, 1.0), Point(3.2, 1.0)
    path = planner(gap(least, resolution)).path(start, goal)
    assert path is not None and tuple(path[-1]) == goal
    assert length(path) == pytest.approx(2.2, rel=0.05)
    assert planner(gap(least - 1, resolution)).path(start, goal) is None
    assert (
        GridPlanner(planning_grid(gap(least, resolution), RADIUS)).path(start, goal) is None
    )  # the other method's limit


maps = arrays(
    np.uint8,
    st.tuples(st.integers(12, 40), st.integers(12, 40)),
    elements=st.sampled_from([FREE] * 99 + [OCCUPIED]),
)
shares = st.floats(0.05, 0.95)


@settings(max_examples=80, deadline=None)
@given(cells=maps, ends=st.tuples(shares, shares, shares, shares))
def test_a_path_leads_over_free_cells_from_the_robot_to_the_goal(
    cells: Octets, ends: tuple[float, float, float, float]
) -> None:
    floor = OccupancyGrid(cells, 0.1, Point(-1.0, 2.0))
    wide, high = floor.columns * 0.1, floor.rows * 0.1
    start, goal = (Point(-1.0 + x * wide, 2.0 + y * high) for x, y in (ends[:2], ends[2:]))
    on = planner(floor)
    path, back = on.path(start, goal), on.path(goal, start)
    if path is None:
        return
    own, there = floor.cell(start), floor.cell(goal)
    assert path[0] == pytest.approx((-1.0 + own.column * 0.1, 2.0 + own.row * 0.1))
    end = Point(*path[-1])
    assert is_on_free_cells(floor, path)
    assert np.hypot(*np.diff(path[:-1], axis=0).T).max(initial=0) < 0.1 * 2**0.5 + 1e-9
    assert length(path) >= Point(*path[0]).distance_to(end) - 1e-9
    if end != goal:
        assert end.distance_to(goal) <= 0.5 * 2**0.5 + 1e-9
        assert global_costs(floor, RADIUS, CHAPTER).costs[there] == IMPASSABLE or there != floor.cell(end)
    elif back is not None and Point(*back[-1]) == start:
        # each wave counts entered cells, and a path to a cell's corner may be a cell longer
        assert length(path) == pytest.approx(length(back), rel=0.35, abs=0.4)


def test_a_path_leads_around_a_mark_and_not_through_its_inflation() -> None:
    on = planner(TWO_ROOMS)
    straight, mark = on.path(START, GOAL), np.array([[2.5, 1.75]])
    diverted = on.path(START, GOAL, mark)
    assert straight is not None and diverted is not None
    assert np.hypot(*(straight - mark).T).min() < 0.1
    inscribed = global_costs(TWO_ROOMS, RADIUS, CHAPTER).inflation.inscribed
    assert np.hypot(*(diverted - mark).T).min() > inscribed - 0.05
    again = on.path(START, GOAL)
    assert again is not None and np.array_equal(again, straight)


@pytest.mark.parametrize(
    ("goal", "end"), [(Point(0.12, 2.0), Point(0.42, 2.0)), (Point(-0.01, 2.0), Point(0.44, 2.0))]
)
def test_a_goal_in_a_wall_beyond_it_or_on_a_mark_becomes_the_nearest_free_point(
    goal: Point, end: Point
) -> None:
    path = planner(TWO_ROOMS).path(START, goal)
    assert path is not None and tuple(path[-1]) == pytest.approx(end)
    path = planner(TWO_ROOMS).path(START, GOAL, np.array([GOAL]))
    assert path is not None and Point(*path[-1]).distance_to(GOAL) == pytest.approx(0.2, abs=0.05)


def test_unreachable_goals_have_no_path() -> None:
    on = planner(TWO_ROOMS)
    for start in (Point(-3.0, 1.0), Point(0.3, 1.0), Point(9.99, 3.49)):
        assert on.path(start, GOAL) is None
    for goal in (Point(-1.0, 1.0), Point(50.0, 50.0), Point(10.5, 2.0)):
        assert on.path(START, goal) is None
    assert on.path(START, GOAL, DOOR) is None
    cells = np.where(TWO_ROOMS.cells == OCCUPIED, OCCUPIED, FREE).astype(np.uint8)
    cells[:, 97:99] = np.where(cells[:, 97:99] == FREE, UNKNOWN, OCCUPIED)  # the door
    assert planner(OccupancyGrid(cells, 0.05)).path(START, GOAL) is None


def test_a_robot_with_a_free_neighbour_cell_leaves_the_wall() -> None:
    path = planner(TWO_ROOMS).path(Point(0.38, 1.0), GOAL)  # in the last cell that is too near
    assert global_costs(TWO_ROOMS, RADIUS, CHAPTER).costs[20, 7] == IMPASSABLE
    assert path is not None and tuple(path[0]) == pytest.approx((0.35, 1.0))
    assert is_on_free_cells(TWO_ROOMS, path)


def test_costs_are_computed_once_per_map_and_body() -> None:
    first = global_costs(TWO_ROOMS, RADIUS, CHAPTER)
    twin = OccupancyGrid(TWO_ROOMS.cells, TWO_ROOMS.resolution, TWO_ROOMS.origin)
    assert global_costs(twin, RADIUS, PlanningParameters()) is first
    assert global_costs(twin, 0.2, CHAPTER) is not first
    assert not first.costs.flags.writeable


def test_marks_at_walls_and_beyond_the_map_change_nothing() -> None:
    on, marks = planner(TWO_ROOMS), np.array([[0.27, 1.0], [4.7, 3.0], [-3.0, 99.0]])
    before, after = on.path(START, GOAL), on.path(START, GOAL, marks)
    assert before is not None and after is not None and np.array_equal(before, after)


def test_robots_have_the_costs_of_the_method_that_they_plan_by() -> None:
    model = load_model("turtlebot2", "chapter")
    chapter = shared_map_data(TWO_ROOMS, model, stack({"navigation": {"preset": "chapter"}}))
    assert chapter.costs is global_costs(TWO_ROOMS, model.footprint.circumradius, CHAPTER)
    assert shared_map_data(TWO_ROOMS, model, Stack(planner=PLANNER_PRESETS["robust"])).costs is None


IDLE = ', but must be absent where planner.method is "{}", which does not use it'


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"method": "theta"}, 'method is "theta", but must be "navfn" or "grid"'),
        ({"neutral": 254}, 'neutral is 254, but must be at most 253 where planner.method is "navfn"'),
        ({"margin": 0.05}, "margin is 0.05" + IDLE.format("navfn")),
        ({"cached": 3}, "cached is 3" + IDLE.format("navfn")),
        ({"method": "grid", "allowance": 0.0}, "allowance is 0.0" + IDLE.format("grid")),
    ],
)
def test_invalid_parameters_are_reported(change: dict[str, Any], fault: str) -> None:
    with pytest.raises(ParameterError) as raised:
        replace(CHAPTER, **change)
    assert str(raised.value) == f"PlanningParameters.{fault}"


def closed(costs: Octets) -> Octets:
    costs = costs.copy()
    costs[[0, -1]] = costs[:, [0, -1]] = IMPASSABLE
    return costs


navfn_potential_maps = (
    arrays(
        np.uint8,
        st.tuples(st.integers(3, 16), st.integers(3, 16)),
        elements=st.integers(30, 283).map(lambda v: min(v, 254)),
    )
    .map(lambda costs: np.maximum(costs, 50))
    .map(closed)
)


@settings(max_examples=100, deadline=None)
@given(costs=navfn_potential_maps, data=st.data())
def test_a_wave_reaches_every_connected_cell_and_a_path_descends_from_each(
    costs: Octets, data: st.DataObject
) -> None:
    rows, columns = costs.shape
    root = data.draw(st.integers(1, rows - 2)), data.draw(st.integers(1, columns - 2))
    field = wave(costs, root, 50)
    passable = costs < IMPASSABLE
    passable[root] = True
    assert np.array_equal(field < UNREACHED, raster.flood(passable, *root))
    for row, column in np.argwhere(field < UNREACHED):
        if (row, column) == root:
            continue
        cost = float(costs[row, column])
        low = min(*field[row, [column - 1, column + 1]], *field[[row - 1, row + 1], column])
        # from 0.704, where the front comes diagonally, to 1.0046, as the fit has it where it comes straight
        assert low + 0.7039 * cost <= field[row, column] <= low + 1.0047 * cost
    row, column = data.draw(st.sampled_from(np.argwhere(field < UNREACHED).tolist()))
    path = steepest_descent(field, row, column, 50)
    assert tuple(path[0]) == (row, column) and tuple(path[-1]) == root
    row, column = np.rint(path).astype(int).T
    assert (field[row, column] < UNREACHED).all()


def test_a_path_longer_than_the_originals_limit_is_complete() -> None:
    costs = closed(np.full((43, 12), 50, np.uint8))
    for wall in range(2, 41, 4):
        costs[wall, 1:-2] = costs[wall + 2, 2:-1] = IMPASSABLE
    path = steepest_descent(wave(costs, (1, 1), 50), 41, 1, 50)
    assert tuple(path[-1]) == (1, 1) and len(path) > 4 * 12


def test_a_wave_ends_at_a_given_cell() -> None:
    costs = closed(np.full((61, 61), 50, np.uint8))
    field = wave(costs, (30, 30), 50, (30, 40))
    assert field[30, 40] < UNREACHED
    assert (field < UNREACHED).sum() < (wave(costs, (30, 30), 50) < UNREACHED).sum() / 2
