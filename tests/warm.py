"""The command line in a process that has imported already: a fork of one that waits for this worker's tests.

A command needs a thousand modules, and importing them takes a second, more than most commands do themselves.
What is forked is a process like any other: it has folder, environment, streams, exit code and end of its own.
Where the interpreter's own beginning matters, a test starts a new one.
"""

import atexit
import json
import os
import pkgutil
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NoReturn

from tests.warm_server import serve_warm

ROOT: Final = Path(__file__).resolve().parents[1]
ACRC: Final = "command_line.app"
MESSAGE_LIMIT: Final = 1 << 20
"""Bytes of what is asked for."""
READ_AT_START: Final = ("GLIBC_", "LD_", "MALLOC_", "NPY_", "NUMBA_", "OMP_", "OPENBLAS_", "PYTHON")
"""Variables that begin so have done their work once the modules are there; a fork would not heed others."""

LEFT_OUT: Final = ("command_line.documentation.", "command_line.experiments.") + (
    () if find_spec("rerun") else ("deploy.fleet.watched", "observation.view.")
)
"""What few commands need is imported by these; what draws into the viewer only where that is installed."""


def read_at_start(env: Mapping[str, str]) -> dict[str, str]:
    """The variables that a process must begin with, as it does not look at them again."""
    return {k: v for k, v in env.items() if k.startswith(READ_AT_START) and k != "PYTHONPATH"}


BEGUN: Final = read_at_start(os.environ) | {"OPENBLAS_NUM_THREADS": "1"}
"""What the waiting process begins with, whatever a test, or a program that one imports, has set by then."""


def heeds(env: Mapping[str, str]) -> bool:
    """True if a fork would do what a new process does that begins with these variables."""
    return read_at_start(env).items() <= BEGUN.items()


def run(
    words: Sequence[str],
    cwd: Path,
    env: Mapping[str, str],
    timeout_s: float,
    *,
    finds_cwd: bool,
    program: str = ACRC,
    cores: Sequence[int] = (),
) -> subprocess.CompletedProcess[str]:
    """What `python -m command_line WORDS…` does in this folder and environment; `finds_cwd`: without `-P`.

    In an environment that a fork heeds, there can be another `program`, a module with a `main`, and `cores`,
    the only ones that it and what it starts may run on.
    """
    if heeds(env):
        asked = {"words": words, "cwd": str(cwd), "env": dict(env), "finds_cwd": finds_cwd}
        return _waiting().run({**asked, "program": program, "cores": cores}, timeout_s)
    assert program == ACRC and not cores
    flags = () if finds_cwd else ("-P",)
    return subprocess.run(
        [sys.executable, *flags, "-m", "command_line", *words],
        cwd=cwd, env=env, capture_output=True, text=True, timeout=timeout_s, check=False,
    )  # fmt: skip


class Waiting:
    """The process that has imported everything, and forks; it ends with the tests."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._lock = threading.Lock()
        rest = {name: value for name, value in os.environ.items() if name not in read_at_start(os.environ)}
        own = {"PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "tests.warm", str(theirs.fileno())],
            cwd=ROOT,
            env={**rest, **BEGUN, **own},
            pass_fds=(theirs.fileno(),),
        )
        theirs.close()
        atexit.register(self.end)

    def run(self, asked: dict[str, Any], timeout_s: float) -> subprocess.CompletedProcess[str]:
        """As `run` above; subprocess.TimeoutExpired once it has taken too long and has been killed."""
        with self._lock:
            ours, theirs = zip(os.pipe(), os.pipe(), strict=True)
            socket.send_fds(self._channel, [json.dumps(asked).encode()], theirs)
            for descriptor in theirs:
                os.close(descriptor)
            pid = int(self._channel.recv(100))
            try:
                out, err = _read_all(ours, time.monotonic() + timeout_s)
            except BaseException as error:  # also when pytest holds that the test has taken long enough
                os.kill(pid, signal.SIGKILL)
                self._channel.recv(100)
                if isinstance(error, TimeoutError):
                    raise subprocess.TimeoutExpired(asked["words"], timeout_s) from None
                raise
            return subprocess.CompletedProcess(asked["words"], int(self._channel.recv(100)), out, err)

    def end(self) -> None:
        """Nothing more will be asked for."""
        self._channel.close()
        self._process.wait()


@cache
def _waiting() -> Waiting:
    return Waiting()


def _read_all(descriptors: Sequence[int], deadline: float) -> list[str]:
    """What comes until nobody can write any more; TimeoutError."""
    data = {descriptor: bytearray() for descriptor in descriptors}
    try:
        with selectors.DefaultSelector() as selector:
            for descriptor in descriptors:
                selector.register(descriptor, selectors.EVENT_READ)
            while selector.get_map():
                ready = selector.select(max(0.0, deadline - time.monotonic()))
                if not ready:
                    raise TimeoutError
                for key, _ in ready:
                    data[key.fd] += (piece := os.read(key.fd, 1 << 16))
                    if not piece:
                        selector.unregister(key.fd)
    finally:
        for descriptor in descriptors:
            os.close(descriptor)
    return [bytes(piece).decode() for piece in data.values()]


def serve(channel: socket.socket) -> None:
    """Fork as asked for until the other end closes, one command at a time."""
    import_module("actors.processes.preload")
    for package in ("command_line", "deploy", "observation"):
        for module in pkgutil.walk_packages(import_module(package).__path__, f"{package}."):
            if not (module.name.endswith("__main__") or module.name.startswith(LEFT_OUT)):
                import_module(module.name)
    import_module(
        "actors.runtime.process"
    ).settle()  # collecting in a fork would look at all this, and copy it
    own = [place for place in sys.path if place != str(ROOT)]
    made = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    while True:
        message, descriptors, _, _ = socket.recv_fds(channel, MESSAGE_LIMIT, 2)
        if not message:
            return
        pid = os.fork()
        if pid == 0:
            channel.close()
            _become(json.loads(message), descriptors, own, made)
        for descriptor in descriptors:
            os.close(descriptor)
        channel.send(str(pid).encode())
        _, status = os.waitpid(pid, 0)
        channel.send(str(os.waitstatus_to_exitcode(status)).encode())


def _become(
    asked: dict[str, Any], descriptors: Sequence[int], places: Sequence[str], made: Mapping[str, str]
) -> NoReturn:
    """Be the command from here on, and end as an interpreter does.

    `places`: where modules are besides the environment's; `made`: the variables that modules have set.
    """
    code: object = 1
    try:
        with Path(os.devnull).open() as nothing:
            for number, descriptor in enumerate((nothing.fileno(), *descriptors)):
                os.dup2(descriptor, number)
        for descriptor in descriptors:
            os.close(descriptor)
        os.chdir(asked["cwd"])
        os.sched_setaffinity(0, asked["cores"] or os.sched_getaffinity(0))
        os.environ.clear()
        os.environ.update({**made, **asked["env"]})
        named = [place for place in asked["env"].get("PYTHONPATH", "").split(os.pathsep) if place]
        sys.path[:] = [*([asked["cwd"]] if asked["finds_cwd"] else ()), *named, *places]
        sys.argv = [str(ROOT / "command_line" / "__main__.py"), *asked["words"]]
        invalidate_caches()
        serve_warm(places)
        import_module(asked["program"]).main()
        code = 0
    except SystemExit as leave:
        code = leave.code
    except BaseException:  # the child must never return into the server's loop
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else code is not None)


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
