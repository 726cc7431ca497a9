"""`check_strategy` and `check_task` find planted faults, and none in shipped code."""

from pathlib import Path

import pytest

import acrc_testbed as acrc
from actors.task import Task
from tests.task.parcels import Parcels

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


_LOTTERY = """
import random
from tests.task.parcels import Loaded, ParcelJudge, Parcels

class Chance(ParcelJudge):
    def settled_by_chance(self):
        return random.random()
    def give(self, instant, robot, items):
        return f"no, {self.settled_by_chance()}"

class Crash(ParcelJudge):
    def take(self, robot, answer, begin, end):
        return self.items[robot][answer.reports[0].number] and None if answer.reports else None

class Lottery(Parcels):
    def judge(self, setup):
        return Chance(setup)

class Crashing(Parcels):
    def judge(self, setup):
        return Crash(setup)
"""


@pytest.mark.parametrize("task", ["cleaning", "logistics", Parcels])
def test_shipped_and_made_up_tasks_have_no_findings(task: str | type[Task]) -> None:
    assert acrc.check_task(task) == []


def test_chance_and_crashes_of_a_judge_are_found(folder: Path) -> None:
    (folder / "lottery_check.py").write_text(_LOTTERY)
    (finding,) = acrc.check_task("lottery_check:Lottery", modules=[folder])
    assert finding.startswith("two judges with equal inputs differ in step 25: one answers ([")
    (finding,) = acrc.check_task("lottery_check:Crashing", modules=[folder])
    assert finding.startswith(
        "task parcels, take at 0 s failed: AttributeError: 'Delivered' object has no at"
    )
    (finding,) = acrc.check_task(Parcels, settings={"per_robot": 10})
    assert finding.endswith("parcels.per_robot is 10, but must be a whole number from 0 to 9")
    (finding,) = acrc.check_task("elsewhere:Task", modules=[folder])
    assert finding == (
        "task 'elsewhere:Task': its module is not installed; name its folder with --modules DIR"
    )
