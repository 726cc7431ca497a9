"""Ports that cannot be opened, in whole sentences; and a base on a pseudo-terminal."""

import errno
import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from actors.instant import Instant
from actors.runtime.errors import AcrcError
from firmware_bridge import serial_port
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.serial_port import KOBUKI, PortError, SerialPort


def refusal(path: Path | str) -> str:
    with pytest.raises(PortError) as failure:
        SerialPort(str(path), KOBUKI)
    return str(failure.value)


def failing_with(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """Let the next port fail to open as the system would."""

    def fail(*_: object, **__: object) -> Any:
        raise serial_port_module.SerialException(number, "could not open port")

    serial_port_module = importlib.import_module("serial")
    monkeypatch.setattr(serial_port_module, "Serial", fail)


def test_a_missing_port(tmp_path: Path) -> None:
    path = tmp_path / "ttyUSB9"
    assert refusal(path) == (
        f"{path}: there is no such port; plug in the Kobuki and switch it on, or give its right port"
    )


def test_a_missing_link_of_udev(monkeypatch: pytest.MonkeyPatch) -> None:
    failing_with(monkeypatch, errno.ENOENT)
    assert refusal("/dev/kobuki") == (
        "/dev/kobuki: there is no such port; plug in the Kobuki and switch it on, and if it has another "
        "name, as without a udev rule, give that, e.g. /dev/ttyUSB0"
    )


def test_a_port_that_this_user_may_not_open(monkeypatch: pytest.MonkeyPatch) -> None:
    failing_with(monkeypatch, errno.EACCES)
    assert refusal("/dev/ttyUSB0") == (
        "/dev/ttyUSB0: this user may not open it; join its group with `sudo usermod -aG dialout $USER` and "
        "log in again, or give the port to everyone by a udev rule"
    )


def test_a_port_that_is_in_use(tmp_path: Path) -> None:
    link = tmp_path / "kobuki"
    with PseudoTerminal(link), SerialPort(str(link), KOBUKI):
        assert refusal(link) == (
            f"{link}: another program has the port open; end it, as only one can talk to the Kobuki"
        )


def test_a_path_that_is_no_port(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("nothing")
    assert refusal(path) == (
        f"{path}: this is no serial port; the Kobuki should be at /dev/kobuki or e.g. /dev/ttyUSB0"
    )


def test_any_other_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    failing_with(monkeypatch, errno.EIO)
    assert refusal("/dev/ttyUSB0") == (
        "/dev/ttyUSB0: the port cannot be opened (EIO); plug in the Kobuki again"
    )


def test_pyserial_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    assert refusal("/dev/kobuki") == (
        "/dev/kobuki: the Kobuki cannot be reached without the Python package pyserial; "
        "install the extra hardware: pip install 'acrc-testbed[hardware]'"
    )


def test_a_cable_pulled_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = tmp_path / "kobuki"
    with PseudoTerminal(link), SerialPort(str(link), KOBUKI) as port:

        def pulled(*_: object) -> bytes:
            raise OSError(errno.EIO, "gone")

        monkeypatch.setattr(port._port, "read", pulled)
        with pytest.raises(PortError) as failure:
            port.read()
    sentence = f"{link}: the Kobuki has gone while in use (EIO); plug its USB cable in again"
    assert str(failure.value) == sentence


def test_bytes_go_both_ways_and_the_link_goes_with_the_device(tmp_path: Path) -> None:
    link = tmp_path / "kobuki"
    link.symlink_to("/nowhere")  # left behind by one that was killed
    with PseudoTerminal(link) as line, SerialPort(str(link), KOBUKI) as port:
        line.write(b"\x00\x11\x13\n\r\xaa")
        assert _read(port, 6) == b"\x00\x11\x13\n\r\xaa"
        assert port.read() == b""
        port.write(b"\xaa\x55\n")
        assert line.read(1.0) == b"\xaa\x55\n"
        line.write(bytes(100_000))
        assert line.lost > 50_000
    assert not link.is_symlink()


def test_a_link_is_not_put_in_place_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("kept")
    with pytest.raises(AcrcError) as failure:
        PseudoTerminal(path)
    assert str(failure.value) == (
        f"{path}: there is something that is no link; give a path where a link can be made"
    )
    assert path.read_text() == "kept"
    with pytest.raises(AcrcError) as failure:
        PseudoTerminal(tmp_path / "none" / "kobuki")
    assert str(failure.value) == (
        f"{tmp_path / 'none' / 'kobuki'}: no link can be made there (No such file or directory); "
        "give a path in a directory that is yours"
    )


def test_an_emulated_base_in_a_process_of_its_own_is_found_and_driven(tmp_path: Path) -> None:
    link = tmp_path / "kobuki"
    command = [sys.executable, "-m", "firmware_bridge.emulate", "kobuki", "--link", str(link)]
    root = Path(serial_port.__file__).parent.parent
    with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == f"a Kobuki at {link}; stop with Ctrl+C\n"
            driver = _drive(str(link), until_x=0.02)
        finally:
            os.kill(process.pid, signal.SIGTERM)
        assert process.wait(10) == 0
    assert driver.odometry.read().x >= 0.02
    assert driver.identity.complete
    assert not link.is_symlink()


def _read(port: SerialPort, count: int) -> bytes:
    """So many bytes, or what has come within 5 s: they may come in pieces."""
    data, end = b"", time.monotonic() + 5
    while len(data) < count and time.monotonic() < end:
        data += port.read()
    return data


def _drive(path: str, until_x: float) -> KobukiDriver:
    """Drive on until it has got so far, in real time; gives up after 30 s."""
    with SerialPort(path, KOBUKI) as port:
        begun = time.monotonic_ns()
        driver = KobukiDriver(Instant(0))
        now = Instant(0)
        while now < 30_000_000 and not (driver.odometry.read().x >= until_x and driver.identity.complete):
            now = Instant((time.monotonic_ns() - begun) // 1000)
            driver.take(now, port.read())
            driver.command(now, 0.3, 0.0)
            port.write(driver.due(now))
        port.write(driver.farewell())
    return driver
