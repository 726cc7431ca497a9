"""Runs that are killed, stopped or signalled at random instants end, or continue, as they should."""

import json
import os
import random
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pytest

from acrc_testbed.recordings import record_check
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.swarm.command import leftovers, processes_of, start

MODES = {
    "forkserver": ("--no-isolate",),
    "exec": ("--spawn", "exec", "--no-isolate"),
    "isolated": ("--isolate",),
}
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGSTOP)
PARENT, FORKSERVER, ALL = "acrc", "forkserver", "all"
ACTORS = ("world", "radio", "r1", "r2")
SIMULATED_S, SPEED, PATIENCE_S = 24.0, 6.0, 240.0
"""A run of at least 4 s, and the time after which it counts as hung."""
WITHIN_S = 8.0
"""The disturbance comes within this time of the start, or as soon as its victim exists."""


class LineNoise(NamedTuple):
    mode: str
    number: signal.Signals
    victim: str
    at_s: float
    hold_s: float = 0.0
    """Time for which SIGSTOP holds."""


def drawn(number: int) -> LineNoise:
    """Return a disturbance; the first three stop a whole run for a minute in each mode, others are random."""
    if number < len(MODES):
        return LineNoise(tuple(MODES)[number], signal.SIGSTOP, ALL, WITHIN_S / 2, 60.0)
    draw = random.Random(f"1 {number}")
    what = draw.choice(SIGNALS)
    victims = {
        signal.SIGSTOP: (PARENT, FORKSERVER, *ACTORS, ALL),
        signal.SIGKILL: (PARENT, FORKSERVER, *ACTORS),
        signal.SIGTERM: (PARENT, *ACTORS),
    }
    victim = draw.choice(victims.get(what, (PARENT,)))
    hold_s = draw.uniform(5.0, 60.0) if what is signal.SIGSTOP else 0.0
    return LineNoise(draw.choice(list(MODES)), what, victim, draw.uniform(0.0, WITHIN_S), hold_s)


def outcome(one: LineNoise, out: Path, digest: str) -> tuple[str, list[str]]:
    """Disturb a run: `ended`, `continued`, `missed` (it was over) or `hung`, and what was wrong."""
    words = ("--robots", 2, "--duration", SIMULATED_S, "--speed", SPEED, "--json", "--out", out)
    process = start("run", *words, *MODES[one.mode])
    time.sleep(one.at_s)
    victims: list[int] = []
    while not victims and process.poll() is None:
        family = process_table.descendants((process.pid,), process_table.processes())
        victims = [pid for pid in family if one.victim in (ALL, role(pid, process.pid, out))]
        time.sleep(0.05)
    send(one.number, victims)
    if one.hold_s and victims:
        time.sleep(one.hold_s)
        send(signal.SIGCONT, victims)
    try:
        answer, said = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return "hung", ["hung"]
    how = "missed" if not victims else "continued" if process.returncode == 0 else "ended"
    faults = [*wrong_end(one, how, process.returncode, said), *left(out)]
    if how != "ended" and json.loads(answer)["digest"] != digest:
        faults.append("another digest")
    try:
        if any(out.glob("*/*.mcap")):
            record_check.check_run(out)
    except AcrcError as error:
        faults.append(str(error))
    return how, faults


def send(number: signal.Signals, pids: list[int]) -> None:
    for pid in pids:
        with suppress(ProcessLookupError):  # some processes of a run are short-lived
            os.kill(pid, number)


def role(pid: int, parent: int, out: Path) -> str:
    if pid == parent:
        return PARENT
    try:
        log = (Path("/proc") / str(pid) / "fd" / "1").readlink()
        command = (Path("/proc") / str(pid) / "cmdline").read_bytes()
    except OSError:
        return ""
    if log.is_relative_to(out):
        return log.stem
    return FORKSERVER if b"actors.processes.forkserver" in command else ""


def wrong_end(one: LineNoise, how: str, code: int, said: str) -> Iterator[str]:
    """Exit code and last line must name the cause."""
    last = said.strip().splitlines()[-1] if said.strip() else ""
    if how != "ended":
        if code != 0:
            yield f"exit code {code}: {last}"
    elif one.number is signal.SIGSTOP:
        yield f"did not continue: {last}"
    elif one.victim == PARENT:
        due = -one.number if one.number is signal.SIGKILL else 128 + one.number
        if code not in (due, -one.number):  # a signal may come before its handler is installed
            yield f"exit code {code} instead of {due}: {last}"
    elif code != 1 or one.victim not in last:
        yield f"exit code {code}, cause not named: {last}"
    elif one.number.name not in last and f"exit code {128 + one.number}" not in last:
        yield f"signal not named: {last}"


def left(out: Path) -> list[str]:
    deadline = time.monotonic() + 10.0
    while (
        found := [*map(str, processes_of(out)), *map(str, leftovers(out))]
    ) and time.monotonic() < deadline:
        time.sleep(0.1)
    return [f"left: {one}" for one in found]


@pytest.fixture(scope="module")
def digest(tmp_path_factory: pytest.TempPathFactory) -> str:
    options = RunOptions(tmp_path_factory.mktemp("undisturbed") / "out", bus="memory")
    plan = swarm.plan(load_scenario(None, Overrides(robots=2, duration=SIMULATED_S)), options)
    return swarm.run_in_memory(plan, lambda progress: None).digest


@pytest.mark.claim("endings")
@pytest.mark.parametrize(
    ("one", "how"),
    [
        (LineNoise("isolated", signal.SIGSTOP, ALL, 2.0, 2.0), "continued"),
        (LineNoise("exec", signal.SIGKILL, FORKSERVER, 1.0), "ended"),
    ],
)
def test_a_stopped_run_continues_and_one_without_its_forkserver_ends(
    digest: str, one: LineNoise, how: str, tmp_path: Path
) -> None:
    assert outcome(one, tmp_path / "out", digest) == (how, [])


@pytest.mark.claim("endings")
@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_random_disturbances_leave_nothing_behind(
    digest: str, full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    count = 200 if full else 4
    disturbances = [drawn(number + (0 if full else len(MODES))) for number in range(count)]
    with ThreadPoolExecutor(4) as pool:
        found = list(
            pool.map(lambda each: outcome(each[1], tmp_path / str(each[0]), digest), enumerate(disturbances))
        )
    record_property("runs", count)
    record_property("outcomes", dict(Counter(how for how, _ in found)))
    wrong = [(one, faults) for one, (_, faults) in zip(disturbances, found, strict=True) if faults]
    assert wrong == []
