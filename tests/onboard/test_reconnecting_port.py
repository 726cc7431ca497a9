"""A port that goes and comes: when it is tried, what is said, and what an exchange gives meanwhile."""

from actors.instant import Instant
from firmware_bridge.onboard.device_loop import ReconnectingPort
from firmware_bridge.serial_port import PortError, SerialPort

SECOND = 1_000_000


class Plug:
    """A cable: while it is in, ports can be opened; the last one breaks when it is pulled."""

    def __init__(self) -> None:
        self.is_in, self.opened, self.tried = False, 0, 0
        self.said: list[str] = []

    def open(self) -> SerialPort:
        self.tried += 1
        if not self.is_in:
            raise PortError("there is no such port")
        self.opened += 1
        return Port(self)


class Port(SerialPort):
    def __init__(self, plug: Plug) -> None:
        self.plug, self.closed = plug, False

    def read(self) -> bytes:
        if not self.plug.is_in:
            raise PortError("it has gone")
        return b"hello"

    def fileno(self) -> int:
        return 77

    def close(self) -> None:
        self.closed = True


def test_a_port_that_is_away_is_tried_once_a_second_and_lamented_once() -> None:
    plug = Plug()
    line = ReconnectingPort(plug.open, plug.said.append)
    assert not any(line.connect(Instant(ms * 1000)) for ms in range(0, 3_500, 100))
    assert (plug.tried, plug.said) == (4, ["there is no such port"])
    assert line.port is None and line.descriptors() == ()
    assert line.exchange(lambda port: port.read()) is None


def test_it_is_opened_anew_and_says_again_why_it_went() -> None:
    plug = Plug()
    line = ReconnectingPort(plug.open, plug.said.append)
    for round_ in range(1, 3):
        plug.is_in = True
        assert line.connect(Instant(round_ * 10 * SECOND)) and not line.connect(Instant(round_ * 20 * SECOND))
        first = line.port
        assert isinstance(first, Port) and line.descriptors() == (77,)
        assert line.exchange(lambda port: port.read()) == b"hello"
        plug.is_in = False
        assert line.exchange(lambda port: port.read()) is None
        assert first.closed and line.port is None and line.descriptors() == ()
        assert (plug.opened, plug.said) == (round_, ["it has gone"] * round_)


def test_closing_gives_the_port_back() -> None:
    plug = Plug()
    plug.is_in = True
    line = ReconnectingPort(plug.open, plug.said.append)
    line.connect(Instant(0))
    port = line.port
    line.close()
    line.close()
    assert isinstance(port, Port) and port.closed and line.port is None
