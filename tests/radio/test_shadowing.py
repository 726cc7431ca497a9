"""Statistics of the shadowing over many seeds, and that it belongs to places, not to robots."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Point
from actors.radio.propagation.indoor import (
    IndoorPropagation,
    PathLossParameters,
    PropagationParameters,
    ShadowingParameters,
    Waves,
    fingerprint,
    waves,
)
from actors.radio.propagation.walls import build

Floats = NDArray[np.float64]
PARAMETERS = ShadowingParameters(sigma_db=4.0, correlation_distance=2.0)
FLAT = PathLossParameters(near_loss_db=100.0, near_exponent=0.0, breakpoint=math.inf)
"""100 dB everywhere: what differs is shadowing."""


def propagation(seed: int, parameters: ShadowingParameters = PARAMETERS) -> IndoorPropagation:
    return IndoorPropagation(
        PropagationParameters(FLAT, shadowing=parameters), None, np.random.default_rng(seed)
    )


def over_seeds(senders: Floats, receivers: Floats, seeds: int = 3000) -> Floats:
    """(seeds, s · r) of shadowing, dB."""
    return np.array([propagation(seed).loss_db(senders, receivers).ravel() - 100.0 for seed in range(seeds)])


def plain(field: Waves, one: Floats, other: Floats, parameters: ShadowingParameters) -> float:
    """The definition, term by term."""
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


def test_sigma_is_the_same_at_any_distance_and_the_mean_is_nothing() -> None:
    # With 3000 seeds the standard error of a deviation is 1.3 %, that of a mean 0.073 dB.
    ends = np.array([[0.025, 0.025], [0.5, 0.0], [1.0, 1.0], [5.0, 3.0], [40.0, 0.0]])
    found = over_seeds(np.zeros((1, 2)), ends)
    assert found.std(axis=0) == pytest.approx(4.0, rel=0.05)
    assert found.mean(axis=0) == pytest.approx(0.0, abs=0.3)
    kurtosis = (found**4).mean(axis=0) / (found**2).mean(axis=0) ** 2
    assert kurtosis == pytest.approx(3.0, abs=0.3)


def test_the_correlation_falls_with_the_way_of_either_end() -> None:
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


def test_one_seed_alone_has_about_the_same_spread_over_places() -> None:
    places = np.random.default_rng(3).uniform(0, 300, (400, 2))
    for seed in range(3):
        found = propagation(seed).loss_db(places[:1], places[1:]) - 100.0
        assert found.std() == pytest.approx(4.0, rel=0.2)


def test_both_directions_are_the_same_to_the_last_bit() -> None:
    places = np.random.default_rng(2).uniform(-30, 30, (40, 2))
    loss = propagation(1).loss_db(places, places)
    assert np.array_equal(loss, loss.T)


def test_others_change_nothing_and_neither_does_who_was_where_before() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(0, 30, (20, 2))
    walking, fresh = propagation(9), propagation(9)
    for _ in range(20):
        places += rng.normal(0, 0.05, places.shape)
        row = walking.loss_db(places[3:4], places)
    assert np.array_equal(row, fresh.loss_db(places[3:4], places))
    pair = propagation(9).loss_db(places[3:4], places[7:8])
    assert pair[0, 0] == row[0, 7]


def test_another_seed_is_another_building() -> None:
    places = np.random.default_rng(2).uniform(-30, 30, (40, 2))
    one, other = (propagation(seed).loss_db(places, places)[np.triu_indices(40, 1)] for seed in (1, 2))
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.2


def test_no_loss_is_below_nothing() -> None:
    near = PropagationParameters(PathLossParameters(), shadowing=replace(PARAMETERS, sigma_db=30.0))
    places = np.random.default_rng(2).uniform(0, 0.5, (40, 2))
    several = (IndoorPropagation(near, None, np.random.default_rng(seed)) for seed in range(10))
    least = [float(one.loss_db(places, places).min()) for one in several]
    assert min(least) == 0.0 < max(least)


def test_the_fingerprint_is_the_same_twice() -> None:
    assert fingerprint() == fingerprint() != b""


@pytest.mark.parametrize("most_db", [60.0, 90.0, 120.0])
def test_behind_walls_shadowing_may_still_bring_a_loss_within_what_is_asked_for(most_db: float) -> None:
    """What walls alone make too much is followed as long as shadowing could take it back."""
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
