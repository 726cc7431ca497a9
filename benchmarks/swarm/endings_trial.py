"""One run that is ended, or held, at a random instant; and what came of it."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import process_table
from benchmarks.statistics.commands import ACRC, answer

MODES: Final = {
    "forkserver": ("--no-isolate",),
    "exec": ("--spawn", "exec", "--no-isolate"),
    "isolated": ("--isolate",),
}
"""How a run is started, by its name in the table."""
SWARM: Final = ("world", "radio", "r1", "r2")
DEEDS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGSTOP)
_FORKSERVER: Final = "forkserver"
_ALL: Final = "all"
_PARENT: Final = "acrc"


@dataclass(frozen=True)
class EndingsTask:
    """What is tried."""

    count: int = 200
    seed: int = 1
    shortest_stop: float = 5.0
    longest_stop: float = 60.0
    """s for which a process is stopped."""
    window: float = 8.0
    """The deed comes within so many s of the start, or as soon as its victim is there: own choice, about what
    a run takes."""
    simulated: float = 24.0
    speed: float = 6.0
    """Simulated time, s, and how fast: so that a run lasts long enough to be hit."""
    patience: float = 240.0
    """After so long a run counts as hung, s."""


class EndingDeed(NamedTuple):
    """What is done to a run."""

    mode: str
    number: signal.Signals
    victim: str
    """acrc, forkserver, an actor, or all."""
    at: float
    """s after the start."""
    hold: float
    """s for which it is stopped; 0 for every other signal."""


class Ending(NamedTuple):
    """What came of it."""

    deed: EndingDeed
    came: str
    """ended, went on, or missed: the run was over, or its victim not there yet."""
    faults: tuple[str, ...]
    """What should not be: a wrong word, something left, a recording that does not pass its check."""
    said: str


def deed(number: int, task: EndingsTask) -> EndingDeed:
    """The n-th deed; it follows from the task's seed.

    The first ones are a run, started in each way, that is stopped as a whole for as long as any is.
    """
    if number < len(MODES):
        return EndingDeed(tuple(MODES)[number], signal.SIGSTOP, _ALL, task.window / 2, task.longest_stop)
    draw = random.Random(f"{task.seed} {number}")
    what = draw.choice(DEEDS)
    anyone = (_PARENT, _FORKSERVER, *SWARM)
    victims = {signal.SIGSTOP: (*anyone, _ALL), signal.SIGKILL: anyone, signal.SIGTERM: (_PARENT, *SWARM)}
    hold = draw.uniform(task.shortest_stop, task.longest_stop) if what is signal.SIGSTOP else 0.0
    victim = draw.choice(victims.get(what, (_PARENT,)))
    return EndingDeed(draw.choice(list(MODES)), what, victim, draw.uniform(0.0, task.window), hold)


def run_words(out: Path, mode: str, task: EndingsTask) -> list[str]:
    """The command line of the run that it is done to."""
    words = ("--robots", "2", "--duration", f"{task.simulated}", "--speed", f"{task.speed}", "--json")
    return ["run", *words, *MODES[mode], "--out", str(out)]


def attempt(one: EndingDeed, task: EndingsTask, digest: str) -> Ending:
    """Start a run, do it, and look at what is left; a run that goes on must have this digest."""
    folder = Path(tempfile.mkdtemp(prefix="acrc-"))
    out = folder / "out"
    try:
        process = subprocess.Popen(
            [*ACRC, *run_words(out, one.mode, task)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=REPOSITORY,
        )
        time.sleep(one.at)
        hit = _do(one, process, out)
        try:
            answer, said = process.communicate(timeout=task.patience)
        except subprocess.TimeoutExpired:
            process.kill()
            said = process.communicate()[1]
            return Ending(one, "hung", ("hung",), said)
        came = "missed" if not hit else "went on" if process.returncode == 0 else "ended"
        faults = [*_wrong_words(one, came, process.returncode, said), *_left(out), *_unchecked(out)]
        if came != "ended" and json.loads(answer)["digest"] != digest:
            faults.append("another digest")
        return Ending(one, came, tuple(faults), said.strip())
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def actor_of(pid: int, out: Path) -> str:
    """Which actor of the run in `out` a process is; empty for none."""
    try:
        log = (Path("/proc") / str(pid) / "fd" / "1").readlink()
    except OSError:
        return ""
    return log.stem if log.is_relative_to(out) else ""


def _do(one: EndingDeed, process: "subprocess.Popen[str]", out: Path) -> bool:
    """Do it to whoever is there; False if the run ends before anybody is."""
    chosen: list[int] = []
    while not chosen:
        if process.poll() is not None:
            return False
        family = process_table.descendants((process.pid,), process_table.table())
        chosen = [pid for pid in family if one.victim in (_ALL, _role(pid, process.pid, out))]
        time.sleep(0.05)
    _send(one.number, chosen)
    if one.hold:
        time.sleep(one.hold)
        _send(signal.SIGCONT, chosen)
    return True


def _send(number: signal.Signals, pids: Sequence[int]) -> None:
    """To each of them that is still there: some of a run's processes live for a moment only."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def _role(pid: int, parent: int, out: Path) -> str:
    if pid == parent:
        return _PARENT
    try:
        command = (Path("/proc") / str(pid) / "cmdline").read_bytes()
    except OSError:
        return ""
    actor = actor_of(pid, out)
    return actor or (_FORKSERVER if b"actors.processes.forkserver" in command else "")


def _wrong_words(one: EndingDeed, came: str, code: int, said: str) -> Sequence[str]:
    """Whether exit code and last line say what was done."""
    last = said.strip().splitlines()[-1] if said.strip() else ""
    if came != "ended":
        return () if code == 0 else (f"exit code {code}: {last}",)
    if one.number is signal.SIGSTOP:
        return (f"did not go on: {last}",)
    if one.victim == _PARENT:
        due = -one.number if one.number is signal.SIGKILL else 128 + one.number
        # A signal may come before anything is looked after, and then just ends the process.
        return () if code in (due, -one.number) else (f"exit code {code} instead of {due}: {last}",)
    named = one.victim in last and (one.number.name in last or f"exit code {128 + one.number}" in last)
    return () if code == 1 and named else (f"exit code {code}, cause not named: {last}",)


def _left(out: Path) -> Sequence[str]:
    """Processes, sockets and passwords that are still there after a while."""
    deadline = time.monotonic() + 10.0
    while (found := _present(out)) and time.monotonic() < deadline:
        time.sleep(0.1)
    return found


def _present(out: Path) -> list[str]:
    found = [f"process {actor_of(pid, out)} left" for pid in process_table.table() if actor_of(pid, out)]
    if not out.is_dir():
        return found
    files = (path for path in out.rglob("*") if path.is_socket() or "credentials" in path.name)
    return [*found, *(f"{path.name} left" for path in files)]


def _unchecked(out: Path) -> Sequence[str]:
    """Whether `acrc record check` refuses what was recorded, if anything was."""
    if not any(out.glob("*/*.mcap")):
        return ()
    try:
        answer("record", "check", str(out))
    except AcrcError as error:
        return (str(error),)
    return ()
