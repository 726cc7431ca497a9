"""The referee of places, and pose errors of robots."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.instant import Instant
from actors.messages import RobotTruth
from actors.task.referee import PlaceOutcome, Referee, Verdict
from actors.task.visits import visitors
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from actors.world.whereabouts import PoseError, Whereabouts
from actors.world.world_setup import BodySetup


def robot(name: str, *places: tuple[float, float]) -> BodySetup:
    return BodySetup(name, "turtlebot2", None, "exact", (0.0, 0.0, 0.0), places)


@pytest.fixture
def referee() -> Referee:
    return Referee((robot("r1", (0.0, 0.0), (3.0, 0.0)), robot("r2", (6.0, 0.0))), reach=0.5)


def at(*points: tuple[float, float]) -> NDArray[np.float64]:
    return np.array(points)


def verdicts(referee: Referee) -> list[Verdict]:
    return [outcome.verdict for outcome in referee.outcomes({})]


def test_a_place_is_reached_once_and_by_the_first(referee: Referee) -> None:
    referee.watch(Instant(0), at((0.6, 0.0), (9.0, 9.0)))
    referee.watch(Instant(100), at((0.4, 0.0), (0.0, 0.1)))
    referee.watch(Instant(200), at((0.0, 0.0), (6.0, 0.2)))
    routes = {"r1": (PlaceKey("r2", 0),), "r2": (PlaceKey("r2", 0), PlaceKey("r1", 1))}
    assert referee.outcomes(routes) == (
        PlaceOutcome("r1", 0, 0.0, 0.0, 100, "r1", None, None, None, None, None, ()),
        PlaceOutcome("r1", 1, 3.0, 0.0, None, None, None, None, None, None, None, ("r2",)),
        PlaceOutcome("r2", 0, 6.0, 0.0, 200, "r2", None, None, None, None, None, ("r1", "r2")),
    )


def test_done_is_reported_and_true_by_then(referee: Referee) -> None:
    referee.watch(Instant(100), at((0.0, 0.0), (9.0, 9.0)))
    referee.report("r1", PlaceReport("r1", 0, 150))  # true
    referee.report("r2", PlaceReport("r1", 1, 150))  # claimed, and nobody had been there
    referee.report("r2", PlaceReport("r2", 0, 150))  # claimed too early
    referee.watch(Instant(200), at((6.0, 0.0), (9.0, 9.0)))
    assert verdicts(referee) == [Verdict.DONE, Verdict.MISTAKEN, Verdict.MISTAKEN]
    assert [outcome.done for outcome in referee.outcomes({})] == [True, False, False]
    assert referee.progress(()).done == 3


def test_the_first_report_and_the_first_giving_up_count(referee: Referee) -> None:
    referee.report("r2", PlaceReport("r1", 0, 10))
    referee.report("r1", PlaceReport("r1", 0, 20))
    referee.give_up("r2", PlaceGivenUp("r1", 1, 30, "blocked"))
    referee.give_up("r1", PlaceGivenUp("r1", 1, 40, "no plan"))
    reported, given_up, _ = referee.outcomes({})
    assert (reported.reported_at, reported.reported_by) == (10, "r2")
    assert (given_up.given_up_at, given_up.given_up_by, given_up.reason) == (30, "r2", "blocked")
    assert referee.progress(()).done == 1


def test_a_place_that_is_reported_and_given_up_counts_as_reported_whichever_came_first(
    referee: Referee,
) -> None:
    referee.watch(Instant(0), at((0.0, 0.0), (3.0, 0.0)))
    referee.give_up("r2", PlaceGivenUp("r1", 0, 10, "blocked"))
    referee.report("r1", PlaceReport("r1", 0, 20))
    referee.report("r1", PlaceReport("r1", 1, 30))
    referee.give_up("r2", PlaceGivenUp("r1", 1, 40, "blocked"))
    assert verdicts(referee) == [Verdict.DONE, Verdict.DONE, Verdict.LOST]
    assert [outcome.settled_at for outcome in referee.outcomes({})] == [10, 30, None]
    assert [outcome.given_up_at for outcome in referee.outcomes({})] == [10, 40, None]


def test_a_place_is_lost_when_nobody_has_a_word_for_it(referee: Referee) -> None:
    referee.give_up("r1", PlaceGivenUp("r1", 0, 10, "blocked"))
    outcomes = referee.outcomes({"r1": (PlaceKey("r1", 1),), "r2": ()})
    assert [outcome.verdict for outcome in outcomes] == [Verdict.GIVEN_UP, Verdict.OPEN, Verdict.LOST]
    assert [outcome.lost for outcome in outcomes] == [False, False, True]


def test_all_is_settled_when_every_place_is_reported_or_given_up(referee: Referee) -> None:
    referee.report("r1", PlaceReport("r1", 0, 10))
    referee.report("r1", PlaceReport("r1", 0, 10))
    referee.give_up("r1", PlaceGivenUp("r1", 0, 10, "blocked"))
    referee.give_up("r2", PlaceGivenUp("r2", 0, 10, "blocked"))
    assert not referee.settled
    referee.report("r1", PlaceReport("r1", 1, 10))
    assert referee.settled
    assert not Referee((robot("r1"),), reach=0.5).settled


@pytest.mark.parametrize(("owner", "place"), [("r1", 2), ("r1", -1), ("r2", 1), ("r9", 0)])
def test_places_that_nobody_was_given_are_not_known(referee: Referee, owner: str, place: int) -> None:
    assert referee.knows(PlaceReport("r1", 1, 10)) and referee.knows(PlaceKey("r2", 0))
    assert not referee.knows(PlaceKey(owner, place))


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


def _truth(x: float, y: float = 0.0) -> RobotTruth:
    return RobotTruth("r1", x, y, 0.0, 0.0, 0.0, 0.0, True, True, 0)


def test_errors_are_those_of_the_samples() -> None:
    whereabouts = Whereabouts(2)
    for held, x in ((0.0, 0.3), (0.0, -0.6), (5.0, 5.0), (0.0, 1.2), (0.0, 1.5), (0.0, 0.9)):
        whereabouts.take(0, (held, 0.0, 1.0), _truth(x))
    error = whereabouts.error(0)
    assert error.samples == 6
    assert error.rmse == pytest.approx(math.sqrt((0.09 + 0.36 + 1.44 + 2.25 + 0.81) / 6))
    assert (error.greatest, error.astray_share, error.lost_share) == (1.5, 4 / 6, 2 / 6)
    assert (error.times_lost, error.lost_at_end) == (1, False)
    assert whereabouts.error(1) == PoseError(0, 0.0, 0.0, 0.0, 0.0, 0, False)


def test_a_robot_gets_lost_anew_after_it_has_found_itself() -> None:
    whereabouts = Whereabouts(1)
    for y in (1.1, 1.3, 0.0, 2.0):
        whereabouts.take(0, (0.0, 0.0, 0.0), _truth(0.0, y))
    assert (whereabouts.error(0).times_lost, whereabouts.error(0).lost_at_end) == (2, True)


def test_who_says_nothing_is_not_measured() -> None:
    whereabouts = Whereabouts(1)
    whereabouts.take(0, None, _truth(7.0))
    assert whereabouts.error(0).samples == 0
