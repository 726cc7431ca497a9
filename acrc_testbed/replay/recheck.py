"""A run executed once more from its recordings, each actor in a new process with another hash seed.

What follows more than what it is told differs there: a clock, random numbers of its own, the order of a set,
an id(). `python -m acrc_testbed.replay.recheck N DIR… OUT ACTOR…`, with N folders for modules, writes a line
of JSON for each actor.
"""

import importlib
import os
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.replay.record_check import check
from acrc_testbed.replay.record_replay import replay_actor
from acrc_testbed.replay.run_recordings import all_recordings
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.loading import look_in
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import failure
from actors.runtime.lifecycle.linux import die_with_parent
from actors.runtime.lifecycle.process_table import passed_on

_LONGEST: Final = 2000
"""Characters of a fault; a pipe holds more."""


class RecheckError(AcrcError):
    """A run that does not come out the same again."""


class RecheckedActor(msgspec.Struct, frozen=True):
    """What came of one actor."""

    actor: str
    outputs: int = 0
    """Messages that it sent again, all equal."""
    fault: str | None = None
    """Why it did not do again what it did."""


@dataclass(frozen=True)
class Recheck:
    """A run that came out the same."""

    actors: int
    outputs: int
    """Messages sent again, over all actors."""


def recheck(out: Path, modules: Sequence[Path] = ()) -> Recheck:
    """Compare a run's recordings, and replay every actor; RecheckError, with everyone's fault.

    `modules`: the folders that the run's own strategy was loaded from.
    """
    check(out)
    actors = tuple(all_recordings(out))
    words = (*map(str, modules), str(out), *actors)
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "acrc_testbed.replay.recheck", str(len(modules)), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        cwd=REPOSITORY,
        env=passed_on(os.environ) | {"PYTHONHASHSEED": other},
    ) as process:
        assert process.stdout is not None
        try:
            told = [msgspec.json.decode(line, type=RecheckedActor) for line in process.stdout]
        except BaseException:
            process.kill()
            raise
    if len(told) != len(actors):
        raise RecheckError(
            f"{out}: could not be replayed: the process for it has ended with exit code "
            f"{process.returncode}; what it said stands above"
        )
    told.sort(key=lambda one: actors.index(one.actor))
    faults = {one.actor: one.fault for one in told if one.fault is not None}
    if faults:
        raise RecheckError(
            f"{' and '.join(faults)}: not the same again, so what they do follows more than what they are "
            "told, such as a clock, random numbers of their own, the order of a set or id(). "
            + "; ".join(faults.values())
        )
    return Recheck(len(told), sum(one.outputs for one in told))


def main(argv: Sequence[str]) -> int:
    """Execute the actors again, as many at a time as there are processors."""
    die_with_parent(os.getppid())
    count, *words = argv
    look_in([Path(folder) for folder in words[: int(count)]])
    out, *actors = words[int(count) :]
    importlib.import_module("actors.processes.preload")
    for again in _all(Path(out), actors):
        sys.stdout.write(msgspec.json.encode(again).decode() + "\n")
        sys.stdout.flush()
    return 0


def _all(out: Path, actors: Sequence[str]) -> Iterator[RecheckedActor]:
    waiting, running = deque(actors), dict[int, tuple[str, int]]()
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            actor = waiting.popleft()
            pid, pipe = _start(out, actor)
            running[pid] = (actor, pipe)
        pid, status = os.wait()
        if pid not in running:
            continue  # left behind by what a strategy has started
        actor, pipe = running.pop(pid)
        with os.fdopen(pipe, "rb") as said:
            text = said.read(1 << 16) if status == 0 else b""
        code = os.waitstatus_to_exitcode(status)
        ended = RecheckedActor(actor, fault=f"{actor}: its process has ended with exit code {code}")
        yield msgspec.json.decode(text, type=RecheckedActor) if text else ended


def _start(out: Path, actor: str) -> tuple[int, int]:
    """A process of its own for one actor, and where its answer can be read."""
    mine, theirs = os.pipe()
    parent = os.getpid()
    pid = os.fork()
    if pid:
        os.close(theirs)
        return pid, mine
    code = 1
    try:
        die_with_parent(parent)
        failure.hold(Path(tempfile.gettempdir()))
        os.dup2(2, 1)  # what a strategy prints is no answer
        os.write(theirs, msgspec.json.encode(_again(out, actor)))
        code = 0
    finally:
        os._exit(code)


def _again(out: Path, actor: str) -> RecheckedActor:
    try:
        return RecheckedActor(actor, replay_actor(out, actor).outputs)
    except AcrcError as error:
        return RecheckedActor(actor, fault=str(error)[:_LONGEST])
    except Exception as error:  # a strategy that takes another way may fail there
        failure.release()
        return RecheckedActor(actor, fault=f"{actor}: {type(error).__name__}: {error}"[:_LONGEST])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
