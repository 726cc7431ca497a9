import os
import pty
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from actors.instant import Instant
from actors.messages import Heard, Sent
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.reception import Event
from firmware_bridge.emulate import main
from firmware_bridge.serial_port import BoardPort, PortError

ROOT = Path(__file__).parents[2]
PATIENCE_S = 20.0


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


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


# --- opening ---------------------------------------------------------------------------------------------


def test_a_missing_port_is_told_with_its_fix() -> None:
    with pytest.raises(PortError) as caught:
        BoardPort("/dev/there-is-none")
    assert str(caught.value) == (
        "/dev/there-is-none: there is no such port; plug in the BEE-click board and switch it on, "
        "or give its right port"
    )


def test_what_is_no_serial_port_is_told(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("no port")
    with pytest.raises(PortError) as caught:
        BoardPort(str(file))
    assert str(caught.value) == (
        f"{file}: this is no serial port; the BEE-click board should be at /dev/beeclick or e.g. /dev/ttyUSB0"
    )


def test_a_port_that_is_in_use_is_told(terminal: Terminal) -> None:
    path = terminal.path
    with BoardPort(path), pytest.raises(PortError) as caught:
        BoardPort(path)
    assert str(caught.value) == (
        f"{path}: another program has the port open; end it, as only one can talk to the BEE-click board"
    )


def test_a_port_without_rights_is_told(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    path = terminal.path

    def refuse(*_: object, **__: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("serial.serialposix.os.open", refuse)
    with pytest.raises(PortError) as caught:
        BoardPort(path)
    assert str(caught.value) == (
        f"{path}: this user may not open it; join its group with `sudo usermod -aG dialout $USER` and log in "
        "again, or give the port to everyone by a udev rule"
    )


def test_a_missing_pyserial_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(PortError) as caught:
        BoardPort("/dev/ttyUSB0")
    assert str(caught.value) == (
        "/dev/ttyUSB0: the BEE-click board cannot be reached without the Python package pyserial; "
        "install the extra hardware: pip install 'acrc-testbed[hardware]'"
    )


# --- reading and writing ---------------------------------------------------------------------------------


def test_reading_does_not_wait_and_bytes_come_unchanged(terminal: Terminal) -> None:
    board, path = terminal.board, terminal.path
    everything = bytes(range(256))
    with BoardPort(path) as port:
        assert port.read() == b""
        os.write(board, everything)
        assert port.read() == everything
        port.write(everything)
        assert port.is_idle
        assert os.read(board, 4096) == everything


def test_writing_does_not_wait_and_loses_nothing(terminal: Terminal) -> None:
    board, path = terminal.board, terminal.path
    data = os.urandom(200_000)
    with BoardPort(path) as port:
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


# --- emulated boards in real time ------------------------------------------------------------------------


def test_emulated_boards_hear_one_another_until_they_are_stopped(tmp_path: Path) -> None:
    folder = tmp_path / "boards"
    command = [
        sys.executable,
        "-m",
        "firmware_bridge.emulate",
        "boards",
        "--boards",
        "2",
        "--links",
        str(folder),
    ]
    emulator = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        assert emulator.stdout is not None
        line = emulator.stdout.readline()
        assert line == f"boards at {folder}/board1, {folder}/board2; stop with Ctrl+C\n"
        with BoardPort(str(folder / "board1")) as one, BoardPort(str(folder / "board2")) as two:
            converse([one, two])
    finally:
        emulator.send_signal(signal.SIGTERM)
        assert emulator.wait(PATIENCE_S) == 0
    assert list(folder.iterdir()) == []


def converse(ports: list[BoardPort]) -> None:
    """Get both boards ready, send from each to the other."""
    links = [BoardLink(BoardSettings(number + 1)) for number in range(len(ports))]
    events: list[list[Event]] = [[] for _ in ports]

    def serve() -> None:
        for port, link, found in zip(ports, links, events, strict=True):
            now = Instant(time.monotonic_ns() // 1000)
            found.extend(link.take(now, port.read()))
            port.write(link.due(now) if port.is_idle else b"")

    def all_are(condition: Callable[[int], bool]) -> Callable[[], bool]:
        def served() -> bool:
            serve()
            return all(condition(number) for number in range(len(ports)))

        return served

    for link in links:
        link.connect(Instant(time.monotonic_ns() // 1000))
    wait_for(all_are(lambda n: links[n].phase is LinkPhase.READY))
    for number, link in enumerate(links):  # one after the other: at once they may collide
        link.send(Instant(0), number, bytes([number]) * 118)
        wait_for(all_are(lambda _: any(isinstance(e, Heard) for e in events[1 - number])))  # noqa: B023
    wait_for(all_are(lambda n: any(isinstance(e, Sent) for e in events[n])))
    heard = [[(e.sender, e.data) for e in found if isinstance(e, Heard)] for found in events]
    assert heard == [[(2, b"\x01" * 118)], [(1, b"\x00" * 118)]]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--boards", "0"], "There cannot be 0 boards; it must be 1 to 100."),
        (["--boards", "101"], "There cannot be 101 boards; it must be 1 to 100."),
    ],
)
def test_nonsense_on_the_command_line_is_told(
    options: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["boards", *options, "--links", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"{sentence}\n"


def test_a_link_where_something_is_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "board1").write_text("mine")
    assert main(["boards", "--boards", "1", "--links", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f"{tmp_path}/board1: there is something that is no link; give a path where a link can be made\n"
    )
