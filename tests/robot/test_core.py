"""The robot's core: inputs, outputs, and rejected messages."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from actors.geometry import CERTAIN, Point, Pose
from actors.instant import Instant
from actors.items import ItemGivenUp, ItemKey
from actors.messages import (
    DRIVE,
    FRAME_DATA_LIMIT,
    RECEIVED,
    SENSES,
    TRANSMIT,
    Drive,
    FrameReceived,
    FrameSent,
    Odometry,
    OutgoingFrame,
    RadioEvents,
    Scan,
    SensorData,
    Transmit,
)
from actors.robot.behaviour.decisions import RobotLimits
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.ports import Decision, Goal, GoalOrder, GoalPhase, GoalStatus, View
from actors.robot.sweep import OdometryBuffer
from actors.runtime.core import Output, at, to
from actors.topic import Message
from cleaning.place import VisitReport
from tests.refusals import refused
from tests.robot.base import model
from tests.robot.rig import HEARD, START, Robot, ScriptedBehaviour, refusal


def test_received_is_awaited_only_if_senses_counts_events() -> None:
    robot = Robot()
    assert robot.core.listens() == (at(SENSES, "r1"), at(RECEIVED, "r1"))
    assert robot.core.missing({}) == (at(SENSES, "r1"),)
    quiet, busy = robot.base.senses(0), robot.base.senses(0, events=2)
    assert robot.core.missing({"swarm/down/r1/senses": quiet}) == ()
    assert robot.core.missing({"swarm/down/r1/senses": busy}) == (at(RECEIVED, "r1"),)
    both = {"swarm/down/r1/senses": busy, "swarm/down/r1/received": RadioEvents(0, (HEARD, HEARD))}
    assert robot.core.missing(both) == ()


def test_a_step_without_frames_outputs_one_drive() -> None:
    robot = Robot()
    assert robot.take_step() == (to(DRIVE, Drive(0, 0.0, 0.0, 0.0, 0, pose=START), "r1"),)
    assert robot.core.step == 1 and not robot.core.finished


def test_frames_precede_drive_which_counts_them_and_carries_reports() -> None:
    frames = (OutgoingFrame(5, 0, b"a"), OutgoingFrame(6, 99_999, bytes(FRAME_DATA_LIMIT)))
    reports = (VisitReport("r1", 4, 50_000),)
    given_up = (ItemGivenUp("r1", 3, 60_000, "door shut"),)
    route = (ItemKey("r2", 7), ItemKey("r1", 0))
    robot = Robot(Decision(frames=frames, reports=reports, given_up=given_up, route=route))
    assert robot.take_step() == (
        to(TRANSMIT, Transmit(0, frames), "r1"),
        to(DRIVE, Drive(0, 0.0, 0.0, 0.0, 2, reports, given_up, route, START), "r1"),
    )


def test_view_has_pose_motion_goal_and_radio_and_goal_moves_the_robot() -> None:
    goal = Point(3.0, 1.0)
    robot = Robot(Decision(goal))
    robot.take_step(HEARD, FrameSent(95, 1))
    robot.behaviour.decision = Decision()
    for _ in range(120):
        robot.take_step()
    views = robot.behaviour.views
    first, until = views[0]
    assert first == View(Instant(0), START, False, None, (HEARD, FrameSent(95, 1)), CERTAIN, 0.0)
    assert until == 100_000
    assert views[1][0].goal == Goal(goal, GoalStatus.ACTIVE, None, GoalPhase.CONTROLLING, Instant(100_000))
    assert views[1][0].radio == () and views[1][0].instant == 100_000
    assert any(view.moving for view, _ in views)
    last = views[-1][0]
    assert last.goal == Goal(goal, GoalStatus.SUCCEEDED) and not last.moving
    assert last.pose.point.distance_to(goal) <= 0.15
    assert last.pose == pytest.approx(robot.base.pose, abs=1e-9)


@pytest.mark.parametrize("events", [(), (HEARD,)])
def test_halt_has_no_answer(events: tuple[FrameReceived, ...]) -> None:
    robot = Robot()
    senses = SensorData(0, 0, len(events), Odometry(0, 0, 0, 0, 0, 0), 0, None, halt=True)
    inputs: dict[str, Message] = {"swarm/down/r1/senses": senses}
    assert robot.core.missing(inputs) == ((at(RECEIVED, "r1"),) if events else ())
    inputs["swarm/down/r1/received"] = RadioEvents(0, events)
    assert robot.core.advance(inputs) == ()
    assert robot.core.finished and robot.behaviour.views == []


def test_messages_of_another_step_or_sensor_are_rejected() -> None:
    robot = Robot(first_step=7)
    assert refusal(robot, senses=robot.base.senses(6)) == (
        "step 7: r1 received SensorData of step 6; it should be of step 7 or later"
    )
    assert refusal(robot, senses=robot.base.senses(7, 1), received=RadioEvents(8, (HEARD,))) == (
        "step 7: r1 received RadioEvents of step 8; it should be of step 7 or earlier"
    )
    assert refusal(robot, senses=robot.base.senses(7, 1), received=RadioEvents(7, (HEARD, HEARD))) == (
        "step 7: r1 received 2 radio events; SensorData counts 1"
    )
    scan = Scan(0, b"\0" * 7)
    assert refusal(robot, senses=replace(robot.base.senses(7), scan=scan)).startswith(
        "received a scan of 7 bytes"
    )


def test_a_frozen_robot_continues_with_the_worlds_step() -> None:
    robot = Robot()
    robot.take_step()
    inputs = {
        "swarm/down/r1/senses": robot.base.senses(41, 1),
        "swarm/down/r1/received": RadioEvents(3, (HEARD,)),
    }
    (drive,) = robot.core.advance(inputs)
    assert drive.message.step == 41 and robot.core.step == 42
    assert robot.behaviour.views[-1][0].instant == 4_100_000
    assert robot.behaviour.views[-1][0].radio == (HEARD,)


def test_pausing_and_peers_reach_navigation_and_localisation() -> None:
    robot = Robot(Decision(Point(3.0, 1.0), paused=True, peers=(Point(2.0, 2.0),)))
    robot.take_step()
    assert robot.localisation.masked == (Point(2.0, 2.0),)
    robot.behaviour.decision = Decision()
    for _ in range(10):
        robot.take_step()
    goal = robot.behaviour.views[-1][0].goal
    assert goal is not None and goal.phase is GoalPhase.PAUSED and robot.base.pose == START
    robot.behaviour.decision = Decision(paused=False, peers=())
    for _ in range(10):
        robot.take_step()
    goal = robot.behaviour.views[-1][0].goal
    assert goal is not None and goal.phase is GoalPhase.CONTROLLING and robot.base.pose.x > START.x
    assert not robot.localisation.masked


def test_backing_out_and_relocalising_reach_navigation_and_localisation() -> None:
    robot = Robot(Decision(Point(3.0, 1.0)))
    for _ in range(20):
        robot.take_step()
    view = robot.behaviour.views[-1][0]
    assert view.plan is not None and view.plan.points[-1] == Point(3.0, 1.0) and not view.backing_out
    there = robot.base.pose.x
    robot.behaviour.decision = Decision(GoalOrder.CANCEL, back_out=0.3, relocalise=True)
    robot.take_step()
    robot.behaviour.decision = Decision()
    robot.take_step()
    assert robot.behaviour.views[-1][0].backing_out and robot.localisation.relocalised == 1
    for _ in range(30):
        robot.take_step()
    view = robot.behaviour.views[-1][0]
    assert not view.backing_out and view.plan is None and robot.base.pose.x < there - 0.1


def test_an_error_in_a_behaviour_is_passed_on_with_its_location() -> None:
    robot = Robot(KeyError("mine"), first_step=4)
    with pytest.raises(KeyError) as caught:
        robot.take_step()
    assert caught.value.__notes__ == ["in step 4 (0.4 s): behaviour 'my.study:behaviour' of r1"]


class BehaviourWithOutcome(ScriptedBehaviour):
    def outcome(self) -> object:
        return self.decision


def test_a_behaviour_may_have_an_outcome() -> None:
    robot = Robot()
    assert list(robot.core.outcome()) == ["localisation", "navigation"]  # optional
    outcome = Robot(behaviour=BehaviourWithOutcome({"study": {"detours": 3}})).core.outcome()
    assert list(outcome) == ["localisation", "navigation", "study"]
    assert outcome["study"] == {"detours": 3}


@pytest.mark.parametrize(
    ("said", "fault"),
    [
        (7, "returned the outcome 7; it should be a dict with names as keys"),
        ({1: 2}, "returned the outcome {1: 2}; it should be a dict with names as keys"),
        ({"good": 1, "bad": {"x": object}},
         "returned an outcome that is not valid JSON, under 'bad': "
         "Encoding objects of type type is unsupported"),
        ({"navigation": {}}, "returned an outcome with the reserved name 'navigation'; choose another name"),
    ],
)  # fmt: skip
def test_an_invalid_outcome_is_reported(said: object, fault: str) -> None:
    robot = Robot(behaviour=BehaviourWithOutcome(said), first_step=4)
    with refused(f"step 4: behaviour 'my.study:behaviour' of r1 {fault}", BehaviourError):
        robot.core.outcome()


def test_equal_inputs_give_equal_outputs() -> None:
    def outputs() -> list[tuple[Output, ...]]:
        robot = Robot(Decision(Point(9.0, 3.0)))
        first = [robot.take_step()]
        robot.behaviour.decision = Decision()
        return first + [robot.take_step() for _ in range(60)]

    assert outputs() == outputs()


WHERE = "step 4 (0.4 s): behaviour 'my.study:behaviour' of r1 "
ANY: Any = Decision
"""Decision without type checks of its arguments."""
GOAL = "it should be a Point of finite numbers or a GoalOrder"
WITHIN = "from 400000 to 499999 µs"
DATA = OutgoingFrame(0, 450_000, b"x")
SHUT = ItemGivenUp("r1", 0, 400_000, "shut")
NO_REASON: Any = None
UNSAID = ItemGivenUp("r1", 0, 400_000, NO_REASON)


def frame(**changed: object) -> Decision:
    return Decision(frames=(replace(DATA, **changed),))


@pytest.mark.parametrize(
    ("decision", "fault"),
    [
        ("go", "returned a str instead of a Decision"),
        (ANY(reports=(7,)), "reports 7; must be a struct of the task, a subclass of MessagePart"),
        (ANY(frames=(b"x",)), "sends b'x'; a frame must be an OutgoingFrame with bytes"),
        (ANY(Point(np.nan, 2.0)), f"returned goal=Point(x=nan, y=2.0); {GOAL}"),
        (ANY(5), f"returned goal=5; {GOAL}"),
        (frame(data=bytes(119)), "sends a frame of 119 bytes; the limit is 118"),
        (frame(tag=-1), f"sends a frame with the tag -1; the tag must be from 0 to {2**63 - 1}"),
        (frame(instant=500_000), f"sends a frame at 500000 µs; the instant must be {WITHIN}"),
        (ANY(frames=(DATA, replace(DATA, instant=449_999))),
         "sends a frame at 449999 µs; the instant must be from 450000 to 499999 µs"),
        (ANY(frames=(DATA,) * 4), "sends 4 frames in one step; the limit is 3"),
        (ANY(reports=(VisitReport("r1", 0, 400000),) * 3),
         "sends 3 task reports in one step; the limit is 2"),
        (ANY(reports=(VisitReport("r1", 0, 399_999),)),
         f"sends a task report at 399999 µs; must be {WITHIN}"),
        (ANY(given_up=("all",)), "gives up 'all'; must be an ItemGivenUp with a text as reason"),
        (ANY(given_up=(UNSAID,)), f"gives up {UNSAID}; must be an ItemGivenUp with a text as reason"),
        *[
            (
                ANY(given_up=(replace(SHUT, reason="x" * length),)),
                f"gives up an item for a reason of {length} characters; must have 1 to 100",
            )
            for length in (0, 101)
        ],
        (ANY(given_up=(replace(SHUT, instant=500_000),)),
         f"gives up an item at 500000 µs; must be {WITHIN}"),
        (ANY(given_up=(SHUT,) * 3), "gives up 3 items in one step; the limit is 2"),
        (ANY(route=[ItemKey("r1", 0)]),
         "has the route [ItemKey(owner='r1', number=0)]; must be a tuple of ItemKey, or None"),
        (ANY(route=(0,)), "has 0 in its route; must be an ItemKey"),
        (ANY(route=(ItemKey("r2", 1), ItemKey("r1", 1), ItemKey("r2", 1))),
         "has item 1 of 'r2' twice in its route; must be unique"),
        (ANY(route=tuple(ItemKey("r1", n) for n in range(5))), "has a route of 5 items; the limit is 4"),
        (ANY(paused="yes"), "returned paused='yes'; it should be True, False or None"),
        *[
            (ANY(back_out=far), f"returned back_out={far}; it should be above 0 and at most 3 m")
            for far in (0.0, 3.1, True)
        ],
        (ANY(relocalise="now"), "returned relocalise='now'; it should be True or False"),
        (ANY(peers=[Point(1.0, 2.0)]),
         "returned peers=[Point(x=1.0, y=2.0)]; it should be a tuple of Points, or None"),
        (ANY(peers=(Point(1.0, np.nan),)),
         "returned Point(x=1.0, y=nan) in peers; it should be a Point of finite numbers"),
        (ANY(peers=(Point(1.0, 2.0),) * 4), "returned 4 peers; at most 3 are allowed"),
    ],
)  # fmt: skip
def test_an_invalid_decision_is_reported(decision: object, fault: str) -> None:
    limits = RobotLimits(frames=3, reports=2, given_up=2, route=4, peers=3)
    robot = Robot(decision, first_step=4, limits=limits)
    with refused(WHERE + fault, BehaviourError):
        robot.take_step()


KIND = model(rays=8)
RANGES = bytes(range(16))


def _sweeps(*poses: tuple[int, float, float]) -> OdometryBuffer:
    sweeps = OdometryBuffer(KIND.sensor)
    for instant, x, heading in poses:
        assert sweeps.take(Instant(instant), Pose(x, 0.0, heading), None) is None
    return sweeps


@pytest.mark.parametrize(
    ("stamp", "x"),
    [(300, 3.0), (250, 2.5), (200, 2.0), (125, 1.25), (100, 1.0), (20, 1.0), (999, 3.0)],
    ids=["now", "between", "at a step", "in the step before", "at the first", "before it", "in the future"],
)
def test_pose_is_that_of_the_stamp(stamp: int, x: float) -> None:
    sweeps = _sweeps((100, 1.0, 0.0), (200, 2.0, 0.0))
    sweep = sweeps.take(Instant(300), Pose(3.0, 0.0, 0.0), Scan(stamp, RANGES))
    assert sweep is not None
    assert sweep.pose == Pose(x, 0.0, 0.0)
    assert sweep.ranges_mm.tobytes() == RANGES


def test_heading_is_interpolated_along_the_shorter_arc() -> None:
    sweeps = _sweeps((0, 0.0, math.pi - 0.1))
    sweep = sweeps.take(Instant(100), Pose(0.0, 0.0, 0.1 - math.pi), Scan(75, RANGES))
    assert sweep is not None
    assert sweep.pose.heading == pytest.approx(0.05 - math.pi)
    sweeps = _sweeps((100, 1.0, 0.0))
    latest = sweeps.take(Instant(200), Pose(2.0, 0.0, 0.0), Scan(200, RANGES))
    assert latest is not None and latest.pose.x == 2.0
    assert sweeps.sweep_of(Scan(150, RANGES)).pose.x == 1.5
    with refused("received a scan of 18 bytes; the robot's range sensor with 8 rays should send 16"):
        OdometryBuffer(KIND.sensor).take(Instant(0), Pose(0.0, 0.0, 0.0), Scan(0, RANGES + b"12"))
