"""Parsing of changes of a branch, merging of orders, and successive behaviours."""

from dataclasses import replace
from pathlib import Path

import pytest

from actors.geometry import Point
from actors.installation.usage import OptionError
from actors.messages import CONTROL, Control
from actors.orders import Freeze, Kill, Pause, Resume, Thaw
from actors.robot.behaviour import handover
from actors.robot.behaviour.handover import BehaviourChange
from actors.robot.behaviour.loading import BehaviourError
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from cleaning.place import Assignment, Takeover
from cleaning.robot import CleaningRobot
from cleaning.strategies import entry
from deeco import Knowledge
from deploy.run import change
from deploy.run.change import TimedControl


def _control(step: int, *orders: object) -> TimedControl:
    return TimedControl(step, encode(Control(0, orders), CONTROL.key()))  # type: ignore[arg-type]


def _orders(given: TimedControl) -> tuple[object, ...]:
    told = decode(at(CONTROL).topic, CONTROL.key(), given.payload)
    assert isinstance(told, Control)
    return told.orders


def test_events_precede_recorded_orders_of_their_step() -> None:
    recorded = [_control(20, Pause()), _control(20, Resume()), _control(50, Thaw("r1"))]
    events = [change.parse_event("kill r2 at 2", 1.0), change.parse_event("freeze r1 at 3.95", 1.0)]
    given = change.merge_events(recorded, events, 100_000)
    assert [(one.step, _orders(one)) for one in given] == [
        (20, (Kill("r2"), Pause())),
        (20, (Resume(),)),
        (40, (Freeze("r1"),)),
        (50, (Thaw("r1"),)),
    ]


def test_an_event_without_instant_happens_at_the_branch() -> None:
    assert change.parse_event("kill r2", 7.5).at_s == 7.5


@pytest.mark.parametrize("text", ["", "at 5", "kill r2 at 1", "kill r2 at x", "dance r2", "pause", "speed 2"])
def test_invalid_events(text: str) -> None:
    with pytest.raises(OptionError, match="--event"):
        change.parse_event(text, 2.0)


@pytest.mark.parametrize("text", ["runs/seen", "@5", "runs/seen@", "runs/seen@0", "runs/seen@nan"])
def test_a_branch_point_is_a_run_and_a_positive_instant(text: str) -> None:
    assert change.parse_branch_point("runs/a@b@59.5") == (Path("runs/a@b"), 59.5)
    with pytest.raises(OptionError, match="branch: "):
        change.parse_branch_point(text)


def test_settings_after_a_name_may_contain_any_characters() -> None:
    turn = BehaviourChange(60.0, "c:d", {"reach": 0.5, "names": ("a>b@3", "{"), "on": True})
    text = handover.join("a:b", [turn, BehaviourChange(120.0, "e:f")])
    assert handover.split(text) == ("a:b", (turn, BehaviourChange(120.0, "e:f")))
    assert handover.names(text) == ("a:b", "c:d", "e:f")
    assert entry("none>chapter@5") == (
        "cleaning.strategies.none:behaviour>cleaning.strategies.chapter:behaviour@5.0"
    )


SETTINGS = "the text after c:d should be settings in JSON"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        *((text, SETTINGS) for text in ('a:b>c:d{"reach":}@5', 'a:b>c:d{"reach":null}@5', "a:b>c:d{@5")),
        *((f"a:b>{text}", "behaviour") for text in ("c:d", "@5", "c:d@x", "c:d@0", "c:d@5>e:f@5")),
    ],
)
def test_invalid_successions(text: str, fault: str) -> None:
    with pytest.raises(BehaviourError, match=fault):
        handover.split(text)


def test_a_handover_keeps_remaining_and_adopted_places() -> None:
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
    assert heir.inherits(Knowledge(id="r1")) is None
