"""A strategy can reorder the queue, pause the robot, send it anywhere, hand a place over, and give one up."""

from dataclasses import replace

from actors.geometry import Point
from actors.instant import START, Instant, seconds
from actors.randomness import generator
from actors.task.words import PlaceKey
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner, State
from deeco.knowledge import seen_as
from examples.courteous import CourteousRobot, GivingWay, HandOver, Offering
from tests.cleaning.equipment import NOW, SOMEWHERE, Floor, Notes, Ways, assignment, route


def robot(name: str, at: float, *xs: float) -> CourteousRobot:
    mine = route(*xs, owner=name)
    return CourteousRobot(id=name, position=Point(at, 0.0), route=mine, destination=mine[0] if mine else None)


def test_it_reorders_the_queue() -> None:
    r1 = robot("r1", 0.0, 9.0, 2.0, -1.0).reorder()
    assert [one.index for one in r1.route] == [2, 1, 0]
    assert r1.offered == assignment(9.0) and r1.destination == assignment(9.0)
    assert robot("r1", 0.0, 9.0).reorder().offered is None


def test_it_pauses_the_robot_and_lets_it_go_on() -> None:
    ways, notes = Ways(), Notes()
    r1 = robot("r1", 0.0, 5.0).drive(ways, notes, NOW)
    r1 = replace(r1, waits_until=Instant(NOW + seconds(2)))
    for later in (0, 1):
        r1 = r1.wait(ways, Instant(NOW + seconds(later))).drive(ways, notes, NOW)
    assert ways.orders == [Point(5.0, 0.0), None, None] and ways.goal is None
    r1.wait(ways, Instant(NOW + seconds(2))).drive(ways, notes, NOW)
    assert ways.orders[-1] == Point(5.0, 0.0)


def test_who_is_in_the_way_stands_or_is_sent_anywhere() -> None:
    r1, r2 = (replace(robot(name, 0.0, 5.0), state=State.BLOCKED) for name in ("r1", "r2"))
    ensemble, chance = GivingWay(1.5), generator(1, "behaviour", "r1", 0)
    assert ensemble.membership(seen_as(r2, Cleaner), r1)  # type: ignore[arg-type]  # it is a Cleaner
    made = [ensemble.at_member(r2, r1, Floor(), chance, NOW) for _ in range(20)]
    assert {(one.waypoint, one.waits_until) for one in made} == {
        (SOMEWHERE, None),
        (None, NOW + seconds(3)),
    }
    ways = Ways()
    next(one for one in made if one.waypoint).drive(ways, Notes(), NOW)
    assert ways.orders == [SOMEWHERE]


def test_it_hands_a_place_over_to_who_has_none() -> None:
    r1, r2 = robot("r1", 0.0, 9.0, 2.0).reorder(), robot("r2", 30.0)
    hand_over, remove = HandOver(), AdoptedDestinationRemove(exchange=False)
    offering = seen_as(r1, Offering)
    assert isinstance(offering, Offering) and hand_over.membership(offering, r2)
    r2 = hand_over.at_member(offering, r2, NOW)
    assert r2.destination == assignment(9.0, term=1) and r1.holds(PlaceKey("r1", 0))
    assert not hand_over.membership(offering, r2), "it has one now"
    heard = seen_as(r2, Offering)
    assert isinstance(heard, Offering) and remove.membership(heard, r1)
    left = remove.at_member(heard, r1, NOW)
    assert not left.holds(PlaceKey("r1", 0)) and left.destination == assignment(2.0, 1)


def test_it_gives_up_what_is_left_at_closing_time() -> None:
    notes = Notes()
    r1 = robot("r1", 0.0, 5.0, 9.0)
    assert r1.close(notes, Instant(START + seconds(579))) == r1
    r1 = r1.close(notes, Instant(START + seconds(580)))
    assert notes.gone == [(PlaceKey("r1", index), "it was closing time") for index in (0, 1)]
    assert (r1.route, r1.destination) == ((), None)
