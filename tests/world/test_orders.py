"""What carrying out the orders of one step boundary comes to, also where a pause parts them."""

from typing import cast

from actors.instant import Instant
from actors.messages import Jam, ProcessOrder
from actors.orders import Freeze, Kill, Pause, Restart, Resume, StartJam, Stop
from actors.robot_model import OdometryKind
from actors.task.task import Task
from actors.world.body import Bodies
from actors.world.orders import Effects, Orders
from actors.world.participants import BarrierStanding, Participants
from actors.world.world_setup import BodySetup, TimedOrder

NOWHERE = cast(Bodies, None)
"""No order here is one for the bodies."""
NOTHING = cast(Task, None)
"""Nor for the task."""
KIND: OdometryKind = "stage"


def orders(*events: TimedOrder) -> Orders:
    robots = tuple(BodySetup(name, "turtlebot2", None, KIND, (0.0, 0.0, 0.0), ()) for name in ("r1", "r2"))
    roster = Participants(robots)
    for member in roster.members:
        member.standing = BarrierStanding.STEPPING
    return Orders(events, roster, NOWHERE, NOTHING)


def test_events_that_are_due_come_to_what_the_world_has_to_send() -> None:
    early = TimedOrder(100, StartJam(1.0, 2.0, 3.0, 50))
    asked = orders(early, TimedOrder(200, Restart("r1")), TimedOrder(900, Stop()))
    effects = asked.due(Instant(200))
    assert effects == Effects((ProcessOrder("r1", 1),), ("r1",), (Jam(1.0, 2.0, 3.0, 250),))
    assert asked.pending
    assert asked.due(Instant(300)) == Effects()
    assert asked.due(Instant(900)) == Effects(stop=True) and not asked.pending


def test_a_process_that_is_killed_before_it_was_begun_is_not_begun() -> None:
    asked = orders()
    restarted, _ = asked.take([Restart("r1"), Pause()], asked.due(Instant(0)))
    assert restarted.paused and restarted.starts == (ProcessOrder("r1", 1),)
    killed, refusals = asked.take([Kill("r1"), Resume()], restarted)
    assert killed == Effects(ends=("r1",), steps=0) and refusals == ()


def test_an_order_that_makes_no_sense_comes_to_nothing_but_a_sentence() -> None:
    asked = orders()
    before = asked.due(Instant(0))
    effects, refusals = asked.take([Freeze("r9"), Kill("r2")], before)
    assert effects == Effects(ends=("r2",)) and before == Effects()
    assert refusals == asked.refused == ("at 0 s: there is no robot 'r9' to freeze",)
