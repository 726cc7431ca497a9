"""What a behaviour must not ask for, in words that name step, entry, value and what would be right."""

from typing import Any

import numpy as np
import pytest

from actors.geometry import Point
from actors.messages import (
    Outgoing,
)
from actors.robot.behaviour.decision_limits import RobotLimits
from actors.robot.behaviour.entry import BehaviourError
from actors.robot.behaviour.ports import Decision
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from tests.robot.rig import Robot

WHERE = "step 4 (0.4 s): behaviour 'my.study:behaviour' of r1 "
ANY: Any = Decision
"""Takes arguments of wrong types, too."""
ANY_REASON: Any = None


@pytest.mark.parametrize(
    ("decision", "fault"),
    [
        ("go", "gives a str where a Decision is due"),
        (ANY(reports=(7,)), "gives 7 for a report; it should be a PlaceReport"),
        (ANY(frames=(b"x",)), "sends b'x'; it should be an Outgoing with bytes"),
        (
            ANY((1.0, 2.0, 3.0)),
            "gives (1.0, 2.0, 3.0) for a goal; it should be a Point of finite numbers or a GoalOrder",
        ),
        (
            ANY(Point(float("nan"), 2.0)),
            "gives Point(x=nan, y=2.0) for a goal; it should be a Point of finite numbers or a GoalOrder",
        ),
        (ANY(5), "gives 5 for a goal; it should be a Point of finite numbers or a GoalOrder"),
        (
            ANY(frames=(Outgoing(0, 400_000, bytes(119)),)),
            "sends a frame of 119 bytes; it should have at most 118",
        ),
        (
            ANY(frames=(Outgoing(-1, 400_000, b"x"),)),
            "sends a frame with the tag -1; it should be 0 to 9223372036854775807",
        ),
        (
            ANY(frames=(Outgoing(0, 500_000, b"x"),)),
            "sends a frame at 500000 µs; it should be sent from 400000 to 499999 µs",
        ),
        (
            ANY(frames=(Outgoing(0, 450_000, b"x"), Outgoing(1, 449_999, b"y"))),
            "sends a frame at 449999 µs; it should be sent from 450000 to 499999 µs",
        ),
        (ANY(frames=(Outgoing(0, 400000, b"x"),) * 4), "sends 4 frames in one step; at most 3 may be"),
        (ANY(reports=(PlaceReport("r1", 0, 400000),) * 3), "reports 3 places in one step; at most 2 may be"),
        (
            ANY(reports=(PlaceReport("r1", 0, 399_999),)),
            "reports a place at 399999 µs; it should be from 400000 to 499999 µs",
        ),
        (ANY(given_up=("all",)), "gives 'all' up; it should be a PlaceGivenUp with a reason in words"),
        (
            ANY(given_up=(PlaceGivenUp("r1", 0, 400_000, ANY_REASON),)),
            "gives PlaceGivenUp(owner='r1', place=0, instant=400000, reason=None) up; "
            "it should be a PlaceGivenUp with a reason in words",
        ),
        (
            ANY(given_up=(PlaceGivenUp("r1", 0, 400_000, ""),)),
            "gives a place up for a reason of 0 characters; it should have 1 to 100",
        ),
        (
            ANY(given_up=(PlaceGivenUp("r1", 0, 400_000, "x" * 101),)),
            "gives a place up for a reason of 101 characters; it should have 1 to 100",
        ),
        (
            ANY(given_up=(PlaceGivenUp("r1", 0, 500_000, "shut"),)),
            "gives a place up at 500000 µs; it should be from 400000 to 499999 µs",
        ),
        (
            ANY(given_up=(PlaceGivenUp("r1", 0, 400_000, "shut"),) * 3),
            "gives 3 places up in one step; at most 2 may be",
        ),
        (
            ANY(route=[PlaceKey("r1", 0)]),
            "gives [PlaceKey(owner='r1', place=0)] for a route; it should be a tuple of PlaceKey, or None",
        ),
        (ANY(route=(0,)), "has 0 in its route; it should be a PlaceKey"),
        (
            ANY(route=(PlaceKey("r2", 1), PlaceKey("r1", 1), PlaceKey("r2", 1))),
            "has place 1 of 'r2' twice in its route; each may be there once",
        ),
        (
            ANY(route=tuple(PlaceKey("r1", place) for place in range(5))),
            "has a route of 5 places; at most 4 may be",
        ),
        (ANY(paused="yes"), "gives 'yes' for paused; it should be True, False or None"),
        (ANY(back_out=0.0), "gives 0.0 for back_out; it should be above 0 and at most 3 m"),
        (ANY(back_out=3.1), "gives 3.1 for back_out; it should be above 0 and at most 3 m"),
        (ANY(back_out=True), "gives True for back_out; it should be above 0 and at most 3 m"),
        (ANY(relocalise="now"), "gives 'now' for relocalise; it should be True or False"),
        (
            ANY(peers=[Point(1.0, 2.0)]),
            "gives [Point(x=1.0, y=2.0)] for peers; it should be a tuple of Points, or None",
        ),
        (
            ANY(peers=(Point(1.0, np.nan),)),
            "has Point(x=1.0, y=nan) among its peers; it should be a Point of finite numbers",
        ),
        (ANY(peers=(Point(1.0, 2.0),) * 4), "gives 4 peers; at most 3 may be"),
    ],
)  # fmt: skip
def test_what_a_behaviour_must_not_ask_for_is_named(decision: object, fault: str) -> None:
    limits = RobotLimits(frames=3, reports=2, given_up=2, route=4, peers=3)
    robot = Robot(decision, first_step=4, limits=limits)
    with pytest.raises(BehaviourError) as caught:
        robot.take_step()
    assert str(caught.value) == WHERE + fault
