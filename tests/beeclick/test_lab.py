"""Links and emulated boards together in simulated time; the port of a board."""

import os
import pty
import tty
from collections.abc import Iterator

import numpy as np
import pytest

from actors.instant import START, Instant, milliseconds, seconds
from actors.radio.radio_model import RadioSetup, radio_model
from firmware_bridge.beeclick.air import Device, EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import BeeClickParameters, BoardSettings
from firmware_bridge.beeclick.reception import PacketEnd
from firmware_bridge.serial_port import BoardPort, PortError
from tests.beeclick.hosts import boards as row_of_boards
from tests.beeclick.hosts import causes, states
from tests.beeclick.lab import Desk, Lab

QUICK = BeeClickParameters(
    answer_timeout=milliseconds(100),
    doubt=milliseconds(50),
    probe_interval=milliseconds(100),
    sync_interval=milliseconds(40),
)


def lab(boards: int, seed: int = 1, parameters: BeeClickParameters | None = None, poll: int = 1_000) -> Lab:
    air = row_of_boards(boards, seed=seed)
    desks = []
    for number, board in enumerate(air.devices):
        assert isinstance(board, EmulatedBoard)
        desks.append(Desk(BoardLink(BoardSettings(number + 1), parameters or BeeClickParameters()), board))
    return Lab(air, desks, np.random.default_rng(seed), milliseconds(poll / 1_000))


def ends(desk: Desk) -> list[tuple[str, int]]:
    return [(type(e).__name__, e.tag) for e in desk.events if isinstance(e, PacketEnd)]


def test_a_restarted_board_is_set_up_again_and_its_packets_are_unconfirmed() -> None:
    room = lab(2)
    desk = room.desks[0]
    room.run(milliseconds(50))
    for tag in range(4):
        desk.send(room.now, tag, bytes(118))
    room.run(milliseconds(7))
    desk.board.reboot(room.now)
    room.run(seconds(1.2))
    assert desk.link.phase is LinkPhase.READY
    assert (desk.board.pan, desk.board.address, desk.board.channel) == (0xBABA, 1, 15)
    kinds = {tag: kind for kind, tag in ends(desk)}
    assert sorted(kinds) == [0, 1, 2, 3]
    assert [kinds[tag] for tag in (1, 2, 3)] == ["UnconfirmedPacket"] * 3
    assert causes(desk.events) == ["answer_skipped"]


def test_the_button_does_no_harm_to_a_board_that_is_being_found() -> None:
    for delay in range(0, 400, 80):
        room = lab(1)
        (desk,) = room.desks
        room.run(milliseconds(50))
        desk.board.reboot(room.now)
        room.run(milliseconds(1_700 + delay))
        desk.board.press(room.now)
        room.run(seconds(3))
        assert not desk.board.hung
        assert desk.link.phase is LinkPhase.READY


def test_noise_that_only_the_board_hears_costs_half_a_second_at_most() -> None:
    """Idle, or with a packet on its way: a command is lost, and nothing shows but that no answer comes."""
    for busy in (False, True):
        for delay in range(0, 250, 80):
            room = lab(1)
            (desk,) = room.desks
            room.run(milliseconds(1_000 + delay))
            desk.board.take(room.now, bytes(range(5, 60)))
            room.run(milliseconds(2))
            assert not desk.board.commands.in_step
            if busy:
                desk.send(room.now, 1, b"lost")
            room.run(milliseconds(510))
            assert desk.board.commands.in_step and desk.link.phase is LinkPhase.READY
            desk.send(room.now, 2, b"comes through")
            room.run(milliseconds(30))
            assert ends(desk)[-1] == ("Sent", 2)


class WedgedAir(EmulatedAir):
    """Loses the interrupt at a frame's end: the board waits for it for ever, and goes on talking."""

    wedged = True

    def transmit(self, device: Device, now: Instant, tag: int, data: bytes) -> None:
        if not self.wedged:
            super().transmit(device, now, tag, data)


def test_a_wedged_radio_is_silent_once_and_its_boards_ring_is_not_overrun() -> None:
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    air = WedgedAir([1], lambda channel: model, 1)
    desk = Desk(BoardLink(BoardSettings(1)), EmulatedBoard(air, START))
    air.add(desk.board)
    room = Lab(air, [desk], np.random.default_rng(1))
    room.run(milliseconds(50))
    for second in range(20):
        desk.send(room.now, second, bytes(50))
        room.run(seconds(1))
    assert [event.up for event in states(desk.events)] == [True, False, False]
    assert causes(desk.events) == [
        "no_confirmation",
        "silent",
    ]
    # At 12 s it has eight commands; with one of them in the air none is lost, but the ring looks empty.
    assert desk.board.commands.overflows == 1
    assert desk.link.counters["silent"] == 1
    air.wedged = False
    desk.board.reboot(room.now)
    room.run(seconds(10.5))
    desk.send(room.now, 99, b"again")
    room.run(milliseconds(100))
    assert states(desk.events)[-1].up and ("Sent", 99) in ends(desk)


class Terminal:
    """A pseudo-terminal: the board's end, and the path of the host's."""

    def __init__(self) -> None:
        self.board, host = pty.openpty()
        tty.setraw(host)
        self.path = os.ttyname(host)
        os.close(host)
        self._is_open = True

    def hang_up(self) -> None:
        if self._is_open:
            self._is_open = False
            os.close(self.board)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    one = Terminal()
    yield one
    one.hang_up()


def test_writing_does_not_wait_and_loses_nothing(terminal: Terminal) -> None:
    board, path = terminal.board, terminal.path
    data = os.urandom(200_000)
    with BoardPort(path) as port:
        assert port.read() == b""
        os.write(board, bytes(range(256)))
        assert port.read() == bytes(range(256))
        port.write(data)
        assert not port.is_idle
        got = bytearray()
        while len(got) < len(data):
            got += os.read(board, 65_536)
            port.write(b"")
        assert port.is_idle
        assert bytes(got) == data


def test_a_port_that_is_unplugged_is_told_in_reading_and_in_writing(terminal: Terminal) -> None:
    with BoardPort(terminal.path) as port:
        terminal.hang_up()
        with pytest.raises(PortError) as reading:
            port.read()
        with pytest.raises(PortError) as writing:
            port.write(b"x")
    gone = f"{terminal.path}: the BEE-click board has gone while in use"
    assert str(reading.value) == f"{gone} (end of file); plug its USB cable in again"
    assert str(writing.value) == f"{gone} (EIO); plug its USB cable in again"
