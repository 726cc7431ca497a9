"""The referee of places."""

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.instant import Instant
from actors.items import ItemGivenUp, ItemKey
from actors.task.task import JudgeSetup
from cleaning.place import VisitReport
from cleaning.referee import PlaceOutcome, PlaceVerdict, Referee
from cleaning.visits import find_visits
from tests.conduct.scripted_swarm import ScriptedAnswer


@pytest.fixture
def referee() -> Referee:
    return made(r1=((0.0, 0.0), (3.0, 0.0)), r2=((6.0, 0.0),))


def made(**items: tuple[tuple[float, float], ...]) -> Referee:
    return Referee(JudgeSetup(robots=tuple(items), items=items), reach=0.5)


def say(
    referee: Referee,
    robot: str,
    *reports: VisitReport,
    given_up: tuple[ItemGivenUp, ...] = (),
    route: tuple[ItemKey, ...] | None = None,
) -> str | None:
    return referee.take(robot, ScriptedAnswer(reports, given_up, route), 0, 1000)


def at(*points: tuple[float, float]) -> NDArray[np.float64]:
    return np.array(points)


def outcomes(referee: Referee, *present: str) -> list[PlaceOutcome]:
    return [*referee.places(present)]


def verdicts(referee: Referee) -> list[PlaceVerdict]:
    return [outcome.verdict for outcome in outcomes(referee)]


def test_a_place_is_reached_once_and_by_the_first(referee: Referee) -> None:
    referee.watch(Instant(0), at((0.6, 0.0), (9.0, 9.0)))
    referee.watch(Instant(100), at((0.4, 0.0), (0.0, 0.1)))
    referee.watch(Instant(200), at((0.0, 0.0), (6.0, 0.2)))
    say(referee, "r1", route=(ItemKey("r2", 0),))
    say(referee, "r2", route=(ItemKey("r2", 0), ItemKey("r1", 1)))
    assert outcomes(referee, "r1", "r2") == [
        PlaceOutcome("r1", 0, 0.0, 0.0, 100, "r1", None, None, None, None, None, ()),
        PlaceOutcome("r1", 1, 3.0, 0.0, None, None, None, None, None, None, None, ("r2",)),
        PlaceOutcome("r2", 0, 6.0, 0.0, 200, "r2", None, None, None, None, None, ("r1", "r2")),
    ]


def test_done_is_reported_and_true_by_then(referee: Referee) -> None:
    referee.watch(Instant(100), at((0.0, 0.0), (9.0, 9.0)))
    say(referee, "r1", VisitReport("r1", 0, 150))  # true
    say(referee, "r2", VisitReport("r1", 1, 150))  # no robot had been there
    say(referee, "r2", VisitReport("r2", 0, 150))  # claimed too early
    referee.watch(Instant(200), at((6.0, 0.0), (9.0, 9.0)))
    assert verdicts(referee) == [PlaceVerdict.DONE, PlaceVerdict.MISTAKEN, PlaceVerdict.MISTAKEN]
    assert [outcome.done for outcome in outcomes(referee)] == [True, False, False]
    assert referee.progress(()).done == 3


def test_the_first_report_and_the_first_giving_up_count(referee: Referee) -> None:
    say(referee, "r2", VisitReport("r1", 0, 10))
    say(referee, "r1", VisitReport("r1", 0, 20))
    say(referee, "r2", given_up=(ItemGivenUp("r1", 1, 30, "blocked"),))
    say(referee, "r1", given_up=(ItemGivenUp("r1", 1, 40, "no plan"),))
    reported, given_up, _ = outcomes(referee)
    assert (reported.reported_at, reported.reported_by) == (10, "r2")
    assert (given_up.given_up_at, given_up.given_up_by, given_up.reason) == (30, "r2", "blocked")
    assert referee.progress(()).done == 1


def test_a_place_reported_and_given_up_counts_as_reported(referee: Referee) -> None:
    referee.watch(Instant(0), at((0.0, 0.0), (3.0, 0.0)))
    say(referee, "r2", given_up=(ItemGivenUp("r1", 0, 10, "blocked"),))
    say(referee, "r1", VisitReport("r1", 0, 20))
    say(referee, "r1", VisitReport("r1", 1, 30))
    say(referee, "r2", given_up=(ItemGivenUp("r1", 1, 40, "blocked"),))
    assert verdicts(referee) == [PlaceVerdict.DONE, PlaceVerdict.DONE, PlaceVerdict.LOST]
    assert [outcome.settled_at for outcome in outcomes(referee)] == [10, 30, None]
    assert [outcome.given_up_at for outcome in outcomes(referee)] == [10, 40, None]


def test_a_place_without_owner_is_lost(referee: Referee) -> None:
    say(referee, "r1", given_up=(ItemGivenUp("r1", 0, 10, "blocked"),))
    assert [outcome.verdict for outcome in outcomes(referee, "r1")] == [
        PlaceVerdict.GIVEN_UP,
        PlaceVerdict.OPEN,
        PlaceVerdict.LOST,
    ]


def test_all_is_settled_when_every_place_is_reported_or_given_up(referee: Referee) -> None:
    say(referee, "r1", VisitReport("r1", 0, 10))
    say(referee, "r1", VisitReport("r1", 0, 10))
    say(referee, "r1", given_up=(ItemGivenUp("r1", 0, 10, "blocked"),))
    say(referee, "r2", given_up=(ItemGivenUp("r2", 0, 10, "blocked"),))
    assert not referee.settled
    say(referee, "r1", VisitReport("r1", 1, 10))
    assert referee.settled
    assert not made(r1=()).settled


@pytest.mark.parametrize(("owner", "place"), [("r1", 2), ("r1", -1), ("r2", 1), ("r9", 0)])
def test_unassigned_places_are_unknown(referee: Referee, owner: str, place: int) -> None:
    key, known = ItemKey(owner, place), VisitReport("r1", 1, 10)
    end = f"place {place} of '{owner}', which does not exist"
    assert say(referee, "r2", known, route=(ItemKey("r2", 0),)) is None
    assert say(referee, "r2", VisitReport(owner, place, 10)) == f"reports {end}"
    assert say(referee, "r2", given_up=(ItemGivenUp(owner, place, 10, "no"),)) == f"gives up {end}"
    assert say(referee, "r2", route=(key,)) == f"has in its route {end}"


def test_changes_of_state_are_shown(referee: Referee) -> None:
    marks, events = referee.take_changes()
    assert [(str(one.key), one.x, one.state, one.by) for one in marks] == [
        ("r1/0", 0.0, "open", ""), ("r1/1", 3.0, "open", ""), ("r2/0", 6.0, "open", "")
    ]  # fmt: skip
    assert events == ()
    say(referee, "r2", VisitReport("r1", 0, 30), given_up=(ItemGivenUp("r2", 0, 40, "blocked"),))
    referee.give(Instant(100), "r2", [(1.0, 2.0)])
    marks, events = referee.take_changes()
    assert [(str(one.key), one.state, one.by) for one in marks] == [
        ("r1/0", "done", "r2"), ("r2/0", "given up", "r2"), ("r2/1", "given", "")
    ]  # fmt: skip
    assert [(one.robot, one.instant, one.kind, str(one.key)) for one in events] == [
        ("r2", 30, "cleaned", "r1/0")
    ]
    assert referee.take_changes() == ((), ())


def test_the_outcome_in_words_and_values(referee: Referee) -> None:
    referee.watch(Instant(0), at((0.0, 0.0), (9.0, 9.0)))
    say(referee, "r1", VisitReport("r1", 0, 10), VisitReport("r1", 1, 20), route=())
    found = referee.outcome(("r1",), Instant(6_000_000))
    assert found.summary == "cleaned 1 of 3 places in 6 s; 2 are left"
    assert found.notes == (
        "1 place was reported although no robot had visited it.",
        "1 place was lost: neither reported nor given up, and on no robot's route.",
    )
    assert (found.values["places_done"], found.values["places_claimed"], found.values["settled_s"]) == (
        1,
        2,
        None,
    )
    assert found.robots["r1"] == {
        "places_total": 2, "places_done": 1, "places_claimed": 2, "places_given_up": 0, "completion_s": None
    }  # fmt: skip
    assert [(row["owner"], row["place"], row["verdict"]) for row in found.items] == [
        ("r1", 0, "done"), ("r1", 1, "mistaken"), ("r2", 0, "lost")
    ]  # fmt: skip
    say(referee, "r2", VisitReport("r2", 0, 30))
    settled = referee.outcome((), Instant(6_000_000))
    assert settled.notes == (
        "Every place was reported or given up by 0 s.",
        "2 places were reported although no robot had visited them.",
        "False reports ended the run.",
    )
    assert made(r1=()).outcome((), Instant(0)).summary == "had no places to clean"
    alone = made(r1=((0.0, 0.0),))
    alone.watch(Instant(0), at((0.0, 0.0)))
    say(alone, "r1", VisitReport("r1", 0, 10))
    assert alone.outcome((), Instant(0)).summary == "cleaned all 1 places in 0 s"
    unseen = Referee(JudgeSetup(robots=("r1",), items={"r1": ((0.0, 0.0),)}, has_truth=False))
    say(unseen, "r1", VisitReport("r1", 0, 10))
    assert unseen.outcome((), Instant(0)).summary == "reported 1 of 1 places as cleaned"
    assert [row["verdict"] for row in unseen.outcome((), Instant(0)).items] == ["claimed"]


def test_the_threshold_itself_is_outside() -> None:
    for x, near_by in ((0.5, []), (np.nextafter(0.5, 0.0), [[0, 0]])):
        assert find_visits(at((0.0, 0.0)), np.arange(1), at((x, 0.0)), 0.5).tolist() == near_by
    rng = np.random.default_rng(3)
    places, positions = rng.uniform(0, 5, (80, 2)), rng.uniform(0, 5, (9, 2))
    watched = np.flatnonzero(rng.random(80) < 0.7)
    near = ((places[watched][:, None] - positions[None]) ** 2).sum(axis=2) < 0.5**2
    twin = [[int(watched[row]), int(near[row].argmax())] for row in np.flatnonzero(near.any(axis=1))]
    assert len(twin) > 5
    assert find_visits(places, watched, positions, 0.5).tolist() == twin
