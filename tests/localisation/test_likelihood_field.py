"""The map as the filter sees it."""

import numpy as np
import pytest

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.robot.localisation import likelihood_field
from actors.runtime.errors import AcrcError


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


def test_beyond_the_map_is_nothing() -> None:
    field = likelihood_field(_plan(), 1.0)
    assert field.levels.shape == (32, 42)
    assert (field.levels[[0, -1]] == 255).all() and (field.levels[:, [0, -1]] == 255).all()
    assert field.frame == pytest.approx([-1.1, 1.9, 0.1])


def test_what_is_unknown_is_no_wall() -> None:
    cells = np.full((30, 40), FREE, np.uint8)
    cells[10:12] = UNKNOWN
    field = likelihood_field(OccupancyGrid(cells, 0.1, Point(0.0, 0.0)), 1.0)
    assert (field.levels == 255).all(), "where nothing is occupied every wall is far"
    cells[20] = OCCUPIED
    field = likelihood_field(OccupancyGrid(cells, 0.1, Point(0.0, 0.0)), 1.0)
    assert field.distances[field.levels[12, 5]] == pytest.approx(0.9, abs=0.002)


def test_nothing_that_is_shared_can_be_changed() -> None:
    field = likelihood_field(_plan(), 1.0)
    for shared in (field.levels, field.frame, field.floor):
        assert not shared.flags.writeable


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


def test_a_map_without_floor_is_refused() -> None:
    with pytest.raises(AcrcError) as raised:
        likelihood_field(OccupancyGrid(np.full((3, 4), OCCUPIED, np.uint8), 0.1), 2.0)
    assert str(raised.value) == "the map of 3 x 4 cells has no free cell; a robot needs floor to be on"


def test_a_distance_of_nothing_is_refused() -> None:
    with pytest.raises(AcrcError, match="max_distance 0 m; it must be above 0 m"):
        likelihood_field(_plan(), 0.0)
