"""The referee: what counts as visited, and what as done."""

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.instant import Instant
from actors.messages import PlaceReport
from actors.world.referee import PlaceOutcome, Referee
from actors.world.setup import RobotSetup
from actors.world.visits import visitors


def robot(name: str, *places: tuple[float, float]) -> RobotSetup:
    return RobotSetup(name, "turtlebot2", None, "exact", (0.0, 0.0, 0.0), places)


@pytest.fixture
def referee() -> Referee:
    return Referee((robot("r1", (0.0, 0.0), (3.0, 0.0)), robot("r2", (6.0, 0.0))), reach=0.5)


def at(*points: tuple[float, float]) -> NDArray[np.float64]:
    return np.array(points)


def test_a_place_is_reached_once_and_by_the_first(referee: Referee) -> None:
    referee.watch(Instant(0), at((0.6, 0.0), (9.0, 9.0)))
    referee.watch(Instant(100), at((0.4, 0.0), (0.0, 0.1)))
    referee.watch(Instant(200), at((0.0, 0.0), (6.0, 0.2)))
    assert referee.outcomes() == (
        PlaceOutcome("r1", 0, 0.0, 0.0, 100, "r1", None, None),
        PlaceOutcome("r1", 1, 3.0, 0.0, None, None, None, None),
        PlaceOutcome("r2", 0, 6.0, 0.0, 200, "r2", None, None),
    )


def test_done_is_reported_and_true_by_then(referee: Referee) -> None:
    referee.watch(Instant(100), at((0.0, 0.0), (9.0, 9.0)))
    assert referee.report("r1", PlaceReport("r1", 0, 150))  # true
    assert referee.report("r2", PlaceReport("r1", 1, 150))  # claimed, and nobody had been there
    assert referee.report("r2", PlaceReport("r2", 0, 150))  # claimed too early
    referee.watch(Instant(200), at((6.0, 0.0), (9.0, 9.0)))
    assert [outcome.done for outcome in referee.outcomes()] == [True, False, False]
    assert referee.reports == 3


def test_the_first_report_counts_and_unknown_places_are_refused(referee: Referee) -> None:
    assert referee.report("r2", PlaceReport("r1", 0, 10)) and referee.report("r1", PlaceReport("r1", 0, 20))
    assert referee.outcomes()[0].reported_by == "r2" and referee.outcomes()[0].reported_at == 10
    assert not referee.report("r1", PlaceReport("r1", 2, 10))
    assert not referee.report("r1", PlaceReport("r9", 0, 10))
    assert referee.reports == 1


def test_the_threshold_itself_is_outside() -> None:
    places, watched = at((0.0, 0.0)), np.arange(1)
    assert visitors(places, watched, at((0.5, 0.0)), 0.5).tolist() == []
    assert visitors(places, watched, at((np.nextafter(0.5, 0.0), 0.0)), 0.5).tolist() == [[0, 0]]


def test_the_kernel_agrees_with_plain_numpy() -> None:
    rng = np.random.default_rng(3)
    places, positions = rng.uniform(0, 5, (80, 2)), rng.uniform(0, 5, (9, 2))
    watched = np.flatnonzero(rng.random(80) < 0.7)
    near = ((places[watched][:, None] - positions[None]) ** 2).sum(axis=2) < 0.5**2
    twin = [[int(watched[row]), int(near[row].argmax())] for row in np.flatnonzero(near.any(axis=1))]
    assert len(twin) > 5
    assert visitors(places, watched, positions, 0.5).tolist() == twin
