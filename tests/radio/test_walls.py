"""Walls on the floor plan, against a plain walk in tiny steps and by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.radio.propagation.walls import (
    MATERIALS,
    TILE,
    WallPatch,
    Walls,
    between,
    build,
    material,
    tiles_of,
)
from actors.runtime.errors import AcrcError

BRICK = MATERIALS["brick"]


def loss(
    walls: Walls, one: tuple[float, float], other: tuple[float, float], most_db: float = math.inf
) -> float:
    side = TILE * walls.resolution
    (x0, y0), (x1, y1) = (((x - walls.west) / side, (y - walls.south) / side) for x, y in (one, other))
    return float(between(*walls.tiles, walls.crossing_db, walls.per_metre_db * side, x0, y0, x1, y1, most_db))


def room(middle: int = OCCUPIED) -> OccupancyGrid:
    """4 m by 3 m in cells of 0.1 m, west corner at (-1, 2), with a wall of 0.2 m from x = 0.5 to 0.7."""
    cells = np.full((30, 40), FREE, np.uint8)
    cells[:, 15:17] = middle
    return OccupancyGrid(cells, 0.1, Point(-1.0, 2.0))


def test_a_wall_costs_its_crossing_and_its_thickness() -> None:
    walls = build(room(), "brick")
    assert loss(walls, (0.0, 3.0), (2.0, 3.0)) == pytest.approx(BRICK.crossing_db + 0.2 * BRICK.per_metre_db)
    slanted = BRICK.crossing_db + 0.2 * math.sqrt(2) * BRICK.per_metre_db
    assert loss(walls, (0.0, 2.5), (2.0, 4.5)) == pytest.approx(slanted)
    assert loss(walls, (-0.5, 3.0), (0.4, 4.0)) == 0.0


def test_what_is_unknown_and_what_is_outside_costs_nothing() -> None:
    assert loss(build(room(UNKNOWN), "brick"), (0.0, 3.0), (2.0, 3.0)) == 0.0
    walls = build(room(), "brick")
    assert loss(walls, (0.6, 9.0), (0.6, 12.0)) == 0.0
    through = loss(walls, (0.0, 3.0), (2.0, 3.0))
    assert loss(walls, (-50.0, 3.0), (50.0, 3.0)) == pytest.approx(through)
    assert loss(walls, (0.6, -9.0), (0.6, 50.0)) == pytest.approx(
        BRICK.crossing_db + 3.0 * BRICK.per_metre_db
    )


def test_a_patch_is_of_its_own_material_and_the_last_one_counts() -> None:
    patches = [WallPatch("concrete", (0.0, 1.0), (2.0, 3.0)), WallPatch("glass", (0.0, 1.0), (2.5, 3.0))]
    walls = build(room(), "brick", patches)
    for y, name in ((2.2, "concrete"), (2.7, "glass"), (3.2, "brick")):
        expected = MATERIALS[name].crossing_db + 0.2 * MATERIALS[name].per_metre_db
        assert loss(walls, (0.0, y), (2.0, y)) == pytest.approx(expected)
    along = loss(walls, (0.6, 2.05), (0.6, 2.95))  # from concrete into glass: both are entered
    assert along == pytest.approx(
        MATERIALS["concrete"].crossing_db
        + MATERIALS["glass"].crossing_db
        + 0.45 * (MATERIALS["concrete"].per_metre_db + MATERIALS["glass"].per_metre_db)
    )


def test_each_wall_of_the_multi_wall_model_counts_once() -> None:
    cells = np.full((20, 40), FREE, np.uint8)
    cells[:, [5, 6, 7, 12, 20, 21]] = OCCUPIED
    walls = build(OccupancyGrid(cells, 0.1), "light_wall")
    assert loss(walls, (0.1, 1.0), (3.9, 1.0)) == pytest.approx(3 * 3.4)


def test_an_unknown_material_is_named() -> None:
    with pytest.raises(AcrcError) as error:
        build(room(), "cheese")
    assert str(error.value) == f"Wall material 'cheese' is unknown; known are {', '.join(MATERIALS)}."


def test_dielectric_materials_are_those_of_the_recommendation() -> None:
    # Concrete at 2.45 GHz: permittivity 5.24, conductivity 0.0462 · 2.45^0.7822 = 0.0931 S/m.
    concrete = material("concrete")
    assert concrete.per_metre_db == pytest.approx(1636 * 0.0931 / math.sqrt(5.24), rel=1e-3)
    reflected = ((math.sqrt(5.24) - 1) / (math.sqrt(5.24) + 1)) ** 2
    assert concrete.crossing_db == pytest.approx(-20 * math.log10(1 - reflected))
    assert all(one.crossing_db >= 0 and one.per_metre_db >= 0 for one in MATERIALS.values())


kinds = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).choice(3, size=(23, 31), p=[0.8, 0.1, 0.1]).astype(np.uint8)
)
spots = st.tuples(st.floats(-0.5, 3.6), st.floats(-0.5, 2.8))


def walls_of(kinds: NDArray[np.uint8]) -> Walls:
    return Walls(tiles_of(kinds), 0.1, 0.0, 0.0, np.array([0.0, 1.0, 3.0]), np.array([0.0, 20.0, 5.0]))


def crossed(kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float]) -> list[float]:
    """Length, m, in each material: the plain way, cell border by cell border."""
    (x0, y0), (x1, y1) = one, other
    rows, columns = kinds.shape
    cuts = {0.0, 1.0}
    for start, end, lines in ((x0, x1, columns + 1), (y0, y1, rows + 1)):
        if start != end:
            cuts |= {t for k in range(lines) if 0 < (t := (0.1 * k - start) / (end - start)) < 1}
    lengths = [0.0, 0.0, 0.0]
    ordered = sorted(cuts)
    for a, b in pairwise(ordered):
        middle = (a + b) / 2
        column = math.floor((x0 + middle * (x1 - x0)) / 0.1)
        row = math.floor((y0 + middle * (y1 - y0)) / 0.1)
        kind = kinds[row, column] if 0 <= row < rows and 0 <= column < columns else 0
        lengths[kind] += (b - a) * math.hypot(x1 - x0, y1 - y0)
    return lengths


@settings(max_examples=300, deadline=None, derandomize=True)
@given(kinds=kinds, one=spots, other=spots)
def test_the_way_through_every_material_is_exact(
    kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float]
) -> None:
    walls = walls_of(kinds)
    nothing = np.zeros(3)
    for kind, length in enumerate(crossed(kinds, one, other)):
        rate = np.zeros(3)
        rate[kind] = 1.0 if kind else 0.0
        only = Walls(walls.tiles, 0.1, 0.0, 0.0, nothing, rate)
        assert loss(only, one, other) == pytest.approx(length if kind else 0.0, abs=1e-7)


def rooms() -> NDArray[np.uint8]:
    """20 m by 15 m in cells of 0.1 m: long walls, two doors, a pillar; most tiles are nothing but air."""
    kinds = np.zeros((150, 200), np.uint8)
    kinds[40:42, :], kinds[:, 90:93], kinds[101:109, 30:37] = 1, 2, 1
    kinds[40:42, 60:70] = kinds[120:130, 90:93] = 0
    return kinds


def test_over_large_rooms_the_way_through_walls_is_exact_and_each_is_entered_once() -> None:
    kinds, rng = rooms(), np.random.default_rng(5)
    rates, entered = np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0, 1.0])
    lengths = Walls(tiles_of(kinds), 0.1, 0.0, 0.0, np.zeros(3), rates)
    entries = Walls(lengths.tiles, 0.1, 0.0, 0.0, entered, np.zeros(3))
    for one, other in rng.uniform([-1.0, -1.0], [21.0, 16.0], (300, 2, 2)):
        ends = (float(one[0]), float(one[1])), (float(other[0]), float(other[1]))
        assert loss(lengths, *ends) == pytest.approx(sum(crossed(kinds, *ends)[1:]), abs=1e-7)
    assert loss(entries, (3.2, 2.0), (3.4, 14.0)) == 2.0  # a wall, the pillar
    assert loss(entries, (2.0, 4.05), (6.5, 4.1)) == 1.0  # along a wall, into its door
    assert loss(entries, (2.0, 4.05), (17.0, 4.1)) == 4.0  # beyond the door, and through the other wall
    assert loss(entries, (6.5, 2.0), (6.6, 14.0)) == 0.0  # through the door


@pytest.mark.parametrize("kinds", [rooms(), np.random.default_rng(1).choice(3, (45, 67)).astype(np.uint8)])
def test_blocks_have_every_cell_of_a_wall_once(kinds: NDArray[np.uint8]) -> None:
    tiles = tiles_of(kinds)
    rows, columns = tiles.leaps.shape[1:]
    found = np.zeros((rows * TILE, columns * TILE), np.uint8)
    for row in range(rows):
        for column in range(columns):
            tile = row * columns + column
            part = found[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
            for west, south, east, north, kind in tiles.blocks[tiles.begins[tile] : tiles.begins[tile + 1]]:
                assert not part[south:north, west:east].any()
                part[south:north, west:east] = kind
            assert (tiles.leaps[:, row, column] == 0).all() == part.any()
    height, width = kinds.shape
    assert np.array_equal(found[:height, :width], kinds)
    assert not found[height:].any() and not found[:, width:].any()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(kinds=kinds, one=spots, other=spots)
def test_walls_are_the_same_from_both_sides(
    kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float]
) -> None:
    walls = walls_of(kinds)
    assert loss(walls, one, other) == loss(walls, other, one) >= 0.0


@settings(max_examples=200, deadline=None, derandomize=True)
@given(kinds=kinds, one=spots, other=spots, most_db=st.floats(0.0, 20.0))
def test_a_loss_is_exact_or_known_to_be_too_much(
    kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float], most_db: float
) -> None:
    walls = walls_of(kinds)
    whole = loss(walls, one, other)
    cut = loss(walls, one, other, most_db)
    assert cut == whole if whole <= most_db else cut > most_db
