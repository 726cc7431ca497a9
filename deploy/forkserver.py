"""A process that has imported and compiled everything once, and forks the actors from there.

`python -m deploy.forkserver FD` serves on an inherited socket: `{"start": [module, argv, log]}` is answered
by `{"started": pid}`, and the end of a child is told as `{"ended": pid, "code": code}`. It ends, and with it
its children, when the other end of the socket closes. The standard library's forkserver leaves a socket file
and keeps running when its parent is killed, see docs/decisions.
"""

import importlib
import importlib.util
import json
import os
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from actors.runtime.log import open_log

MESSAGE_LIMIT: Final = 1 << 16
"""Bytes of one message on the socket."""


def serve(channel: socket.socket) -> None:
    """Fork on request until the other end closes."""
    alarm_out, alarm_in = os.pipe()
    os.set_blocking(alarm_in, False)
    signal.set_wakeup_fd(alarm_in, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    with selectors.DefaultSelector() as selector:
        selector.register(channel, selectors.EVENT_READ)
        selector.register(alarm_out, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fd == alarm_out:
                    os.read(alarm_out, 512)
                    _tell_ended(channel)
                    continue
                request = channel.recv(MESSAGE_LIMIT)
                if not request:
                    return
                module, argv, log = json.loads(request)["start"]
                pid = _fork(module, argv, Path(log), (channel.fileno(), alarm_out, alarm_in))
                _tell(channel, {"started": pid})


def enter(module: str, argv: Sequence[str], log: Path) -> int:
    """Run `main(argv)` of the module, or of a package's `__main__`, as exec would; its exit code."""
    open_log(log)
    code: int = importlib.import_module(_program(module)).main(argv)
    return code


def _program(module: str) -> str:
    """What `python -m module` executes."""
    spec = importlib.util.find_spec(module)
    is_package = spec is not None and spec.submodule_search_locations is not None
    return f"{module}.__main__" if is_package else module


def _fork(module: str, argv: Sequence[str], log: Path, private: Sequence[int]) -> int:
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for descriptor in private:
            os.close(descriptor)
        code = enter(module, argv, log)
    except SystemExit as leave:
        code = leave.code if isinstance(leave.code, int) else 1
    except BaseException:  # the child must never return into the server's loop
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _tell_ended(channel: socket.socket) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid == 0:
            return
        _tell(channel, {"ended": pid, "code": os.waitstatus_to_exitcode(status)})


def _tell(channel: socket.socket, message: dict[str, Any]) -> None:
    channel.send(json.dumps(message).encode())


def main(argv: Sequence[str]) -> int:
    """Preload, then serve on the socket whose descriptor is given."""
    channel = socket.socket(fileno=int(argv[0]))
    channel.set_inheritable(False)
    importlib.import_module("deploy.preload")
    _tell(channel, {"ready": os.getpid()})
    serve(channel)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
