"""Commands in forks of a process with imported modules, which saves a second per command.

A fork has its own working directory, environment, streams and exit code, and forks the forkserver of its run.
"""

import atexit
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module, invalidate_caches
from multiprocessing import forkserver as stdlib_forkserver
from pathlib import Path
from typing import Any, Final, NoReturn
from unittest import mock

from actors.processes import forkserver, launcher
from actors.runtime.process_table import child_environment

ROOT: Final = Path(__file__).resolve().parents[1]
ACRC: Final = "acrc_testbed.command_line.app"
BEGIN_SERVER: Final = launcher.start_server
_CONTEXT: Final = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["tests.preload"])


def run(
    words: Sequence[str], cwd: Path, env: Mapping[str, str], timeout_s: float,
    *, finds_cwd: bool, program: str = ACRC,
) -> subprocess.CompletedProcess[str]:  # fmt: skip
    """Run `acrc WORDS…` in this folder and environment; `finds_cwd`: put the folder on the module path."""
    command = begin(words, cwd, env, finds_cwd=finds_cwd, program=program)
    try:
        out, err = command.communicate(timeout_s)
        return subprocess.CompletedProcess(words, command.wait(), out, err)
    finally:
        command.kill()
        command.close()


def begin(
    words: Sequence[str], cwd: Path, env: Mapping[str, str], *, finds_cwd: bool, program: str = ACRC
) -> "ForkedCommand":
    """Start a command and return immediately."""
    return ForkedCommand(program, words, cwd, dict(env), finds_cwd)


def begin_server(command: Sequence[str], channel: socket.socket) -> launcher.Server:
    """Replace `launch.begin` in the process of a test: fork the server from the preloaded process."""
    *_, how, whose = command
    if how != "fork":
        return BEGIN_SERVER(command, channel)
    return Server(_start(_run_server, channel, [how, whose], dict(os.environ)))


class Server:
    """A forkserver with the interface of `actors.processes.launcher`."""

    def __init__(self, process: Any) -> None:
        self._process, self.pid, self.kill = process, process.pid, process.kill

    def wait(self) -> int:
        self._process.join()
        return int(self._process.exitcode)


class ForkedCommand:
    """A started command, with the interface of subprocess.Popen."""

    def __init__(self, program: str, words: Sequence[str], cwd: Path, env: dict[str, str], finds_cwd: bool):
        self._words, pipes = words, [_CONTEXT.Pipe(duplex=False) for _ in range(2)]
        writing = [end for _, end in pipes]
        self._process = _start(_run_command, program, list(words), cwd, env, finds_cwd, writing)
        self.stdout, self.stderr = (os.fdopen(os.dup(end.fileno()), errors="replace") for end, _ in pipes)
        self.pid: int = self._process.pid
        for end in writing:
            end.close()

    @property
    def returncode(self) -> int | None:
        """Exit code, or the negative signal number; None while running."""
        return self._process.exitcode  # type: ignore[no-any-return]

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit and return the exit code. Raises subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if (code := self.returncode) is None:
            raise subprocess.TimeoutExpired(self._words, timeout or 0.0)
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the exit and return the output. Raises subprocess.TimeoutExpired."""
        texts = ["", ""]

        def read(number: int) -> None:
            texts[number] = (self.stdout, self.stderr)[number].read()

        threads = [threading.Thread(target=read, args=(number,), daemon=True) for number in range(2)]
        for thread in threads:
            thread.start()
        self.wait(timeout)
        for thread in threads:
            thread.join()
        return texts[0], texts[1]

    def send_signal(self, number: int) -> None:
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def close(self) -> None:
        self.stdout.close()
        self.stderr.close()


def _start(target: Any, *args: object) -> Any:
    """Start a fork of the preloaded process, which starts at the first call."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NPY_", "GLIBC_"))}
    env = {**kept, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    with mock.patch.dict(os.environ, env, clear=True):
        stdlib_forkserver.ensure_running()
    process = _CONTEXT.Process(target=target, args=args, daemon=True)
    process.start()
    return process


def _enter(cwd: Path, env: Mapping[str, str], places: Sequence[str]) -> None:
    """Set folder, environment and module path of a fork."""
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
    made = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update({**made, **env})
    named = [place for place in env.get("PYTHONPATH", "").split(os.pathsep) if place]
    own = [place for place in sys.path if place not in {"", str(ROOT)}]
    sys.path[:] = [*places, *named, *own]
    invalidate_caches()


def _run_command(
    program: str, words: list[str], cwd: Path, env: dict[str, str], finds_cwd: bool, streams: list[Any]
) -> NoReturn:
    """Run the command in this fork and exit like an interpreter."""
    for number, end in enumerate(streams, 1):
        os.dup2(end.fileno(), number)
        end.close()
    with Path(os.devnull).open() as nothing:
        os.dup2(nothing.fileno(), 0)
    _enter(cwd, env, [str(cwd)] if finds_cwd else [])
    sys.argv = [str(ROOT / "acrc_testbed" / "command_line" / "__main__.py"), *words]
    launcher.start_server = _fork_server
    _exit_after(lambda: import_module(program).main())


def _fork_server(command: Sequence[str], channel: socket.socket) -> launcher.Server:
    """Replace `launch.begin` in a fork without threads: fork the server from the fork."""
    *_, how, whose = command
    forks = how == "fork" or (whose == "reap" and "--spawn" not in sys.argv)
    if not forks or len(list(Path("/proc/self/task").iterdir())) > 1:
        return BEGIN_SERVER(command, channel)
    process = multiprocessing.get_context("fork").Process(
        target=_run_server, args=(channel, ["fork", whose], dict(os.environ))
    )
    process.start()
    return Server(process)


def _run_server(channel: socket.socket, words: Sequence[str], env: dict[str, str]) -> NoReturn:
    """Run the server in this fork, with only what a new interpreter inherits."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.setsid()
    atexit._clear()  # the starter's temporary folders are still in use
    with Path(os.devnull).open("r+b", buffering=0) as nothing:
        for stream in (0, 1):
            os.dup2(nothing.fileno(), stream)
    descriptor = channel.detach()
    os.closerange(3, descriptor)
    os.closerange(descriptor + 1, os.sysconf("SC_OPEN_MAX"))
    _enter(ROOT, child_environment(env), ())
    launcher.start_server = _fork_server
    _exit_after(partial(forkserver.main, [str(descriptor), *words]))


def _exit_after(main: Any) -> NoReturn:
    code: object = 1
    try:
        code = main()
    except SystemExit as leave:
        code = leave.code
    except BaseException:  # a fork must not continue the code of its parent
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else code is not None)
