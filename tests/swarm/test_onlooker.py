"""Whoever looks on and is slow, or stopped for good, holds nobody up; the view says what it lacks."""

import json
import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

from tests.swarm.command import leftovers, processes_of, run, start

pytest.importorskip("rerun", reason="`./acrc run --view` installs what shows a run")
pytestmark = pytest.mark.alone
WORDS = ("--robots", 2, "--duration", 100, "--no-isolate", "--speed", 20)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return run(tmp_path_factory.mktemp("reference") / "out", *WORDS[:4], "--bus", "memory")


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[tuple[Popen[str], Path, int]]:
    """A run that is looked at and has begun, its folder, and the observer's process."""
    out = tmp_path / "out"
    process = start("run", *WORDS, "--view", "--json", "--out", out)
    try:
        deadline = time.monotonic() + 60.0
        while not grown(out) and time.monotonic() < deadline:
            time.sleep(0.05)
        yield process, out, observer_of(out)
    finally:
        process.kill()


def grown(out: Path) -> bool:
    """The world has taken some dozens of steps."""
    record = out / "world" / "world.mcap"
    return record.exists() and record.stat().st_size > 50_000


def observer_of(out: Path) -> int:
    """The process that writes the view's log."""
    log = str(out / "view.log")
    return next(pid for pid in processes_of(out) if str(Path(f"/proc/{pid}/fd/1").readlink()) == log)


def result_of(process: "Popen[str]", out: Path) -> dict[str, Any]:
    answer, told = process.communicate(timeout=90)
    assert process.returncode == 0, told
    assert processes_of(out) == [] and leftovers(out) == []
    result: dict[str, Any] = json.loads(answer)
    return result


def test_an_observer_that_is_stopped_for_a_while_misses_steps_and_counts_them(
    watched: tuple["Popen[str]", Path, int], undisturbed: dict[str, Any]
) -> None:
    process, out, observer = watched
    os.kill(observer, signal.SIGSTOP)
    time.sleep(3.0)
    before = (out / "world" / "world.mcap").stat().st_size
    time.sleep(0.5)
    assert (out / "world" / "world.mcap").stat().st_size > before, "the world waits for who only looks on"
    os.kill(observer, signal.SIGCONT)
    result = result_of(process, out)
    assert result["digest"] == undisturbed["digest"]
    lacks = re.search(
        r"^the view lacks (\d+) steps that were not received$", (out / "view.log").read_text(), re.M
    )
    assert lacks is not None and 50 <= int(lacks[1]) < 1000


def test_an_observer_that_is_stopped_for_good_is_not_waited_for_and_says_where_the_view_ends(
    watched: tuple["Popen[str]", Path, int], undisturbed: dict[str, Any]
) -> None:
    process, out, observer = watched
    os.kill(observer, signal.SIGSTOP)
    result = result_of(process, out)
    assert result["digest"] == undisturbed["digest"]
    ends = re.search(
        r"^the view ends before step (\d+): what came later was not received$",
        (out / "view.log").read_text(),
        re.M,
    )
    assert ends is not None and 0 < int(ends[1]) < 1000
