"""A slow or stopped observer does not delay a run; the view reports missing steps."""

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

pytest.importorskip("rerun", reason="`./acrc run --view` installs rerun")
pytestmark = pytest.mark.nightly
WORDS = ("--robots", 2, "--duration", 100, "--no-isolate", "--speed", 20)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return run(tmp_path_factory.mktemp("reference") / "out", *WORDS[:4], "--bus", "memory")


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[tuple[Popen[str], Path, int]]:
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
    record, view = out / "world" / "world.mcap", out / "view.rrd"
    return record.exists() and record.stat().st_size > 50_000 and view.exists() and view.stat().st_size > 0


def observer_of(out: Path) -> int:
    log = str(out / "view.log")
    return next(pid for pid in processes_of(out) if str(Path(f"/proc/{pid}/fd/1").readlink()) == log)


def result_of(process: "Popen[str]", out: Path) -> dict[str, Any]:
    answer, errors = process.communicate(timeout=90)
    assert process.returncode == 0, errors
    assert processes_of(out) == [] and leftovers(out) == []
    result: dict[str, Any] = json.loads(answer)
    return result


def test_a_stopped_observer_delays_no_run_and_reports_missing_steps(
    watched: tuple["Popen[str]", Path, int], undisturbed: dict[str, Any]
) -> None:
    process, out, observer = watched
    os.kill(observer, signal.SIGSTOP)
    time.sleep(3.0)
    before = (out / "world" / "world.mcap").stat().st_size
    time.sleep(0.5)
    assert (out / "world" / "world.mcap").stat().st_size > before, "the world waits for the observer"
    result = result_of(process, out)
    assert result["digest"] == undisturbed["digest"]
    ends = re.search(
        r"^the view ends at ([\d.]+) s; (\d+) later steps are not included$",
        (out / "view.log").read_text(),
        re.M,
    )
    assert ends is not None and int(ends[2]) > 100
    assert round(float(ends[1]) * 10) + int(ends[2]) in (999, 1000)
