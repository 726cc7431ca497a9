"""A device on a serial port that may come and go, and its driver without I/O."""

from collections.abc import Callable, Sequence
from typing import Protocol

from actors.instant import Instant, seconds
from firmware_bridge.serial_port import PortError, SerialPort

_RETRY = seconds(1)
"""A port that is not there is tried again so often."""


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
        self._tell = say
        self._open = open_port
        self._driver = driver
        self._take = take
        self._port: SerialPort | None = None
        self._retry_at = Instant(0)
        self._said = ""

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return () if self._port is None else (self._port.fileno(),)

    @property
    def port(self) -> SerialPort | None:
        """Another object each time that it is opened; None while it is not."""
        return self._port

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        if self._port is None:
            self._connect(now)
        data = self._exchange(lambda port: port.read()) or b""
        self._take(now, data)
        if due := self._driver.due(now):
            self._exchange(lambda port: port.write(due))

    def close(self) -> None:
        """Say farewell to the device, and give the port back."""
        last = self._driver.farewell()
        self._exchange(lambda port: port.write(last))
        if self._port is not None:
            self._port.close()

    def _connect(self, now: Instant) -> None:
        if now < self._retry_at:
            return
        self._retry_at = Instant(now + _RETRY)
        try:
            self._port = self._open()
            self._say("")
        except PortError as error:
            self._say(str(error))

    def _exchange(self, what: Callable[[SerialPort], bytes | None]) -> bytes | None:
        if self._port is None:
            return None
        try:
            return what(self._port)
        except PortError as error:
            self._say(str(error))
            self._port.close()
            self._port = None
            return None

    def _say(self, sentence: str) -> None:
        """Each thing once, into the process's log."""
        if sentence and sentence != self._said:
            self._tell(sentence)
        self._said = sentence
