"""Starts an isolated robot in a process that never held a name of anything outside its view.

The started process forks the robot before it receives the request, and becomes its keeper. It then receives
the request, builds the robot's view of the file tree, which both share, and passes on command line, log and
recording.

`python -m actors.processes.confined FD` does so in a new interpreter, which first imports and compiles what a
robot needs; FD is a socket with the request. Isolation needs a process with one thread, so this module must
not import numpy, nor therefore the launcher, before the robot's program has limited the threads of BLAS.
"""

import json
import os
import socket
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

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
    """What a process is to become: the main function of a module, with these words."""

    module: str
    argv: tuple[str, ...]


def born(told: Callable[[], dict[str, Any]], parent: int, private: Collection[int]) -> Part:
    """Go on as the sandboxed robot, in a child of this process, which becomes its keeper.

    `told`: waits for the request and redirects standard output and error to the log; only the keeper calls
    it. `private`: descriptors that it needs. The keeper ends with `parent`.
    """
    linux.set_title("acrc robot")  # its command line's address cannot be looked up later
    message, (log, recording) = isolate(lambda: _prepared(told()), parent=parent, private=private)
    for descriptor, place in ((log, 1), (log, 2), (recording, RECORDING)):
        os.dup2(descriptor, place)
    for descriptor in {log, recording} - {RECORDING}:
        os.close(descriptor)
    request = json.loads(message)
    linux.set_title(request["title"])
    os.chdir(own_folder(FOLDER))
    return Part(request["module"], tuple(request["argv"]))


def _prepared(request: dict[str, Any]) -> Handover:
    """In the keeper: return the robot's view, its command line, its log and its recording."""
    names, title = Names(**request["names"]), f"acrc {Path(request['log']).stem}"
    linux.set_title(title)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    recording = os.open(names.record, flags, 0o644)
    robot = {"title": title, "module": request["module"], "argv": request["argv"]}
    return Handover(names.view(), json.dumps(robot).encode(), (_LOG, recording))


def main(argv: Sequence[str]) -> int:
    """Be the robot that the request describes; its exit code."""
    from actors.robot import __main__ as robot  # noqa: PLC0415 — a server that executes stays small
    from actors.robot import assembly  # noqa: PLC0415

    assembly.kernels()  # compiled while their cache can still be written
    (descriptor,) = argv
    channel = socket.socket(fileno=int(descriptor))

    def told() -> dict[str, Any]:
        with channel:
            request: dict[str, Any] = json.loads(channel.recv(MESSAGE_LIMIT))
        return request

    part = born(told, os.getppid(), (channel.fileno(),))
    channel.detach()
    sys.argv[1:] = part.argv
    return robot.main(part.argv)


if __name__ == "__main__":
    leave(main(sys.argv[1:]))
