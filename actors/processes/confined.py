"""Starts an isolated robot in a process that never held a name of anything outside its view.

The started process forks the robot before it receives the robot's start, and becomes its keeper. Then it
builds the robot's view of the file tree, and passes on command line, log and recording.

`python -m actors.processes.confined FD` does so in a new interpreter, which first imports and compiles what a
robot needs; FD is a socket with the start. Isolation requires a single thread, so this module must not import
numpy, nor therefore the launcher, before the robot's program has limited the threads of BLAS.
"""

import os
import socket
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.runtime import linux
from actors.runtime.isolation.sandbox import (
    FOLDER,
    MESSAGE_LIMIT,
    RECORDING,
    Handover,
    Names,
    isolate,
    own_folder,
)
from actors.runtime.linux import leave

_LOG: Final = 1


class Part(NamedTuple):
    """The program of a process: the main function of a module, with its arguments."""

    module: str
    argv: tuple[str, ...]


class ProcessStart(msgspec.Struct, frozen=True):
    """All that a new process is told."""

    part: Part
    log: str
    names: Names | None = None
    """Of a sandboxed robot."""

    @property
    def title(self) -> str:
        """Name of the process for ps and top."""
        return f"acrc {Path(self.log).stem}"


def born(told: Callable[[], ProcessStart], parent: int, private: Collection[int]) -> Part:
    """Go on as the sandboxed robot, in a child of this process, which becomes its keeper.

    `told`: waits for the start and redirects standard output and error to the log; only the keeper calls it.
    `private`: descriptors that it needs. The keeper ends with `parent`.
    """
    linux.set_title("acrc robot")  # its command line's address cannot be looked up later
    message, (log, recording) = isolate(lambda: _prepared(told()), parent=parent, private=private)
    for descriptor, place in ((log, 1), (log, 2), (recording, RECORDING)):
        os.dup2(descriptor, place)
    for descriptor in {log, recording} - {RECORDING}:
        os.close(descriptor)
    title, part = msgspec.json.decode(message, type=tuple[str, Part])
    linux.set_title(title)
    os.chdir(own_folder(FOLDER))
    return part


def _prepared(start: ProcessStart) -> Handover:
    """In the keeper: return the robot's view, its command line, its log and its recording."""
    assert start.names is not None
    linux.set_title(start.title)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    recording = os.open(start.names.record, flags, 0o644)
    message = msgspec.json.encode((start.title, start.part))
    return Handover(start.names.view(), message, (_LOG, recording))


def main(argv: Sequence[str]) -> int:
    """Run the robot whose start waits on the socket; return its exit code."""
    from actors.robot import __main__ as robot  # noqa: PLC0415 — a server that executes stays small
    from actors.robot import assembly  # noqa: PLC0415

    assembly.kernels()  # compiled while their cache can still be written
    (descriptor,) = argv
    channel = socket.socket(fileno=int(descriptor))

    def told() -> ProcessStart:
        with channel:
            return msgspec.json.decode(channel.recv(MESSAGE_LIMIT), type=ProcessStart)

    part = born(told, os.getppid(), (channel.fileno(),))
    channel.detach()
    sys.argv[1:] = part.argv
    return robot.main(part.argv)


if __name__ == "__main__":
    leave(main(sys.argv[1:]))
