"""The driver at an emulated base: its events and what it sends; serial ports and why they fail."""

import errno
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import serial

from actors.runtime.errors import AcrcError
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.kobuki.driver import (
    BatteryChanged,
    BatteryLevel,
    FieldChanged,
    Found,
    Lost,
    Sense,
    StopsChanged,
)
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import (
    POWER_RAILS,
    BaseControl,
    Command,
    GeneralOutput,
    SoundSequence,
)
from firmware_bridge.serial_port import KOBUKI, PortError, SerialPort
from tests.kobuki.drives import Rig


def heard(rig: Rig, kind: type[Command]) -> list[Command]:
    return [command for _, command in rig.base.heard if isinstance(command, kind)]


def test_a_lost_base_is_told_and_found_again() -> None:
    rig = Rig()
    rig.run(1.0, (0.2, 0.0))
    assert rig.driver.odometry.read().vx > 0.1
    rig.base.faults.silent = True
    rig.run(0.5)
    lost = next(event for event in rig.told if isinstance(event, Lost))
    assert 100_000 < lost.instant - lost.since <= 110_000
    assert rig.driver.odometry.read().vx == 0.0
    rig.base.faults.silent = False
    rig.base.outputs = 0  # it was switched off and on
    rig.run(0.1)
    assert rig.base.outputs == POWER_RAILS
    rig.run(0.5)
    assert len([event for event in rig.told if isinstance(event, Found)]) == 2


def test_base_control_goes_out_once_per_feedback_and_never_too_often() -> None:
    rig = Rig()
    rig.run(1.0)
    rig.base.heard.clear()
    rig.fed = 0
    rig.run(4.0, (0.1, 0.1))
    controls = heard(rig, BaseControl)
    assert rig.fed == 200
    assert len(controls) == 200
    assert len(rig.base.heard) <= 206  # and the outputs once a second


def test_sensors_that_change_are_events() -> None:
    rig = Rig()
    rig.run(0.5)
    rig.told.clear()
    rig.base.faults.buttons, rig.base.faults.charger = 2, 6
    rig.run(0.1)
    rig.base.faults.buttons = 0
    rig.run(0.1)
    changes = [(e.sense, e.before, e.now) for e in rig.told if isinstance(e, FieldChanged)]
    assert changes == [(Sense.BUTTONS, 0, 2), (Sense.CHARGER, 0, 6), (Sense.BUTTONS, 2, 0)]


def test_a_bumper_that_was_pressed_between_two_looks_is_not_missed() -> None:
    rig = Rig()
    rig.run(0.5)
    assert rig.driver.pressed() == 0
    rig.base.faults.bumper = 4
    rig.run(0.04)
    rig.base.faults.bumper = 0
    rig.run(0.04)
    assert rig.driver.pressed() == 4
    assert rig.driver.pressed() == 0


def test_the_battery_runs_down_by_levels_and_does_not_flicker() -> None:
    rig = Rig()
    for volts in (16.6, 16.4, 15.0, 14.0, 14.1, 14.2, 13.2, 13.4, 13.6, 14.4):
        rig.base.faults.battery = volts
        rig.run(0.1)
    told = [(e.volts, e.level) for e in rig.told if isinstance(e, BatteryChanged)]
    assert told == [
        (16.6, BatteryLevel.FULL),
        (15.0, BatteryLevel.FAIR),
        (14.0, BatteryLevel.LOW),
        (13.2, BatteryLevel.DANGER),
        (13.6, BatteryLevel.LOW),
        (14.4, BatteryLevel.FAIR),
    ]


def test_a_low_battery_is_shown_and_heard_and_with_a_nearly_empty_one_it_stands() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS and heard(rig, SoundSequence) == []
    rig.base.faults.battery = 14.0
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | 0x0300
    assert heard(rig, SoundSequence) == [SoundSequence(2)]
    assert rig.body.truth().v > 0
    rig.told.clear()
    rig.base.faults.battery = 13.2
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | 0x0100
    assert len(heard(rig, SoundSequence)) == 2
    assert rig.body.truth().v == 0
    (change,) = [e for e in rig.told if isinstance(e, StopsChanged)]
    assert [stop.cause for stop in change.stops] == [HoldCause.BATTERY]
    rig.base.faults.battery, rig.base.outputs = 16.0, 0  # and the base was switched off and on
    rig.run(1.1, (0.1, 0.0))
    assert all(command.flags & POWER_RAILS == POWER_RAILS for command in heard(rig, GeneralOutput))  # type: ignore[union-attr]
    assert rig.base.outputs == POWER_RAILS and rig.body.truth().v > 0


def test_a_noisy_line_loses_frames_and_no_more() -> None:
    rig = Rig()
    rig.base.faults.scramble = 0.002
    rig.run(20.0, (0.2, 0.1))
    reception = rig.driver.reception
    assert 0.75 < reception.frames / 1000 < 0.95  # (1 - 0.002) ** 81 = 0.85
    assert reception.bad_checksum + reception.bad_length > 20
    truth = rig.body.truth().pose
    odometry = rig.driver.odometry.read()
    assert (odometry.x, odometry.y) == pytest.approx((truth.x - 10, truth.y - 10), abs=0.02)


def test_on_a_noisy_line_stop_is_said_as_often_as_the_line_carries_it() -> None:
    rig = Rig()
    rig.run(2.0, (0.4, 0.0))
    rig.base.faults.scramble = 0.3
    rig.run(0.2, (0.4, 0.0))
    assert {stop.cause for stop in rig.driver.allowed.stops} == {HoldCause.NO_FEEDBACK, HoldCause.NOISE}
    assert rig.body.truth().v == 0.0
    before = len(rig.written)
    rig.run(0.1, (0.4, 0.0))
    assert {data for _, data in rig.written[before:]} == {rig.driver.farewell() * 5}  # in 5 ms
    rig.base.faults.scramble = 0.0
    rig.run(0.5, (0.4, 0.0))
    assert rig.driver.allowed.stops == () and rig.body.truth().v > 0.0


def test_a_base_that_does_not_hear_stop_is_told_so_150_times_a_second_until_it_stands() -> None:
    rig = Rig()
    rig.run(2.0, (0.4, 0.0))
    rig.base.faults.deaf = True
    rig.run(0.8, (0.0, 0.0))  # the ramp
    before = len(rig.written)
    rig.run(1.0, (0.0, 0.0))
    assert 95 <= len(rig.written) - before <= 150  # rounds of 5 ms: every second one
    rig.base.faults.deaf = False
    rig.run(0.5, (0.0, 0.0))
    before = len(rig.written)
    rig.run(1.0, (0.0, 0.0))
    assert 48 <= len(rig.written) - before <= 52


@pytest.mark.parametrize(
    ("path", "number", "sentence"),
    [
        (
            "x",
            errno.ENOENT,
            "there is no such port; plug in the Kobuki and switch it on, or give its right port",
        ),
        (
            "/dev/kobuki",
            errno.ENOENT,
            "there is no such port; plug in the Kobuki and switch it on, and if it has another "
            "name, as without a udev rule, give that, e.g. /dev/ttyUSB0",
        ),
        (
            "x",
            errno.EACCES,
            "this user may not open it; join its group with `sudo usermod -aG dialout $USER` and "
            "log in again, or give the port to everyone by a udev rule",
        ),
        ("x", errno.EBUSY, "another program has the port open; end it, as only one can talk to the Kobuki"),
        (
            "x",
            errno.ENOTTY,
            "this is no serial port; the Kobuki should be at /dev/kobuki or e.g. /dev/ttyUSB0",
        ),
        ("x", errno.EIO, "the port cannot be opened (EIO); plug in the Kobuki again"),
        (
            "x",
            None,
            "the Kobuki cannot be reached without the Python package pyserial; "
            "install the extra hardware: pip install 'acrc-testbed[hardware]'",
        ),
    ],
)
def test_why_a_port_cannot_be_opened(
    path: str, number: int | None, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> Any:
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial, "Serial", fail)
    if number is None:
        monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(PortError) as failure:
        SerialPort(path, KOBUKI)
    assert str(failure.value) == f"{path}: {sentence}"


def test_a_missing_port_a_file_and_a_port_in_use_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with PseudoTerminal(tmp_path / "used"), SerialPort(str(tmp_path / "used"), KOBUKI):
        for name, sentence in (
            ("none", "there is no such port"),
            ("notes.txt", "this is no serial port"),
            ("used", "another program has the port open"),
        ):
            with pytest.raises(PortError, match=sentence):
                SerialPort(str(tmp_path / name), KOBUKI)


def test_bytes_go_both_ways_until_the_cable_is_pulled_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pulled(*_: object) -> bytes:
        raise OSError(errno.EIO, "gone")

    link = tmp_path / "kobuki"
    link.symlink_to("/nowhere")  # left behind by a process that was killed
    with PseudoTerminal(link) as line, SerialPort(str(link), KOBUKI) as port:
        line.write(b"\x00\x11\x13\n\r\xaa")
        assert _read(port, 6) == b"\x00\x11\x13\n\r\xaa"
        assert port.read() == b""
        port.write(b"\xaa\x55\n")
        assert line.read(1.0) == b"\xaa\x55\n"
        line.write(bytes(100_000))
        assert line.lost > 50_000
        monkeypatch.setattr(port._port, "read", pulled)
        with pytest.raises(PortError) as failure:
            port.read()
    sentence = f"{link}: the Kobuki has gone while in use (EIO); plug its USB cable in again"
    assert str(failure.value) == sentence
    assert not link.is_symlink(), "the link goes with the device"


def test_a_link_is_not_put_in_place_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("kept")
    with pytest.raises(AcrcError, match="there is something that is no link; give a path where"):
        PseudoTerminal(path)
    assert path.read_text() == "kept"
    with pytest.raises(AcrcError, match=r"no link can be made there \(No such file or directory\)"):
        PseudoTerminal(tmp_path / "none" / "kobuki")


def _read(port: SerialPort, count: int) -> bytes:
    """Read so many bytes, or what has come within 5 s: they may come in pieces."""
    data, end = b"", time.monotonic() + 5
    while len(data) < count and time.monotonic() < end:
        data += port.read()
    return data
