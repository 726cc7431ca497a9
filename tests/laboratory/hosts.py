"""Laboratory process, and hosts of its devices."""

import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import msgspec

from actors.instant import Instant
from actors.messages import Scan
from actors.radio.radio_model import RadioSetup
from actors.robot_model import OdometryKind, load_model
from actors.task.loading import DEFAULT, task_setup
from actors.world.world_setup import BodySetup, WorldSetup
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.laboratory.laboratory import LaboratoryResult, LaboratorySetup
from firmware_bridge.range_sensors import rplidar
from firmware_bridge.range_sensors.rplidar import Rplidar
from firmware_bridge.serial_port import KOBUKI, RPLIDAR, SerialPort
from tests import helpers

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
STARTS = ((12.0, 12.5, 0.0), (14.0, 12.5, 3.0), (16.0, 12.0, 1.0))


def setup(robots: int, odometry: OdometryKind = "exact") -> LaboratorySetup:
    """Return a set-up with robots r1, r2, … in the corridor."""
    bodies = tuple(
        BodySetup(
            id=f"r{number}",
            model="turtlebot2",
            sensor=None,
            odometry=odometry,
            start=start,
        )
        for number, start in enumerate(STARTS[:robots], start=1)
    )
    task = task_setup(DEFAULT, {})
    world = WorldSetup(str(ROOT / "maps/corridor.yaml"), 1, 100_000, 1_000_000, bodies, task)
    addresses = tuple((body.id, number) for number, body in enumerate(bodies, start=1))
    return LaboratorySetup(
        world, RadioSetup(seed=1, step_us=100_000, robots=addresses, preset="beeclick", map=world.map)
    )


def now() -> Instant:
    return Instant(time.monotonic_ns() // 1000)


class Running:
    """A laboratory process; the context manager kills it at its end."""

    def __init__(self, folder: Path, built_from: LaboratorySetup, *options: str) -> None:
        self.links, self.result = folder / "links", folder / "result.json"
        file = folder / "setup.json"
        file.write_bytes(msgspec.json.encode(built_from))
        paths = ("--setup", str(file), "--links", str(self.links), "--result", str(self.result))
        self._errors = (folder / "errors.log").open("w+")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "firmware_bridge.laboratory", *paths, *options],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            bufsize=1,
        )

    def __enter__(self) -> Self:
        assert self._heard() == "ready"
        return self

    def __exit__(self, *error: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait(PATIENCE_S)
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()
        self._errors.close()

    @property
    def complaints(self) -> str:
        """Standard error, after the exit."""
        return Path(self._errors.name).read_text()

    def pause(self, duration_s: float) -> None:
        """Suspend the process for `duration_s`."""
        self._process.send_signal(signal.SIGSTOP)
        time.sleep(duration_s)
        self._process.send_signal(signal.SIGCONT)

    def path(self, robot: str, device: str) -> Path:
        return self.links / robot / device

    def say(self, line: str) -> str:
        """Send a command and return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        return self._heard()

    def end(self, number: int | None = signal.SIGTERM) -> LaboratoryResult:
        """Stop it by signal `number` (None: wait for its exit) and return the result."""
        if number is not None:
            self._process.send_signal(number)
        assert self._process.wait(PATIENCE_S) == 0
        return msgspec.json.decode(self.result.read_bytes(), type=LaboratoryResult)

    def _heard(self) -> str:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], PATIENCE_S)
        assert ready, "timeout of the laboratory"
        return self._process.stdout.readline().rstrip("\n")


def until(condition: Callable[[], bool], *hosts: "BaseHost | LidarHost") -> None:
    def served() -> bool:
        for host in hosts:
            host.serve()
        return condition()

    helpers.until(served, PATIENCE_S, 0.001)


class BaseHost:
    """Host of a Kobuki, which repeats one command."""

    def __init__(self, path: Path) -> None:
        self._port = SerialPort(str(path), KOBUKI)
        # Tolerate tests that do not run for seconds on a busy machine.
        self.driver = KobukiDriver(now())
        self.driver.odometry.longest_gap = 20.0
        self.wanted = (0.0, 0.0)

    def serve(self) -> None:
        at = now()
        self.driver.take(at, self._port.read())
        self.driver.command(at, *self.wanted)
        if data := self.driver.due(at):
            self._port.write(data)

    def close(self) -> None:
        self._port.close()


class LidarHost:
    """Host of a lidar, which stores scans."""

    def __init__(self, path: Path) -> None:
        self._port = SerialPort(str(path), RPLIDAR)
        self._lidar = Rplidar(load_model("turtlebot2").sensor, now())
        self.scans: list[Scan] = []

    @property
    def counts(self) -> rplidar.RplidarCounts:
        return self._lidar.counts

    def serve(self) -> None:
        at = now()
        self._lidar.take(at, self._port.read())
        if data := self._lidar.due(at):
            self._port.write(data)
        if (scan := self._lidar.scan()) is not None:
            self.scans.append(scan)

    def close(self) -> None:
        self._port.close()
