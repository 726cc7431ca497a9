"""Start of an isolated robot in a process that never knows a name of anything outside its view.

The started process forks the robot before it receives the robot's start, and becomes its keeper. It then
builds the robot's view of the file tree, and passes command line, log and recording to the robot.

`python -m actors.processes.sandboxed_process FD` does this in a new interpreter, which first imports and
compiles the robot's code; FD is a socket with the start. Isolation requires a single thread, so this module
must not import numpy, and thus not the launcher, before the robot's program has limited the threads of BLAS.
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
    SandboxPaths,
    SandboxSetup,
    isolate,
    own_folder,
)
from actors.runtime.linux import exit_now

_LOG: Final = 1


class EntryPoint(NamedTuple):
    """Program of a process: a module with a main function, and its arguments."""

    module: str
    argv: tuple[str, ...]


class ProcessStart(msgspec.Struct, frozen=True):
    """Start message of a new process."""

    entry_point: EntryPoint
    log: str
    names: SandboxPaths | None = None
    """Paths of a sandboxed robot; None: no sandbox."""

    @property
    def title(self) -> str:
        """Process name for ps and top."""
        return f"acrc {Path(self.log).stem}"


def continue_sandboxed(
    receive_start: Callable[[], ProcessStart], parent: int, private: Collection[int]
) -> EntryPoint:
    """Continue as the sandboxed robot in a child of this process, which becomes its keeper.

    `receive_start`: waits for the start and redirects standard output and error to the log; only the keeper
    calls it. `private`: descriptors that it uses. The keeper exits with `parent`.
    """
    linux.set_title("acrc robot")  # finds the command line's address while /proc is there
    message, (log, recording) = isolate(lambda: _prepare(receive_start()), parent=parent, private=private)
    for descriptor, place in ((log, 1), (log, 2), (recording, RECORDING)):
        os.dup2(descriptor, place)
    for descriptor in {log, recording} - {RECORDING}:
        os.close(descriptor)
    title, entry_point = msgspec.json.decode(message, type=tuple[str, EntryPoint])
    linux.set_title(title)
    os.chdir(own_folder(FOLDER))
    return entry_point


def _prepare(start: ProcessStart) -> SandboxSetup:
    """In the keeper: return the robot's view, command line, log and recording."""
    assert start.names is not None
    linux.set_title(start.title)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    recording = os.open(start.names.record, flags, 0o644)
    message = msgspec.json.encode((start.title, start.entry_point))
    return SandboxSetup(start.names.view(), message, (_LOG, recording))


def main(argv: Sequence[str]) -> int:
    """Run the robot whose start is on the socket; return its exit code."""
    from actors.robot import __main__ as robot  # noqa: PLC0415 — keeps the exec server small
    from actors.robot import assembly  # noqa: PLC0415

    assembly.kernels()  # compile while the cache is writable
    (descriptor,) = argv
    channel = socket.socket(fileno=int(descriptor))

    def receive_start() -> ProcessStart:
        with channel:
            return msgspec.json.decode(channel.recv(MESSAGE_LIMIT), type=ProcessStart)

    entry_point = continue_sandboxed(receive_start, os.getppid(), (channel.fileno(),))
    channel.detach()
    sys.argv[1:] = entry_point.argv
    return robot.main(entry_point.argv)


if __name__ == "__main__":
    exit_now(main(sys.argv[1:]))
