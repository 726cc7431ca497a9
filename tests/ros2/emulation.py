"""Emulated TurtleBots in a process of their own, for tests."""

import select
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

import msgspec

from actors.installation.repository import REPOSITORY
from actors.robot_model import OdometryKind
from actors.task.loading import DEFAULT, task_setup
from actors.world.world_setup import BodySetup, WorldSetup
from tests.helpers import free_port

STARTS = ((12.0, 12.5, 0.0), (14.0, 12.5, 3.0), (16.0, 12.0, 1.0))
PATIENCE_S = 60.0


def robots_world(models: Sequence[str], odometry: OdometryKind = "kobuki", seed: int = 1) -> WorldSetup:
    """Return a world with robots r1, r2, … of these models in the corridor."""
    bodies = tuple(
        BodySetup(id=f"r{number}", model=model, sensor=None, odometry=odometry, start=start)
        for number, (model, start) in enumerate(zip(models, STARTS, strict=False), start=1)
    )
    map_file = str(REPOSITORY / "maps/corridor.yaml")
    return WorldSetup(map_file, seed, 100_000, 1_000_000, bodies, task_setup(DEFAULT, {}))


class Whereabouts(NamedTuple):
    """Answer to `where`."""

    time_s: float
    travelled: float
    """m."""
    speed: float
    """m/s."""
    is_commanded_to_stand: bool


class TurtlebotProcess:
    """Process with a router and emulated robots; the context manager ends it."""

    def __init__(self, folder: Path, world: WorldSetup, domain: int = 0, **robots: dict[str, object]) -> None:
        """Start it; `robots`: options by name, see EmulatedRobotOptions."""
        self.port = free_port()
        file = folder / "emulation.json"
        file.write_bytes(
            msgspec.json.encode({"world": world, "port": self.port, "domain": domain, "robots": robots})
        )
        self._errors = (folder / "emulation.log").open("w+")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.ros2.emulated_turtlebot", "--setup", str(file)],
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            bufsize=1,
        )

    def __enter__(self) -> Self:
        assert self._read() == "ready", self.errors
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait(PATIENCE_S)
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()
        self._errors.close()

    @property
    def router(self) -> str:
        """Endpoint of the router."""
        return f"tcp/127.0.0.1:{self.port}"

    @property
    def errors(self) -> str:
        """Standard error of the process."""
        return Path(self._errors.name).read_text()

    def ask(self, line: str) -> str:
        """Send a command and return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        return self._read()

    def order(self, line: str) -> None:
        """Send a command that must be accepted."""
        answer = self.ask(line)
        assert answer == "ok", answer

    def where(self, robot: str) -> Whereabouts:
        """Return time, distance travelled and speed of a robot."""
        time_s, travelled, speed, stands = self.ask(f"where {robot}").split()
        return Whereabouts(float(time_s), float(travelled), float(speed), stands == "1")

    def _read(self) -> str:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], PATIENCE_S)
        assert ready, f"timeout of the emulated robots: {self.errors}"
        return self._process.stdout.readline().rstrip("\n")
