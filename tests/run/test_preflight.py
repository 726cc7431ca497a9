"""A strategy that cannot be made is refused before the run starts, in memory and in a sandbox."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.processes.launcher import Launcher
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import isolation_fault
from cleaning.place import points
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.run.preflight import PreflightLimits, preflight
from tests.scenario.faults import scenario

STUDY = """
import os
from dataclasses import dataclass
from actors.instant import Duration, Instant, seconds
from actors.robot.behaviour.ports import Behaviour, Decision, Start, View
from actors.robot.behaviour import from_settings
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
    made.append((start, from_settings(Parameters, start.settings), start.floor.random_point()))
    return Own()

def undeployed(start: Start) -> Behaviour:
    raise DeploymentError("Robot.drive needs a Wings ('wings'); this node provides Navigation")

def buggy(start: Start) -> Behaviour:
    return Own(1 / 0)

def gone(start: Start) -> Behaviour:
    os._exit(0)
"""


def planned(folder: Path, name: str, text: str, function: str = "behaviour") -> RunPlan:
    (folder / f"{name}.py").write_text(STUDY)
    head = f'[run]\nstrategy = "{name}:{function}"\nmodules = "{folder}"\n'
    return swarm.plan(scenario(head + text), RunOptions(folder / "out", bus="memory", modules=(folder,)))


def test_preflight_makes_the_first_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path.parent)
    text = "[strategy]\nlease = 3\n[deeco]\nhop_limit = 5\n"
    text += "[[area]]\nname = 'hall'\nx = [8, 12]\ny = [10.5, 13.8]\n"
    plan = planned(tmp_path, "study_right", text)
    [(start, parameters, place)] = sys.modules["study_right"].made
    assert str(tmp_path) not in sys.path
    assert (start.robot, start.address, start.epoch) == ("r1", 1, 0)
    assert points(start.items) == points(plan.world.robots[0].items)
    assert (dict(start.settings), parameters.lease) == ({"lease": 3}, 3_000_000)
    assert start.exchange.hop_limit == 5
    assert 8 <= place.x <= 12 and 10.5 <= place.y <= 13.8
    assert plan.options.modules == (tmp_path,)
    assert capsys.readouterr().out == ""


PORT = "Robot.drive needs a Wings ('wings'); this node provides Navigation"


@pytest.mark.parametrize(
    ("name", "text", "function", "sentence"),
    [
        ("key", "[strategy]\nleese = 3", "behaviour",
         "unknown key strategy.leese; did you mean strategy.lease?"),
        ("value", "[strategy]\nlease = true", "behaviour",
         "strategy.lease is true, but must be a number of seconds, at most 1000000"),
        ("port", "", "undeployed", "behaviour 'port:undeployed': " + PORT),
        ("entry", "", "behavior", "behaviour 'entry:behavior': module 'entry' has no "
         "'behavior'; did you mean behaviour?"),
        ("gone", "", "gone", "behaviour 'gone:gone': its code called os._exit(0) (gone.py:31)"),
        ("bug", "", "buggy", "strategy 'bug:buggy', preflight for r1: ZeroDivisionError: "
         "division by zero (bug.py:28)"),
    ],
)  # fmt: skip
def test_a_strategy_that_does_not_fit_is_one_sentence(
    tmp_path: Path, name: str, text: str, function: str, sentence: str
) -> None:
    with pytest.raises(AcrcError) as caught:
        planned(tmp_path, name, text, function)
    assert str(caught.value).splitlines()[0] == sentence
    assert not (tmp_path / "out").exists()


HOSTILE = """
import os, signal, sys, time
from pathlib import Path

def behaviour(start):
    raise ZeroDivisionError("first line\\n\\x1b[31msecond")

def leaves(start):
    print("not a word of this is a sentence of ours")
    sys.exit(0)

def dies(start):
    os.kill(os.getpid(), signal.SIGKILL)

def hangs(start):
    while True: pass

def hangs_unseen(start):
    import faulthandler
    faulthandler.cancel_dump_traceback_later()
    hangs(start)

def sends_a_courier(start):
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            for number in (0, 1, 2):
                os.close(number)
            while True:
                for folder in Path(__file__).parent.glob("out*/r2/own"):
                    (folder / "mail").write_text(Path(folder, "../../r1/setup.json").read_text())
                time.sleep(0.01)
        os._exit(0)
    os.wait()
    return start
"""


@pytest.fixture(scope="module")
def launched() -> Iterator[Launcher]:
    if (reason := isolation_fault()) is not None:
        pytest.skip(reason)
    with Launcher("fork") as launched:
        yield launched


def hostile(folder: Path, function: str) -> RunPlan:
    (folder / "hostile.py").write_text(HOSTILE)
    text = f'[run]\nstrategy = "hostile:{function}"\nmodules = "{folder}"\n'
    return swarm.plan(scenario(text), RunOptions(folder / "out", isolate=True, modules=(folder,)))


MADE = "strategy 'hostile:{}', preflight for r1: "


@pytest.mark.parametrize(
    ("function", "grace_s", "sentence"),
    [
        ("leaves", 5.0, "behaviour 'hostile:leaves': its code called sys.exit(0) (hostile.py:10)"),
        ("dies", 5.0, MADE + "its process was killed by SIGKILL"),
        ("hangs", 5.0, MADE + "not finished after 2 s; it is at hostile.py:16"),
        ("hangs_unseen", 0.5, MADE + "not finished after 2.5 s"),
    ],
)
def test_a_robot_that_cannot_be_made_is_one_sentence(
    tmp_path: Path, launched: Launcher, function: str, grace_s: float, sentence: str
) -> None:
    with pytest.raises(AcrcError) as caught:
        preflight(hostile(tmp_path, function), launched, PreflightLimits(2.0, grace_s))
    assert str(caught.value) == sentence.format(function)
    assert not (tmp_path / "out").exists()


def test_a_bug_shows_its_traceback_without_control_characters(
    tmp_path: Path, launched: Launcher, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(AcrcError) as caught:
        preflight(hostile(tmp_path, "behaviour"), launched)
    assert str(caught.value) == (
        f"{MADE.format('behaviour')}ZeroDivisionError: first line\n\\x1b[31msecond (hostile.py:6)"
    )
    said = capsys.readouterr().err
    assert "Traceback (most recent call last):" in said and "\x1b" not in said


def test_processes_started_in_preflight_are_ended(tmp_path: Path, launched: Launcher) -> None:
    for robot in ("r1", "r2"):
        (tmp_path / "out1" / robot / "own").mkdir(parents=True)
        (tmp_path / "out1" / robot / "setup.json").write_text("where r1 has to go")
    with pytest.raises(AcrcError) as caught:
        preflight(hostile(tmp_path, "sends_a_courier"), launched)
    assert str(caught.value) == (
        "behaviour 'hostile:sends_a_courier' returned a Start, which has no method advance(view, until)"
    )
    assert [path.name for path in (tmp_path / "out1" / "r2" / "own").iterdir()] == []
    server = launched._server.pid
    assert Path(f"/proc/{server}/task/{server}/children").read_text() == ""
