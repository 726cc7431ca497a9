"""Programs that replay recorded code in a sandbox: started, waited for, heard out, and ended in any case.

What they answer is bytes, and whoever's code ran wrote them: nothing is said of these here but that they are
not too many.
"""

import os
import re
import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from acrc_testbed.replay.run_recordings import all_recordings, code_folders, run_of, told
from actors.processes.launch import Child, Launcher, Program, launcher, scratch_folder
from actors.processes.robot_logs import said
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.foreign import Permit, admitted
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import warn

_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes on board that serve devices: no program replays those."""


def check_trust(out: Path, actor: str, permit: Permit) -> tuple[Path, ...] | None:
    """The folders that a robot's recorded code may be looked for in; None for world and radio.

    They run no code but this project's. Raises AcrcError for code that the permit does not cover, and
    AcrcError for code that is not here. Code that was recorded without its hashes is said to be so.
    """
    files = all_recordings(out)
    if actor in files and _ON_DEVICES.search(actor):
        raise ReplayError(f"{actor}: is a process with devices on board; must be a robot, world or radio")
    if actor not in files or actor in {"world", "radio"}:
        return None
    run = run_of(files[actor])
    entry = told(files[actor], run, RobotSetup, "a robot").behaviour
    folders = admitted(files[actor], entry, code_folders(out), permit)
    if folders and run.code is None and not permit.trust:
        say_unhashed(files[actor])
    return folders


@cache
def say_unhashed(place: Path) -> None:
    """Say once on standard error that nobody can tell whether a strategy is the recorded one."""
    warn(f"{place}: was recorded without the hashes of its strategy's modules, which may be others here")


_SHOWN: Final = 300
"""Characters of what a program said before it failed."""


@dataclass(frozen=True)
class Bounds:
    """What such a program may take."""

    most_bytes: int
    """Of its answer."""
    least_s: float = 120.0
    """So long it is waited for at least, kernels included ..."""
    bytes_per_s: float = 4096.0
    """... and a second longer for so many bytes of recordings: half of what a simulated second has, so that
    even what is slower than real time comes to its end."""


@dataclass(frozen=True)
class Call:
    """What one program is to do."""

    name: str
    """Of whom it is about; no two calls have the same."""
    actors: Sequence[str]
    """Whose recorded code it runs."""
    words: Sequence[str] = ()
    """What it is told beside that."""


@dataclass(frozen=True)
class CallOutcome:
    """What came of a call: one of the two."""

    name: str
    data: bytes | None = None
    fault: str | None = None
    """A sentence that begins with the name."""
    said: str = ""
    """The end of what its code printed."""


class CallError(AcrcError):
    """A program that cannot be called."""


def ask(
    out: Path, module: str, calls: Sequence[Call], bounds: Bounds, *, permit: Permit, isolate: bool
) -> Iterator[CallOutcome]:
    """Call a program (see `sandboxed`) with each, as many at a time as there are processors.

    Answers come as they are there. Of code that the permit does not cover it is a fault: it was not run.
    `isolate`: see `actors.runtime.isolation.sandbox`.
    """
    spawn = "forkserver" if len(calls) > 1 else "exec"
    with scratch_folder() as home, launcher(spawn) as launched:
        waiting, running = deque(calls), list[_Running]()
        while waiting or running:
            while waiting and len(running) < (os.cpu_count() or 1):
                call = waiting.popleft()
                try:
                    words = program_words(out, call, permit=permit, isolate=isolate)
                    patience_s = _patience(out, call, bounds)
                    child = start(launched, module, home, call, words)
                    running.append(
                        _Running(child, home / call.name, patience_s, time.monotonic() + patience_s)
                    )
                except AcrcError as error:
                    yield CallOutcome(call.name, fault=str(error))
            ended = [one for one in running if one.over()]
            for one in ended:
                running.remove(one)
                yield one.answer(launched, bounds)
            if running and not ended:
                launched.wait(0.5)


def program_words(out: Path, call: Call, *, permit: Permit, isolate: bool) -> tuple[str, ...]:
    """What the program is told. Raises an AcrcError for code that must not run."""
    code: dict[Path, None] = {}
    for actor in call.actors:
        folders = check_trust(out, actor, permit)
        if folders is None:
            raise CallError(f"{actor}: is no robot")
        code |= dict.fromkeys(folders)
    return (
        *("--out", str(out.resolve()), "--actor", call.name, *call.words),
        *(word for folder in code for word in ("--path", str(folder))),
        *(("--any-content",) if permit.trust else ()),
        *(("--isolate",) if isolate else ()),
    )


def _patience(out: Path, call: Call, bounds: Bounds) -> float:
    files = all_recordings(out)
    size = sum(files[actor].stat().st_size for actor in call.actors)
    return bounds.least_s + size / bounds.bytes_per_s


def start(launched: Launcher, module: str, home: Path, call: Call, words: tuple[str, ...]) -> Child:
    """The program's process, in a folder of the call's name in `home`, where its `answer` will be."""
    stage = home / call.name
    (stage / "own").mkdir(parents=True)
    argv = (*words, "--answer", str(stage / "answer"), "--own", str(stage / "own"))
    return launched.start(Program(call.name, module, argv, stage / f"{call.name}.log", None))


def failed(child: Child) -> str:
    """Why a program has left no answer, in a sentence."""
    last = " ".join(said(child.program).split())[-_SHOWN:]
    why = f"exit code {child.exit_code}" + (f"; the last that it said: {last}" if last else "")
    return f"{child.program.actor}: could not be replayed ({why})"


@dataclass(frozen=True)
class _Running:
    child: Child
    stage: Path
    patience_s: float
    deadline: float

    def over(self) -> bool:
        """True once it has ended, or should have."""
        return self.child.exit_code is not None or time.monotonic() > self.deadline

    def answer(self, launched: Launcher, bounds: Bounds) -> CallOutcome:
        """What it left; it is ended, if it has not."""
        name, hung = self.child.program.actor, self.child.exit_code is None
        while self.child.exit_code is None:
            self.child.send(signal.SIGKILL)
            launched.wait(0.5)
        if hung:
            why = f"what it runs has not ended after {self.patience_s:.0f} s, and was ended"
            return self._answered(fault=f"{name}: could not be replayed: {why}")
        data = b""
        with suppress(OSError), (self.stage / "answer").open("rb") as file:
            data = file.read(bounds.most_bytes + 1)
        with suppress(OSError):
            (self.stage / "answer").unlink()
        if len(data) > bounds.most_bytes:
            return self._answered(fault=f"{name}: answers with more than {bounds.most_bytes} bytes")
        if data and self.child.exit_code == 0:
            return self._answered(data)
        return self._answered(fault=failed(self.child))

    def _answered(self, data: bytes | None = None, fault: str | None = None) -> CallOutcome:
        program = self.child.program
        return CallOutcome(program.actor, data, fault, said(program))
