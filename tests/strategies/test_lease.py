"""Leased doors: priority, waiting, timeouts, and robots without radio contact."""

from dataclasses import replace
from functools import partial

from acrc_testbed.testing import LoggedNavigation
from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.strategies.lease import DoorClearing, LeasingParameters, LeasingRobot, Lessee, RivalClaims
from tests.cleaning.fakes import DOORWAY, NOW, published, route

seen = partial(published, role=Lessee)
P = LeasingParameters()
RIVALS, CLEARED = RivalClaims(), DoorClearing(P.yield_distance)


def robot(name: str, at: float, *xs: float) -> LeasingRobot:
    places = route(*xs, owner=name)
    return LeasingRobot(id=name, position=Point(at, 0.0), route=places, destination=places[0])


def leasing(one: LeasingRobot, navigation: LoggedNavigation, after: float = 0.0) -> LeasingRobot:
    """Return the robot after its process, `after` seconds after NOW."""
    return one.lease(DOORWAY, navigation, Instant(NOW + seconds(after)))


def hears(member: LeasingRobot, peer: LeasingRobot, after: float = 0.0) -> LeasingRobot:
    told = seen(peer)
    if RIVALS.membership(told, member):
        member = RIVALS.at_member(told, member, Instant(NOW + seconds(after)))
    return member


def heading(navigation: LoggedNavigation, one: LeasingRobot) -> LoggedNavigation:
    assert one.target is not None
    navigation.go_to(one.target)
    navigation.commands.clear()
    return navigation


def test_it_requests_the_next_door_once_it_is_near() -> None:
    far, near = (
        leasing(robot("r1", -3.6, 5.0), LoggedNavigation()),
        leasing(robot("r1", -3.4, 5.0), LoggedNavigation()),
    )
    assert far.claim is None and near.claim is not None
    assert (near.claim.door, near.claim.into, near.claim.since, near.claim.inside) == (0, 2, NOW, False)
    assert leasing(robot("r1", -0.4, -5.0), LoggedNavigation()).claim is not None, "it is in the door"
    assert leasing(robot("r1", -2.0, -5.0), LoggedNavigation()).claim is None, "no door is on its path"


def test_the_later_request_waits_until_the_other_robot_has_passed() -> None:
    r1, r2 = leasing(robot("r1", -1.5, 5.0), LoggedNavigation()), robot("r2", 1.3, -5.0)
    navigation = heading(LoggedNavigation(), r2)
    r2 = leasing(hears(leasing(r2, navigation, 1.0), r1, 1.0), navigation, 1.5)
    assert r2.held_since is not None and navigation.commands == [("pause", None)] and not r2.is_blocked()
    assert leasing(hears(r1, r2, 1.5), LoggedNavigation(), 2.0).held_since is None
    through = leasing(replace(r1, position=Point(2.0, 1.0)), LoggedNavigation(), 5.0)
    assert through.claim is None
    r2 = leasing(hears(r2, through, 5.0), navigation, 5.5)
    assert r2.held_since is None and navigation.commands[1:] == [("resume", None)]

    r1 = leasing(robot("r1", -1.5, 5.0), LoggedNavigation())
    r2 = leasing(
        hears(leasing(robot("r2", -1.8, 6.0), LoggedNavigation(), 1.0), r1, 1.0), LoggedNavigation(), 1.5
    )
    assert r2.held_since is None, "robots in the same direction do not wait"


def test_order_of_requests() -> None:
    r1 = leasing(robot("r1", -1.5, 5.0), LoggedNavigation())
    r2 = leasing(robot("r2", 0.3, -5.0), LoggedNavigation(), 1.0)
    assert not hears(r1, r2, 1.0).has_lease() and hears(r2, r1, 1.0).has_lease()
    again = leasing(r1, LoggedNavigation(), 20.5)
    assert again.claim is not None and again.claim.since == NOW + seconds(20.5), "it has expired"
    r2 = hears(leasing(robot("r2", 1.3, -5.0), LoggedNavigation(), 1.0), r1, 1.0)
    assert leasing(r2, LoggedNavigation(), 5.5).held_since is None, "r1's claim is too old"


def test_after_the_timeout_it_chooses_another_place_or_enters() -> None:
    r1 = leasing(robot("r1", -1.5, 5.0), LoggedNavigation())
    for places, target in (((-5.0, 7.0), Point(7.0, 0.0)), ((-5.0,), Point(-5.0, 0.0))):
        r2 = robot("r2", 1.3, *places)
        navigation = heading(LoggedNavigation(), r2)
        r2 = leasing(hears(leasing(r2, navigation, 1.0), r1, 1.0), navigation, 1.5)
        r2 = leasing(hears(r2, r1, 9.0), navigation, 10.0)
        assert r2.held_since is None and r2.target == target
        assert leasing(hears(r2, r1, 10.0), navigation, 10.5).held_since is None


def test_without_radio_contact_both_enter_and_one_backs_out() -> None:
    """The wall blocks the radio."""
    navigation = (
        heading(LoggedNavigation(), robot("r1", -1.5, 5.0)),
        heading(LoggedNavigation(), robot("r2", 1.3, -5.0)),
    )
    r1, r2 = (
        leasing(robot("r1", -1.5, 5.0), navigation[0]),
        leasing(robot("r2", 1.3, -5.0), navigation[1], 0.3),
    )
    r1, r2 = replace(r1, position=Point(-0.45, 0.0)), replace(r2, position=Point(0.45, 0.0))
    r1, r2 = leasing(r1, navigation[0], 3.0), leasing(r2, navigation[1], 3.3)
    assert r1.has_lease() and r2.has_lease() and navigation[0].commands == navigation[1].commands == []
    assert r1.claim is not None and r2.claim is not None and r1.claim.inside and r2.claim.inside
    told = seen(r1), seen(r2)  # no wall between them in the door
    assert not CLEARED.membership(told[1], r1), "r1 requested first"
    assert CLEARED.membership(told[0], r2)
    r2 = CLEARED.at_member(told[0], r2, DOORWAY, Instant(NOW + seconds(4)))
    r2 = r2.give_way(navigation[1], Instant(NOW + seconds(4)))
    assert navigation[1].commands[-1] == ("back_out", P.back_out_of_door) and not navigation[0].commands
    assert leasing(r2, navigation[1], 4.5).claim is None, "it requests again after waiting"
    assert not CLEARED.membership(told[0], r2)
