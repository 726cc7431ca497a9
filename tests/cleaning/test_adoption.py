"""Stories of two robots and their ensembles; among them the defects of the released code, mended."""

from dataclasses import replace

import pytest

from actors.geometry import Point
from actors.instant import Instant, seconds
from actors.task.task import PlaceKey
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption, MakingWay
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters, ReleasedParameters
from cleaning.place import Takeover
from deeco.knowledge import seen_as
from tests.cleaning.equipment import NOW, SOMEWHERE, Floor, Notes, adaptive, assignment, route

P = AdaptationParameters()
ADOPTION = DestinationAdoption(P.adoption_distance, P.adoption_checks, P.adoption_backoff)
REMOVE = AdoptedDestinationRemove(exchange=True)
RELEASED = AdoptedDestinationRemove(exchange=ReleasedParameters().exchange)


def blocked(robot: str, at: float, *xs: float) -> AdaptiveCleaningRobot:
    return replace(adaptive(robot, at, *xs), state=State.BLOCKED, blocked_for=1)


def seen(robot: AdaptiveCleaningRobot) -> Cleaner:
    """What it publishes."""
    role = seen_as(robot, Cleaner)
    assert isinstance(role, Cleaner)
    return role


def adopts(member: AdaptiveCleaningRobot, peer: Cleaner, now: Instant = NOW) -> AdaptiveCleaningRobot:
    """The member after an evaluation of the first ensemble with this peer."""
    return ADOPTION.at_member(peer, member, now) if ADOPTION.membership(peer, seen(member)) else member


def removes(
    member: AdaptiveCleaningRobot, peer: Cleaner, ensemble: AdoptedDestinationRemove = REMOVE
) -> AdaptiveCleaningRobot:
    """The member after an evaluation of the second ensemble with this peer."""
    return ensemble.at_member(peer, member, NOW) if ensemble.membership(peer, member) else member


R1, R2 = blocked("r1", 0.0, 5.0, 6.0), blocked("r2", 1.0, -5.0, -6.0)


def test_two_blocked_robots_exchange_their_destinations() -> None:
    r1, r2 = adopts(R1, seen(R2)), adopts(R2, seen(R1))
    assert r1.destination == assignment(-5.0, owner="r2", term=1) == r1.route[-1]
    assert r2.destination == assignment(5.0, owner="r1", term=1) == r2.route[-1]
    assert r1.adopted == (Takeover("r2", 0, 1),) and r1.former == assignment(5.0)
    r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    assert (
        r1.route == (assignment(6.0, 1), assignment(-5.0, owner="r2", term=1))
        and r1.destination == r1.route[-1]
    )
    assert r2.route == (assignment(-6.0, 1, "r2"), assignment(5.0, term=1)) and r2.destination == r2.route[-1]


@pytest.mark.parametrize(
    ("far", "state"), [(1.499, State.FREE), (1.501, State.BLOCKED), (1.499, State.BLOCKED)]
)
def test_both_must_be_blocked_and_near(far: float, state: State) -> None:
    peer = replace(seen(R2), position=Point(far, 0.0), state=state)
    expected = state is State.BLOCKED and far < 1.5
    assert ADOPTION.membership(peer, seen(R1)) is ADOPTION.membership(seen(R1), peer) is expected


def test_who_has_been_blocked_for_no_whole_second_does_not_adopt() -> None:
    assert adopts(replace(R1, blocked_for=0), seen(R2)).destination == R1.destination


def test_it_adopts_once_in_ten_seconds() -> None:
    r1 = adopts(R1, seen(R2))
    again = replace(r1, state=State.BLOCKED, blocked_for=1)
    other = seen(replace(R2, destination=assignment(-6.0, 1, "r2")))
    assert adopts(again, other, Instant(NOW + seconds(9.9))) == again
    assert adopts(again, other, Instant(NOW + seconds(10))).destination == assignment(-6.0, 1, "r2", 1)


def test_after_adopting_it_is_free_until_the_outcome_is_seen() -> None:
    r1 = adopts(replace(R1, still_for=9, blocked_for=4), seen(R2))
    assert (r1.state, r1.blocked_for, r1.still_for) == (State.FREE, 0, 0)
    code = replace(R1, parameters=ReleasedParameters(), still_for=9, blocked_for=4)
    r1 = adopts(code, seen(R2))
    assert (r1.state, r1.blocked_for, r1.still_for) == (State.BLOCKED, 0, 9)


# --- whoever comes second ----------------------------------------------------------------------------------


def test_who_is_late_gets_the_others_destination_in_exchange_all_the_same() -> None:
    r1 = adopts(R1, seen(R2))
    r2 = adopts(R2, seen(r1))
    assert r2 == R2, "r1 shows r2's own destination by now, and is not blocked any more"
    r2 = removes(r2, seen(r1))
    assert r2.destination == assignment(5.0, term=1) and r2.former is None
    assert r2.route == (assignment(-6.0, 1, "r2"), assignment(5.0, term=1))
    assert removes(r1, seen(r2)).route == (assignment(6.0, 1), assignment(-5.0, owner="r2", term=1))


def test_what_the_other_left_is_taken_from_nobody_else() -> None:
    r1 = adopts(R1, seen(R2))
    third = replace(
        adaptive("r3", 0.0), route=route(-5.0, owner="r2"), destination=assignment(3.0, owner="r3")
    )
    third = replace(third, route=(*third.route, assignment(3.0, owner="r3")))
    assert removes(third, seen(r1)).route == (assignment(3.0, owner="r3"),)
    elsewhere = replace(seen(r1), destination=assignment(6.0, 1))
    assert removes(R2, elsewhere).destination == assignment(-6.0, 1, "r2")


def test_who_is_done_makes_way_for_who_is_blocked_near_by() -> None:
    ensemble, idle = MakingWay(1.5), adaptive("r2", 1.0)
    assert ensemble.membership(seen(R1), idle)
    assert ensemble.at_member(seen(R1), idle, Floor()).waypoint == SOMEWHERE
    for peer, member in (
        (replace(seen(R1), state=State.FREE), idle),
        (replace(seen(R1), position=Point(-0.6, 0.0)), idle),
        (seen(R1), R2),
        (seen(R1), idle.sent_to(SOMEWHERE)),
    ):
        assert not ensemble.membership(peer, member)


# --- defects of the released code --------------------------------------------------------------------------


def test_a_place_that_goes_there_and_back_is_not_lost() -> None:
    """There, what was adopted once takes a place off everybody's route for ever, its adopter's too."""
    r1, r2 = adopts(R1, seen(R2)), adopts(R2, seen(R1))
    r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    r1 = replace(r1, state=State.BLOCKED, blocked_for=1, adopted_at=None)
    r1 = adopts(r1, replace(seen(r2), state=State.BLOCKED))
    assert r1.destination == assignment(5.0, term=2), "r1 takes back what was its own"
    r2 = removes(r2, seen(r1))
    for _ in range(3):
        r1, r2 = removes(r1, seen(r2)), removes(r2, seen(r1))
    assert r1.holds(PlaceKey("r1", 0)) and not r2.holds(PlaceKey("r1", 0))


def test_no_goal_and_its_own_goal_are_not_adopted() -> None:
    for destination in (None, R1.destination, replace(R1.route[1], term=5)):
        assert adopts(R1, replace(seen(R2), destination=destination)) == R1


def test_what_it_has_cleaned_or_given_up_itself_is_not_adopted() -> None:
    notes = Notes()
    r1 = replace(R1, position=Point(5.0, 0.0)).set_destination(notes, NOW)
    r1 = replace(r1, position=Point(0.0, 0.0))
    assert adopts(r1, replace(seen(R2), destination=assignment(5.0, term=1))) == r1
    gone = R1.given_up(R1.route[0], "the door is shut", notes, NOW)
    gone = replace(gone, state=State.BLOCKED, blocked_for=1)
    assert adopts(gone, replace(seen(R2), destination=assignment(5.0, term=1))) == gone


def test_the_later_word_counts_and_of_two_the_greater_id() -> None:
    r3 = replace(seen(adaptive("r3", 0.0)), adopted=(Takeover("r1", 0, 2),))
    mine = {term: replace(R2, route=(assignment(5.0, term=term),), destination=None) for term in (1, 2, 3)}
    assert [bool(mine[term].taken_by(r3)) for term in (1, 2, 3)] == [True, True, False]
    other = replace(mine[2], id="r4")
    assert not other.taken_by(r3)


def test_a_term_that_nobody_can_come_to_is_not_adopted_and_breaks_nothing() -> None:
    """From the air: one more than the greatest number of 64 bits has no form to be published in."""
    r1 = seen(R2)
    for term in (2**63 - 1, 2**64 - 1):
        assert adopts(R1, replace(r1, destination=assignment(-5.0, owner="r2", term=term))) == R1
    taken = adopts(R1, replace(r1, destination=assignment(-5.0, owner="r2", term=2**63 - 2)))
    assert taken.destination is not None and taken.destination.term == 2**63 - 1
