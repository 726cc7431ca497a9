"""Replay of recorded code in a separate process, sandboxed where the machine supports it.

`run_program` runs a program and returns its answer: untrusted bytes of limited size. Such programs share
`argument_parser` and `open_answer`. The program of this module replays one actor and answers with a JSON
object:
`python -m acrc_testbed.recordings.sandboxed_replay --out DIR --actor NAME --answer FILE --own DIR`.
"""

import os

if __name__ == "__main__":  # not in an importing process
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

from acrc_testbed.recordings.record_replay import ReplayOptions, ReplayReport, replay_actor
from acrc_testbed.recordings.run_recordings import all_recordings, code_folders, decode_setup, read_run_note
from actors.processes.launcher import Program, create_launcher, scratch_folder
from actors.processes.robot_logs import print_output, program_output
from actors.robot import assembly
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.runtime import captured_output, failure
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import print_traceback
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import (
    ProcessLimits,
    SandboxSetup,
    choose_isolation,
    enforce_limits,
    isolate,
    print_warning,
)
from actors.runtime.linux import die_with_parent
from actors.runtime.recording import RecordingReader
from actors.runtime.recording.reader import report_damage
from actors.runtime.replay_bus import ReplayError
from actors.user_code import set_folders

_PROGRAM: Final = "acrc_testbed.recordings.sandboxed_replay"
_ON_DEVICES: Final = re.compile(r"\.(base|radio)(\.|$)")
"""Processes that serve devices of a real robot; they cannot be replayed."""
_MAX_QUOTE: Final = 300
"""Length of the quote from a failed program's log, characters."""
_FILE_MB: Final = 64
"""Limit of the answer; `CapturedOutput` limits printed output to less."""


def check_trust(out: Path, actor: str, permit: Permit) -> tuple[Path, ...] | None:
    """Return the folders that a robot's recorded code may be loaded from; None for world and radio.

    World and radio run only code of this project. Raises AcrcError for code that is missing or not permitted.
    Warns about code that was recorded without hashes.
    """
    files = all_recordings(out)
    if actor in files and _ON_DEVICES.search(actor):
        raise ReplayError(f"{actor}: serves devices and cannot be replayed; give a robot, world or radio")
    if actor not in files or actor in {"world", "radio"}:
        return None
    run = read_run_note(files[actor])
    entry = decode_setup(files[actor], run, RobotSetup, "a robot").behaviour
    folders = permitted_folders(files[actor], entry, code_folders(out), permit)
    if folders and run.code is None and not permit.trust:
        warn_about_missing_hashes(files[actor])
    return folders


@cache
def warn_about_missing_hashes(path: Path) -> None:
    """Warn once that the strategy's code cannot be compared with the recorded one."""
    print_warning(f"{path}: recorded without hashes of the strategy's modules; they may differ here")


@dataclass(frozen=True)
class ProgramLimits:
    """Limits of one program."""

    max_bytes: int
    """Limit of the answer."""
    min_timeout_s: float = 120.0
    """Minimum timeout, including compilation of kernels."""
    bytes_per_s: float = 4096.0
    """Bytes of the recording per second of additional timeout: half of the data of a simulated second, so
    that runs slower than real time can be replayed."""


class ProgramOutput(NamedTuple):
    """Result of a program: data or a fault."""

    data: bytes | None
    fault: str | None
    """Sentence that begins with the actor."""
    output: str
    """Last output of its code."""


def run_program(
    out: Path,
    module: str,
    actor: str,
    words: Sequence[str],
    bounds: ProgramLimits,
    *,
    permit: Permit,
    isolate: bool,
) -> ProgramOutput:
    """Run a program with a robot's recorded code; `words`: further arguments.

    `isolate`: see `actors.runtime.isolation.sandbox`. Raises AcrcError for code that is not permitted.
    """
    folders = check_trust(out, actor, permit)
    if folders is None:
        raise AcrcError(f"{actor}: not a robot")
    timeout_s = bounds.min_timeout_s + all_recordings(out)[actor].stat().st_size / bounds.bytes_per_s
    with scratch_folder() as home, create_launcher("exec") as launcher:
        work = home / actor
        (work / "own").mkdir(parents=True)
        argv = (
            *("--out", str(out.resolve()), "--actor", actor, *words),
            *(word for folder in folders for word in ("--path", str(folder))),
            *(("--any-content",) if permit.trust else ()),
            *(("--isolate",) if isolate else ()),
            *("--answer", str(work / "answer"), "--own", str(work / "own")),
        )
        program = Program(actor, module, argv, work / f"{actor}.log", None)
        process, deadline = launcher.start(program), time.monotonic() + timeout_s
        while process.exit_code is None and time.monotonic() < deadline:
            launcher.wait(0.5)
        is_late = process.exit_code is None
        while process.exit_code is None:
            process.send(signal.SIGKILL)
            launcher.wait(0.5)
        data = b""
        with suppress(OSError), (work / "answer").open("rb") as file:
            data = file.read(bounds.max_bytes + 1)
        printed, fault = program_output(program), None
        if is_late:
            fault = f"replay timed out after {timeout_s:.0f} s and was killed"
        elif len(data) > bounds.max_bytes:
            fault = f"answer is larger than {bounds.max_bytes} bytes"
        elif not data or process.exit_code != 0:
            last = " ".join(printed.split())[-_MAX_QUOTE:]
            reason = f"exit code {process.exit_code}" + (f"; last output: {last}" if last else "")
            fault = f"replay failed ({reason})"
        return (
            ProgramOutput(None, f"{actor}: {fault}", printed) if fault else ProgramOutput(data, None, printed)
        )


BOUNDS: Final = ProgramLimits(1 << 16)
"""Limits of a replay; a difference is one sentence that quotes two messages."""


class ReplayAnswer(msgspec.Struct, frozen=True):
    """Answer of a replay: a report or a fault."""

    report: ReplayReport | None = None
    fault: str | None = None


def replay(
    out: Path, actor: str, *, permit: Permit, isolate: bool | None, bounds: ProgramLimits = BOUNDS
) -> ReplayReport:
    """Replay one actor; a robot in a sandbox if the machine supports it and `isolate` permits it.

    Raises AcrcError for code that is not permitted, ReplayError at the first output that differs.
    """
    folders = check_trust(out, actor, permit)
    if folders is None:
        return replay_actor(out, actor)
    choice = choose_isolation(isolate)
    print_warning(choice.warning)
    if isolate is False:
        set_folders(folders, any_content=permit.trust)
        return replay_actor(out, actor)  # in this process, for debuggers
    report_damage(all_recordings(out)[actor])
    outcome = run_program(out, _PROGRAM, actor, (), bounds, permit=permit, isolate=choice.isolate)
    print_output(outcome.output)
    fault = outcome.fault
    if outcome.data is not None:
        try:
            answer = msgspec.json.decode(outcome.data, type=ReplayAnswer)
        except (ValueError, RecursionError):
            raise ReplayError(f"{actor}: invalid answer of the replay") from None
        if answer.report is not None:
            return answer.report
        fault = printable(answer.fault or "")
    raise ReplayError(fault or f"{actor}: no answer of the replay")


def argument_parser(program: str) -> ArgumentParser:
    """Return the parser of the common arguments; `program`: the module."""
    options = ArgumentParser(prog=f"python -m {program}")
    for name in ("--out", "--answer", "--own"):
        options.add_argument(name, type=Path, required=True)
    options.add_argument("--actor", required=True)
    options.add_argument("--path", type=Path, action="append", default=[], help="load code from this folder")
    options.add_argument("--any-content", action="store_true", help="accept code other than recorded")
    options.add_argument("--isolate", action="store_true")
    return options


@contextmanager
def open_answer(options: Namespace, file_mb: int) -> Iterator[FileIO]:
    """Create the answer's file, then enter the sandbox if `--isolate` is given.

    The process exits with its parent; files that it writes are limited to `file_mb`. Raises OSError if the
    file exists or cannot be created.
    """
    RecordingReader.reports = False
    with options.answer.open("xb", buffering=0) as answer:
        parent = os.getppid()
        assembly.kernels()  # before their cache becomes read-only
        if options.isolate:
            view = file_view(options.own, (options.own.parent,), (options.out,), options.path)
            isolate(lambda: SandboxSetup(view), (1, 2, answer.fileno()), parent=parent)
            os.chdir(options.own)
        else:
            die_with_parent(parent)
        failure.hold_reserve(options.own)
        set_folders(options.path, any_content=options.any_content)
        enforce_limits(ProcessLimits(file_mb=file_mb), isolated=options.isolate)
        yield answer


def describe_failure(actor: str, error: Exception) -> str:
    """Return the fault of failed code, and write its traceback to the log if that has room."""
    failure.release_reserve()
    print_traceback(error)
    return f"{actor}: {type(error).__name__}: {error}"


def write_all(answer: FileIO, data: bytes) -> None:
    """Write all data. Raises OSError beyond the limit of a file."""
    left = memoryview(data)
    while left:
        left = left[answer.write(left) :]


def main(argv: Sequence[str]) -> int:
    """Replay one actor and write the answer; return the exit code."""
    options = argument_parser(_PROGRAM).parse_args(argv)
    with open_answer(options, _FILE_MB) as answer:
        try:
            replay_options = ReplayOptions(prints=partial(captured_output.output_to_stream, sys.stdout))
            result = ReplayAnswer(report=replay_actor(options.out, options.actor, replay_options))
        except AcrcError as error:
            result = ReplayAnswer(fault=str(error))
        except Exception as error:
            result = ReplayAnswer(fault=describe_failure(options.actor, error))
        answer.write(msgspec.json.encode(result))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
