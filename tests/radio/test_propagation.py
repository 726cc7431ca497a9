"""Walls and shadowing, compared with plain computations."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.radio.propagation import (
    IndoorPropagation,
    PathLossParameters,
    PropagationParameters,
    ShadowingParameters,
    ShadowingWaves,
    waves,
)
from actors.radio.walls import (
    MATERIALS,
    TILE,
    WallPatch,
    Walls,
    build,
    material,
    wall_loss,
    walls_of,
)

BRICK = MATERIALS["brick"]


def loss(
    walls: Walls, one: tuple[float, float], other: tuple[float, float], most_db: float = math.inf
) -> float:
    side = TILE * walls.resolution
    (x0, y0), (x1, y1) = (((x - walls.west) / side, (y - walls.south) / side) for x, y in (one, other))
    return float(wall_loss(walls, walls.per_metre_db * side, x0, y0, x1, y1, most_db))


def room(middle: int = OCCUPIED) -> OccupancyGrid:
    """Return 4 m by 3 m in cells of 0.1 m, corner at (-1, 2), with a wall from x = 0.5 to 0.7."""
    cells = np.full((30, 40), FREE, np.uint8)
    cells[:, 15:17] = middle
    return OccupancyGrid(cells, 0.1, Point(-1.0, 2.0))


def test_a_wall_costs_its_crossing_and_its_thickness() -> None:
    walls = build(room(), "brick")
    assert loss(walls, (0.0, 3.0), (2.0, 3.0)) == pytest.approx(BRICK.crossing_db + 0.2 * BRICK.per_metre_db)
    slanted = BRICK.crossing_db + 0.2 * math.sqrt(2) * BRICK.per_metre_db
    assert loss(walls, (0.0, 2.5), (2.0, 4.5)) == pytest.approx(slanted)
    assert loss(walls, (-0.5, 3.0), (0.4, 4.0)) == 0.0


def test_unknown_cells_and_the_outside_cause_no_loss() -> None:
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


def walls(kinds: NDArray[np.uint8]) -> Walls:
    return walls_of(kinds, 0.1, 0.0, 0.0, np.array([0.0, 1.0, 3.0]), np.array([0.0, 20.0, 5.0]))


def crossed(kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float]) -> list[float]:
    """Return the length in each material, m, cell by cell."""
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
def test_path_lengths_in_materials_are_exact(
    kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float]
) -> None:
    floor = walls(kinds)
    nothing = np.zeros(3)
    for kind, length in enumerate(crossed(kinds, one, other)):
        rate = np.zeros(3)
        rate[kind] = 1.0 if kind else 0.0
        only = floor._replace(crossing_db=nothing, per_metre_db=rate)
        assert loss(only, one, other) == pytest.approx(length if kind else 0.0, abs=1e-7)


def rooms() -> NDArray[np.uint8]:
    """Return 20 m by 15 m in cells of 0.1 m: long walls, two doors, a pillar; most tiles are air."""
    kinds = np.zeros((150, 200), np.uint8)
    kinds[40:42, :], kinds[:, 90:93], kinds[101:109, 30:37] = 1, 2, 1
    kinds[40:42, 60:70] = kinds[120:130, 90:93] = 0
    return kinds


def test_path_lengths_in_walls_are_exact_over_large_rooms() -> None:
    kinds, rng = rooms(), np.random.default_rng(5)
    rates, entered = np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0, 1.0])
    lengths = walls_of(kinds, 0.1, 0.0, 0.0, np.zeros(3), rates)
    entries = lengths._replace(crossing_db=entered, per_metre_db=np.zeros(3))
    for one, other in rng.uniform([-1.0, -1.0], [21.0, 16.0], (300, 2, 2)):
        ends = (float(one[0]), float(one[1])), (float(other[0]), float(other[1]))
        assert loss(lengths, *ends) == pytest.approx(sum(crossed(kinds, *ends)[1:]), abs=1e-7)
    assert loss(entries, (3.2, 2.0), (3.4, 14.0)) == 2.0  # a wall, the pillar
    assert loss(entries, (2.0, 4.05), (6.5, 4.1)) == 1.0  # along a wall, into its door
    assert loss(entries, (2.0, 4.05), (17.0, 4.1)) == 4.0  # beyond the door, and through the other wall
    assert loss(entries, (6.5, 2.0), (6.6, 14.0)) == 0.0  # through the door


@settings(max_examples=200, deadline=None, derandomize=True)
@given(kinds=kinds, one=spots, other=spots, most_db=st.floats(0.0, 20.0))
def test_losses_are_symmetric_and_exact_or_above_the_limit(
    kinds: NDArray[np.uint8], one: tuple[float, float], other: tuple[float, float], most_db: float
) -> None:
    floor = walls(kinds)
    whole = loss(floor, one, other)
    cut = loss(floor, one, other, most_db)
    assert cut == whole if whole <= most_db else cut > most_db
    assert whole == loss(floor, other, one) >= 0.0, "the same from both sides"


Floats = NDArray[np.float64]
PARAMETERS = ShadowingParameters(sigma_db=4.0, correlation_distance=2.0)
FLAT = PathLossParameters(near_loss_db=100.0, near_exponent=0.0, breakpoint=math.inf)
"""100 dB everywhere, plus shadowing."""


def propagation(seed: int, parameters: ShadowingParameters = PARAMETERS) -> IndoorPropagation:
    return IndoorPropagation(
        PropagationParameters(FLAT, shadowing=parameters), None, np.random.default_rng(seed)
    )


def over_seeds(senders: Floats, receivers: Floats, seeds: int = 3000) -> Floats:
    """Return (seeds, s · r) of shadowing, dB."""
    return np.array([propagation(seed).loss_db(senders, receivers).ravel() - 100.0 for seed in range(seeds)])


def plain(field: ShadowingWaves, one: Floats, other: Floats, parameters: ShadowingParameters) -> float:
    p, q = ((np.floor(end / parameters.grain) + 0.5) * parameters.grain for end in (one, other))
    total = sum(
        math.cos(k @ p + m @ q + phase) + math.cos(k @ q + m @ p + phase)
        for k, m, phase in zip(field.first, field.second, field.phase, strict=True)
    )
    alike = math.exp(-2 * math.dist(p, q) / parameters.correlation_distance)
    return parameters.sigma_db * total / math.sqrt(parameters.sinusoids * (1 + alike))


def test_the_kernel_computes_the_definition() -> None:
    rng = np.random.default_rng(5)
    senders, receivers = rng.uniform(-20, 20, (3, 2)), rng.uniform(-20, 20, (9, 2))
    found = propagation(7).loss_db(senders, receivers) - 100.0
    field = waves(PARAMETERS, np.random.default_rng(7))
    for i, one in enumerate(senders):
        for j, other in enumerate(receivers):
            assert found[i, j] == pytest.approx(plain(field, one, other, PARAMETERS), abs=1e-9)


def test_shadowing_has_constant_sigma_and_zero_mean() -> None:
    # With 3000 seeds the standard error of a deviation is 1.3 %, that of a mean 0.073 dB.
    ends = np.array([[0.025, 0.025], [0.5, 0.0], [1.0, 1.0], [5.0, 3.0], [40.0, 0.0]])
    found = over_seeds(np.zeros((1, 2)), ends)
    assert found.std(axis=0) == pytest.approx(4.0, rel=0.05)
    assert found.mean(axis=0) == pytest.approx(0.0, abs=0.3)
    kurtosis = (found**4).mean(axis=0) / (found**2).mean(axis=0) ** 2
    assert kurtosis == pytest.approx(3.0, abs=0.3)


def test_the_correlation_falls_with_the_displacement_of_either_end() -> None:
    # The standard error of a correlation from 3000 seeds is at most 0.018.
    one = np.array([[0.025, 0.025], [2.025, 0.025], [0.025, 1.025]])
    other = np.array([[20.025, 0.025], [22.025, 0.025], [20.025, 4.025]])
    found = over_seeds(one, other).reshape(-1, 3, 3)

    def correlation(a: tuple[int, int], b: tuple[int, int]) -> float:
        return float(np.corrcoef(found[:, a[0], a[1]], found[:, b[0], b[1]])[0, 1])

    assert correlation((0, 0), (0, 1)) == pytest.approx(math.exp(-1), abs=0.06)  # the receiver by 2 m
    assert correlation((0, 0), (1, 0)) == pytest.approx(math.exp(-1), abs=0.06)  # the sender by 2 m
    assert correlation((0, 0), (0, 2)) == pytest.approx(math.exp(-2), abs=0.06)
    assert correlation((0, 0), (2, 0)) == pytest.approx(math.exp(-0.5), abs=0.06)
    assert correlation((0, 0), (1, 1)) == pytest.approx(math.exp(-2), abs=0.06)  # both by 2 m


def test_directions_are_equal_to_the_last_bit_and_seeds_independent() -> None:
    places = np.random.default_rng(2).uniform(-30, 30, (40, 2))
    one, other = (propagation(seed).loss_db(places, places) for seed in (1, 2))
    assert np.array_equal(one, one.T)
    upper = np.triu_indices(40, 1)
    assert abs(np.corrcoef(one[upper], other[upper])[0, 1]) < 0.2


def test_shadowing_depends_only_on_the_two_places() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(0, 30, (20, 2))
    walking, fresh = propagation(9), propagation(9)
    for _ in range(20):
        places += rng.normal(0, 0.05, places.shape)
        row = walking.loss_db(places[3:4], places)
    assert np.array_equal(row, fresh.loss_db(places[3:4], places))
    pair = propagation(9).loss_db(places[3:4], places[7:8])
    assert pair[0, 0] == row[0, 7]


def test_no_loss_is_negative() -> None:
    near = PropagationParameters(PathLossParameters(), shadowing=replace(PARAMETERS, sigma_db=30.0))
    places = np.random.default_rng(2).uniform(0, 0.5, (40, 2))
    several = (IndoorPropagation(near, None, np.random.default_rng(seed)) for seed in range(10))
    least = [float(one.loss_db(places, places).min()) for one in several]
    assert min(least) == 0.0 < max(least)


@pytest.mark.parametrize("most_db", [60.0, 90.0, 120.0])
def test_negative_shadowing_is_included_in_the_limit(most_db: float) -> None:
    cells = np.full((40, 120), FREE, np.uint8)
    cells[:, 10::20] = OCCUPIED
    floor = build(OccupancyGrid(cells, 0.25, Point(0.0, 0.0)), "concrete")
    parameters = PropagationParameters(shadowing=ShadowingParameters(sigma_db=12.0))
    places = np.random.default_rng(2).uniform([0.0, 0.0], [30.0, 10.0], (60, 2))
    indoor = IndoorPropagation(parameters, floor, np.random.default_rng(1))
    whole, cut = indoor.loss_db(places, places), indoor.loss_db(places, places, most_db)
    near = whole <= most_db
    assert np.array_equal(cut[near], whole[near]) and (cut[~near] > most_db).all()
    assert near.any() and not near.all()
