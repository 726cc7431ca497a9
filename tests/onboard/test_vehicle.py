"""A port that comes and goes, and what keeps a TurtleBot from driving."""

import pytest

from actors.instant import Instant
from firmware_bridge.onboard.device_loop import ReconnectingPort
from firmware_bridge.onboard.vehicle import LastWord, TurtleBot
from firmware_bridge.serial_port import PortError, SerialPort
from tests.kobuki.drives import Rig

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


def nothing_plugged_in() -> SerialPort:
    raise AssertionError("the port is not asked for")


def vehicle(rig: Rig) -> TurtleBot:
    return TurtleBot(nothing_plugged_in, rig.driver, None, LastWord("base"), lambda line: None)


@pytest.mark.parametrize(
    ("fault", "value", "told"),
    [
        ("battery", 16.0, ()),
        ("battery", 14.0, ("the battery is low",)),
        ("battery", 13.0, ("the battery is nearly empty",)),
        ("overcurrent", 1, ("a wheel's motor draws too much current: something may hold it",)),
    ],
)
def test_what_holds_the_base_is_told(fault: str, value: float, told: tuple[str, ...]) -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    setattr(rig.base.faults, fault, value)
    rig.run(0.5, (0.1, 0.0))
    assert vehicle(rig).held() == told
