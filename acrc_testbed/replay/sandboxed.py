"""What programs share that replay recorded code in a sandbox: their command line, and the walls."""

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

from actors.robot import assembly
from actors.robot.behaviour.modules import look_in
from actors.runtime.isolation.resource_limits import ProcessLimits, enforce
from actors.runtime.isolation.sandbox import Confinement, isolate
from actors.runtime.lifecycle import failure
from actors.runtime.lifecycle.failure import print_traceback
from actors.runtime.lifecycle.linux import die_with_parent
from actors.runtime.recording import Reading


def parser(program: str) -> ArgumentParser:
    """The options that each of them has; `program` is its module."""
    options = ArgumentParser(prog=f"python -m {program}")
    for name in ("--out", "--answer", "--own"):
        options.add_argument(name, type=Path, required=True)
    options.add_argument("--actor", required=True)
    options.add_argument("--path", type=Path, action="append", default=[], help="folder with code")
    options.add_argument("--any-content", action="store_true", help="which need not be what was recorded")
    options.add_argument("--isolate", action="store_true")
    return options


@contextmanager
def answering(options: Namespace, file_mb: int, readable: Sequence[Path] | None = None) -> Iterator[FileIO]:
    """The new file for the answer, open before this process is in its sandbox, where `--isolate` stands.

    `readable`: what it may read of the run; None: all, for one that has ended, where no secret is left.
    From here on it ends with its parent, and neither answer nor log nor another file becomes larger than
    `file_mb`. OSError where the file is there already, or cannot be made.
    """
    Reading.reports = False
    with options.answer.open("xb", buffering=0) as answer:
        parent = os.getppid()
        room = failure.hold(options.answer.parent)
        assembly.kernels()  # while their cache can still be written
        if options.isolate:
            isolate(
                Confinement(
                    own=options.own,
                    hidden=(options.own.parent,),
                    readable=(options.out,) if readable is None else tuple(readable),
                    code=tuple(options.path),
                    descriptors=(1, 2, answer.fileno(), room),
                    parent=parent,
                )
            )
        else:
            die_with_parent(parent)
        look_in(options.path, any_content=options.any_content)
        enforce(ProcessLimits(file_mb=file_mb), isolated=options.isolate)
        yield answer


def bug(actor: str, error: Exception) -> str:
    """What is answered where the code failed; the whole traceback goes to the log, if that takes any more."""
    failure.release()
    print_traceback(error)
    return f"{actor}: {type(error).__name__}: {error}"


def write_whole(answer: FileIO, data: bytes) -> None:
    """All of it, however much a single call takes. OSError beyond what a file may have."""
    left = memoryview(data)
    while left:
        left = left[answer.write(left) :]
