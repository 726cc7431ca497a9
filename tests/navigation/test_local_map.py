"""The rolling window: marks stay where they were seen, until something is seen through them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.bounds import ParameterError
from actors.geometry import Pose
from actors.instant import Instant, seconds
from actors.messages import NO_ECHO_MM
from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS, CostMap, CostMapParameters
from actors.robot.cost_maps.inflation import INSCRIBED, LETHAL
from actors.robot.navigation.navigator import NavigationParameters
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor, load_model

RADIUS = 0.177
TURTLEBOT = load_model("turtlebot2", "chapter").sensor
ALL_ROUND = TURTLEBOT.model_copy(update={"rays": 360})
CAMERA = load_model("turtlebot2", "kinect").sensor.model_copy(update={"rays": 120, "x": 0.0})
ORIGIN = Pose(0.0, 0.0, 0.0)
START = Instant(0)
SILENCE = np.full(360, NO_ECHO_MM, np.uint16)


def sweep(pose: Pose, *, only: dict[int, int] | None = None, sensor: RangeSensor = ALL_ROUND) -> Sweep:
    """A scan in which the rays pointing at these degrees in the sensor's frame give these ranges, mm."""
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


def rounded(points: NDArray[np.float64]) -> list[tuple[float, float]]:
    return [(round(float(x), 3), round(float(y), 3)) for x, y in points]


def test_an_echo_marks_the_cell_it_comes_from() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130, 90: 1010}))
    assert rounded(local.marks()) == [(-0.075, 1.025), (1.025, 0.025)] or rounded(local.marks()) == [
        (1.025, 0.025), (-0.075, 1.025)]  # fmt: skip
    costs = local.costs()
    assert costs.shape == (80, 80)
    assert costs[40, 60] == LETHAL and costs[40, 57] == INSCRIBED and 0 < costs[40, 56] < INSCRIBED


def test_a_scan_counts_from_where_it_was_made_not_from_where_the_robot_is() -> None:
    local = CostMap(ALL_ROUND, RADIUS)
    local.take(START, Pose(0.3, 0.2, 1.0), sweep(ORIGIN, only={0: 1130}))
    assert rounded(local.marks()) == [(1.025, 0.025)]


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


def test_what_is_seen_through_is_cleared_and_what_is_hidden_stays() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130, 180: 1000}))
    beyond, before = dict.fromkeys(range(-20, 21), 1600), dict.fromkeys(range(170, 191), 700)
    local.take(START, ORIGIN, sweep(ORIGIN, only={**beyond, **before}))
    marks = rounded(local.marks())
    assert (1.025, 0.025) not in marks
    assert len([x for x, _ in marks if x < -1.0]) == 1


def test_what_left_the_window_is_forgotten() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130}))
    local.take(START, Pose(-1.2, 0.0, 0.0), None)
    assert not local.marks().size
    local.take(START, ORIGIN, None)
    assert not local.marks().size


@pytest.mark.parametrize(("valid", "left"), [(True, 0), (False, 1)])
def test_whether_silence_clears_is_a_parameter(valid: bool, left: int) -> None:
    parameters = replace(CostMapParameters(), inf_is_valid=valid)
    local = mapped(sweep(ORIGIN, only={0: 1130}), sweep(ORIGIN), parameters=parameters)
    assert len(local.marks()) == left


def test_silence_does_not_clear_where_the_sensor_is_blind_and_as_far_again() -> None:
    local = CostMap(CAMERA, RADIUS, replace(CostMapParameters(), inf_is_valid=True))
    local.take(START, ORIGIN, sweep(ORIGIN, only={-10: 600, 10: 1200}, sensor=CAMERA))
    assert len(local.marks()) == 2
    local.take(START, ORIGIN, sweep(ORIGIN, sensor=CAMERA))
    assert len(local.marks()) == 1
    assert np.hypot(*local.marks()[0]) < 0.7


def test_recovery_forgets_what_is_outside_of_a_square() -> None:
    local = mapped(sweep(ORIGIN, only={0: 1130, 90: 1800, 180: 1700, 45: 2300}))
    assert len(local.marks()) == 4
    local.clear(3.0)
    assert rounded(local.marks()) == [(1.025, 0.025)]
    assert local.costs()[40, 60] == LETHAL and local.costs()[76, 38] == 0


def test_its_age_is_that_of_the_last_scan() -> None:
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


def test_what_is_marked_where_the_floor_was_seen_free_is_an_arrival() -> None:
    wall, robot = dict.fromkeys(range(360), 800), dict.fromkeys(range(-5, 6), 500)
    local = mapped(sweep(ORIGIN, only=wall), parameters=LOCAL_MAP_PRESETS["robust"])
    assert (local.arrivals < START).all(), "a wall that comes into view does not move"
    seen = Instant(100_000)
    local.take(seen, ORIGIN, sweep(ORIGIN, only=wall | robot))
    cells = np.argwhere(local.arrivals == seen)
    assert cells.size and (local.squared[cells[:, 0], cells[:, 1]] == 0).all()
    assert (np.hypot(*(cells - 39.5).T) < 11).all()
    local.take(Instant(200_000), Pose(0.11, 0.0, 0.0), None)
    assert (np.argwhere(local.arrivals == seen) == cells - (0, 2)).all()
    with pytest.raises(ParameterError, match=r"local_map.free_memory is 0, but must be above 0"):
        CostMapParameters(moving_memory=seconds(1))


def test_a_robot_backs_off_no_nearer_to_a_wall_than_the_local_planner_may_drive() -> None:
    local = mapped(sweep(ORIGIN, only={180: 500}), parameters=LOCAL_MAP_PRESETS["robust"])
    ((x, y),) = local.marks().tolist()
    room = -x - math.sqrt((RADIUS + 0.045) ** 2 - y**2)
    assert local.free_behind(ORIGIN, room - 0.001) and not local.free_behind(ORIGIN, room + 0.001)
    near = Pose(x + 0.19, y, 0.0)
    assert not local.free_behind(near, 0.01, touching=True)
    assert local.free_behind(Pose(near.x, near.y, math.pi), 0.15, touching=True)


def test_below_the_body_nothing_is_marked_and_all_is_trusted() -> None:
    local = CostMap(ALL_ROUND, RADIUS, LOCAL_MAP_PRESETS["robust"])
    local.take(START, ORIGIN, sweep(ORIGIN, only=dict.fromkeys(range(360), 30)))
    assert not local.marks().size
    assert local.trusted(START)[38:42, 38:42].all()


@pytest.mark.parametrize("heading", [0.0, 2.0, -1.3])
def test_nothing_is_free_where_the_map_does_not_reach(heading: float) -> None:
    here = Pose(0.0, 0.0, heading)
    local = mapped(sweep(here))
    assert local.free_behind(here, 1.0)
    assert not any(local.free_behind(here, distance) for distance in (3.0, 7.0, 50.0))


def test_a_retreat_is_bounded() -> None:
    with pytest.raises(ParameterError) as raised:
        NavigationParameters(retreat=1.5)
    assert str(raised.value) == "navigation.retreat is 1.5, but must be at most 1"
