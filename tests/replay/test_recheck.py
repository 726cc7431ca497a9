"""`acrc run --check`: a strategy that follows more than what it is told is found by the run itself."""

import re
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from deploy.run import swarm
from deploy.run.options import RunOptions, checked
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay.recheck import RecheckError, recheck
from tests.in_process import acrc


def test_what_follows_a_clock_chance_a_set_or_an_address_is_found(tmp_path: Path) -> None:
    overrides = Overrides(robots=5, duration=2, strategy="tests.replay.fickle:behaviour")
    plan = swarm.plan(load_scenario(None, overrides), RunOptions(tmp_path / "out", bus="memory"))
    swarm.run_in_memory(plan, lambda progress: None)
    with pytest.raises(RecheckError) as caught:
        recheck(tmp_path / "out")
    said = str(caught.value)
    assert said.startswith(
        "r1 and r2 and r3 and r4: not the same again, so what they do follows more than what they are "
        "told, such as a clock, random numbers of their own, the order of a set or id(). "
    )
    faults = re.findall(
        r"/(r\d)\.mcap: step 10: swarm/up/r\d/drive: Drive\.given_up\[0\]\.reason is '(.*?)'; "
        r"recorded was '(.*?)'",
        said,
    )
    assert [robot for robot, _, _ in faults] == ["r1", "r2", "r3", "r4"]
    assert all(now != then for _, now, then in faults)


def test_an_honest_run_is_the_same_again(recorded: Path) -> None:
    again = recheck(recorded)
    assert again.actors == 4 and again.outputs > 120


def test_what_is_checked_is_said(tmp_path: Path) -> None:
    words = ("--bus", "memory", "--robots", 1, "--duration", 1, "--check", "--out", tmp_path / "out")
    done = acrc("run", *words)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"checked: 3 actors replayed, all \d+ messages equal", done.stderr.splitlines()[-1])


def test_it_needs_a_run_that_can_be_executed_again(tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, hardware=True, check=True))
    assert str(caught.value) == (
        "--check: replays a simulated run; cannot be combined with --hardware-in-the-loop"
    )
