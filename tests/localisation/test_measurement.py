"""Likelihood field and measurement model."""

import numpy as np
import pytest
from msgspec.structs import replace

from actors.array_types import Floats
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point, Pose
from actors.robot.localisation import PRESETS, AmclParameters, likelihood_field
from actors.robot.localisation.measurement import Measurement, ParticleSet, likelihoods
from actors.runtime.errors import AcrcError
from tests.localisation.scenes import FIELD, NO_OBSTACLES, ROOM, TURTLEBOT, ends, scan


def _plan(seed: int = 0) -> OccupancyGrid:
    cells = np.where(np.random.default_rng(seed).random((30, 40)) < 0.02, OCCUPIED, FREE).astype(np.uint8)
    cells[12, 7] = UNKNOWN
    return OccupancyGrid(cells, 0.1, Point(-1.0, 2.0))


def test_distances_are_those_between_the_centres_of_cells() -> None:
    plan = _plan()
    field = likelihood_field(plan, 1.0)
    walls = np.argwhere(plan.cells == OCCUPIED)
    for row, column in [(0, 0), (29, 39), (15, 20), (12, 8), (12, 7), (3, 30)]:
        nearest = 0.1 * np.hypot(*(walls - (row, column)).T).min()
        found = field.distances[field.levels[row + 1, column + 1]]
        assert found == pytest.approx(min(nearest, 1.0), abs=0.5 * 1.0 / 255 + 1e-12)


def test_distances_outside_the_map_are_maximal() -> None:
    field = likelihood_field(_plan(), 1.0)
    assert field.levels.shape == (32, 42)
    assert (field.levels[[0, -1]] == 255).all() and (field.levels[:, [0, -1]] == 255).all()
    assert field.frame == pytest.approx([-1.1, 1.9, 0.1])
    assert not any(shared.flags.writeable for shared in (field.levels, field.frame, field.floor))


def test_unknown_cells_are_not_walls() -> None:
    cells = np.full((30, 40), FREE, np.uint8)
    cells[10:12] = UNKNOWN
    field = likelihood_field(OccupancyGrid(cells, 0.1, Point(0.0, 0.0)), 1.0)
    assert (field.levels == 255).all(), "without walls all distances are maximal"
    cells[20] = OCCUPIED
    field = likelihood_field(OccupancyGrid(cells, 0.1, Point(0.0, 0.0)), 1.0)
    assert field.distances[field.levels[12, 5]] == pytest.approx(0.9, abs=0.002)


def test_poses_are_drawn_evenly_over_the_free_floor() -> None:
    """20 000 draws over quarters of the floor and of the circle: 1.5 % are about five standard errors."""
    plan = _plan()
    x, y, heading = likelihood_field(plan, 1.0).poses(np.random.default_rng(1), 20_000)
    assert all(plan.is_free(Point(*at)) for at in zip(x[:500].tolist(), y[:500].tolist(), strict=True))
    columns, rows = (x + 1.0) // 2.0, (y - 2.0) // 1.5
    for i in range(2):
        for j in range(2):
            share = plan.free[15 * j : 15 * j + 15, 20 * i : 20 * i + 20].sum() / plan.free.sum()
            assert ((columns == i) & (rows == j)).mean() == pytest.approx(share, abs=0.015)
    assert np.histogram(heading, 4, (-np.pi, np.pi))[0] / 20_000 == pytest.approx(0.25, abs=0.015)
    assert heading.min() > -np.pi and heading.max() <= np.pi


def test_a_map_without_floor_and_a_distance_of_0_are_rejected() -> None:
    with pytest.raises(AcrcError, match="is 0 m; it must be above 0 m"):
        likelihood_field(_plan(), 0.0)
    with pytest.raises(AcrcError) as raised:
        likelihood_field(OccupancyGrid(np.full((3, 4), OCCUPIED, np.uint8), 0.1), 2.0)
    assert str(raised.value) == "the map of 3 x 4 cells has no free cell; robots need free floor"


CUBES = PRESETS["chapter"]
PRODUCT = replace(CUBES, weighting="product")
SKIPPING = replace(PRODUCT, beam_skip=True, sharpness=0.4)
RANGE = TURTLEBOT.sensor.range_max
HERE = Pose(3.2, 4.0, 0.4)


def scan_ends(others: Floats = NO_OBSTACLES) -> Floats:
    return ends(scan(ROOM, HERE, others))


def cloud(spread: float, count: int, seed: int = 0) -> Floats:
    """Return poses around HERE: (3, count)."""
    noise = np.random.default_rng(seed).standard_normal((3, count))
    return np.array(HERE)[:, np.newaxis] + spread * noise


def distances(points: Floats, poses: Floats) -> Floats:
    """Return the distance of each beam's end to the nearest wall for each particle, by the field: (n, b)."""
    c, s = np.cos(poses[2])[:, np.newaxis], np.sin(poses[2])[:, np.newaxis]
    x = poses[0][:, np.newaxis] + c * points[:, 0] - s * points[:, 1]
    y = poses[1][:, np.newaxis] + s * points[:, 0] + c * points[:, 1]
    columns = np.clip((x - FIELD.frame[0]) / FIELD.frame[2], 0, FIELD.levels.shape[1] - 1).astype(int)
    rows = np.clip((y - FIELD.frame[1]) / FIELD.frame[2], 0, FIELD.levels.shape[0] - 1).astype(int)
    found: Floats = FIELD.distances[FIELD.levels[rows, columns]]
    return found


def weighed(
    parameters: AmclParameters, points: Floats, poses: Floats, together: bool = True
) -> tuple[Floats, float, int]:
    """Return the weights of all particles but the last, the fit, and the number of skipped beams."""
    count = poses.shape[1] - 1
    weights = before(poses.shape[1])
    directions = np.empty_like(poses[:2])
    fit, skipped = Measurement(FIELD, RANGE, parameters).weigh(
        points, ParticleSet(poses, weights, directions, count), together=together
    )
    assert directions[:, :count] == pytest.approx(np.stack((np.cos(poses[2]), np.sin(poses[2])))[:, :count])
    assert weights[count] == before(count + 1)[count]
    return weights[:count], fit, skipped


def before(count: int) -> Floats:
    return (1.0 + np.arange(count) % 4) / 1000


def p(d: Floats) -> Floats:
    return 0.5 * np.exp(-0.5 * (d / 0.2) ** 2) + 0.5 / RANGE


@pytest.mark.parametrize(
    ("spread", "sharpness"), [(0.05, None), (5.0, None), (0.05, 1.0), (0.5, 0.3), (5.0, 0.3)]
)
def test_weights_are_those_of_numpy(spread: float, sharpness: float | None) -> None:
    points, poses = scan_ends(), cloud(spread, 101)
    d = distances(points, poses[:, :100])
    if sharpness is None:
        expected, parameters = before(100) * (1 + (p(d) ** 3).sum(axis=1)), CUBES
    else:
        logarithms, parameters = sharpness * np.log(p(d)).sum(axis=1), replace(PRODUCT, sharpness=sharpness)
        expected = before(100) * np.exp(logarithms - logarithms.max())
    weights, fit, skipped = weighed(parameters, points, poses)
    assert weights == pytest.approx(expected / expected.sum())
    assert fit == pytest.approx((d < 0.5).mean()) and skipped == 0


@pytest.mark.parametrize("seed", range(2))
def test_beams_that_few_particles_agree_with_are_skipped(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-3, 3, 3)
    discs = np.column_stack((HERE.x + np.cos(angles), HERE.y + np.sin(angles), np.full(3, 0.2)))
    points, poses = scan_ends(discs), cloud(0.05, 101, seed)
    d = distances(points, poses[:, :100])
    kept = (d < 0.5).mean(axis=0) >= 0.3
    logarithms = 0.4 * np.log(p(d[:, kept])).sum(axis=1)
    expected = before(100) * np.exp(logarithms - logarithms.max())
    weights, fit, skipped = weighed(SKIPPING, points, poses)
    assert skipped == (~kept).sum() > 0
    assert weights == pytest.approx(expected / expected.sum())
    assert fit == pytest.approx((d[:, kept] < 0.5).mean())  # otherwise a crowd would look like a wrong pose
    assert weighed(SKIPPING, points, poses, together=False)[2] == 0
    poses[:2] += 100.0
    assert weighed(SKIPPING, points, poses)[2] == 0, "nearly all would be skipped"


def test_random_measurements_cover_the_sensors_range() -> None:
    far = likelihoods(FIELD, 6.5, CUBES)[-1]
    assert far == pytest.approx(0.5 / 6.5) and likelihoods(FIELD, 12.0, CUBES)[-1] < far
    assert likelihoods(FIELD, 6.5, CUBES)[0] == pytest.approx(0.5 + 0.5 / 6.5)


@pytest.mark.parametrize("parameters", [CUBES, SKIPPING], ids=["cubes", "product"])
def test_a_scan_without_beams_leaves_the_weights_in_proportion(parameters: AmclParameters) -> None:
    weights, fit, skipped = weighed(parameters, np.empty((0, 2)), cloud(0.1, 101))
    assert weights == pytest.approx(before(100) / before(100).sum())
    assert (fit, skipped) == (0.0, 0)


def test_a_particle_of_weight_0_does_not_affect_the_others() -> None:
    """Its fit exceeds theirs so much that exp() of the difference is 0."""
    poses = cloud(0.0, 3)
    poses[:2, 1:] += 100.0
    weights = np.array([0.0, 0.5, 0.5])
    points = np.repeat(scan_ends(), 20, axis=0)
    Measurement(FIELD, RANGE, PRODUCT).weigh(
        points, ParticleSet(poses, weights, np.empty((2, 3)), 3), together=True
    )
    assert weights == pytest.approx([0.0, 0.5, 0.5])
