"""Range sensors, and real-world errors of floor and map."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.floor import raster
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid, largest_region, outline
from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError
from actors.floor.raster import free_squares
from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.messages import NO_ECHO_MM
from actors.randomness import generator
from actors.robot_model import RobotModel, scan_angles
from actors.world import rays
from actors.world.physics import Shape, disc, footprint_at
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import RealFloor, Uncertainty, draw_floor, with_drift
from tests.world.scenery import OMNIBOX, TURTLEBOT, clutter, with_sensor

NO_OBSTACLES = np.empty((0, 3))
MM = 0.001


def sensors(grid: OccupancyGrid, *models: RobotModel, seed: int = 0) -> RangeSensors:
    return RangeSensors(grid, models, [np.random.default_rng([seed, k]) for k in range(len(models))])


def test_dropout_affects_only_its_share_of_the_rays() -> None:
    grid, poses = hall(4.0), np.zeros((1, 3))
    model = TURTLEBOT
    (whole,) = sensors(grid, model).scan([0], poses, NO_OBSTACLES)
    missing = RangeSensors(grid, [model], [np.random.default_rng([0, 0])], 0.3, [np.random.default_rng(1)])
    (scan,) = missing.scan([0], poses, NO_OBSTACLES)
    lost = scan != whole
    assert (scan[lost] == NO_ECHO_MM).all()
    assert lost.mean() == pytest.approx(0.3, abs=0.1)
    (again,) = missing.scan([0], poses, NO_OBSTACLES)
    assert ((again == NO_ECHO_MM) != (scan == NO_ECHO_MM)).any()


def hall(side: float = 16.0) -> OccupancyGrid:
    cells = np.full((round(side / 0.05),) * 2, FREE, np.uint8)
    return OccupancyGrid(cells, 0.05, origin=type(OccupancyGrid.origin)(-side / 2, -side / 2))


def free_pose(grid: OccupancyGrid, rng: np.random.Generator) -> Pose:
    x, y = grid.origin.x + grid.corner.x, grid.origin.y + grid.corner.y
    return Pose(x / 2 + rng.uniform(-0.25, 0.25), y / 2 + rng.uniform(-0.25, 0.25), rng.uniform(-3, 3))


def rays_of(model: RobotModel, pose: Pose) -> tuple[Pose, NDArray[np.float64]]:
    angles = pose.heading + scan_angles(model.sensor)
    return pose.compose(model.sensor.mount), np.stack([np.cos(angles), np.sin(angles)], axis=1)


def to_lines(origin: Pose, direction: NDArray[np.float64], lines: NDArray[np.float64]) -> float:
    along = lines[:, 2:] - lines[:, :2]
    offset = lines[:, :2] - (origin.x, origin.y)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = direction[0] * along[:, 1] - direction[1] * along[:, 0]
        distance = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / determinant
        share = (offset[:, 0] * direction[1] - offset[:, 1] * direction[0]) / determinant
    hit = (distance >= 0) & (share >= 0) & (share <= 1)
    return float(distance[hit].min(initial=math.inf))


def border_of(shape: Shape) -> NDArray[np.float64]:
    """Return the outline as line segments; a disc as a polygon of 2000 edges."""
    if shape.radius:
        angles = np.linspace(0, math.tau, 2000, endpoint=False)
        ring = shape.vertices[0] + shape.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        ring = shape.vertices
    return np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=1)


def traversal(grid: OccupancyGrid, x: float, y: float, dx: float, dy: float, reach: float) -> float:
    blocking = np.pad(grid.blocking, 1, constant_values=True)
    column, row = math.floor(x), math.floor(y)
    step_x, step_y = (1 if dx >= 0 else -1), (1 if dy >= 0 else -1)
    next_x = (column + (step_x > 0) - x) / dx if dx else math.inf
    next_y = (row + (step_y > 0) - y) / dy if dy else math.inf
    distance = 0.0
    while not blocking[row, column]:
        if next_x < next_y:
            distance, next_x, column = next_x, next_x + abs(1 / dx), column + step_x
        else:
            distance, next_y, row = next_y, next_y + abs(1 / dy), row + step_y
        if distance > reach:
            return math.inf
    return distance


def cast(squares: NDArray[np.uint8], x: float, y: float, dx: float, dy: float, reach: float) -> float:
    distance = np.empty(1)
    rays.cast(squares, x, y, np.array([[dx], [dy]]), reach, distance)
    return float(distance[0])


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 10**6), st.floats(-3.2, 3.2), st.sampled_from([0.02, 0.1, 0.3]))
def test_a_ray_ends_where_the_plain_traversal_ends(seed: int, angle: float, share: float) -> None:
    grid = clutter(seed % 50, share=share)
    squares = free_squares(grid.blocking)
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(26, 34), rng.uniform(16, 24)
    dx, dy = math.cos(angle), math.sin(angle)
    expected = traversal(grid, x, y, dx, dy, 25.0)
    assert cast(squares, x, y, dx, dy, 25.0) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("angle", [k * math.pi / 4 for k in range(8)])
def test_rays_along_the_grid_and_along_its_diagonals(angle: float) -> None:
    cells = np.full((21, 21), FREE, np.uint8)
    cells[10, [0, 20]] = cells[[0, 20], 10] = cells[[0, 0, 20, 20], [0, 20, 0, 20]] = OCCUPIED
    squares = free_squares(OccupancyGrid(cells, 1.0).blocking)
    dx, dy = round(math.cos(angle), 12), round(math.sin(angle), 12)
    length = math.hypot(dx, dy)
    far = 9.5 * math.hypot(round(dx), round(dy))
    assert cast(squares, 11.5, 11.5, dx / length, dy / length, 50.0) == pytest.approx(far)
    assert cast(squares, 11.5, 11.5, dx / length, dy / length, far - 0.1) == math.inf


def test_a_ray_that_starts_in_a_wall_or_outside_of_the_map_is_at_its_end() -> None:
    squares = free_squares(np.zeros((5, 5), np.bool_))
    for x, y in ((0.5, 3.0), (-4.0, 3.0), (3.0, 99.0)):
        assert cast(squares, x, y, 1.0, 0.0, 50.0) == 0.0


@pytest.mark.parametrize("share", [0.0, 0.003, 0.02, 0.2])
@pytest.mark.parametrize("view", [0.3, 2.0, math.tau])
def test_a_fan_has_the_distances_of_single_rays_bit_for_bit(share: float, view: float) -> None:
    squares = free_squares(clutter(7, share=share).blocking)
    faces = rays.wall_faces(squares)
    rng, n = np.random.default_rng(5), 200
    offsets = [*rng.random((40, 2)), *rng.choice([0.0, 0.5, 1e-13, 2e-3], (20, 2))]
    turns = [*rng.uniform(-math.pi, math.pi, 40), *rng.choice(np.arange(8) * math.pi / 4, 20)]
    for offset, bearing in zip(offsets, turns, strict=True):
        x, y = rng.integers(15, 30, 2) + offset
        angles = bearing + view / n * np.arange(n)
        directions = np.stack([np.cos(angles), np.sin(angles)])
        alone, together = np.empty((2, n))
        rays.cast(squares, x, y, directions, 30.0, alone)
        rays.cast_fan(squares, *faces, x, y, bearing, view / n, directions, 30.0, together)
        assert np.array_equal(alone, together)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("view", "seer"), [(360, TURTLEBOT), (58, TURTLEBOT), (58, OMNIBOX), (200, OMNIBOX)])
def test_ranges_are_those_of_outlines_cut_with_rays(seed: int, view: float, seer: RobotModel) -> None:
    grid, rng = clutter(seed, share=0.01), np.random.default_rng(seed)
    seer = with_sensor(seer, field_of_view_deg=view, rays=90, range_max=2.5, range_min=0.0, noise=0.0)
    seer = with_sensor(seer, noise_growth=0.0)
    here = free_pose(grid, rng)
    others = [
        (TURTLEBOT, Pose(here.x + 0.6, here.y + 0.1, 1.0)),
        (OMNIBOX, Pose(here.x - 0.5, here.y - 0.6, 0.7)),
        (TURTLEBOT, Pose(here.x - 0.3, here.y + 0.7, 0.0)),
    ]
    obstacle = (here.x + 0.3, here.y - 0.8, 0.08)
    poses = np.array([here, *(pose for _, pose in others)])
    scan = sensors(grid, seer, *(model for model, _ in others)).scan([0], poses, np.array([obstacle]))[0]
    got = np.where(scan == NO_ECHO_MM, math.inf, scan * MM)
    lines = [outline(grid), *(border_of(footprint_at(model.footprint, pose)) for model, pose in others)]
    lines.append(border_of(disc(*obstacle)))
    origin, directions = rays_of(seer, here)
    expected = np.array([to_lines(origin, direction, np.concatenate(lines)) for direction in directions])
    expected[expected > 2.5] = math.inf
    different = ~np.isclose(got, expected, atol=0.6 * MM)
    assert different.sum() <= 1  # where a ray grazes a corner, either answer is good


def test_a_lone_robot_does_not_see_itself() -> None:
    scan = sensors(hall(), TURTLEBOT).scan([0], np.zeros((1, 3)), NO_OBSTACLES)[0]
    assert scan.dtype == np.uint16 and (scan == NO_ECHO_MM).all()
    poses = np.array([[0, 0, 0], [2.0, 0, 0]])
    scan = sensors(hall(), TURTLEBOT, TURTLEBOT).scan([0], poses, NO_OBSTACLES)[0]
    seen = np.flatnonzero(scan != NO_ECHO_MM)
    half = math.asin(0.177 / 2.1)  # the sensor sits 0.1 m behind the middle
    assert scan[319] == 2100 - 177 and scan_angles(TURTLEBOT.sensor)[319] == 0
    assert len(seen) == 2 * math.floor(half / (math.tau / 640)) + 1 and seen.mean() == 319


@pytest.mark.parametrize("bearing", np.linspace(-math.pi, math.pi, 13).tolist())
def test_a_robot_is_scanned_across_the_ends_of_a_scan(bearing: float) -> None:
    poses = np.array([[0.1, 0, 0], [1.5 * math.cos(bearing), 1.5 * math.sin(bearing), 0]])
    scan = sensors(hall(), TURTLEBOT, TURTLEBOT).scan([0], poses, NO_OBSTACLES)[0]
    expected = 2 * math.asin(0.177 / 1.5) / (math.tau / 640)
    assert abs((scan != NO_ECHO_MM).sum() - expected) <= 1 and scan.min() in (1323, 1324)


def test_near_obstacles_give_no_echo_but_occlude() -> None:
    kinect = with_sensor(TURTLEBOT, x=0.0, field_of_view_deg=10.0, rays=11, range_min=0.45)
    near, far = np.array([[0.4, 0, 0.1]]), np.array([[0.6, 0, 0.1]])
    grid = hall(4.0)
    assert sensors(grid, kinect).scan([0], np.zeros((1, 3)), NO_OBSTACLES)[0][5] == 2000
    assert sensors(grid, kinect).scan([0], np.zeros((1, 3)), near)[0][5] == NO_ECHO_MM
    assert sensors(grid, kinect).scan([0], np.zeros((1, 3)), far)[0][5] == 500


def test_scans_of_different_sensors_in_one_call_are_those_of_single_calls() -> None:
    grid = clutter(2)
    poses = np.array([free_pose(grid, np.random.default_rng(k)) for k in range(3)])
    models = (TURTLEBOT, OMNIBOX, with_sensor(TURTLEBOT, rays=50, range_max=1.0))
    together = sensors(grid, *models).scan([2, 0, 1], poses, NO_OBSTACLES)
    assert [len(scan) for scan in together] == [50, 640, 640]
    for index, scan in zip([2, 0, 1], together, strict=True):
        assert np.array_equal(sensors(grid, *models).scan([index], poses, NO_OBSTACLES)[0], scan)
    assert sensors(grid, *models).scan([], poses, NO_OBSTACLES) == []


def test_noise_has_the_deviation_of_the_model_and_grows_with_the_range() -> None:
    noisy = with_sensor(TURTLEBOT, x=0.0, noise=0.01, noise_growth=0.002, range_max=5.0, rays=4)
    instrument = sensors(hall(8.0), noisy)  # 4 m ahead, behind and to the sides
    scans = np.array([instrument.scan([0], np.zeros((1, 3)), NO_OBSTACLES)[0] for _ in range(1500)]) * MM
    assert scans.std() == pytest.approx(0.01 + 0.002 * 16, rel=0.03)
    assert scans.mean() == pytest.approx(4.0, abs=4 * 0.042 / math.sqrt(6000))
    assert np.abs(np.corrcoef(scans.T) - np.eye(4)).max() < 0.1


def test_the_noise_of_robots_is_independent() -> None:
    noisy = with_sensor(TURTLEBOT, noise=0.02, range_max=6.5)  # it sees all of the hall
    poses = np.array([[0.0, 0, 0], [1.0, 1, 1], [-3.0, 0, 0]])
    few = sensors(hall(8.0), noisy, noisy).scan([0, 1], poses[:2], NO_OBSTACLES)
    one, other = sensors(hall(8.0), noisy, noisy, noisy).scan([1, 0], poses, NO_OBSTACLES)
    for a, b in ((few[0], other), (few[1], one)):
        assert 0 < (a != b).sum() < 20  # the rays that now meet the third robot
    again = sensors(hall(8.0), noisy, noisy, seed=1).scan([0, 1], poses[:2], NO_OBSTACLES)
    assert (few[0] != again[0]).mean() > 0.9


CORRIDOR = load_map(REPOSITORY / "maps" / "corridor.yaml")
BODY = 0.177


def made(dose: Uncertainty, seed: int = 1, kept_off: tuple[Point, ...] = ()) -> RealFloor:
    return draw_floor(CORRIDOR, dose, generator(seed, "uncertainty", "world"), kept_off)


def walls(grid: OccupancyGrid) -> "np.typing.NDArray[np.bool_]":
    return np.equal(grid.cells, OCCUPIED)


def test_a_floor_follows_from_dose_and_seed() -> None:
    solid, visible = made(Uncertainty())
    assert solid.cells.tobytes() == visible.cells.tobytes() == CORRIDOR.cells.tobytes()
    assert with_drift(TURTLEBOT, Uncertainty()) == TURTLEBOT
    drifting = with_drift(TURTLEBOT, Uncertainty(drift=3.0))
    stage, kobuki = drifting.stage_errors, drifting.kobuki_errors
    usual = TURTLEBOT.kobuki_errors
    assert (stage.forward, stage.turn) == (3 * 0.03, 3 * 0.02)
    assert kobuki.gyro_bias_deg == 3 * usual.gyro_bias_deg and kobuki.slip == 3 * usual.slip
    assert (kobuki.track, kobuki.tick_um) == (usual.track, usual.tick_um)
    dose = Uncertainty(map_error=0.1, glass=0.3, furniture=5)
    first, again, other = made(dose), made(dose), made(dose, seed=2)
    assert [part.cells.tobytes() for part in first] == [part.cells.tobytes() for part in again]
    assert first.solid.cells.tobytes() != other.solid.cells.tobytes()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("error", [0.05, 0.1, 0.2])
def test_displaced_walls_have_no_gaps(error: float, seed: int) -> None:
    solid, visible = made(Uncertainty(map_error=error), seed)
    assert solid.cells.tobytes() == visible.cells.tobytes()
    apart = np.sqrt(raster.squared_distance(walls(CORRIDOR))) * CORRIDOR.resolution
    off = apart[walls(solid)]
    assert 0.2 * error < np.sqrt(np.mean(np.square(off))) < 1.5 * error  # along a wall nothing is seen of it
    assert off.max() < 5 * error
    regions = [largest_region(grid, BODY).sum() for grid in (CORRIDOR, solid)]
    assert regions[1] == pytest.approx(regions[0], rel=0.1)  # nothing is cut off, nothing opened


@pytest.mark.parametrize("seed", range(4))
def test_furniture_leaves_passages_and_keeps_its_distance(seed: int) -> None:
    here = (Point(12.0, 5.0), Point(17.5, 12.0))
    solid, visible = made(Uncertainty(furniture=12), seed, here)
    assert solid.cells.tobytes() == visible.cells.tobytes()
    added = walls(solid) & ~walls(CORRIDOR)
    assert 12 * 0.19 < added.sum() * CORRIDOR.resolution**2 < 12 * 0.21  # a disc of 0.25 m has 0.196 m²
    assert CORRIDOR.clearance[added].min() > 0.55
    lost = largest_region(CORRIDOR, BODY) & ~largest_region(solid, BODY)
    around = 12 * 3.14 * (0.25 + BODY + 0.05) ** 2
    assert lost.sum() * CORRIDOR.resolution**2 < around
    for point in here:
        assert solid.clearance_at(point, 1.0) > 0.6


def test_furniture_without_room_is_refused() -> None:
    sentence = r"uncertainty\.furniture = 1000: only .* of 1000 points fit"
    with pytest.raises(PlacementError, match=sentence):
        made(Uncertainty(furniture=1000))


@pytest.mark.parametrize("share", [0.2, 0.6, 1.0])
def test_glass_is_invisible_and_solid(share: float) -> None:
    solid, visible = made(Uncertainty(glass=share, furniture=3))
    bare = walls(CORRIDOR)
    assert walls(solid)[bare].all() and set(np.unique(visible.cells)) == {FREE, OCCUPIED}
    assert not (walls(visible) & ~walls(solid)).any()
    shares = [np.mean(~walls(made(Uncertainty(glass=share), seed).visible)[bare]) for seed in range(5)]
    assert np.mean(shares) == pytest.approx(share, abs=0.08)
    things = walls(solid) & ~bare
    assert walls(visible)[things].all()  # what stands on the floor is no glass
