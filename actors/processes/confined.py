"""Starts an isolated robot in a process that never held a name of anything outside its view.

The started process forks the robot before it receives the request, and becomes its keeper. It then receives
the request, builds the robot's view of the file tree, which both share, and passes on command line, log and
recording.

`python -m actors.processes.confined FD` does so in a new interpreter, which first imports and compiles what a
robot needs; FD is a socket with the request. Isolation needs a process with one thread, so this module must
not import numpy, nor therefore the launcher, before the robot's program has limited the threads of BLAS.
"""

import contextlib
import json
import os
import socket
import sys
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

from actors.runtime import linux
from actors.runtime.isolation import mounts, sandbox
from actors.runtime.isolation.sandbox import FOLDER, RECORDING, Names, robot_view
from actors.runtime.linux import leave

MESSAGE_LIMIT: Final = 1 << 16
"""Bytes of one message on the socket."""
_LOG: Final = 1


class Part(NamedTuple):
    """What a process is to become: the main function of a module, with these words."""

    module: str
    argv: tuple[str, ...]


def born(told: Callable[[], dict[str, Any]], parent: int, private: Collection[int]) -> Part:
    """Go on as the robot, shut off, in a child of this process, which becomes its keeper.

    `told`: waits for the request and has standard output and error lead to the log; only the keeper calls it.
    `private`: descriptors that it needs. The keeper ends with `parent`.
    """
    sandbox.check_threads()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sandbox.shed_descriptors((0, 1, 2, ours.fileno(), theirs.fileno(), *private))
    os.chdir("/")  # no working directory shows the former tree
    linux.set_title("acrc robot")  # where its command line stands cannot be looked up later
    try:
        sandbox.enter_namespaces()
    except OSError as error:
        told()
        _refuse(error)
    linux.enter_namespace(parent, lambda: _prepare(told, ours, theirs), (ours.fileno(), *private))
    ours.detach()
    return _take_over(theirs)


def _prepare(told: Callable[[], dict[str, Any]], ours: socket.socket, theirs: socket.socket) -> None:
    """In the keeper: build the view, and hand over what the robot needs."""
    theirs.close()
    request = told()
    names, title = Names(**request["names"]), f"acrc {Path(request['log']).stem}"
    linux.set_title(title)
    try:
        recording = os.open(
            names.record, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644
        )
        mounts.enter(robot_view(names))
    except OSError as error:
        _refuse(error)
    robot = {
        "title": title,
        "module": request["module"],
        "argv": request["argv"],
        "spent": time.process_time(),
    }
    with ours, contextlib.suppress(BrokenPipeError):  # it has been ended
        socket.send_fds(ours, [json.dumps(robot).encode()], [_LOG, recording])
    os.close(recording)


def _take_over(theirs: socket.socket) -> Part:
    """In the robot: take what the keeper has prepared, and close every other way."""
    message, descriptors, _, _ = socket.recv_fds(theirs, MESSAGE_LIMIT, 2)
    if not message:
        os._exit(1)
    log, recording = descriptors
    theirs.close()
    for descriptor, place in ((log, 1), (log, 2), (recording, RECORDING)):
        os.dup2(descriptor, place)
    for descriptor in {log, recording} - {RECORDING}:
        os.close(descriptor)
    request = json.loads(message)
    linux.set_title(request["title"])
    linux.add_spent(request["spent"])
    os.chdir(FOLDER / "own")
    try:
        sandbox.close_ways_out()
    except OSError as error:
        _refuse(error)
    return Part(request["module"], tuple(request["argv"]))


def _refuse(error: OSError) -> NoReturn:
    sys.stderr.write(f"{sandbox.refusal(error)}\n")
    sys.stderr.flush()
    os._exit(2)


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
