"""The check of endings: what it does follows from its seed, and a handful of it, fixed."""

import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from benchmarks.swarm.endings_trial import MODES, Ending, EndingDeed, EndingsTask, attempt, deed, run_words
from tests.swarm.command import run

TASK = EndingsTask(simulated=8.0, speed=4.0, patience=90.0)


def test_what_is_done_follows_from_the_seed_and_covers_everything() -> None:
    deeds = [deed(number, TASK) for number in range(300)]
    assert deeds == [deed(number, TASK) for number in range(300)]
    assert deeds != [deed(number, EndingsTask(seed=2)) for number in range(300)]
    assert set(Counter(one.mode for one in deeds)) == set(MODES)
    victims = {one.victim for one in deeds if one.number is signal.SIGSTOP}
    assert victims == {"acrc", "forkserver", "world", "radio", "r1", "r2", "all"}
    assert all((5 <= one.hold <= 60) == (one.number is signal.SIGSTOP) for one in deeds)


@pytest.fixture(scope="module")
def digest(tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    words = run_words(out, "forkserver", TASK)
    given: str = run(out, *words[1 : words.index("--json")], "--no-isolate")["digest"]
    return given


@pytest.mark.parametrize(
    ("one", "came"),
    [
        (EndingDeed("isolated", signal.SIGSTOP, "all", 2.0, 2.0), "went on"),
        (EndingDeed("exec", signal.SIGKILL, "forkserver", 1.0, 0.0), "ended"),
        (EndingDeed("exec", signal.SIGKILL, "acrc", 0.8, 0.0), "ended"),
        (EndingDeed("forkserver", signal.SIGINT, "acrc", 0.6, 0.0), "ended"),
    ],
)
def test_an_ending_leaves_nothing_and_is_named(
    digest: str, one: EndingDeed, came: str, tmp_path: Path
) -> None:
    ending = attempt(one, TASK, digest)
    assert ending == Ending(one, came, (), ending.said)


def test_also_a_check_that_ignores_signals_starts_runs_that_do_not() -> None:
    shown = "import signal; print(signal.getsignal(signal.SIGINT), repr(signal.getsignal(signal.SIGHUP)))"
    program = (
        "import signal, subprocess, sys; from benchmarks.swarm import endings\n"
        "for number in (signal.SIGINT, signal.SIGHUP): signal.signal(number, signal.SIG_IGN)\n"
        "endings._obeyed_by_children()\n"
        f"subprocess.run([sys.executable, '-S', '-c', {shown!r}])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "default_int_handler" in done.stdout and "SIG_DFL" in done.stdout
