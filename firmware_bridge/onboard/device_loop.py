"""Event loop of base and bridge: waits for serial ports, mesh and clock; reopens ports that disappear."""

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
from actors.runtime.process_setup import ActorSetup, ProcessSetup, located_model
from actors.runtime.shell import Shell
from actors.runtime.zenoh_bus import WakingBus
from firmware_bridge.beeclick.reception import BoardSettings
from firmware_bridge.serial_port import PortError, SerialPort

OPENNI: Final = "openni"
"""The range sensor that is no port: a depth camera, found by itself."""
PATIENCE_S: Final = 30.0
"""Of a base; own choice: a restarted robot should be there by then."""


class BaseSetup(RobotDescription, frozen=True, kw_only=True):
    """Everything a base needs to know."""

    step_us: int
    base: str
    """Path of the Kobuki's port."""
    range: str | None
    """Path of the lidar's port, or OPENNI; None = there is none."""
    listen: str | None = None
    """Where the operator's laptop may connect, `tls/HOST:PORT`; None = nowhere."""
    keys: str | None = None
    """Folder with the robot's own keys; needed to listen."""
    last_pose: str | None = None
    """File with where the robot last held itself to be; None: nobody keeps it."""
    patience_s: float | None = PATIENCE_S
    """A robot or bridge that does not answer for so long hangs, and the base ends, s. None: a debugger may
    hold it."""

    def located(self, folder: Path) -> Self:
        """With its files as they are called for who does not stand in `folder`, where the set-up lies."""
        last_pose = None if self.last_pose is None else str(folder / self.last_pose)
        return msgspec.structs.replace(self, model=located_model(self.model, folder), last_pose=last_pose)


class BridgeSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a bridge needs to know."""

    robot: str
    step_us: int
    radio: str
    """Path of the board's port."""
    settings: BoardSettings
    board: bool = True
    """False: at the port is a transceiver of a laboratory's, without a board."""


BaseProgram = ActorSetup[BaseSetup, ProcessSetup]
"""What a base's process reads."""
BridgeProgram = ActorSetup[BridgeSetup, ProcessSetup]
"""What a bridge's process reads."""


class Clock:
    """Microseconds since the Unix epoch that never go back, whatever becomes of the machine's clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> Instant:
        """The instant that it is."""
        return Instant((time.monotonic_ns() + self._ahead_ns) // 1000)

    def seconds_until(self, instant: Instant | None) -> float:
        """How long it is until then, s, at least 0; a second if there is no instant."""
        return 1.0 if instant is None else max(0.0, (instant - self.now()) / 1e6)


class TimedCore(ABC):
    """A core that is told the time, and by `expect` which message comes next; else time has passed."""

    def __init__(self) -> None:
        self.now = Instant(0)
        self.step = 0
        self.finished = False
        self._expected: Address | None = None

    def expect(self, key: str) -> None:
        """The next advance takes the message that has come on that key."""
        self._expected = next(address for address in self.listens() if address.key == key)

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return what was announced by `expect`."""
        expected = self._expected
        return () if expected is None or expected.key in have else (expected,)

    @abstractmethod
    def listens(self) -> Sequence[Address]:
        """Return every address that a message may come in on."""

    @abstractmethod
    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take in one message, or the passing of time."""


class Devices(Protocol):
    """The ports beside the mesh."""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; called at least every `LONGEST_WAIT`."""

    @property
    def wake(self) -> Instant | None:
        """When to be served again, if nothing comes before."""


LONGEST_WAIT = 0.02
"""s; a Kobuki wants a command with each feedback, 50 a second."""


def conduct(
    shell: Shell,
    bus: WakingBus,
    core: TimedCore,
    devices: Devices,
    clock: Clock,
    wake: Callable[[], Instant | None],
    timely: Callable[[], bool],
) -> None:
    """Run until the core has finished.

    `wake`: when the core wants an advance without a message, if it says so by `timely`.
    """
    while not core.finished:
        due = [instant for instant in (wake(), devices.wake) if instant is not None]
        patience = min(LONGEST_WAIT, clock.seconds_until(min(due) if due else None))
        select.select([bus.fileno(), *devices.descriptors()], [], [], patience)
        core.now = clock.now()
        devices.serve(core.now)
        for delivery in bus.take():
            core.now = clock.now()
            core.expect(delivery.key)
            shell.deliver(delivery)
            shell.pump()
        core.now = clock.now()
        if not core.finished and timely():
            shell.pump()


_RETRY = seconds(1)
"""Between attempts to open a port that is not there."""
P = TypeVar("P", bound=SerialPort)
R = TypeVar("R")


class ReconnectingPort(Generic[P]):
    """A port that is opened anew whenever it has gone and is there again."""

    def __init__(self, open_port: Callable[[], P], say: Callable[[str], None]) -> None:
        """`say` is told, in a sentence and once for each reason, when the port is away."""
        self.port: P | None = None
        """Another object each time that it is opened; None while it is not."""
        self._open = open_port
        self._tell = say
        self._retry_at = Instant(0)
        self._said = ""

    def descriptors(self) -> Sequence[int]:
        """Return what to wait for."""
        return () if self.port is None else (self.port.fileno(),)

    def connect(self, now: Instant) -> bool:
        """Open the port if it is away, at most once a second; True if it has just been opened."""
        if self.port is not None or now < self._retry_at:
            return False
        self._retry_at = Instant(now + _RETRY)
        try:
            self.port = self._open()
        except PortError as error:
            self._say(str(error))
            return False
        self._said = ""
        return True

    def exchange(self, use: Callable[[P], R]) -> R | None:
        """Return what `use` returns for the port; None if the port is away, or goes meanwhile."""
        if self.port is None:
            return None
        try:
            return use(self.port)
        except PortError as error:
            self._say(str(error))
            ReconnectingPort.close(self)
            return None

    def close(self) -> None:
        """Give the port back."""
        if self.port is not None:
            self.port.close()
            self.port = None

    def _say(self, sentence: str) -> None:
        if sentence != self._said:
            self._tell(sentence)
        self._said = sentence


class DeviceDriver(Protocol):
    """What the drivers of Kobuki and lidar have in common."""

    def due(self, now: Instant) -> bytes:
        """The bytes to write now."""

    def farewell(self) -> bytes:
        """The last bytes to write."""


class DeviceLine(ReconnectingPort[SerialPort]):
    """One device and its driver on one port, which may come and go."""

    def __init__(
        self,
        open_port: Callable[[], SerialPort],
        driver: DeviceDriver,
        take: Callable[[Instant, bytes], None],
        say: Callable[[str], None],
    ) -> None:
        """`take` gives the driver what has come; `say` as in ReconnectingPort."""
        super().__init__(open_port, say)
        self._driver = driver
        self._take = take

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        self.connect(now)
        self._take(now, self.exchange(lambda port: port.read()) or b"")
        if due := self._driver.due(now):
            self.exchange(lambda port: port.write(due))

    def close(self) -> None:
        """Send the driver's last bytes, and give the port back."""
        last = self._driver.farewell()
        self.exchange(lambda port: port.write(last))
        super().close()
