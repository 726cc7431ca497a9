"""What robots say about places: when it ends the run, and what the world makes of it."""

import pytest

from actors.orders import Freeze, Kill, Obstacle, Restart
from actors.runtime.errors import AcrcError
from actors.task.referee import Verdict
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from tests.conduct.theatre import Says, Theatre

R1, R2 = PlaceKey("r1", 0), PlaceKey("r2", 0)


def reported(key: PlaceKey, instant: int = 700_000) -> Says:
    return Says(reports=(PlaceReport(key.owner, key.place, instant),))


def given_up(key: PlaceKey, instant: int = 700_000) -> Says:
    return Says(given_up=(PlaceGivenUp(key.owner, key.place, instant, "the door is shut"),))


def test_the_run_ends_when_every_place_is_reported_or_given_up() -> None:
    play = Theatre(60.0)
    play.acts["r1"].says = {3: reported(R1, 300_000), 7: given_up(R2)}  # whoever it belongs to
    play.run()
    assert play.core.step == 8 and play.progress[-1].finished
    assert [place.verdict for place in play.places] == [Verdict.MISTAKEN, Verdict.GIVEN_UP]
    assert (play.places[1].given_up_by, play.places[1].reason) == ("r1", "the door is shut")


def test_robots_that_want_nowhere_any_more_do_not_end_the_run() -> None:
    play = Theatre(2.0)
    for act in play.acts.values():
        act.says = {3: Says(route=())}
    assert play.run().core.step == 20
    assert [place.verdict for place in play.places] == [Verdict.LOST] * 2
    assert [play.progress[0].places_left, play.progress[-1].places_left] == [0, 0]


def test_without_any_place_the_run_goes_to_its_limit() -> None:
    play = Theatre(1.0, places=())
    assert play.run().core.step == 10
    assert play.places == ()


def test_the_run_goes_on_while_events_lie_ahead() -> None:
    play = Theatre(5.0, [(2.0, Obstacle(25.0, 12.0, 0.2))])
    play.acts["r1"].says = {
        3: Says(given_up=(*given_up(R1, 399_999).given_up, *given_up(R2, 300_000).given_up))
    }
    assert play.run().core.step == 20


def test_the_run_goes_on_until_a_robot_that_is_started_again_has_come() -> None:
    play = Theatre(5.0, [(0.4, Restart("r2"))])
    play.acts["r1"].says = {
        3: Says(given_up=(*given_up(R1, 399_999).given_up, *given_up(R2, 300_000).given_up))
    }
    assert play.run().core.step == 5 and "r2.1" in play.acts


def test_a_frozen_robot_keeps_its_places_and_a_killed_one_loses_them() -> None:
    play = Theatre(2.0, [(1.0, Freeze("r1")), (1.0, Kill("r2"))]).run()
    r1, r2 = play.places
    assert (r1.in_route_of, r1.verdict) == (("r1",), Verdict.OPEN)
    assert (r2.in_route_of, r2.verdict, r2.lost) == ((), Verdict.LOST, True)
    assert play.progress[0].places_left == 2 and play.progress[-1].places_left == 1


def test_who_takes_a_place_over_keeps_it_from_being_lost() -> None:
    play = Theatre(2.0, [(1.0, Kill("r2"))])
    play.acts["r1"].says = {5: Says(route=(R2, R1))}
    assert [place.in_route_of for place in play.run().places] == [("r1",), ("r1",)]


def test_a_robot_started_again_has_the_places_that_it_was_given() -> None:
    play = Theatre(2.0, [(1.0, Restart("r2"))])
    play.acts["r2"].says = {5: Says(route=())}
    assert play.run().places[1].in_route_of == ("r2",)


@pytest.mark.parametrize(
    ("says", "sentence"),
    [
        (reported(PlaceKey("r2", 1)), "step 7 (0.7 s): r1 reports place 1 of 'r2', which nobody was given"),
        (given_up(PlaceKey("r9", 0)), "step 7 (0.7 s): r1 gives up place 0 of 'r9', which nobody was given"),
        (
            Says(route=(R1, PlaceKey("r1", -1))),
            "step 7 (0.7 s): r1 has in its route place -1 of 'r1', which nobody was given",
        ),
    ],
)
def test_a_place_that_nobody_was_given_ends_the_run(says: Says, sentence: str) -> None:
    play = Theatre(2.0)
    play.acts["r1"].says = {7: says}
    with pytest.raises(AcrcError) as caught:
        play.run()
    assert str(caught.value) == sentence
