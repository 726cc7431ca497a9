"""Event loop of base and bridge: waits for serial ports, mesh and clock; reopens lost ports."""

import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Generic, Protocol, Self, TypeVar

import msgspec

from actors.instant import Instant, seconds
from actors.robot_model import RobotDescription
from actors.runtime.core import Address, Inputs, Output
from actors.runtime.process_setup import ActorSetup, ProcessSetup, resolve_model
from actors.runtime.shell import Shell
from actors.runtime.zenoh_bus import SelectableBus
from actors.task.loading import TaskSetup
from firmware_bridge.beeclick.answer_decoder import BoardSettings
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.serial_port import PortError, Say, SerialPort, changed_only

OPENNI: Final = "openni"
"""Value of `range` for a depth camera, which is found without a port."""
PATIENCE_S: Final = 30.0
"""Timeout of a base for answers; own choice, longer than a robot's restart."""


class BaseSetup(RobotDescription, frozen=True, kw_only=True):
    """Set-up of a base process."""

    step_us: int
    task: TaskSetup
    """For readers of recordings only."""
    base: str | Ros2Base
    """Path of the Kobuki's port, or a ROS 2 robot, which has a range sensor of its own."""
    range: str | None
    """Path of the lidar's port, or OPENNI; None = no range sensor, or that of a ROS 2 robot."""
    listen: str | None
    """Endpoint for the operator's laptop, `tls/HOST:PORT`; None = no connections."""
    keys: str | None
    """Folder with the robot's keys; required with `listen`."""
    last_pose: str
    """File for the robot's last pose estimate."""
    patience_s: float | None
    """Timeout of answers of robot and bridge, after which the base exits, s; None: no limit (debugger)."""

    def resolve_paths(self, folder: Path) -> Self:
        """Return the set-up with paths resolved against `folder`, in which it was read."""
        last_pose = str(folder / self.last_pose)
        return msgspec.structs.replace(self, model=resolve_model(self.model, folder), last_pose=last_pose)


class BridgeSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Set-up of a bridge process."""

    robot: str
    step_us: int
    radio: str
    """Path of the board's port, or with `keys` the endpoint of a simulated medium, `tls/HOST:PORT`."""
    settings: BoardSettings
    board: bool = True
    """False if it is a simulated transceiver without a board."""
    keys: str | None = None
    """Folder with the robot's keys, to connect to the medium over a network; None = a port."""


BaseProcessSetup = ActorSetup[BaseSetup, ProcessSetup]
"""Set-up file of a base."""
BridgeProcessSetup = ActorSetup[BridgeSetup, ProcessSetup]
"""Set-up file of a bridge."""


class Clock:
    """Monotonic microseconds, since the Unix epoch or since now, unaffected when the clock is set."""

    def __init__(self, *, from_zero: bool = False) -> None:
        self._ahead_ns = (0 if from_zero else time.time_ns()) - time.monotonic_ns()

    def now(self) -> Instant:
        """Return the current time."""
        return Instant((time.monotonic_ns() + self._ahead_ns) // 1000)


class TimedCore(ABC):
    """Core with the time as input; `expect` announces a message, otherwise only time passes."""

    def __init__(self) -> None:
        self.now = Instant(0)
        self.step = 0
        self.finished = False
        self._expected: Address | None = None

    def expect(self, key: str) -> None:
        """Announce a message on `key` for the next advance."""
        self._expected = next(address for address in self.listens() if address.key == key)

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return the announced address, if its message is missing."""
        expected = self._expected
        return () if expected is None or expected.key in have else (expected,)

    @property
    @abstractmethod
    def wake(self) -> Instant | None:
        """Time of the next action without a message; None: none."""

    @property
    def has_news(self) -> bool:
        """True if an advance without a message is due."""
        return False

    @abstractmethod
    def listens(self) -> Sequence[Address]:
        """Return the addresses of incoming messages."""

    @abstractmethod
    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Process one message, or the passing of time."""


class ServedDevices(Protocol):
    """Ports of a process, served by the event loop."""

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""

    def serve(self, now: Instant) -> None:
        """Exchange bytes with the devices; called at least every `LONGEST_WAIT`."""


LONGEST_WAIT = 0.02
"""Maximum wait, s; a Kobuki needs a command per feedback, 50 per second."""


def run_event_loop(
    shell: Shell,
    bus: SelectableBus,
    core: TimedCore,
    devices: ServedDevices,
    clock: Clock,
) -> None:
    """Run the event loop until the core has finished."""
    while not core.finished:
        wake = core.wake
        wait = LONGEST_WAIT if wake is None else min(LONGEST_WAIT, (wake - clock.now()) / 1e6)
        select.select([bus.fileno(), *devices.descriptors()], [], [], max(0.0, wait))
        core.now = clock.now()
        devices.serve(core.now)
        for delivery in bus.take():
            core.now = clock.now()
            core.expect(delivery.key)
            shell.deliver(delivery)
            shell.pump()
        core.now = clock.now()
        if not core.finished and core.has_news:
            shell.pump()


_RETRY = seconds(1)
"""Delay before reopening a missing port."""
P = TypeVar("P", bound=SerialPort)
R = TypeVar("R")


class ReconnectingPort(Generic[P]):
    """A port that is reopened after a loss."""

    def __init__(self, open_port: Callable[[], P], say: Say) -> None:
        """Create it, closed; `say`: called once with each new cause of failure."""
        self.port: P | None = None
        """A new object after each opening; None while closed."""
        self._open = open_port
        self._say = changed_only(say)
        self._retry_at = Instant(0)

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""
        return () if self.port is None else (self.port.fileno(),)

    def connect(self, now: Instant) -> bool:
        """Open a closed port, at most once per second; return True if it was opened now."""
        if self.port is not None or now < self._retry_at:
            return False
        self._retry_at = Instant(now + _RETRY)
        try:
            self.port = self._open()
        except PortError as error:
            self._say(str(error))
            return False
        self._say("")
        return True

    def exchange(self, use: Callable[[P], R]) -> R | None:
        """Call `use` with the port and return its result; None if the port is closed or lost."""
        if self.port is None:
            return None
        try:
            return use(self.port)
        except PortError as error:
            self._say(str(error))
            ReconnectingPort.close(self)
            return None

    def close(self) -> None:
        """Close the port."""
        if self.port is not None:
            self.port.close()
            self.port = None


class DeviceDriver(Protocol):
    """Common interface of the drivers of Kobuki and lidar."""

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now."""

    def final_bytes(self) -> bytes:
        """Return the last bytes to write."""


class DeviceLine(ReconnectingPort[SerialPort]):
    """A device's driver on a port that is reopened after a loss."""

    def __init__(
        self,
        open_port: Callable[[], SerialPort],
        driver: DeviceDriver,
        take: Callable[[Instant, bytes], None],
        say: Say,
    ) -> None:
        """Create it; `take`: passes bytes read to the driver, `say`: as in ReconnectingPort."""
        super().__init__(open_port, say)
        self._driver = driver
        self._take = take

    def serve(self, now: Instant) -> None:
        """Exchange bytes with the device; reopen a lost port."""
        self.connect(now)
        self._take(now, self.exchange(lambda port: port.read()) or b"")
        if due := self._driver.due(now):
            self.exchange(lambda port: port.write(due))

    def close(self) -> None:
        """Send the driver's last bytes and close the port."""
        last = self._driver.final_bytes()
        self.exchange(lambda port: port.write(last))
        super().close()
