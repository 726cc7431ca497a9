"""One robot on emulated devices, with faults of its processes and devices while it drives."""

import ctypes
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

import msgspec

from actors.installation.repository import REPOSITORY, SHIPPED
from actors.radio.radio_model import RadioSetup
from actors.runtime.errors import AcrcError
from actors.world.world_setup import BodySetup, WorldSetup
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup

GUARDIAN: Final = "guardian.py"
MAP: Final = SHIPPED / "maps" / "corridor.yaml"
_START: Final = (8.0, 12.5, 0.0)
_PLACES: Final = ((22.0, 12.5), (8.0, 12.5))
_FAST: Final = 0.45
"""m/s, of 0.5: above it the robot counts as driving."""
_FLEET: Final = """
map = "{map}"
[run]
strategy = "none"
[[robot]]
id = "r1"
address = 1
start = [8.0, 12.5, 0.0]
places = [[22.0, 12.5], [8.0, 12.5]]
base = "{links}/r1/base"
radio = "{links}/r1/radio"
range = "{links}/r1/range"
"""
_NICE: Final = -10
"""The robot's processes and the emulated devices, where the system allows it; the service has -5."""
_PTRACE_SEIZE: Final = 0x4206
_PTRACE_INTERRUPT: Final = 0x4207

TITLE: Final = "acrc r1"
"""Process title of a sandboxed robot."""


class NotDrivingError(AcrcError):
    """The robot does not start to drive."""


class Where(NamedTuple):
    """Ground truth."""

    time: float
    way: float
    speed: float
    told: float
    """1 if the last command to the wheels was to stand."""


class Rig:
    """Emulated devices and the processes of a robot; a context manager."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.out = folder / "runs" / "one"
        self._links = folder / "links"

    def __enter__(self) -> Self:
        body = BodySetup("r1", "turtlebot2", "chapter", "exact", _START, _PLACES)
        world = WorldSetup(str(MAP), 1, 100_000, 1_000_000, (body,))
        radio = RadioSetup(1, world.step_us, (("r1", 1),), "beeclick")
        setup = self.folder / "setup.json"
        setup.write_bytes(msgspec.json.encode(LaboratorySetup(world, radio)))
        files = ("--setup", setup, "--links", self._links, "--result", self.folder / "result.json")
        before = os.nice(0)
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        self._room = subprocess.Popen(
            [sys.executable, "-m", "firmware_bridge.laboratory", *map(str, files)],
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._heard = b""
        self._answer(patience_s=60.0)  # "ready"
        command = self.onboard()
        self._log = (self.folder / "onboard.log").open("wb")
        self._onboard = subprocess.Popen(command, cwd=REPOSITORY, stdout=self._log, stderr=self._log)
        os.setpriority(os.PRIO_PROCESS, 0, before)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._onboard.poll() is None:
            self._onboard.kill()
        self._onboard.wait()
        parts = ("base", "bridge")
        for word in ("actors.robot", *(f"firmware_bridge.onboard.{part}" for part in parts), GUARDIAN):
            killed(self.processes(word))
        self._room.kill()
        self._room.wait()
        self._log.close()
        for stream in (self._room.stdin, self._room.stdout):
            assert stream is not None
            stream.close()

    def write_fleet(self, map_file: str) -> Path:
        """Write the file of a fleet of this robot alone."""
        fleet = self.folder / "fleet.toml"
        fleet.write_text(_FLEET.format(map=map_file, links=self._links))
        return fleet

    def onboard(self) -> list[str]:
        """Return the command that starts the robot."""
        words = ("fleet", "onboard", self.write_fleet(str(MAP)), "--robot", "r1", "--out", self.out)
        return [sys.executable, "-m", "command_line", *map(str, words)]

    def processes(self, word: str) -> list[int]:
        """Return the robot's processes whose command line or title has this word."""
        found = []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) == os.getpid():
                continue
            try:
                words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
                words += ["actors.robot", str((entry / "fd" / "1").readlink())] if words[0] == TITLE else []
            except OSError:
                continue
            ours = any(str(self.folder) in one for one in words)
            if ours and any(one.endswith(word) for one in words):
                found.append(int(entry.name))
        return found

    def order(self, line: str) -> str:
        """Cause a fault of a device; return the answer."""
        assert self._room.stdin is not None
        self._room.stdin.write(f"{line}\n".encode())
        self._room.stdin.flush()
        return self._answer(patience_s=10.0)

    def expect_ok(self, line: str) -> None:
        """Cause a fault of a device. Raises NotDrivingError if it is refused."""
        if (answer := self.order(line)) != "ok":
            raise NotDrivingError(f"{line}: {answer}")

    def where(self) -> Where:
        """Return the ground truth."""
        return Where(*map(float, self.order("where r1").split()))

    def until_driving(self, patience_s: float = 90.0) -> None:
        """Wait until the robot drives. Raises NotDrivingError."""
        deadline = time.monotonic() + patience_s
        while self.where().speed < _FAST:
            if time.monotonic() > deadline:
                said = (self.folder / "onboard.log").read_text()
                raise NotDrivingError(f"the robot did not drive within {patience_s:g} s: {said}")
            time.sleep(0.02)

    def standing(self, patience_s: float) -> tuple[Where | None, Where | None]:
        """Return the truth at the command to stand and at standstill; None if it did not happen."""
        deadline = time.monotonic() + patience_s
        told = None
        while time.monotonic() < deadline:
            here = self.where()
            told = told or (here if here.told else None)
            if told is not None and (here.speed == 0 or not here.told):
                return told, here if here.speed == 0 else None
            time.sleep(0.003)
        return told, None

    def _answer(self, patience_s: float) -> str:
        assert self._room.stdout is not None
        while b"\n" not in self._heard:
            if not select.select([self._room.stdout], [], [], patience_s)[0]:
                raise NotDrivingError(f"the emulated devices did not answer within {patience_s:g} s")
            data = os.read(self._room.stdout.fileno(), 4096)
            if not data:
                raise NotDrivingError("the emulated devices have ended")
            self._heard += data
        line, _, self._heard = self._heard.partition(b"\n")
        return line.decode()


def killed(processes: Sequence[int]) -> None:
    """Send SIGKILL."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def stopped(processes: Sequence[int]) -> None:
    """Send SIGSTOP."""
    for process in processes:
        os.kill(process, signal.SIGSTOP)


def held(processes: Sequence[int]) -> None:
    """Stop the main thread only, as an endless loop would. Raises OSError where ptrace is not permitted."""
    libc = ctypes.CDLL(None, use_errno=True)
    for process in processes:
        for request in (_PTRACE_SEIZE, _PTRACE_INTERRUPT):
            if libc.ptrace(request, process, None, None) != 0:
                number = ctypes.get_errno()
                raise OSError(number, os.strerror(number))
