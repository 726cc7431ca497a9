"""The local cost map: marks keep their positions until they are cleared."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.array_types import Flags, Floats, Int64s, Octets
from actors.geometry import Pose
from actors.instant import Instant, seconds
from actors.messages import NO_ECHO_MM
from actors.robot.navigation import ray_tracing
from actors.robot.navigation.cost_map import (
    INSCRIBED,
    LETHAL,
    LOCAL_MAP_PRESETS,
    CostMap,
    CostMapParameters,
    Inflation,
)
from actors.robot.navigation.navigator import NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, GridPlanner, planning_grid
from actors.robot.navigation.ray_tracing import (
    MOST_REACH,
    Rays,
    mark_and_clear,
    squared_within,
    stamp_free_cells,
)
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor, load_model
from actors.settings import ParameterError
from tests.robot.base import TWO_ROOMS

RADIUS = 0.177
TURTLEBOT = load_model("turtlebot2", "chapter").sensor
ALL_ROUND = replace(TURTLEBOT, rays=360)
CAMERA = replace(load_model("turtlebot2", "kinect").sensor, rays=120, x=0.0)
ORIGIN = Pose(0.0, 0.0, 0.0)
START = Instant(0)
SILENCE = np.full(360, NO_ECHO_MM, np.uint16)


def sweep(pose: Pose, *, only: dict[int, int] | None = None, sensor: RangeSensor = ALL_ROUND) -> Sweep:
    """Return a scan with these ranges, mm, of rays at these angles, degrees, sensor's frame."""
    ranges = np.full(sensor.rays, NO_ECHO_MM, np.uint16)
    for degrees, range_mm in (only or {}).items():
        offset = math.radians(degrees) - sensor.first_angle
        ranges[round(offset / sensor.increment) % sensor.rays] = range_mm
    return Sweep(ranges, pose)


def mapped(*sweeps: Sweep, parameters: CostMapParameters | None = None) -> CostMap:
    made = CostMap(ALL_ROUND, RADIUS, parameters or CostMapParameters())
    for seen in sweeps:
        made.take(START, seen.pose, seen)
    return made


def rounded(points: Floats) -> list[tuple[float, float]]:
    return [(round(float(x), 3), round(float(y), 3)) for x, y in points]


def test_an_echo_marks_the_cell_it_comes_from() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130, 90: 1010}))
    assert sorted(rounded(local.marks())) == [(-0.075, 1.025), (1.025, 0.025)]
    costs = local.costs()
    assert costs.shape == (80, 80)
    assert costs[40, 60] == LETHAL and costs[40, 57] == INSCRIBED and 0 < costs[40, 56] < INSCRIBED
    later = CostMap(ALL_ROUND, RADIUS)
    later.take(START, Pose(0.3, 0.2, 1.0), sweep(ORIGIN, only={0: 1130}))
    assert rounded(later.marks()) == [(1.025, 0.025)], "relative to the pose of the scan"


@settings(max_examples=60, deadline=None)
@given(
    start=st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3)),
    moves=st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)), max_size=8),
)
def test_rolling_keeps_every_mark_that_stays_in_the_window(
    start: tuple[float, float, float], moves: list[tuple[float, float]]
) -> None:
    pose = Pose(*start)
    local = mapped(sweep(pose, only={degrees: 700 + 4 * degrees for degrees in range(0, 360, 10)}))
    marked = set(rounded(local.marks()))
    assert len(marked) > 20
    x, y = pose.x, pose.y
    for dx, dy in moves:
        x, y = x + dx, y + dy
        local.take(START, Pose(x, y, 0.0), None)
        corner = (0.05 * (math.floor(x / 0.05) - 40), 0.05 * (math.floor(y / 0.05) - 40))
        marked = {
            (mx, my) for mx, my in marked
            if corner[0] < mx < corner[0] + 4.0 and corner[1] < my < corner[1] + 4.0
        }  # fmt: skip
        assert set(rounded(local.marks())) == marked


@pytest.mark.parametrize(("valid", "left"), [(True, 0), (False, 1)])
def test_clearing_by_rays_without_echo_is_a_parameter(valid: bool, left: int) -> None:
    parameters = replace(CostMapParameters(), inf_is_valid=valid)
    local = mapped(sweep(ORIGIN, only={0: 1130}), sweep(ORIGIN), parameters=parameters)
    assert len(local.marks()) == left


def test_rays_without_echo_do_not_clear_below_twice_the_shortest_range() -> None:
    local = CostMap(CAMERA, RADIUS, replace(CostMapParameters(), inf_is_valid=True))
    local.take(START, ORIGIN, sweep(ORIGIN, only={-10: 600, 10: 1200}, sensor=CAMERA))
    assert len(local.marks()) == 2
    local.take(START, ORIGIN, sweep(ORIGIN, sensor=CAMERA))
    assert len(local.marks()) == 1
    assert np.hypot(*local.marks()[0]) < 0.7


def test_recovery_clears_marks_outside_of_a_square() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130, 90: 1800, 180: 1700, 45: 2300}))
    assert len(local.marks()) == 4
    local.clear(3.0)
    assert rounded(local.marks()) == [(1.025, 0.025)]
    assert local.costs()[40, 60] == LETHAL and local.costs()[76, 38] == 0


def test_the_age_is_that_of_the_last_scan() -> None:
    local = CostMap(ALL_ROUND, RADIUS)
    assert local.age(START) == math.inf
    local.take(Instant(1_000_000), ORIGIN, sweep(ORIGIN))
    local.take(Instant(1_100_000), ORIGIN, None)
    assert local.age(Instant(1_300_000)) == 0.3


def test_free_floor_is_remembered_for_a_while_if_at_all() -> None:
    assert not mapped(sweep(ORIGIN)).trusted(START).any()
    local = mapped(sweep(ORIGIN, only=dict.fromkeys(range(360), 800)), parameters=LOCAL_MAP_PRESETS["robust"])
    trusted = local.trusted(Instant(seconds(3)))
    assert trusted[40, 40 - 16] and not trusted[40, 40 - 19]
    assert not local.trusted(Instant(seconds(3) + 1)).any()


def test_a_new_mark_on_observed_free_floor_is_stamped() -> None:
    wall, robot = dict.fromkeys(range(360), 800), dict.fromkeys(range(-5, 6), 500)
    local = mapped(sweep(ORIGIN, only=wall), parameters=LOCAL_MAP_PRESETS["robust"])
    assert (local.arrivals < START).all(), "a newly visible wall does not count as moving"
    seen = Instant(100_000)
    local.take(seen, ORIGIN, sweep(ORIGIN, only=wall | robot))
    cells = np.argwhere(local.arrivals == seen)
    assert cells.size and (local.squared[cells[:, 0], cells[:, 1]] == 0).all()
    assert (np.hypot(*(cells - 39.5).T) < 11).all()
    local.take(Instant(200_000), Pose(0.11, 0.0, 0.0), None)
    assert (np.argwhere(local.arrivals == seen) == cells - (0, 2)).all()
    with pytest.raises(ParameterError, match=r"free_memory is 0, but must be above 0"):
        CostMapParameters(moving_memory=seconds(1))


def test_a_robot_backs_off_no_nearer_to_a_wall_than_the_local_planner_may_drive() -> None:
    local = mapped(sweep(ORIGIN, only={180: 500}), parameters=LOCAL_MAP_PRESETS["robust"])
    ((x, y),) = local.marks().tolist()
    room = -x - math.sqrt((RADIUS + 0.045) ** 2 - y**2)
    assert local.free_behind(ORIGIN, room - 0.001) and not local.free_behind(ORIGIN, room + 0.001)
    near = Pose(x + 0.19, y, 0.0)
    assert not local.free_behind(near, 0.01, touching=True)
    assert local.free_behind(Pose(near.x, near.y, math.pi), 0.15, touching=True)


def test_space_outside_the_map_is_not_free() -> None:
    with pytest.raises(ParameterError, match=r"retreat is 1.5, but must be a number above 0 and at most 1"):
        NavigationParameters(retreat=1.5)
    here = Pose(0.0, 0.0, 2.0)
    local = mapped(sweep(here))
    assert local.free_behind(here, 1.0)
    assert not any(local.free_behind(here, distance) for distance in (3.0, 7.0, 50.0))


grids = arrays(
    np.uint8, st.tuples(st.integers(1, 24), st.integers(1, 24)), elements=st.sampled_from([0] * 19 + [1])
)


def looked_up(marks: Octets, reach: int) -> Int64s:
    row, column = np.indices(marks.shape)
    least = np.full(marks.shape, (reach + 1) ** 2)
    for r, c in np.argwhere(marks):
        least = np.minimum(least, (row - r) ** 2 + (column - c) ** 2)
    return least


@settings(max_examples=200, deadline=None)
@given(marks=grids, reach=st.integers(1, 20))
def test_distances_are_exact_up_to_the_reach(marks: Octets, reach: int) -> None:
    assert np.array_equal(squared_within(marks, reach), looked_up(marks, reach))


def test_the_largest_reach_does_not_overflow() -> None:
    marks = np.zeros((300, 300), np.uint8)
    marks[150, 150] = 1
    assert np.array_equal(squared_within(marks, MOST_REACH), looked_up(marks, MOST_REACH))
    marks[:] = 0
    assert (squared_within(marks, MOST_REACH) == (MOST_REACH + 1) ** 2).all()


def test_parameters_beyond_the_reach_are_rejected() -> None:
    sensor, wide = load_model("turtlebot2").sensor, CostMapParameters(body="disc", allowance=0.0, padding=7.0)
    with pytest.raises(ParameterError) as raised:
        CostMap(sensor, 0.177, wide)
    assert str(raised.value) == (
        "local_map: the radius of the body with its padding is 7.177, but must be at most 126 cells of 0.05 m"
    )
    with pytest.raises(ParameterError) as raised:
        GridPlanner(planning_grid(TWO_ROOMS, 0.177), replace(PLANNER_PRESETS["robust"], inflation_radius=6.4))
    assert str(raised.value) == (
        "planner: the inflation radius is 6.4, but must be at most 126 cells of 0.05 m"
    )


LOCAL = Inflation(0.222, 0.75, 15.0)


@pytest.mark.parametrize(
    ("distance", "cost"),
    [(0.0, LETHAL), (0.01, INSCRIBED), (0.222, INSCRIBED), (0.2221, 251), (0.322, 56), (0.75, 0), (0.8, 0)],
)
def test_costs_of_single_distances(distance: float, cost: int) -> None:
    assert LOCAL.costs(distance) == cost
    wide = Inflation(0.2, 0.5, 1.0)
    assert wide.costs([0.5, 0.5001]).tolist() == [int(252 * math.exp(-0.3)), 0]


@pytest.mark.parametrize("cell", [0.05, 0.04, 0.1])
def test_the_table_gives_the_cost_of_every_distance_between_cells(cell: float) -> None:
    table = LOCAL.table(cell)
    assert not table.flags.writeable
    reach = LOCAL.reach(cell)
    assert reach * cell >= 0.75 > (reach - 1) * cell
    for rows in range(reach + 1):
        for columns in range(reach + 1):
            squared = min(rows**2 + columns**2, len(table) - 1)
            assert table[squared] == LOCAL.costs(cell * math.hypot(rows, columns))


def outline(radius: float, padding: float) -> list[complex]:
    """Return the corners as costmap_2d computes and pads them, with sines and cosines of the C library."""

    def padded(value: float) -> float:
        return value + math.copysign(padding, value) if value else 0.0

    corners = (math.tau * k / 16 for k in range(16))
    return [complex(padded(radius * math.cos(a)), padded(radius * math.sin(a))) for a in corners]


@pytest.mark.parametrize(("radius", "padding"), [(0.1, 0.0), (0.18, 0.01), (0.5, 0.1)])
def test_the_inscribed_radius_is_that_of_the_padded_outline(radius: float, padding: float) -> None:
    corners = outline(radius, padding)
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    distances = [(a.conjugate() * b).imag / abs(b - a) for a, b in sides]
    assert ray_tracing.inscribed(radius, padding) == pytest.approx(min(distances))
    assert ray_tracing.inscribed(0.18, 0.01) == pytest.approx(0.18626, abs=5e-6), "the chapter's files"


SIDE = 24
CELL_MM = 50
FAR_AWAY = np.array([-100.0, -100.0, 1.0])


class View:
    """A sensor with a number of rays over a field of view, rad, and its data for kernels."""

    def __init__(self, rays: int, field: float, silent: float = 0.0, raytrace: float = 12.0) -> None:
        full = field == math.tau
        self.first = -math.pi if full else -field / 2
        self.increment = field / (rays if full else rays - 1)
        angles = self.first + self.increment * np.arange(rays)
        self.rays = np.column_stack((np.cos(angles), np.sin(angles)))
        self.limits = np.array([1 / CELL_MM, 10.0, raytrace, silent])
        self.seen = Rays(self.rays, np.array([self.first, self.increment]), self.limits)


def through(x: float, y: float, dx: float, dy: float, row: int, column: int) -> tuple[float, float] | None:
    """Return where the ray enters and leaves a cell, by clipping to four half planes."""
    enter, leave = 0.0, math.inf
    for at, along, low in ((x, dx, column), (y, dy, row)):
        if abs(along) < 1e-15:
            if not low <= at <= low + 1:
                return None
            continue
        ends = sorted(((low - at) / along, (low + 1 - at) / along))
        enter, leave = max(enter, ends[0]), min(leave, ends[1])
    return (enter, leave) if enter < leave else None


def passed(view: View, ranges: NDArray[np.uint16], eye: Floats) -> Flags:
    """Return which cells are passed by a ray: (SIDE, SIDE)."""
    cells = np.zeros((SIDE, SIDE), np.bool_)
    c, s = math.cos(eye[2]), math.sin(eye[2])
    for k in range(len(ranges)):
        silent = ranges[k] == NO_ECHO_MM
        begin = view.limits[3] if silent else 0.0
        end = view.limits[2] if silent else min(ranges[k] * view.limits[0], view.limits[2])
        dx, dy = c * view.rays[k, 0] - s * view.rays[k, 1], s * view.rays[k, 0] + c * view.rays[k, 1]
        for row in range(SIDE):
            for column in range(SIDE):
                hit = through(eye[0], eye[1], dx, dy, row, column)
                if hit and begin <= hit[0] and hit[1] <= end:
                    cells[row, column] = True
    return cells


def ends(view: View, ranges: NDArray[np.uint16], eye: Floats) -> set[tuple[int, int]]:
    """Return the cells of echoes within the obstacle range."""
    angle = view.first + view.increment * np.arange(len(ranges)) + eye[2]
    apart = ranges / CELL_MM
    near = (ranges != NO_ECHO_MM) & (apart < view.limits[1])
    rows = np.floor(eye[1] + apart * np.sin(angle))[near].astype(int)
    columns = np.floor(eye[0] + apart * np.cos(angle))[near].astype(int)
    return {(r, c) for r, c in zip(rows, columns, strict=True) if 0 <= r < SIDE and 0 <= c < SIDE}


scans = arrays(np.uint16, 30, elements=st.one_of(st.just(NO_ECHO_MM), st.integers(20, 900)))
# not on the lines between cells, where the two methods may round differently
eyes = st.integers(0, 10**6).map(
    lambda seed: np.random.default_rng(seed).uniform((8, 8, -3.1), (16, 16, 3.1))
)


@settings(max_examples=50, deadline=None)
@given(
    ranges=scans,
    eye=eyes,
    field=st.sampled_from([math.tau, 1.0, 4.0]),
    silent=st.sampled_from([0.0, 6.0, math.inf]),
    raytrace=st.sampled_from([5.0, 12.0]),
)
def test_passed_cells_are_cleared_and_stamped_and_end_cells_marked(
    ranges: NDArray[np.uint16], eye: Floats, field: float, silent: float, raytrace: float
) -> None:
    view = View(len(ranges), field, silent, raytrace)
    marks, stamps = np.ones((SIDE, SIDE), np.uint8), np.zeros((SIDE, SIDE), np.int64)
    mark_and_clear(marks, ranges, view.seen, eye, FAR_AWAY)
    stamp_free_cells(stamps, 5, ranges, view.seen, eye, FAR_AWAY)
    cleared = passed(view, ranges, eye)
    assert np.array_equal(stamps, 5 * cleared)
    for cell in ends(view, ranges, eye):
        cleared[cell] = False
    assert np.array_equal(marks, ~cleared)


@pytest.mark.parametrize("radius", [3.5, 0.9])
def test_the_body_clears_the_cells_that_lie_wholly_below_it(radius: float) -> None:
    view = View(4, math.tau, silent=math.inf)
    marks = np.ones((SIDE, SIDE), np.uint8)
    silence = np.full(4, NO_ECHO_MM, np.uint16)
    body = np.array([12.3, 11.8, radius])
    mark_and_clear(marks, silence, view.seen, np.array([12.0, 12.0, 0.0]), body)
    for row in range(SIDE):
        for column in range(SIDE):
            corners = [(x, y) for x in (column, column + 1) for y in (row, row + 1)]
            farthest = max(math.hypot(x - body[0], y - body[1]) for x, y in corners)
            if farthest > radius + 1e-9 and math.hypot(column + 0.5 - 12.3, row + 0.5 - 11.8) > radius - 0.7:
                assert marks[row, column]
            if math.hypot(column + 0.5 - 12.3, row + 0.5 - 11.8) <= radius - math.sqrt(0.5):
                assert not marks[row, column]
