"""A device on a serial port that may come and go, and its driver without I/O."""

from collections.abc import Callable, Sequence
from typing import Protocol

from actors.instant import Instant
from firmware_bridge.onboard.reconnecting_port import ReconnectingPort
from firmware_bridge.serial_port import SerialPort


class WireDriver(Protocol):
    """What a Kobuki's and a lidar's driver have in common."""

    def due(self, now: Instant) -> bytes:
        """The bytes to write now."""

    def farewell(self) -> bytes:
        """The last bytes to write."""


class Wire:
    """One device on one port, which may come and go."""

    def __init__(
        self,
        open_port: Callable[[], SerialPort],
        driver: WireDriver,
        take: Callable[[Instant, bytes], None],
        say: Callable[[str], None],
    ) -> None:
        """`take`: gives the driver what has come. `say` is told, in a sentence, when the port is away."""
        self._line = ReconnectingPort(open_port, say)
        self._driver = driver
        self._take = take

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return self._line.descriptors()

    @property
    def port(self) -> SerialPort | None:
        """Another object each time that it is opened; None while it is not."""
        return self._line.port

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        self._line.connect(now)
        self._take(now, self._line.exchange(lambda port: port.read()) or b"")
        if due := self._driver.due(now):
            self._line.exchange(lambda port: port.write(due))

    def close(self) -> None:
        """Say farewell to the device, and give the port back."""
        last = self._driver.farewell()
        self._line.exchange(lambda port: port.write(last))
        self._line.close()
