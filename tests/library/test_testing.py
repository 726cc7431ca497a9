"""Parts for tests of strategies: drawn floors, the lossy medium, and swarms in virtual time."""

from typing import Any

import pytest

from acrc_testbed.testing import LossyMedium, VirtualSwarm, floor
from actors.geometry import Point
from actors.instant import START, Duration, Instant, milliseconds, seconds
from actors.messages import FrameReceived, FrameSent, OutgoingFrame
from actors.robot.behaviour import Decision, Goal, GoalOrder, GoalPhase, GoalStatus, View
from actors.robot.behaviour.loading import BehaviourError
from actors.runtime.errors import AcrcError
from deeco.link import Transmission
from tests.cleaning.fakes import DOORWAY
from tests.robot.rig import ACTIVE, ScriptedBehaviour


def test_a_drawn_floor_is_in_metres_with_its_south_west_corner_at_the_origin() -> None:
    drawn = floor(
        """
          b.
        a..#
        """,
        2.0,
        origin=(10.0, -1.0),
    )
    assert drawn.points == {"a": Point(11.0, 0.0), "b": Point(15.0, 2.0)}
    length = drawn.length(drawn["a"], drawn["b"])
    assert length is not None and 4.0 < length < 6.0
    free = {(x, y): drawn.is_free(Point(x, y)) for x in (11.0, 13.0, 15.0, 17.0) for y in (0.0, 2.0)}
    assert [place for place, is_free in free.items() if not is_free] == [
        (11.0, 2.0),
        (13.0, 2.0),
        (17.0, 0.0),
    ]
    assert all(drawn.is_free(drawn.random_point()) for _ in range(9))
    assert drawn.path(drawn["a"], Point(99.0, 0.0)) is None


@pytest.mark.parametrize(
    ("text", "metres", "message"),
    [
        ("a.a", 1.0, "the floor has two points 'a'; use another character, or . for free floor"),
        ("...", 1.0, "the floor has no named point; draw a letter where a robot starts"),
        ("", 1.0, "the floor has no named point; draw a letter where a robot starts"),
        (
            "a#",
            0.4,
            "point 'a' of the floor is within 0.207 m of a wall; move it, or use more than 0.4 m per "
            "character",
        ),
    ],
)
def test_faulty_drawings(text: str, metres: float, message: str) -> None:
    with pytest.raises(AcrcError) as caught:
        floor(text, metres)
    assert str(caught.value) == message


def received(medium: LossyMedium, frames: int = 1000) -> list[tuple[int, int]]:
    """Return number and delay, µs, of the frames that b receives; frame n is sent by a at n ms."""
    for number in range(frames):
        medium.send("a", Transmission(Instant(1000 * number), number.to_bytes(2, "big")), ["a", "b", "far"])
    receptions = medium.receive("b", Instant(seconds(9)))
    assert medium.receive("a", Instant(seconds(9))) == medium.receive("b", Instant(seconds(9))) == []
    assert {(one.sender, one.rssi_dbm) for one in receptions} <= {(1, -60.0)}
    numbers = [int.from_bytes(one.data, "big") for one in receptions]
    return [(number, one.instant - 1000 * number) for number, one in zip(numbers, receptions, strict=True)]


def test_frames_are_lost_and_delayed_by_seeded_draws() -> None:
    assert received(LossyMedium(), 3) == [(0, 0), (1, 0), (2, 0)]
    bounds = Duration(2000), Duration(4000)
    heard = received(LossyMedium(0.3, bounds))
    assert len(heard) == pytest.approx(700, abs=60)  # 4 standard deviations of 14.5
    delays = sorted(delay for _, delay in heard)
    assert 2000 <= delays[0] < 2100 and 3900 < delays[-1] <= 4000
    assert heard == received(LossyMedium(0.3, bounds)) != received(LossyMedium(0.3, bounds, seed=2))
    assert received(LossyMedium(loss=1.0)) == []
    assert received(LossyMedium(reach=lambda sender, receiver: -60.0 if receiver == "far" else None)) == []


class ScriptedSwarm:
    """Two robots whose behaviours return the test's decisions."""

    def __init__(self) -> None:
        self.behaviours = {"r1": ScriptedBehaviour(), "r2": ScriptedBehaviour()}
        robots = {"r1": [DOORWAY["a"], Point(3.0, 0.0)], "r2": [Point(2.0, 0.0)]}
        self.swarm = VirtualSwarm(lambda start: self.behaviours[start.robot], DOORWAY, robots)

    def decide(self, **requests: Any) -> View:
        """Return r1's view after a decision of r1 with these fields."""
        for decision in (Decision(**requests), None):
            self.behaviours["r1"].decision = decision
            self.swarm.advance(milliseconds(100))
        return self.behaviours["r1"].views[-1][0]


def test_starts_name_all_members_and_equal_seeds_draw_equal_numbers() -> None:
    swarm, again = ScriptedSwarm().swarm, ScriptedSwarm().swarm
    r1, r2 = (swarm[name].start for name in ("r1", "r2"))
    assert (r1.address, r2.address, r1.members) == (1, 2, {"r1": 1, "r2": 2})
    assert (r1.pose.point, r1.items, r2.items) == (DOORWAY["a"], ([3.0, 0.0],), ())
    assert r1.floor.random_point() == again["r1"].start.floor.random_point() != r2.floor.random_point()


def test_decisions_become_commands_and_the_test_ends_goals() -> None:
    scripted, goal = ScriptedSwarm(), Point(3.0, 0.0)
    robot = scripted.swarm["r1"]
    assert scripted.decide(goal=goal).goal == Goal(goal, ACTIVE, None, GoalPhase.CONTROLLING, START)
    robot.navigation.obstruct()
    view = scripted.decide(peers=(goal,), relocalise=True, back_out=1.0)
    assert view.goal is not None and view.goal.phase is GoalPhase.OBSTRUCTED and view.backing_out
    assert (robot.positioning.peers, robot.positioning.relocalised) == ((goal,), 1)
    assert scripted.decide(paused=True).goal == Goal(goal, ACTIVE, None, GoalPhase.PAUSED, Instant(400_000))
    robot.reach_goal()
    robot.battery = 0.25
    view = scripted.decide(paused=False)
    assert (view.goal, view.pose.point, view.battery) == (Goal(goal, GoalStatus.SUCCEEDED), goal, 0.25)
    assert scripted.decide(goal=GoalOrder.CANCEL).goal is None
    names = ["go_to", "back_out", "pause", "resume", "stop"]
    assert robot.navigation.commands == list(zip(names, [goal, 1.0, None, None, None], strict=True))


def test_a_frame_arrives_a_step_later_and_a_frozen_robot_receives_it_afterwards() -> None:
    scripted = ScriptedSwarm()
    scripted.swarm["r2"].is_frozen = True
    assert scripted.decide(frames=(OutgoingFrame(7, 50_000, b"hello"),)).radio == (FrameSent(50_000, 7),)
    assert scripted.behaviours["r2"].views == []
    scripted.swarm["r2"].is_frozen = False
    scripted.swarm.advance(milliseconds(100))
    ((view, _),) = scripted.behaviours["r2"].views
    assert (view.instant, view.radio) == (200_000, (FrameReceived(50_000, 1, -60.0, 255, b"hello"),))


def test_a_wrong_decision_and_a_condition_that_never_holds() -> None:
    with pytest.raises(BehaviourError, match=r"^0 s: the behaviour of r1 returned back_out=9\.0; it should"):
        ScriptedSwarm().decide(back_out=9.0)
    swarm = ScriptedSwarm().swarm
    with pytest.raises(AssertionError, match=r"the condition does not hold within 0\.5 s"):
        swarm.advance_until(lambda: False, timeout=seconds(0.5))
    assert swarm.now == 500_000
