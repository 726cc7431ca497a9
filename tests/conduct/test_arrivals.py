"""Places that robots are given while the run goes on: who hears of them, and what becomes of them."""

import pytest
from msgspec.structs import replace

from actors.message_limits import OrderLimits
from actors.messages import SENSES, Senses
from actors.orders import Freeze, Give, Kill, Order, Restart, Thaw
from actors.runtime.codec import decode, encode
from actors.runtime.errors import AcrcError
from actors.task.referee import Verdict
from actors.task.words import PlaceKey, PlaceReport
from tests.conduct.theatre import Says, Theatre

HERE, THERE = (15.5, 12.5), (19.0, 12.5)


def told(senses: list[Senses]) -> dict[int, tuple[tuple[float, float], ...]]:
    """By step: the places that came with it."""
    return {one.step: one.places for one in senses if one.places}


def test_the_owner_hears_of_a_place_once_and_nobody_else_does() -> None:
    play = Theatre(2.0, [(0.55, Give("r1", (HERE, THERE))), (1.0, Give("r1", (HERE,)))]).run()
    assert told(play.acts["r1"].senses) == {6: (HERE, THERE), 10: (HERE,)}
    assert told(play.acts["r2"].senses) == {}
    mine = [place for place in play.places if place.owner == "r1"]
    assert [(one.place, one.x, one.given_at) for one in mine] == [
        (0, 15.0, 0), (1, 15.5, 600_000), (2, 19.0, 600_000), (3, 15.5, 1_000_000)
    ]  # fmt: skip
    assert [one.verdict for one in mine] == [Verdict.OPEN] * 4
    assert [one.owner for one in play.places] == ["r1"] * 4 + ["r2"]


def test_a_message_without_new_places_is_as_it_was_before_there_were_any() -> None:
    play = Theatre(0.5).run()
    senses = play.acts["r1"].senses[0]
    assert encode(senses)[1] == 0x98, "a list of eight fields"
    more = replace(senses, places=(HERE,))
    assert encode(more)[1] == 0x99 and decode(SENSES, "", encode(more)) == more  # type: ignore[arg-type]


def test_the_run_waits_for_places_to_come_and_for_them_to_be_done() -> None:
    play = Theatre(9.0, [(2.0, Give("r2", (HERE,)))])
    play.acts["r1"].says = {
        3: Says(reports=(PlaceReport("r1", 0, 300_000), PlaceReport("r2", 0, 300_000)), route=()),
        29: Says(reports=(PlaceReport("r2", 1, 2_900_000),)),
    }
    play.acts["r2"].says = {3: Says(route=())}
    play.run()
    assert play.core.step == 30
    left = {progress.instant: progress.places_left for progress in play.progress}
    assert (left[1_000_000], left[2_000_000], left[3_000_000]) == (0, 0, 1)
    assert play.places[-1].reported_at == 2_900_000


def test_a_place_counts_as_reached_from_when_it_came() -> None:
    """Robot r1 drives over it before, and away from it."""
    passed = Theatre(9.0, [(8.0, Give("r1", ((12.5, 13.0),)))], drive=lambda senses: (0.5, 0.0)).run()
    (place,) = [one for one in passed.places if one.place == 1]
    assert (place.reached_at, place.given_at) == (None, 8_000_000)
    before = Theatre(9.0, [(0.0, Give("r1", ((12.5, 13.0),)))], drive=lambda senses: (0.5, 0.0)).run()
    (place,) = [one for one in before.places if one.place == 1]
    assert place.reached_by == "r1"


def test_a_frozen_robot_hears_of_it_once_it_goes_on() -> None:
    play = Theatre(2.0, [(0.5, Freeze("r1")), (0.8, Give("r1", (HERE,))), (1.2, Thaw("r1"))]).run()
    assert told(play.acts["r1"].senses) == {12: (HERE,)}


def test_what_a_dead_robot_is_given_nobody_knows_of() -> None:
    play = Theatre(2.0, [(0.5, Kill("r1")), (0.8, Give("r1", (HERE,)))]).run()
    (place,) = [one for one in play.places if one.place == 1]
    assert (place.verdict, place.in_route_of) == (Verdict.LOST, ())


def test_a_robot_started_again_is_told_of_all_of_them_again() -> None:
    events: list[tuple[float, Order]] = [
        (0.5, Give("r2", (HERE,))),
        (1.0, Restart("r2")),
        (1.4, Give("r2", (THERE,))),
    ]
    play = Theatre(2.0, events)
    play.acts["r2"].says = {7: Says(route=())}
    play.run()
    assert told(play.acts["r2"].senses) == {5: (HERE,)}
    assert told(play.acts["r2.1"].senses) == {10: (HERE,), 14: (THERE,)}
    assert [one.in_route_of for one in play.places if one.owner == "r2"] == [("r2",)] * 3


def test_a_robot_may_report_and_keep_what_it_was_given() -> None:
    play = Theatre(2.0, [(0.5, Give("r1", (HERE,)))])
    play.acts["r2"].says = {8: Says(route=(PlaceKey("r1", 1),))}
    assert play.run().places[1].in_route_of == ("r1", "r2")


@pytest.mark.parametrize(
    ("order", "sentence"),
    [
        (Give("r1", ((-3.0, 12.0),)), "(-3, 12) is not on free floor, but a place must be"),
        (Give("r9", (HERE,)), "there is no robot 'r9' to give"),
        (Give("r1", ()), "r1 is given 0 places; it should be 1 to 1000"),
        (
            Give("r1", ((float("inf"), 0.0),)),
            "r1 cannot clean at (inf, 0); each should be a finite number, at most 1e+06 m",
        ),
    ],
)
def test_places_that_cannot_be_are_refused(order: Give, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        Theatre(1.0, [(0.5, order)]).run()
    assert str(caught.value) == f"the event at 0.5 s cannot happen: {sentence}"


def test_there_is_a_limit_that_fits_one_message() -> None:
    most = OrderLimits().places
    crowd = (HERE,) * most
    play = Theatre(1.0, [(0.2, Give("r1", crowd)), (0.5, Restart("r1"))]).run()
    assert told(play.acts["r1.1"].senses) == {5: crowd}
    with pytest.raises(AcrcError, match="it may be at most 1000"):
        Theatre(1.0, [(0.2, Give("r1", crowd)), (0.5, Give("r1", (HERE,)))]).run()
