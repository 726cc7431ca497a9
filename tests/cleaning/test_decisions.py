"""What a robot's adaptation decides is told with its cause, what it was decided from, and in words."""

from dataclasses import replace
from typing import Any

import numpy as np

from actors.geometry import Point, Pose
from actors.instant import Instant, seconds
from actors.robot.behaviour import Start, host
from actors.robot.behaviour.decisions import DecisionLog
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import State
from cleaning.place import Assignment, assignments
from cleaning.robot import CleaningRobot
from deeco import component
from deeco.local import Commit

HERE, THERE = Point(1.0, 2.0), Point(5.0, 2.0)
OWN = Assignment("r1", 0, HERE)
OTHERS = Assignment("r2", 3, THERE)
ROBOT = AdaptiveCleaningRobot(id="r1", position=Point(0.0, 0.0), route=(OWN,), destination=OWN)
NOW = Instant(seconds(10))


def told(log: DecisionLog) -> list[dict[str, Any]]:
    found = log.outcome()["decisions"]
    assert isinstance(found, list)
    return found


def commit(
    after: CleaningRobot, before: CleaningRobot = ROBOT, *, adaptation: bool = True, at: Instant = NOW
) -> Commit:
    return Commit("AdaptiveCleaningRobot.auto_unblock", at, before, after, adaptation)


def test_a_decision_is_told_with_its_cause_and_goals() -> None:
    log = DecisionLog(ROBOT)
    log.take(commit(ROBOT.adopting(OTHERS, NOW))._replace(peer="r2", heard=Instant(seconds(9))))
    assert told(log) == [
        {
            "instant": NOW,
            "by": "AdaptiveCleaningRobot.auto_unblock",
            "words": "takes over r2/3",
            "source": "r2",
            "age": seconds(1),
            "old": [1.0, 2.0],
            "new": [5.0, 2.0],
        }
    ]


def test_every_kind_of_decision_has_its_words() -> None:
    both = ROBOT.adopting(OTHERS, NOW)
    cases = {
        "turns elsewhere": (ROBOT, ROBOT.sent_to(THERE)),
        "stops": (ROBOT, replace(ROBOT, destination=None, attempt=1)),
        "leaves to another r2/3": (both, both.without({OTHERS.key}, settled=False)),
        "gives up r2/3": (both, both.without({OTHERS.key}, settled=True)),
        "": (ROBOT, replace(ROBOT, blocked_for=3)),
    }
    for words, (before, after) in cases.items():
        assert after.decided_since(before) == words


def test_what_the_adapted_layer_does_is_no_decision() -> None:
    log = DecisionLog(ROBOT)
    log.take(commit(ROBOT.sent_to(THERE), adaptation=False))
    log.take(commit(replace(ROBOT, blocked_for=2)))
    assert told(log) == []


def test_spells_of_being_blocked_are_told_and_the_last_may_be_open() -> None:
    log, blocked = DecisionLog(ROBOT), replace(ROBOT, state=State.BLOCKED)
    for at_s, robot in ((1, ROBOT), (4, blocked), (5, blocked), (7, ROBOT), (9, blocked)):
        log.take(commit(robot, at=Instant(seconds(at_s))))
    assert log.outcome()["blocked"] == [[seconds(4), seconds(7)], [seconds(9), None]]


def test_the_list_is_bounded_and_says_what_it_leaves_out() -> None:
    log = DecisionLog(ROBOT)
    for _ in range(1002):
        log.take(commit(ROBOT.sent_to(THERE)))
    assert len(told(log)) == 1000 and log.outcome()["decisions_unlisted"] == 2


@component
class _Reporting(CleaningRobot):
    def outcome(self) -> dict[str, object]:
        return {"held": len(self.route), "deeco": "not mine"}


def test_a_component_may_have_results_of_its_own() -> None:
    start = Start("r1", 1, 0, Pose(1.0, 2.0, 0.0), (Point(3.0, 1.0),), np.random.default_rng(1))
    made = host(start, _Reporting(id="r1", position=Point(1.0, 2.0), route=assignments(start)))
    told = made.outcome()  # type: ignore[attr-defined]
    assert told["held"] == 1 and list(told) == ["held", "deeco", "adaptation"]
    assert "counters" in told["deeco"]
