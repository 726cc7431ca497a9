"""`check_strategy` and `check_task` find planted faults, and none in shipped code."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import acrc_testbed as acrc
from cleaning.referee import Referee

_PURE = """
from actors.robot.behaviour import Behaviour, Start, host
from cleaning.place import assignments
from cleaning.robot import CleaningRobot

def behaviour(start: Start) -> Behaviour:
    return host(start, CleaningRobot(id=start.robot, position=start.pose.point, route=assignments(start)))
"""
_IMPURE = """
from itertools import count
from actors.geometry import Point
from actors.robot.behaviour import Decision

calls = count()

class Wanderer:
    def advance(self, view, until):
        return Decision(Point(view.pose.x + next(calls) % 7, view.pose.y))

def behaviour(start):
    if start.epoch:
        raise ValueError("cannot be restarted")
    return Wanderer()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_strategy_that_follows_its_inputs_has_no_findings(folder: Path) -> None:
    (folder / "pure_check.py").write_text(_PURE)
    assert acrc.check_strategy("pure_check:behaviour", duration=10) == []


def test_state_outside_of_knowledge_and_a_failing_restart_are_found(folder: Path) -> None:
    (folder / "impure_check.py").write_text(_IMPURE)
    findings = "\n".join(acrc.check_strategy("impure_check:behaviour", duration=10))
    assert "a second run in the same process differs" in findings
    assert "cannot be restarted" in findings


def test_wrong_arguments_are_one_sentence(folder: Path) -> None:
    (folder / "wrong_check.py").write_text("def behaviour(): pass\n")
    (finding,) = acrc.check_strategy("wrong_check:behaviour")
    assert finding.startswith("wrong_check:behaviour cannot be called with a Start as its only argument")
    with pytest.raises(acrc.AcrcError, match="at least 10 s"):
        acrc.check_strategy("none", duration=1)


def test_tasks_are_functions_of_their_inputs() -> None:
    robots = [SimpleNamespace(id="r1", places=((1.0, 1.0),)), SimpleNamespace(id="r2", places=((2.0, 2.0),))]
    assert acrc.check_task(lambda: Referee(robots, 0.7)) == []
    made: list[Referee] = []

    class Moody(Referee):
        def outcome(self, present):  # type: ignore[no-untyped-def]
            made.append(self)
            return {"number": len(made)}

    (finding,) = acrc.check_task(lambda: Moody(robots, 0.7))
    assert finding.startswith("two tasks with equal inputs differ")
