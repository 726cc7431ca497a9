"""Behaviours that follow one another: how they are named, and what the second finds."""

from dataclasses import replace

import pytest

from actors.geometry import Point
from actors.robot.behaviour import succession
from actors.robot.behaviour.entry import BehaviourError
from actors.robot.behaviour.succession import Turn
from cleaning.place import Assignment, Takeover
from cleaning.robot import CleaningRobot
from cleaning.strategies import entry
from deeco import Knowledge


def test_names_are_taken_apart_and_put_together() -> None:
    text = "a:b>c:d@60.0>e:f@120.5"
    assert succession.split(text) == ("a:b", (Turn(60.0, "c:d"), Turn(120.5, "e:f")))
    assert succession.joined(*succession.split(text)) == text


def test_settings_stand_behind_a_name_whatever_characters_are_in_them() -> None:
    turn = Turn(60.0, "c:d", {"reach": 0.5, "names": ("a>b@3", "{"), "on": True})
    text = succession.joined("a:b", [turn, Turn(120.0, "e:f")])
    assert succession.split(text) == ("a:b", (turn, Turn(120.0, "e:f")))
    assert succession.names(text) == ("a:b", "c:d", "e:f")


@pytest.mark.parametrize("text", ['a:b>c:d{"reach":}@5', 'a:b>c:d{"reach":null}@5', "a:b>c:d{@5"])
def test_settings_that_are_none(text: str) -> None:
    with pytest.raises(BehaviourError, match="what stands behind c:d should be its settings in JSON"):
        succession.split(text)


@pytest.mark.parametrize("text", ["a:b>c:d", "a:b>@5", "a:b>c:d@x", "a:b>c:d@0", "a:b>c:d@5>e:f@5"])
def test_what_follows_needs_a_later_instant(text: str) -> None:
    with pytest.raises(BehaviourError, match="behaviour"):
        succession.split(text)


def test_strategies_that_follow_one_another_have_their_entries() -> None:
    assert entry("none>chapter@5") == (
        "cleaning.strategies.none:behaviour>cleaning.strategies.chapter:behaviour@5.0"
    )


def test_a_cleaning_robot_keeps_what_is_left_in_its_own_order_and_what_it_has_taken_over() -> None:
    a, b, c = (Assignment("r1", index, Point(index, 0.0)) for index in range(3))
    taken = Assignment("r2", 0, Point(9.0, 9.0), 1)
    here = Point(5.0, 5.0)
    former = CleaningRobot(
        id="r1", position=here, route=(a, taken, b), destination=taken, settled=(c.takeover,),
        adopted=(taken.takeover,), waypoint=Point(1.0, 1.0),
    )  # fmt: skip
    heir = CleaningRobot(id="r1", position=Point(0.0, 0.0), route=(c, b, a)).inherits(former)
    assert heir is not None
    assert heir.route == (b, a, taken)
    assert (heir.position, heir.destination, heir.waypoint) == (here, taken, None)
    assert (heir.settled, heir.adopted) == ((Takeover("r1", 2, 0),), (taken.takeover,))
    assert heir.attempt == former.attempt + 1
    without = replace(former, waypoint=None)
    assert replace(heir, attempt=0).inherits(without) == replace(heir, attempt=0, route=(b, a, taken))


def test_it_makes_nothing_of_something_else() -> None:
    robot = CleaningRobot(id="r1", position=Point(0.0, 0.0))
    assert robot.inherits(Knowledge(id="r1")) is None
