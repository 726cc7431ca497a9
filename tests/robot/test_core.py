"""The robot's core: which messages it awaits, what it answers, and what it refuses."""

from collections.abc import Sequence

import numpy as np
import pytest

from actors.geometry import CERTAIN, Point, Pose
from actors.instant import Instant
from actors.messages import (
    DRIVE,
    FRAME_DATA_LIMIT,
    RECEIVED,
    SENSES,
    TRANSMIT,
    Drive,
    Heard,
    Odometry,
    Outgoing,
    Received,
    Scan,
    Senses,
    Sent,
    Transmit,
)
from actors.robot.behaviour.decision_limits import RobotLimits
from actors.robot.behaviour.entry import BehaviourError
from actors.robot.behaviour.goal import Goal, GoalOrder, GoalPhase, GoalStatus
from actors.robot.behaviour.ports import Decision, View
from actors.robot.core import RobotCore, RobotParts, StepError
from actors.robot.localisation import DeadReckoning
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.dwa_parameters import DwaParameters
from actors.robot.navigation.local_planner import LocalPlanner
from actors.robot.navigation.navigator import Navigator
from actors.robot.navigation.planning import Planner, ground
from actors.robot.sweep import ScanError, Sweeps
from actors.runtime.core import Output, at, to
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from actors.topic import Message
from tests.robot.base import TWO_ROOMS, FakeBase, model
from tests.robot.behaviours import Scripted

FLOOR = ground(TWO_ROOMS, 0.177)
START = Pose(1.0, 1.0, 0.0)
LIMITS = RobotLimits()
HEARD = Heard(90, 2, -60.0, 255, b"hello")


class Masked(DeadReckoning):
    """Dead reckoning that notes which peers it is told of."""

    told: tuple[Point, ...] | None = None

    relocalised = 0

    def mask(self, peers: Sequence[Point]) -> None:
        self.told = tuple(peers)

    def relocalise(self) -> None:
        self.relocalised += 1


class Robot:
    """A core, its behaviour, and a base to feed it."""

    def __init__(
        self,
        decision: object = None,
        first_step: int = 0,
        limits: RobotLimits = LIMITS,
        behaviour: Scripted | None = None,
    ) -> None:
        kind = model()
        self.behaviour = behaviour or Scripted(decision)
        self.base = FakeBase(TWO_ROOMS, kind, START)
        local = CostMap(kind.sensor, 0.177)
        driver = LocalPlanner(local, 0.177, kind.drive, DwaParameters())
        navigation = Navigator(Planner(FLOOR), local, driver)
        self.localisation = Masked(START)
        parts = RobotParts(Sweeps(kind.sensor), self.localisation, navigation, self.behaviour)
        self.core = RobotCore(
            "r1", parts, entry="my.study:behaviour", first_step=first_step, step_us=100_000, limits=limits
        )

    def take_step(self, *events: Heard | Sent) -> tuple[Output, ...]:
        """One step of core and base; nothing may be missing."""
        step = self.core.step
        inputs: dict[str, Message] = {"swarm/down/r1/senses": self.base.senses(step, len(events))}
        if events:
            inputs["swarm/down/r1/received"] = Received(step, events)
        assert not self.core.missing(inputs)
        outputs = self.core.advance(inputs)
        drive = outputs[-1].message
        assert isinstance(drive, Drive)
        self.base.drive(drive)
        return tuple(outputs)


def test_it_awaits_senses_and_then_received_only_if_there_are_events() -> None:
    robot = Robot()
    assert robot.core.listens() == (at(SENSES, "r1"), at(RECEIVED, "r1"))
    assert robot.core.missing({}) == (at(SENSES, "r1"),)
    quiet, busy = robot.base.senses(0), robot.base.senses(0, events=2)
    assert robot.core.missing({"swarm/down/r1/senses": quiet}) == ()
    assert robot.core.missing({"swarm/down/r1/senses": busy}) == (at(RECEIVED, "r1"),)
    both = {"swarm/down/r1/senses": busy, "swarm/down/r1/received": Received(0, (HEARD, HEARD))}
    assert robot.core.missing(both) == ()


def test_a_quiet_step_gives_one_drive() -> None:
    robot = Robot()
    assert robot.take_step() == (to(DRIVE, Drive(0, 0.0, 0.0, 0.0, 0, pose=START), "r1"),)
    assert robot.core.step == 1 and not robot.core.finished


def test_frames_go_out_before_drive_which_counts_them_and_carries_the_word_on_places() -> None:
    frames = (Outgoing(5, 0, b"a"), Outgoing(6, 99_999, bytes(FRAME_DATA_LIMIT)))
    reports = (PlaceReport("r1", 4, 50_000),)
    given_up = (PlaceGivenUp("r1", 3, 60_000, "door shut"),)
    route = (PlaceKey("r2", 7), PlaceKey("r1", 0))
    robot = Robot(Decision(GoalOrder.KEEP, frames, reports, given_up, route))
    assert robot.take_step() == (
        to(TRANSMIT, Transmit(0, frames), "r1"),
        to(DRIVE, Drive(0, 0.0, 0.0, 0.0, 2, reports, given_up, route, START), "r1"),
    )


def test_the_behaviour_sees_pose_motion_goal_and_radio_and_its_goal_drives_the_robot() -> None:
    goal = Point(3.0, 1.0)
    robot = Robot(Decision(goal))
    robot.take_step(HEARD, Sent(95, 1))
    robot.behaviour.decision = Decision()
    for _ in range(120):
        robot.take_step()
    views = robot.behaviour.views
    first, until = views[0]
    assert first == View(Instant(0), START, False, None, (HEARD, Sent(95, 1)), CERTAIN, 0.0)
    assert until == 100_000
    assert views[1][0].goal == Goal(goal, GoalStatus.ACTIVE, None, GoalPhase.CONTROLLING, Instant(100_000))
    assert views[1][0].radio == () and views[1][0].instant == 100_000
    assert any(view.moving for view, _ in views)
    last = views[-1][0]
    assert last.goal == Goal(goal, GoalStatus.SUCCEEDED) and not last.moving
    assert last.pose.point.distance_to(goal) <= 0.15
    assert last.pose == pytest.approx(robot.base.pose, abs=1e-9)


def test_a_restarted_robot_begins_with_the_step_it_was_started_for() -> None:
    robot = Robot(first_step=731)
    (drive,) = robot.take_step()
    assert drive.message.step == 731
    assert robot.behaviour.views[0][0].instant == Instant(73_100_000)


@pytest.mark.parametrize("events", [(), (HEARD,)])
def test_halt_is_taken_in_without_an_answer(events: tuple[Heard, ...]) -> None:
    robot = Robot()
    senses = Senses(0, 0, len(events), Odometry(0, 0, 0, 0, 0, 0), 0, None, halt=True)
    inputs: dict[str, Message] = {"swarm/down/r1/senses": senses}
    assert robot.core.missing(inputs) == ((at(RECEIVED, "r1"),) if events else ())
    inputs["swarm/down/r1/received"] = Received(0, events)
    assert robot.core.advance(inputs) == ()
    assert robot.core.finished and robot.behaviour.views == []


def refusal(robot: Robot, **messages: Message) -> str:
    with pytest.raises(StepError) as caught:
        robot.core.advance({f"swarm/down/r1/{name}": message for name, message in messages.items()})
    return str(caught.value)


def test_messages_of_another_step_are_refused() -> None:
    robot = Robot(first_step=7)
    assert refusal(robot, senses=robot.base.senses(6)) == (
        "step 7: r1 got Senses of step 6; it should be of step 7 or later"
    )
    assert refusal(robot, senses=robot.base.senses(7, 1), received=Received(8, (HEARD,))) == (
        "step 7: r1 got Received of step 8; it should be of step 7 or earlier"
    )
    assert refusal(robot, senses=robot.base.senses(7, 1), received=Received(7, (HEARD, HEARD))) == (
        "step 7: r1 got 2 radio events; Senses counts 1"
    )


def test_a_robot_that_was_frozen_goes_on_with_the_step_that_the_world_is_in() -> None:
    robot = Robot()
    robot.take_step()
    inputs = {
        "swarm/down/r1/senses": robot.base.senses(41, 1),
        "swarm/down/r1/received": Received(3, (HEARD,)),
    }
    (drive,) = robot.core.advance(inputs)
    assert drive.message.step == 41 and robot.core.step == 42
    assert robot.behaviour.views[-1][0].instant == 4_100_000
    assert robot.behaviour.views[-1][0].radio == (HEARD,)


def test_pausing_and_peers_reach_navigation_and_localisation() -> None:
    robot = Robot(Decision(Point(3.0, 1.0), paused=True, peers=(Point(2.0, 2.0),)))
    robot.take_step()
    assert robot.localisation.told == (Point(2.0, 2.0),)
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
    assert not robot.localisation.told


def test_backing_out_and_looking_for_itself_reach_navigation_and_localisation() -> None:
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


def test_a_scan_of_another_sensor_is_refused() -> None:
    robot = Robot()
    senses = Senses(0, 0, 0, Odometry(0, 0, 0, 0, 0, 0), 0, Scan(0, b"\0" * 7))
    with pytest.raises(ScanError):
        robot.core.advance({"swarm/down/r1/senses": senses})


WHERE = "step 4 (0.4 s): behaviour 'my.study:behaviour' of r1 "


@pytest.mark.parametrize(
    ("decision", "fault"),
    [
        ("go", "gives a str where a Decision is due"),
        (
            Decision(reports=(7,)),  # type: ignore[arg-type]
            "gives 7 for a report; it should be a PlaceReport",
        ),
        (
            Decision(frames=(b"x",)),  # type: ignore[arg-type]
            "sends b'x'; it should be an Outgoing with bytes",
        ),
        (
            Decision((1.0, 2.0, 3.0)),  # type: ignore[arg-type]
            "gives (1.0, 2.0, 3.0) for a goal; it should be a Point of finite numbers or a GoalOrder",
        ),
        (
            Decision(Point(float("nan"), 2.0)),
            "gives Point(x=nan, y=2.0) for a goal; it should be a Point of finite numbers or a GoalOrder",
        ),
        (
            Decision(5),  # type: ignore[arg-type]
            "gives 5 for a goal; it should be a Point of finite numbers or a GoalOrder",
        ),
        (
            Decision(frames=(Outgoing(0, 400_000, bytes(119)),)),
            "sends a frame of 119 bytes; it should have 1 to 118",
        ),
        (
            Decision(frames=(Outgoing(0, 400_000, b""),)),
            "sends a frame of 0 bytes; it should have 1 to 118",
        ),
        (
            Decision(frames=(Outgoing(-1, 400_000, b"x"),)),
            "sends a frame with the tag -1; it should be 0 to 9223372036854775807",
        ),
        (
            Decision(frames=(Outgoing(0, 500_000, b"x"),)),
            "sends a frame at 500000 µs; it should be sent from 400000 to 499999 µs",
        ),
        (
            Decision(frames=(Outgoing(0, 450_000, b"x"), Outgoing(1, 449_999, b"y"))),
            "sends a frame at 449999 µs; it should be sent from 450000 to 499999 µs",
        ),
        (
            Decision(frames=(Outgoing(0, 400_000, b"x"),) * 4),
            "sends 4 frames in one step; at most 3 may be",
        ),
        (
            Decision(reports=(PlaceReport("r1", 0, 400_000),) * 3),
            "reports 3 places in one step; at most 2 may be",
        ),
        (
            Decision(reports=(PlaceReport("r1", 0, 399_999),)),
            "reports a place at 399999 µs; it should be from 400000 to 499999 µs",
        ),
        (
            Decision(given_up=("all",)),  # type: ignore[arg-type]
            "gives 'all' up; it should be a PlaceGivenUp with a reason in words",
        ),
        (
            Decision(given_up=(PlaceGivenUp("r1", 0, 400_000, None),)),  # type: ignore[arg-type]
            "gives PlaceGivenUp(owner='r1', place=0, instant=400000, reason=None) up; "
            "it should be a PlaceGivenUp with a reason in words",
        ),
        (
            Decision(given_up=(PlaceGivenUp("r1", 0, 400_000, ""),)),
            "gives a place up for a reason of 0 characters; it should have 1 to 100",
        ),
        (
            Decision(given_up=(PlaceGivenUp("r1", 0, 400_000, "x" * 101),)),
            "gives a place up for a reason of 101 characters; it should have 1 to 100",
        ),
        (
            Decision(given_up=(PlaceGivenUp("r1", 0, 500_000, "shut"),)),
            "gives a place up at 500000 µs; it should be from 400000 to 499999 µs",
        ),
        (
            Decision(given_up=(PlaceGivenUp("r1", 0, 400_000, "shut"),) * 3),
            "gives 3 places up in one step; at most 2 may be",
        ),
        (
            Decision(route=[PlaceKey("r1", 0)]),  # type: ignore[arg-type]
            "gives [PlaceKey(owner='r1', place=0)] for a route; it should be a tuple of PlaceKey, or None",
        ),
        (
            Decision(route=(0,)),  # type: ignore[arg-type]
            "has 0 in its route; it should be a PlaceKey",
        ),
        (
            Decision(route=(PlaceKey("r2", 1), PlaceKey("r1", 1), PlaceKey("r2", 1))),
            "has place 1 of 'r2' twice in its route; each may be there once",
        ),
        (
            Decision(route=tuple(PlaceKey("r1", place) for place in range(5))),
            "has a route of 5 places; at most 4 may be",
        ),
        (
            Decision(paused="yes"),  # type: ignore[arg-type]
            "gives 'yes' for paused; it should be True, False or None",
        ),
        (Decision(back_out=0.0), "gives 0.0 for back_out; it should be above 0 and at most 3 m"),
        (Decision(back_out=3.1), "gives 3.1 for back_out; it should be above 0 and at most 3 m"),
        (Decision(back_out=True), "gives True for back_out; it should be above 0 and at most 3 m"),
        (
            Decision(relocalise="now"),  # type: ignore[arg-type]
            "gives 'now' for relocalise; it should be True or False",
        ),
        (
            Decision(peers=[Point(1.0, 2.0)]),  # type: ignore[arg-type]
            "gives [Point(x=1.0, y=2.0)] for peers; it should be a tuple of Points, or None",
        ),
        (
            Decision(peers=(Point(1.0, np.nan),)),
            "has Point(x=1.0, y=nan) among its peers; it should be a Point of finite numbers",
        ),
        (Decision(peers=(Point(1.0, 2.0),) * 4), "gives 4 peers; at most 3 may be"),
    ],
)
def test_what_a_behaviour_must_not_ask_for_is_named(decision: object, fault: str) -> None:
    limits = RobotLimits(frames=3, reports=2, given_up=2, route=4, peers=3)
    robot = Robot(decision, first_step=4, limits=limits)
    with pytest.raises(BehaviourError) as caught:
        robot.take_step()
    assert str(caught.value) == WHERE + fault


def test_an_error_in_a_behaviour_is_passed_on_with_a_note_of_where() -> None:
    robot = Robot(KeyError("mine"), first_step=4)
    with pytest.raises(KeyError) as caught:
        robot.take_step()
    assert caught.value.__notes__ == ["in step 4 (0.4 s): behaviour 'my.study:behaviour' of r1"]


class Talkative(Scripted):
    """Has something to say about its run."""

    said: object = None

    def outcome(self) -> object:
        return self.said


def test_a_behaviour_may_say_something_about_its_run() -> None:
    robot = Robot()
    assert list(robot.core.outcome()) == ["localisation", "navigation"]  # it need not
    behaviour = Talkative()
    behaviour.said = {"study": {"detours": 3}}
    robot = Robot(behaviour=behaviour)
    outcome = robot.core.outcome()
    assert list(outcome) == ["localisation", "navigation", "study"]
    assert outcome["study"] == {"detours": 3}


@pytest.mark.parametrize(
    ("said", "fault"),
    [
        (7, "gives 7 for its outcome; it should be a dict by subject"),
        ({1: 2}, "gives {1: 2} for its outcome; it should be a dict by subject"),
        (
            {"good": 1, "bad": {"x": object}},
            "has an outcome that is no JSON, under 'bad': Encoding objects of type type is unsupported",
        ),
        ({"navigation": {}}, "has an outcome under 'navigation', where the robot's own stands"),
    ],
)
def test_an_outcome_that_cannot_be_kept_is_named(said: object, fault: str) -> None:
    behaviour = Talkative()
    behaviour.said = said
    robot = Robot(behaviour=behaviour, first_step=4)
    with pytest.raises(BehaviourError) as caught:
        robot.core.outcome()
    assert str(caught.value) == f"step 4: behaviour 'my.study:behaviour' of r1 {fault}"


def test_equal_inputs_give_equal_outputs() -> None:
    def outputs() -> list[tuple[Output, ...]]:
        robot = Robot(Decision(Point(9.0, 3.0)))
        first = [robot.take_step()]
        robot.behaviour.decision = Decision()
        return first + [robot.take_step() for _ in range(60)]

    assert outputs() == outputs()
