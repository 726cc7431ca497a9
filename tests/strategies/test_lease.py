"""Doors on lease: who goes first, who waits and for how long, and what follows if neither hears the other."""

from dataclasses import replace
from functools import partial

from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.strategies.lease import DoorRivals, DoorsCleared, LeasingParameters, LeasingRobot, Lessee
from tests.cleaning.equipment import NOW, Floor, Ways, published, route

seen = partial(published, role=Lessee)
P = LeasingParameters()
DOOR = Floor(0.0)
"""A door from x = -0.5 to 0.5, region 1 west and region 2 east of it."""
RIVALS, CLEARED = DoorRivals(), DoorsCleared(P.yield_distance)


def robot(name: str, at: float, *xs: float) -> LeasingRobot:
    places = route(*xs, owner=name)
    return LeasingRobot(id=name, position=Point(at, 0.0), route=places, destination=places[0])


def leasing(one: LeasingRobot, ways: Ways, after: float = 0.0) -> LeasingRobot:
    """The robot after its process, so many seconds after NOW."""
    return one.lease(DOOR, ways, Instant(NOW + seconds(after)))


def hears(member: LeasingRobot, peer: LeasingRobot, after: float = 0.0) -> LeasingRobot:
    told = seen(peer)
    if RIVALS.membership(told, member):
        member = RIVALS.at_member(told, member, Instant(NOW + seconds(after)))
    return member


def heading(ways: Ways, one: LeasingRobot) -> Ways:
    assert one.target is not None
    ways.go_to(one.target)
    ways.orders.clear()
    return ways


def test_it_asks_for_the_next_door_once_it_is_near() -> None:
    far, near = leasing(robot("r1", -3.1, 5.0), Ways()), leasing(robot("r1", -2.9, 5.0), Ways())
    assert far.claim is None and near.claim is not None
    assert (near.claim.door, near.claim.into, near.claim.since, near.claim.inside) == (0, 2, NOW, False)
    assert leasing(robot("r1", -0.4, -5.0), Ways()).claim is not None, "it is in the door"
    assert leasing(robot("r1", -2.0, -5.0), Ways()).claim is None, "no door is on its way"


def test_who_asked_later_waits_and_goes_on_once_the_other_one_is_through() -> None:
    r1, r2 = leasing(robot("r1", -1.5, 5.0), Ways()), robot("r2", 1.5, -5.0)
    ways = heading(Ways(), r2)
    r2 = leasing(hears(leasing(r2, ways, 1.0), r1, 1.0), ways, 1.5)
    assert r2.held_since is not None and ways.orders == [None] and not r2.is_blocked()
    assert leasing(hears(r1, r2, 1.5), Ways(), 2.0).held_since is None
    through = leasing(replace(r1, position=Point(2.0, 1.0)), Ways(), 5.0)
    assert through.claim is None
    r2 = leasing(hears(r2, through, 5.0), ways, 5.5)
    assert r2.held_since is None and ways.orders == [None, r2.target]

    r1 = leasing(robot("r1", -1.5, 5.0), Ways())
    r2 = leasing(hears(leasing(robot("r2", -1.8, 6.0), Ways(), 1.0), r1, 1.0), Ways(), 1.5)
    assert r2.held_since is None, "in the same direction nobody waits"


def test_order_of_requests() -> None:
    r1 = leasing(robot("r1", -1.5, 5.0), Ways())
    r2 = leasing(robot("r2", 0.3, -5.0), Ways(), 1.0)
    assert not hears(r1, r2, 1.0).comes_first() and hears(r2, r1, 1.0).comes_first()
    again = leasing(r1, Ways(), 20.5)
    assert again.claim is not None and again.claim.since == NOW + seconds(20.5), "it has expired"
    r2 = hears(leasing(robot("r2", 1.5, -5.0), Ways(), 1.0), r1, 1.0)
    assert leasing(r2, Ways(), 5.5).held_since is None, "r1 has not been heard of for long"


def test_who_has_waited_for_long_turns_to_where_no_door_is_or_goes_in() -> None:
    r1 = leasing(robot("r1", -1.5, 5.0), Ways())
    for places, target in (((-5.0, 7.0), Point(7.0, 0.0)), ((-5.0,), Point(-5.0, 0.0))):
        r2 = robot("r2", 1.5, *places)
        ways = heading(Ways(), r2)
        r2 = leasing(hears(leasing(r2, ways, 1.0), r1, 1.0), ways, 1.5)
        r2 = leasing(hears(r2, r1, 9.0), ways, 10.0)
        assert r2.held_since is None and r2.target == target
        assert leasing(hears(r2, r1, 10.0), ways, 10.5).held_since is None


def test_both_hold_the_door_while_the_wall_is_between_them_and_one_backs_out_once_they_meet() -> None:
    """Neither hears the other: the radio does not go through the wall."""
    ways = heading(Ways(), robot("r1", -1.5, 5.0)), heading(Ways(), robot("r2", 1.5, -5.0))
    r1, r2 = leasing(robot("r1", -1.5, 5.0), ways[0]), leasing(robot("r2", 1.5, -5.0), ways[1], 0.3)
    r1, r2 = replace(r1, position=Point(-0.45, 0.0)), replace(r2, position=Point(0.45, 0.0))
    r1, r2 = leasing(r1, ways[0], 3.0), leasing(r2, ways[1], 3.3)
    assert r1.comes_first() and r2.comes_first() and ways[0].orders == ways[1].orders == []
    assert r1.claim is not None and r2.claim is not None and r1.claim.inside and r2.claim.inside
    told = seen(r1), seen(r2)  # in the door there is no wall
    assert not CLEARED.membership(told[1], r1), "r1 asked first"
    assert CLEARED.membership(told[0], r2)
    r2 = CLEARED.at_member(told[0], r2, DOOR, Instant(NOW + seconds(4)))
    r2 = r2.give_way(ways[1], Instant(NOW + seconds(4)))
    assert ways[1].backed == [P.back_out_of_door] and ways[0].backed == []
    assert leasing(r2, ways[1], 4.5).claim is None, "it asks anew once it has waited"
    assert not CLEARED.membership(told[0], r2)
