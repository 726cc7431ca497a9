"""The robot's core: which messages it awaits, what it answers, and what it refuses."""

import pytest

from actors.geometry import CERTAIN, Point
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
from actors.robot.behaviour.entry import BehaviourError
from actors.robot.behaviour.goal import Goal, GoalOrder, GoalPhase, GoalStatus
from actors.robot.behaviour.ports import Decision, View
from actors.runtime.core import Output, at, to
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from actors.topic import Message
from tests.robot.behaviours import Scripted
from tests.robot.rig import HEARD, START, Robot, refusal


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
    robot = Robot(Decision(frames=frames, reports=reports, given_up=given_up, route=route))
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
    with pytest.raises(AcrcError):
        robot.core.advance({"swarm/down/r1/senses": senses})


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
