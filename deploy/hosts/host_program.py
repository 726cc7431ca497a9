"""One host of a run, as a program: `python -m deploy.hosts.host_program FOLDER`.

It connects where the run was started, is told its robots, starts and watches their processes, is the router
through which they reach the world, and ends with the connection. In the folder lie its errand and its keys;
what it is sent comes there, too, and so does what the robots record.
"""

import math
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.results.seal import HostLoad
from actors.installation.repository import REPOSITORY
from actors.processes.launch import Launcher, launcher
from actors.runtime.access import credentials, tls
from actors.runtime.access.credentials import Credentials, reveal
from actors.runtime.access.tls import load_keys
from actors.runtime.bus.zenoh_bus import HostRouter, open_host_router
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import own_folder
from actors.runtime.lifecycle.linux import Ended, die_with_parent, leave_in_order
from deploy.hosts.channel import (
    ERRAND,
    FOLDER,
    RUN,
    AskPulse,
    Begin,
    Channel,
    ChannelClosedError,
    Done,
    Fault,
    FilePart,
    Finish,
    Glimpse,
    HostErrand,
    Joined,
    PemKeys,
    Signal,
    StartRobot,
    ToHost,
    Unlinked,
    connect,
    from_host,
)
from deploy.hosts.fetching import Incoming
from deploy.hosts.host_robots import HostRobots

KEYS: Final = "keys"
RECORDED: Final = 3
"""Exit code: what robots have recorded is left in the folder, as wanted, or as the connection ended first."""
CODE: Final = "code"
_INFRA: Final = ".router"
"""Folder of the router, in that of the run; no robot can be called so."""
_LAID_OUT: Final = 1 << 30
"""Bytes at most of what a host is sent: maps, models, a strategy's code."""
_PATIENCE_S: Final = 30.0
_GRACE_S: Final = 3.0
_TURN_S: Final = 0.05


class HostProgram:
    """One run's part on this computer."""

    def __init__(self, folder: Path, errand: HostErrand, channel: Channel[ToHost]) -> None:
        self._folder = folder
        self._errand = errand
        self._channel = channel
        self._incoming = Incoming(folder, {RUN, CODE}.__contains__, _LAID_OUT)
        self._begin: Begin | None = None
        self._launched: Launcher | None = None
        self._robots: HostRobots | None = None
        self._router: HostRouter | None = None
        self._issued: Credentials | None = None
        self._heard_s = time.monotonic()
        self._linked = False
        self._finishing = False

    def run(self) -> int:
        """Stay until the run has ended; the exit code. Raises ChannelClosedError where nobody is there any
        more."""
        with ExitStack() as stack:
            while self._begin is None:
                self._turn()
            self._launched = stack.enter_context(launcher(self._begin.spawn))
            self._robots = HostRobots(
                self._folder / RUN, self._folder / CODE, self._begin, self._launched, self._channel
            )
            self._lay_out(self._begin, self._launched)
            try:
                assert self._issued is not None
                config = tls.host_config(self._issued, load_keys(self._folder / KEYS), self._begin.endpoint)
                robot = self._begin.robots[0]
                self._router = stack.enter_context(open_host_router(config, robot, between=self._turn))
                while not (self._finishing and not self._robots.running and self._robots.settled):
                    self._turn()
                self._leave(self._robots)
            finally:
                self._end_robots(self._robots)
            return RECORDED if self._begin.leave else 0

    def _lay_out(self, begin: Begin, launched: Launcher) -> None:
        """Draw the robots' passwords, and have the kernels ready before the first is started."""
        run = self._folder / RUN
        (run / _INFRA).mkdir()
        for robot in begin.robots:
            own_folder(run / robot).mkdir(parents=True, exist_ok=True)
        self._issued = credentials.issue({robot: run / robot for robot in begin.robots}, run / _INFRA, ())
        credentials.write_router_file(run / _INFRA / credentials.ROUTER_FILE, self._issued)
        for words in begin.share:
            launched.share("actors.robot.program", words, run)

    def _turn(self) -> None:
        """Do what there is to be done, and wait a moment if that is nothing."""
        ready = [self._channel.fileno()]
        if self._launched is not None:
            ready.append(self._launched.fileno())
        out = [self._channel] if self._channel.waiting else []
        select.select(ready, out, [], _TURN_S)
        self._channel.flush()
        for message in self._channel.receive():
            self._heard_s = time.monotonic()
            self._obey(message)
        silent_s = time.monotonic() - self._heard_s
        if silent_s > self._errand.silence_s:
            raise ChannelClosedError(f"nothing has been heard for {silent_s:.0f} s")
        if self._launched is not None and self._robots is not None:
            self._launched.wait(0.0)
            self._robots.look()
        self._look_at_link()

    def _look_at_link(self) -> None:
        router = self._router
        if router is None:
            return
        if not self._linked and router.joined:
            self._linked = True
            assert self._issued is not None
            reveal(self._issued)
            self._channel.send(Joined(time.time(), str(self._folder)))
        elif self._linked and not router.linked:
            self._router = None
            self._channel.send(Unlinked())

    def _obey(self, message: ToHost) -> None:
        match message:
            case FilePart():
                self._incoming.take(message)
            case Begin():
                self._begin = message
            case AskPulse():
                if self._robots is not None:
                    self._channel.send(self._robots.pulse())
            case Finish():
                self._finishing = True
            case _ if self._robots is not None:
                self._act(self._robots, message)

    def _act(self, robots: HostRobots, message: ToHost) -> None:
        match message:
            case StartRobot():
                robots.start(message)
            case Signal():
                robots.signal(message)

    def _leave(self, robots: HostRobots) -> None:
        """Send what is left, and wait until it has gone."""
        for part in robots.own_parts():
            self._channel.send(part)
            while self._channel.waiting > _LAID_OUT >> 10:
                self._turn()
        self._channel.send(Done())
        while self._channel.waiting:
            self._turn()

    def _end_robots(self, robots: HostRobots) -> None:
        assert self._launched is not None
        for number in (signal.SIGTERM, signal.SIGKILL):
            robots.end(number)
            deadline = time.monotonic() + _GRACE_S
            while robots.running and time.monotonic() < deadline:
                self._launched.wait(_TURN_S)


def main(argv: Sequence[str]) -> int:
    """Be one host of a run; the exit code: 0, RECORDED, or 2: it never came to that."""
    die_with_parent(os.getppid(), signal.SIGTERM)
    leave_in_order()
    folder = Path(argv[0]).resolve()
    errand = msgspec.json.decode((folder / ERRAND).read_bytes(), type=HostErrand)
    try:
        encrypted = connect(folder / KEYS, errand.address, errand.port, _PATIENCE_S)
    except OSError as error:
        sys.stderr.write(f"{errand.address}:{errand.port} cannot be reached: {error.strerror or error}\n")
        return 2
    channel = from_host(encrypted)
    try:
        return HostProgram(folder, errand, channel).run()
    except Ended:
        raise
    except ChannelClosedError as error:
        sys.stderr.write(f"{error}; what robots have recorded is in {folder / RUN}\n")
        return RECORDED
    except Exception as error:
        return _failed(channel, error)
    finally:
        channel.close()
        _remove_secrets(folder)


def _remove_secrets(folder: Path) -> None:
    """Leave neither keys nor passwords behind, also where the worker is not there to do it."""
    shutil.rmtree(folder / KEYS, ignore_errors=True)
    with suppress(AcrcError):  # what a robot has put in the place of one
        credentials.remove_router_file(folder / RUN / _INFRA / credentials.ROUTER_FILE)


def _failed(channel: Channel[ToHost], error: Exception) -> int:
    sys.stderr.write(f"{type(error).__name__}: {error}\n")
    try:
        channel.send(Fault(f"{error}"[:2000]))
    except ChannelClosedError:
        return RECORDED
    return RECORDED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))


_MOST_SAID: Final = 4000
_COMPILING_S: Final = 900.0
"""How long a computer may take to describe itself, which compiles the kernels if they are not."""


def describe() -> tuple[int, str, str]:
    """The exit code, output and last words of `host_probe` on the worker's computer."""
    words = [sys.executable, "-P", "-m", "deploy.hosts.host_probe"]
    try:
        done = subprocess.run(
            words, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=_COMPILING_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return 1, "", f"took longer than {_COMPILING_S:g} s"
    return done.returncode, done.stdout, done.stderr[-_MOST_SAID:]


def serve(errand: bytes, keys: tuple[bytes, bytes, bytes]) -> tuple[int, str]:
    """Be a host until its run has ended; exit code and last words of its process.

    `keys`: as of PemKeys. Recordings stay in its folder where they are to, or nobody could be sent them.
    """
    folder = Path(tempfile.mkdtemp(prefix=FOLDER))
    (folder / ERRAND).write_bytes(errand)
    PemKeys(*keys).write(folder / KEYS)
    words = [sys.executable, "-P", "-m", "deploy.hosts.host_program", str(folder)]
    done = subprocess.run(
        words, cwd=REPOSITORY, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    useless = folder / KEYS if done.returncode == RECORDED else folder
    shutil.rmtree(useless, ignore_errors=True)
    return done.returncode, done.stderr[-_MOST_SAID:]


class LoadMeter:
    """Adds up what its processes did between two answers, and how long answers took."""

    def __init__(self) -> None:
        self._asked_s = self._seen_s = math.nan
        self._before: dict[int, Glimpse] = {}
        self._watched_s = self._worked_s = self._waited_s = 0.0
        self._answers, self._answer_s, self._slowest_s = 0, 0.0, 0.0

    def asked(self) -> None:
        """It was asked now; while an answer is out, only the first time counts."""
        if math.isnan(self._asked_s):
            self._asked_s = time.monotonic()

    def answered(self, processes: Sequence[Glimpse]) -> None:
        """It has told of its processes now."""
        now = time.monotonic()
        if not math.isnan(self._asked_s):
            self._answers += 1
            self._answer_s += now - self._asked_s
            self._slowest_s = max(self._slowest_s, now - self._asked_s)
            self._asked_s = math.nan
        both = [(self._before[one.pid], one) for one in processes if one.pid in self._before]
        if both:
            self._watched_s += now - self._seen_s
            self._worked_s += math.fsum(max(one.cpu_s - before.cpu_s, 0.0) for before, one in both)
            self._waited_s += math.fsum(_waited_s(before, one) for before, one in both)
        self._before, self._seen_s = {one.pid: one for one in processes}, now

    @property
    def load(self) -> HostLoad:
        """So far."""
        watched_s, answers = self._watched_s or math.inf, self._answers or 1
        return HostLoad(
            worked=round(self._worked_s / watched_s, 3),
            waited=round(self._waited_s / watched_s, 3),
            answer_s=round(self._answer_s / answers, 4),
            slowest_s=round(self._slowest_s, 4),
        )


def _waited_s(before: Glimpse, now: Glimpse) -> float:
    if before.queued_s is None or now.queued_s is None:
        return 0.0
    return max(now.queued_s - before.queued_s, 0.0)
