"""Runs that end abnormally."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

from actors.runtime.recording import Entry, read_recording
from tests import warm
from tests.swarm.command import ROOT, begin, leftovers, processes_of


def until(true: Callable[[], object], timeout_s: float = 30.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def stepping(out: Path) -> bool:
    recording = out / "world" / "world.mcap"
    return recording.exists() and recording.stat().st_size > 20_000


def process_of(out: Path, actor: str) -> int:
    """Return the process id of an actor, found by its log file."""
    (found,) = [
        pid
        for pid in processes_of(out)
        if str(Path(f"/proc/{pid}/fd/1").readlink()).endswith(f"/{actor}.log")
    ]
    return found


def last_step(path: Path) -> int:
    """Return the step of the last message in a recording, except RadioEvents, which is of the next step."""
    entries = [item for item in read_recording(path) if isinstance(item, Entry)]
    return max(item.step for item in entries if not item.key.endswith("/received"))


def gone(out: Path) -> bool:
    return processes_of(out) == [] and leftovers(out) == []


Acrc = TypeVar("Acrc", warm.ForkedCommand, subprocess.Popen[str])


def started(begins: Callable[..., Acrc], out: Path) -> Acrc:
    corridor = ROOT / "scenarios" / "corridor.toml"
    process = begins("run", corridor, "--robots", 2, "--duration", 100_000, "--speed", 20, "--out", out)
    until(lambda: stepping(out), timeout_s=120.0)  # nothing may be compiled yet
    return process


class Death(NamedTuple):
    """Run that ended because an actor was killed."""

    out: Path
    code: int
    said: str
    lasted_s: float


def killed(out: Path, actor: str) -> Death:
    process = started(begin, out)
    os.kill(process_of(out, actor), signal.SIGKILL)
    died = time.monotonic()
    _, said = process.communicate(timeout=20)
    return Death(out, process.wait(), said, time.monotonic() - died)
