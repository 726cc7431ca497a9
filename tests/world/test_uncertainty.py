"""How the floor differs from the map: by dose, from the seed, and so that robots still get everywhere."""

import numpy as np
import pytest

from actors.floor import distance
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid, largest_region
from actors.floor.map_file import load_map
from actors.floor.placement import PlacementError
from actors.geometry import Point
from actors.installation.repository import REPOSITORY
from actors.randomness import generator
from actors.world.odometry import KobukiErrors, StageErrors
from actors.world.uncertainty import RealFloor, Uncertainty, drifting, floor

CORRIDOR = load_map(REPOSITORY / "maps" / "corridor.yaml")
BODY = 0.177


def made(dose: Uncertainty, seed: int = 1, kept_off: tuple[Point, ...] = ()) -> RealFloor:
    return floor(CORRIDOR, dose, generator(seed, "uncertainty", "world"), kept_off)


def walls(grid: OccupancyGrid) -> "np.typing.NDArray[np.bool_]":
    return np.equal(grid.cells, OCCUPIED)


def test_without_a_dose_the_floor_is_the_map() -> None:
    solid, visible = made(Uncertainty())
    assert solid.cells.tobytes() == visible.cells.tobytes() == CORRIDOR.cells.tobytes()
    assert drifting(Uncertainty()) == (StageErrors(), KobukiErrors())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("error", [0.05, 0.1, 0.2])
def test_walls_are_about_so_far_off_and_have_no_gaps(error: float, seed: int) -> None:
    solid, visible = made(Uncertainty(map_error=error), seed)
    assert solid.cells.tobytes() == visible.cells.tobytes()
    apart = np.sqrt(distance.squared_distance(walls(CORRIDOR))) * CORRIDOR.resolution
    off = apart[walls(solid)]
    assert 0.2 * error < np.sqrt(np.mean(np.square(off))) < 1.5 * error  # along a wall nothing is seen of it
    assert off.max() < 5 * error
    regions = [largest_region(grid, BODY).sum() for grid in (CORRIDOR, solid)]
    assert regions[1] == pytest.approx(regions[0], rel=0.1)  # nothing is cut off, nothing opened


def test_the_seed_says_which() -> None:
    dose = Uncertainty(map_error=0.1, glass=0.3, furniture=5)
    first, again, other = made(dose), made(dose), made(dose, seed=2)
    assert [part.cells.tobytes() for part in first] == [part.cells.tobytes() for part in again]
    assert first.solid.cells.tobytes() != other.solid.cells.tobytes()


@pytest.mark.parametrize("seed", range(4))
def test_furniture_leaves_a_way_and_keeps_off(seed: int) -> None:
    here = (Point(12.0, 5.0), Point(17.5, 12.0))
    solid, visible = made(Uncertainty(furniture=12), seed, here)
    assert solid.cells.tobytes() == visible.cells.tobytes()
    added = walls(solid) & ~walls(CORRIDOR)
    assert 12 * 0.19 < added.sum() * CORRIDOR.resolution**2 < 12 * 0.21  # a disc of 0.25 m has 0.196 m²
    assert CORRIDOR.clearance[added].min() > 0.55
    lost = largest_region(CORRIDOR, BODY) & ~largest_region(solid, BODY)
    assert (
        lost.sum() * CORRIDOR.resolution**2 < 12 * 3.14 * (0.25 + BODY + 0.05) ** 2
    )  # around it, and no more
    for point in here:
        assert solid.clearance_at(point, 1.0) > 0.6


def test_furniture_that_finds_no_room_is_said() -> None:
    with pytest.raises(
        PlacementError, match=r"uncertainty\.furniture is 1000, but there is room for .* of 1000 points"
    ):
        made(Uncertainty(furniture=1000))


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_sensors_look_through_so_many_walls_and_bodies_do_not_pass(share: float) -> None:
    solid, visible = made(Uncertainty(glass=share, furniture=3))
    bare = walls(CORRIDOR)
    assert walls(solid)[bare].all() and set(np.unique(visible.cells)) == {FREE, OCCUPIED}
    assert not (walls(visible) & ~walls(solid)).any()
    shares = [np.mean(~walls(made(Uncertainty(glass=share), seed).visible)[bare]) for seed in range(5)]
    assert np.mean(shares) == pytest.approx(share, abs=0.08)
    things = walls(solid) & ~bare
    assert walls(visible)[things].all()  # what stands on the floor is no glass


def test_all_of_it_is_seen_through() -> None:
    assert not walls(made(Uncertainty(glass=1.0)).visible).any()


def test_odometry_drifts_so_many_times_as_much() -> None:
    stage, kobuki = drifting(Uncertainty(drift=3.0))
    assert (stage.forward, stage.turn) == (3 * StageErrors().forward, 3 * StageErrors().turn)
    assert kobuki.gyro_bias_deg == 3 * KobukiErrors().gyro_bias_deg and kobuki.slip == 3 * KobukiErrors().slip
    assert (kobuki.track, kobuki.tick_um) == (KobukiErrors().track, KobukiErrors().tick_um)
