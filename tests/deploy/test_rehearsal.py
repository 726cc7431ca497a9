"""What is wrong with a strategy is said in the parent, before anything is laid out or started."""

import sys
from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from deploy import swarm
from deploy.options import RunOptions
from deploy.plan import Plan
from tests.deploy.faults import scenario

STUDY = """
from dataclasses import dataclass
from actors.instant import Duration, Instant, seconds
from actors.robot.ports import Behaviour, Decision, Start, View
from cleaning.settings import from_settings
from deeco import DeploymentError

print("this must not come between a program and its JSON")
made = []

@dataclass(frozen=True)
class Parameters:
    lease: Duration = seconds(2)

class Own:
    def advance(self, view: View, until: Instant) -> Decision:
        return Decision()

def behaviour(start: Start) -> Behaviour:
    made.append((start, from_settings(Parameters, start.settings), start.floor.random_place()))
    return Own()

def undeployed(start: Start) -> Behaviour:
    raise DeploymentError("Robot.drive needs a Wings ('wings'); this node provides Navigation")

def buggy(start: Start) -> Behaviour:
    return Own(1 / 0)
"""


def planned(folder: Path, name: str, text: str, function: str = "behaviour") -> Plan:
    (folder / f"{name}.py").write_text(STUDY)
    head = f'[run]\nstrategy = "{name}:{function}"\nmodules = "{folder}"\n'
    return swarm.plan(scenario(head + text), RunOptions(folder / "out", bus="memory"))


def test_the_first_robot_is_made_as_it_will_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path.parent)
    text = "[strategy]\nlease = 3\n[deeco]\nhop_limit = 5\n"
    text += "[[area]]\nname = 'hall'\nx = [8, 12]\ny = [10.5, 13.8]\n"
    plan = planned(tmp_path, "study_right", text)
    [(start, parameters, place)] = sys.modules["study_right"].made
    assert str(tmp_path) not in sys.path
    assert (start.robot, start.address, start.epoch) == ("r1", 1, 0)
    assert start.places == tuple(plan.world.robots[0].places)
    assert (dict(start.settings), parameters.lease) == ({"lease": 3}, 3_000_000)
    assert start.exchange.hop_limit == 5
    assert 8 <= place.x <= 12 and 10.5 <= place.y <= 13.8
    assert plan.modules == (tmp_path, tmp_path.parent)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("name", "text", "function", "sentence"),
    [
        (
            "study_key",
            "[strategy]\nleese = 3",
            "behaviour",
            "strategy.leese is not known; did you mean strategy.lease?",
        ),
        (
            "study_value",
            "[strategy]\nlease = true",
            "behaviour",
            "strategy.lease is true, but must be a number of seconds, at most 1000000",
        ),
        (
            "study_port",
            "",
            "undeployed",
            "behaviour 'study_port:undeployed':"
            " Robot.drive needs a Wings ('wings'); this node provides Navigation",
        ),
        (
            "study_entry",
            "",
            "behavior",
            "behaviour 'study_entry:behavior': module 'study_entry' has no 'behavior'",
        ),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    tmp_path: Path, name: str, text: str, function: str, sentence: str
) -> None:
    with pytest.raises(AcrcError) as caught:
        planned(tmp_path, name, text, function)
    assert str(caught.value) == sentence
    assert not (tmp_path / "out").exists()


def test_a_bug_is_the_strategys_own_and_named(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        planned(tmp_path, "study_buggy", "", "buggy")
    assert caught.value.__notes__ == ["in strategy 'study_buggy:buggy' made for r1 before the run"]
