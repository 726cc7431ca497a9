"""Replays of recorded code, each in a process of its own, in a sandbox where the machine has one.

`ask` runs a program and returns its answer, which is untrusted: bytes, bounded, nothing more. Such programs
share `parser` and `answering`. The one here replays one actor:
`python -m acrc_testbed.recordings.sandboxed --out DIR --actor NAME --answer FILE --own DIR`; its answer is a
JSON object.
"""

import os

if __name__ == "__main__":  # an importing process has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import re
import signal
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from io import FileIO
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.recordings.record_replay import Onlook, ReplayReport, replay_actor
from acrc_testbed.recordings.run_recordings import all_recordings, code_folders, run_of, told
from actors.processes.launch import Program, launcher, scratch_folder
from actors.processes.robot_logs import said, show
from actors.robot import assembly
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.foreign import Permit, admitted
from actors.robot.behaviour.loading import look_in
from actors.runtime import failure, prints
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import print_traceback
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import Handover, ProcessLimits, choose, enforce, isolate, warn
from actors.runtime.linux import die_with_parent
from actors.runtime.recording import Reading
from actors.runtime.recording.reading import report_damage
from actors.runtime.replay_bus import ReplayError

_PROGRAM: Final = "acrc_testbed.recordings.sandboxed"
_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes on board that serve devices, which cannot be replayed."""
_SHOWN: Final = 300
"""Last characters of a failed program's log that its fault quotes."""
_FILE_MB: Final = 64
"""Limit of the answer; what the code prints is held to less by `Prints`."""


def check_trust(out: Path, actor: str, permit: Permit) -> tuple[Path, ...] | None:
    """Return the folders that a robot's recorded code may be loaded from; None for world and radio.

    World and radio run this project's code only. Raises AcrcError for code that the permit does not cover,
    and for code that is not here. Warns about code that was recorded without its hashes.
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
    """Warn once that a strategy cannot be compared with the recorded one."""
    warn(f"{place}: was recorded without the hashes of its strategy's modules, which may be others here")


@dataclass(frozen=True)
class Bounds:
    """Limits of one program."""

    most_bytes: int
    """Of its answer."""
    least_s: float = 120.0
    """Timeout, kernels included ..."""
    bytes_per_s: float = 4096.0
    """... plus a second for so many bytes of recordings: half of what a simulated second has, so that a run
    slower than real time can be replayed, too."""


class ProgramOutput(NamedTuple):
    """Result of a program: data or a fault."""

    data: bytes | None
    fault: str | None
    """A sentence that begins with the actor."""
    said: str
    """The end of what its code printed."""


def ask(
    out: Path, module: str, actor: str, words: Sequence[str], bounds: Bounds, *, permit: Permit, isolate: bool
) -> ProgramOutput:
    """Run a program with a robot's recorded code; `words`: further arguments.

    `isolate`: see `actors.runtime.isolation.sandbox`. Raises AcrcError for code that the permit does not
    cover.
    """
    folders = check_trust(out, actor, permit)
    if folders is None:
        raise AcrcError(f"{actor}: is no robot")
    patience_s = bounds.least_s + all_recordings(out)[actor].stat().st_size / bounds.bytes_per_s
    with scratch_folder() as home, launcher("exec") as launched:
        stage = home / actor
        (stage / "own").mkdir(parents=True)
        argv = (
            *("--out", str(out.resolve()), "--actor", actor, *words),
            *(word for folder in folders for word in ("--path", str(folder))),
            *(("--any-content",) if permit.trust else ()),
            *(("--isolate",) if isolate else ()),
            *("--answer", str(stage / "answer"), "--own", str(stage / "own")),
        )
        program = Program(actor, module, argv, stage / f"{actor}.log", None)
        child, deadline = launched.start(program), time.monotonic() + patience_s
        while child.exit_code is None and time.monotonic() < deadline:
            launched.wait(0.5)
        is_late = child.exit_code is None
        while child.exit_code is None:
            child.send(signal.SIGKILL)
            launched.wait(0.5)
        data = b""
        with suppress(OSError), (stage / "answer").open("rb") as file:
            data = file.read(bounds.most_bytes + 1)
        printed, fault = said(program), None
        if is_late:
            fault = (
                f"could not be replayed: what it runs has not ended after {patience_s:.0f} s, and was ended"
            )
        elif len(data) > bounds.most_bytes:
            fault = f"answers with more than {bounds.most_bytes} bytes"
        elif not data or child.exit_code != 0:
            last = " ".join(printed.split())[-_SHOWN:]
            why = f"exit code {child.exit_code}" + (f"; the last that it said: {last}" if last else "")
            fault = f"could not be replayed ({why})"
        return (
            ProgramOutput(None, f"{actor}: {fault}", printed) if fault else ProgramOutput(data, None, printed)
        )


BOUNDS: Final = Bounds(1 << 16)
"""Of a replay: a difference between two messages is one sentence that quotes both."""


class ReplayAnswer(msgspec.Struct, frozen=True):
    """ProgramOutput of a replay: one of the two."""

    report: ReplayReport | None = None
    fault: str | None = None


def replay(
    out: Path, actor: str, *, permit: Permit, isolate: bool | None, bounds: Bounds = BOUNDS
) -> ReplayReport:
    """Replay one actor; a robot in a sandbox, where the machine has one and `isolate` lets it.

    Raises AcrcError for a robot whose recording names code that the permit does not cover; ReplayError at the
    first output that differs.
    """
    folders = check_trust(out, actor, permit)
    if folders is None:
        return replay_actor(out, actor)
    choice = choose(isolate)
    warn(choice.warning)
    if isolate is False:
        look_in(folders, any_content=permit.trust)
        return replay_actor(out, actor)  # in this process, where a debugger may be
    report_damage(all_recordings(out)[actor])
    outcome = ask(out, _PROGRAM, actor, (), bounds, permit=permit, isolate=choice.isolate)
    show(outcome.said)
    fault = outcome.fault
    if outcome.data is not None:
        try:
            answer = msgspec.json.decode(outcome.data, type=ReplayAnswer)
        except (ValueError, RecursionError):
            raise ReplayError(f"{actor}: what it answers makes no sense") from None
        if answer.report is not None:
            return answer.report
        fault = printable(answer.fault or "")
    raise ReplayError(fault or f"{actor}: nothing was answered")


def parser(program: str) -> ArgumentParser:
    """Return the parser of the arguments that all programs have; `program` is the module."""
    options = ArgumentParser(prog=f"python -m {program}")
    for name in ("--out", "--answer", "--own"):
        options.add_argument(name, type=Path, required=True)
    options.add_argument("--actor", required=True)
    options.add_argument("--path", type=Path, action="append", default=[], help="folder with code")
    options.add_argument("--any-content", action="store_true", help="accept code other than the recorded")
    options.add_argument("--isolate", action="store_true")
    return options


@contextmanager
def answering(options: Namespace, file_mb: int) -> Iterator[FileIO]:
    """Open the new file for the answer, then enter the sandbox if `--isolate` is given.

    The process ends with its parent, and no file that it writes becomes larger than `file_mb`. Raises OSError
    where the file exists already, or cannot be made.
    """
    Reading.reports = False
    with options.answer.open("xb", buffering=0) as answer:
        parent = os.getppid()
        assembly.kernels()  # while their cache can still be written
        if options.isolate:
            view = file_view(options.own, (options.own.parent,), (options.out,), options.path)
            isolate(lambda: Handover(view), (1, 2, answer.fileno()), parent=parent)
            os.chdir(options.own)
        else:
            die_with_parent(parent)
        failure.hold(options.own)
        look_in(options.path, any_content=options.any_content)
        enforce(ProcessLimits(file_mb=file_mb), isolated=options.isolate)
        yield answer


def bug(actor: str, error: Exception) -> str:
    """Return the answer where the code failed; the traceback goes to the log, if that has room."""
    failure.release()
    print_traceback(error)
    return f"{actor}: {type(error).__name__}: {error}"


def write_whole(answer: FileIO, data: bytes) -> None:
    """Write all of it, however much a single call takes. OSError beyond what a file may have."""
    left = memoryview(data)
    while left:
        left = left[answer.write(left) :]


def main(argv: Sequence[str]) -> int:
    """Replay one actor and write the answer; return the exit code."""
    options = parser(_PROGRAM).parse_args(argv)
    with answering(options, _FILE_MB) as answer:
        try:
            onlook = Onlook(prints=partial(prints.on, sys.stdout))
            told = ReplayAnswer(report=replay_actor(options.out, options.actor, onlook))
        except AcrcError as error:
            told = ReplayAnswer(fault=str(error))
        except Exception as error:
            told = ReplayAnswer(fault=bug(options.actor, error))
        answer.write(msgspec.json.encode(told))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
