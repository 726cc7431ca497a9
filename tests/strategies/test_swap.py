"""Swapping destinations by offer and answer: only if paths become shorter, without losing places."""

from dataclasses import replace
from functools import partial

from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import State
from cleaning.strategies.swap import OfferAcceptance, OfferConclusion, Offers, Swapper, SwappingRobot
from tests.cleaning.fakes import NOW, OPEN, FakeTaskMonitor, assignment, published, route

seen = partial(published, role=Swapper)
OFFERS, ACCEPTS, CONCLUDES, REMOVE = (
    Offers(1.5),
    OfferAcceptance(),
    OfferConclusion(),
    AdoptedDestinationRemove(False),
)


def robot(name: str, at: float, *xs: float) -> SwappingRobot:
    places = route(*xs, owner=name)
    return SwappingRobot(
        id=name, position=Point(at, 0.0), route=places, destination=places[0], state=State.BLOCKED
    )


def hears(member: SwappingRobot, peer: Swapper, now: Instant = NOW) -> SwappingRobot:
    if OFFERS.membership(peer, member):
        member = OFFERS.at_member(peer, member, OPEN, now)
    if ACCEPTS.membership(peer, member):
        member = ACCEPTS.at_member(peer, member, OPEN, now)
    if CONCLUDES.membership(peer, member):
        member = CONCLUDES.at_member(peer, member, now)
    if REMOVE.membership(peer, member):
        moved = REMOVE.at_member(peer, member, now)
        assert isinstance(moved, SwappingRobot)
        member = moved
    return member


R1, R2 = robot("r1", 0.0, 5.0), robot("r2", 1.0, -5.0)


def test_two_robots_head_on_swap_and_each_place_has_one_holder() -> None:
    r1 = hears(R1, seen(R2))
    assert r1.offer is not None and (r1.offer.to, r1.offer.number) == ("r2", 1) and r1.route == R1.route
    assert hears(R2, seen(R1)) == R2, "the robot with the lesser id offers"
    r2 = hears(R2, seen(r1))
    assert r2.destination == assignment(5.0, term=1) and len(r2.route) == 2
    r1 = hears(r1, seen(r2))
    assert r1.destination == assignment(-5.0, owner="r2", term=1) == r1.route[-1] and r1.offer is None
    r2 = hears(r2, seen(r1))
    assert r2.route == (assignment(5.0, term=1),) and r1.route == (assignment(-5.0, owner="r2", term=1),)


def test_no_swap_is_offered_that_lengthens_paths() -> None:
    away = robot("r1", 0.0, -5.0), robot("r2", 1.0, 5.0)
    assert hears(away[0], seen(away[1])) == away[0]


def test_a_lost_answer_loses_no_place() -> None:
    r1 = hears(R1, seen(R2))
    r2 = hears(R2, seen(r1))
    late = replace(r1, offer=None)  # the offer is no longer current when the answer arrives
    late = hears(late, seen(r2))
    assert late.route == () and {place.key for place in r2.route} == {R1.route[0].key, R2.route[0].key}


def test_an_offer_that_is_no_longer_worth_it_is_not_accepted() -> None:
    r1 = hears(R1, seen(R2))
    moved = replace(R2, position=Point(-4.6, 0.0)).set_destination(FakeTaskMonitor(), NOW)
    assert hears(moved, seen(r1)) == moved, "it has visited what r1 wants"
    turned = replace(robot("r2", 1.0, -5.0, 8.0), destination=route(-5.0, 8.0, owner="r2")[1])
    assert hears(turned, seen(r1)) == turned


def test_an_offer_stands_for_some_seconds_and_an_answer_counts_once() -> None:
    r1 = hears(R1, seen(R2))
    assert hears(r1, seen(R2), Instant(NOW + seconds(3))) == r1
    again = hears(r1, seen(R2), Instant(NOW + seconds(4)))
    assert again.offer == r1.offer and again.offered_at == NOW + seconds(4)
    r2 = hears(R2, seen(r1))
    assert hears(again, seen(r2)).destination == assignment(-5.0, owner="r2", term=1)
    assert hears(r2, seen(again)) == r2
