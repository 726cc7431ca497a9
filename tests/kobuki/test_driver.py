"""Driver with an emulated base: safety rules, events and output; serial ports."""

import errno
import math
import os
import re
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Pose
from actors.instant import START, Instant
from actors.runtime.errors import AcrcError
from firmware_bridge.device_lines import NO_NOISE, LineNoise, PseudoTerminal
from firmware_bridge.kobuki.kobuki_motion import KOBUKI_LIMITS, TRACK, BaseFeedback, velocity
from firmware_bridge.kobuki.kobuki_packets import (
    POWER_RAILS,
    BaseControl,
    BasicSensorData,
    Command,
    GeneralOutput,
    InertialSensorData,
    SoundSequence,
)
from firmware_bridge.safety import AllowedMotion, BatteryLevel, HoldCause, SafetyStop, StateChange
from firmware_bridge.serial_port import KOBUKI, PortError, SerialPort
from tests.kobuki.rig import Rig, Room


def fastest_wheel(v: float, omega: float) -> float:
    """Return the forward speed of the faster wheel, m/s."""
    return v + abs(omega) * TRACK / 2


class SafetyScenario:
    """A safety stop that gets feedback and returns the permitted motion every 20 ms."""

    def __init__(self) -> None:
        self.now = START
        self.safety = SafetyStop(START, KOBUKI_LIMITS)
        self.ticks = 0
        self.rate = 0
        self.bumper = self.cliff = self.drop = self.overcurrent = 0
        self.silent = False
        self.late_ms = 0
        """Age of commands at their arrival."""
        self.allowed = AllowedMotion(0.0, 0.0, ())

    def go(self, ms: int, v: float | None, omega: float = 0.0) -> AllowedMotion:
        """Advance with a command, `v` None: no command; return the permitted motion."""
        for _ in range(ms // 20):
            self.now = Instant(self.now + 20_000)
            if not self.silent:
                bits = (self.bumper, self.drop, self.cliff, self.ticks & 0xFFFF)
                basic = BasicSensorData(0, *bits, *5 * (0,), 160, self.overcurrent)
                self.safety.sense(BaseFeedback(self.now, basic, InertialSensorData(0, self.rate)))
            if v is not None:
                self.safety.command(self.now, Instant(self.now - 1000 * self.late_ms), v, omega)
            self.allowed = self.safety.allowed(self.now)
        return self.allowed

    @property
    def causes(self) -> list[HoldCause]:
        return [stop.cause for stop in self.allowed.stops]


def rolling() -> SafetyScenario:
    scenario = SafetyScenario()
    scenario.go(3000, 0.4)
    assert scenario.allowed == AllowedMotion(0.4, 0.0, ())
    return scenario


FAST, BACK = (0.4, 0.0), (-0.4, 0.0)
Step = tuple[dict[str, int], int, tuple[float, float] | None, str, float]
"""Changes, duration in ms, command, resulting causes, and speed, m/s."""
RULES: dict[str, list[Step]] = {
    **{
        f"{sensor}: no wheel turns forward until release": [
            ({sensor: 2}, 20, FAST, cause, 0.0),  # immediate, without a ramp
            ({}, 2000, (0.4, 1.0), cause, 0.0),
            ({}, 2000, (0.0, 1.0), cause, 0.0),  # not even in place: a wheel would turn forward
            ({}, 2000, BACK, cause, -0.4),
            ({sensor: 0}, 3500, FAST, "", 0.4),
        ]
        for sensor, cause in (("bumper", "BUMPER"), ("cliff", "CLIFF"))
    },
    "over-current: stop until a second after its end": [
        ({"overcurrent": 2}, 20, FAST, "OVERCURRENT", 0.0),
        ({"overcurrent": 0}, 1000, FAST, "OVERCURRENT", 0.0),
        ({}, 3000, FAST, "", 0.4),
    ],
    "external causes: immediate stop while they last": [
        ({"NO_RANGE_DATA": 1, "NO_GUARDIAN": 1}, 20, FAST, "NO_RANGE_DATA NO_GUARDIAN", 0.0),
        ({"NO_RANGE_DATA": 0}, 20, BACK, "NO_GUARDIAN", 0.0),
        ({"NO_GUARDIAN": 0}, 3000, FAST, "", 0.4),
    ],
    "wheel drop: stop until put down and at standstill": [
        ({"drop": 2}, 20, FAST, "WHEEL_DROP", 0.0),
        ({}, 5000, BACK, "WHEEL_DROP", 0.0),
        *(({"drop": 0, "ticks": 10 * n}, 20, FAST, "PUT_DOWN", 0.0) for n in range(100)),  # pushed about
        ({"rate": 1000}, 2000, FAST, "PUT_DOWN", 0.0),  # turned by hand
        ({"rate": 0}, 980, FAST, "PUT_DOWN", 0.0),
        ({}, 40, FAST, "", 0.012),  # from standing
    ],
    "no feedback for 100 ms: stop until it is stable": [
        ({"silent": 1}, 100, FAST, "", 0.4),
        ({}, 20, FAST, "NO_FEEDBACK", 0.0),
        ({"silent": 0}, 100, FAST, "LINK_RECOVERING", 0.0),
        ({}, 20, FAST, "", 0.006),
    ],
    "commands are valid for 200 ms": [
        ({}, 200, None, "", 0.4),
        ({}, 20, None, "NO_COMMAND", 0.0),
        ({"late_ms": 201}, 3000, FAST, "STALE_COMMAND", 0.0),
        ({"late_ms": 180}, 3000, FAST, "", 0.4),
        ({"late_ms": 0}, 20, FAST, "", 0.4),
    ],
    "a command from the future is valid as long as others and does not block them": [
        ({"late_ms": -10_000}, 200, FAST, "", 0.4),
        ({"late_ms": 0}, 220, None, "NO_COMMAND", 0.0),
        ({}, 100, BACK, "", -0.03),
    ],
    **{
        f"{v} m/s and {omega} rad/s are refused": [({}, 20, (v, omega), "BAD_COMMAND", 0.0)]
        for v, omega in ((math.nan, 0.0), (0.1, math.inf), (-math.inf, 0.0))
    },
}


@pytest.mark.parametrize("rule", RULES)
def test_the_safety_rules(rule: str) -> None:
    scenario = rolling()
    for number, (changes, ms, command, causes, speed) in enumerate(RULES[rule]):
        for name, value in changes.items():
            if name in HoldCause.__members__:
                scenario.safety.hold(HoldCause[name], bool(value))
            else:
                assert hasattr(scenario, name)
                setattr(scenario, name, value)
        v, omega = command or (None, 0.0)
        allowed = scenario.go(ms, v, omega)
        assert [cause.name for cause in scenario.causes] == causes.split(), number
        assert allowed.v == pytest.approx(speed, abs=1e-9), number
        assert speed or allowed.omega == 0.0


def test_it_stands_before_the_first_command_and_ignores_overtaken_ones() -> None:
    scenario = SafetyScenario()
    scenario.silent = True
    scenario.go(20, None)
    assert scenario.causes == [HoldCause.NO_FEEDBACK, HoldCause.NO_COMMAND]
    scenario.silent = False
    scenario.go(1000, 0.0)
    scenario.late_ms = 30
    scenario.go(1000, 0.4)
    assert scenario.safety.late_commands == 1  # the first of them; the others are newer than the last
    scenario.safety.command(scenario.now, Instant(scenario.now - 40_000), -0.4, 0.0)
    assert scenario.safety.late_commands == 2
    assert scenario.go(20, None).v > 0


def test_backing_off_is_allowed_in_arcs_without_a_forward_wheel() -> None:
    scenario = rolling()
    scenario.bumper = 2
    allowed = scenario.go(20, 0.4)
    assert allowed.stops == ((HoldCause.BUMPER, scenario.now, 2),)
    scenario.go(2000, -0.2, 3.0)
    assert scenario.allowed.v == pytest.approx(-0.2)
    assert fastest_wheel(scenario.allowed.v, scenario.allowed.omega) <= 0
    assert scenario.allowed.omega > 1.5


def test_speeds_are_limited_on_the_same_arc() -> None:
    scenario = SafetyScenario()
    scenario.go(10_000, 1.4, 2.0)
    assert (scenario.allowed.v, scenario.allowed.omega) == pytest.approx((0.7, 1.0))
    scenario.go(10_000, 0.5, 2 * math.pi)
    assert (scenario.allowed.v, scenario.allowed.omega) == pytest.approx((0.25, math.pi))


def test_accelerations_are_those_of_the_reference_driver() -> None:
    scenario = SafetyScenario()
    scenario.go(200, 0.0)
    scenario.go(1000, 0.6, 5.0)
    assert (scenario.allowed.v, scenario.allowed.omega) == pytest.approx((0.3, math.pi))
    assert scenario.go(300, 0.0).v == pytest.approx(0.3 - 0.6 * 0.3)
    assert scenario.go(1000, -0.6).v < 0  # stopped at 0 in between
    scenario = rolling()
    scenario.go(20, 0.0, 3.0)
    assert (scenario.allowed.v, scenario.allowed.omega) == pytest.approx((0.4 - 0.012, 0.07))


STEP = st.tuples(
    st.integers(1, 150),  # ms
    st.one_of(st.none(), st.tuples(*[st.sampled_from([0, 0, 0, 0, 1, 4])] * 3)),  # feedback
    st.one_of(st.none(), st.tuples(st.floats(-3, 3), st.floats(-9, 9), st.integers(-300, 300))),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(STEP, max_size=40))
def test_the_rules_hold_for_any_inputs(
    steps: list[tuple[int, tuple[int, int, int] | None, tuple[float, float, int] | None]],
) -> None:
    now, safety = START, SafetyStop(START, KOBUKI_LIMITS)
    heard: Instant | None = None
    newest = -(10**12)
    bits = (0, 0, 0)
    before = 0.0
    for ms, feedback, command in steps:
        now = Instant(now + 1000 * ms)
        if feedback is not None:
            heard, bits = now, feedback
            safety.sense(BaseFeedback(now, BasicSensorData(0, *bits, 0, 0, 0, 0, 0, 0, 160, 0), None))
        if command is not None:
            issued = Instant(now - 1000 * command[2])
            newest = max(newest, min(issued, now))
            safety.command(now, issued, command[0], command[1])
        allowed = safety.allowed(now)
        moving = (allowed.v, allowed.omega) != (0.0, 0.0)
        if heard is None or now - heard > 100_000 or now - newest > 200_000 or bits[1]:
            assert not moving
        if bits[0] or bits[2]:
            assert fastest_wheel(allowed.v, allowed.omega) <= 0
        assert abs(allowed.v) <= 0.7
        assert abs(allowed.omega) <= math.pi
        assert abs(allowed.v) - abs(before) <= 0.3 * 0.06 + 1e-9
        before = allowed.v


def test_a_base_at_a_wall_stops_and_can_back_off() -> None:
    rig = Rig(room=Room(4.0, 4.0), pose=Pose(3.0, 2.0, 0.1))
    rig.run(5.0, (0.4, 0.0))
    touched = rig.body.truth().pose
    assert touched.x == pytest.approx(4.0 - 0.177, abs=1e-6)
    assert rig.driver.pressed() & 2
    controls = [command for _, command in rig.base.commands if isinstance(command, BaseControl)]
    assert controls[-5:] == [BaseControl(0, 0)] * 5
    rig.run(3.0, (-0.2, 0.0))
    assert rig.body.truth().pose.x < touched.x - 0.3
    assert rig.driver.allowed.stops == ()


@pytest.mark.parametrize(
    ("fault", "within_ms"),
    [("bumper", 50), ("cliff", 50), ("wheel_drop", 50), ("silent", 140), ("no command", 200)],
)
def test_the_base_stops_in_time(fault: str, within_ms: int) -> None:
    rig = Rig()
    rig.run(3.0, (0.4, 0.3))
    began, wish = rig.now, None if fault == "no command" else (0.4, 0.3)
    if wish is not None:
        setattr(rig.base.faults, fault, 1)
    rig.run(0.5, wish)
    moving = [at for at, c in rig.base.commands if isinstance(c, BaseControl) and velocity(c) != (0.0, 0.0)]
    assert moving[-1] - began <= 1000 * within_ms
    assert rig.body.truth().v == 0.0


def changes(rig: Rig, what: str) -> list[StateChange]:
    return [change for change in rig.changes if change.what == what]


def heard(rig: Rig, kind: type[Command]) -> list[Command]:
    return [command for _, command in rig.base.commands if isinstance(command, kind)]


def test_loss_and_return_of_the_base_are_reported() -> None:
    rig = Rig()
    rig.run(1.0, (0.2, 0.0))
    assert rig.driver.odometry.read().vx > 0.1
    rig.base.faults.silent = True
    rig.run(0.5)
    (lost,) = changes(rig, "feedback")[1:]
    assert 100_000 < lost.instant - 1_000_000 <= 125_000, "one feedback was in transit"
    assert rig.driver.odometry.read().vx == 0.0
    rig.base.faults.silent = False
    rig.base.outputs = 0  # it was switched off and on
    rig.run(0.1)
    assert rig.base.outputs == POWER_RAILS
    rig.run(0.5)
    assert [change.now for change in changes(rig, "feedback")] == [True, False, True]


def test_base_control_is_sent_once_per_feedback() -> None:
    rig = Rig()
    rig.run(1.0)
    rig.base.commands.clear()
    rig.fed = 0
    rig.run(4.0, (0.1, 0.1))
    controls = heard(rig, BaseControl)
    assert rig.fed == 200
    assert len(controls) == 200
    assert len(rig.base.commands) <= 206  # and the outputs once a second


def test_changes_of_sensors_are_events() -> None:
    rig = Rig()
    rig.run(0.5)
    rig.changes.clear()
    rig.base.faults.buttons, rig.base.faults.charger = 2, 6
    rig.run(0.1)
    rig.base.faults.buttons = 0
    rig.run(0.1)
    assert [change[1:] for change in rig.changes] == [("buttons", 0, 2), ("charger", 0, 6), ("buttons", 2, 0)]


def test_a_short_press_of_the_bumper_is_not_missed() -> None:
    rig = Rig()
    rig.run(0.5)
    assert rig.driver.pressed() == 0
    rig.base.faults.bumper = 4
    rig.run(0.04)
    rig.base.faults.bumper = 0
    rig.run(0.04)
    assert rig.driver.pressed() == 4
    assert rig.driver.pressed() == 0


def test_battery_levels_have_hysteresis() -> None:
    rig = Rig()
    for volts in (16.6, 16.4, 15.0, 14.0, 14.1, 14.2, 13.2, 13.4, 13.6, 14.4):
        rig.base.faults.battery = volts
        rig.run(0.1)
    told = [(change.instant // 100_000, change.now) for change in changes(rig, "battery")]
    levels = (BatteryLevel.FULL, BatteryLevel.FAIR, BatteryLevel.LOW, BatteryLevel.DANGER)
    assert told == list(zip((0, 2, 3, 6, 8, 9), (*levels, *levels[2:0:-1]), strict=True))


def test_a_low_battery_is_signalled_and_a_nearly_empty_one_stops_the_base() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS and heard(rig, SoundSequence) == []
    rig.base.faults.battery = 14.0
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | 0x0300
    assert heard(rig, SoundSequence) == [SoundSequence(2)]
    assert rig.body.truth().v > 0
    rig.changes.clear()
    rig.base.faults.battery = 13.2
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | 0x0100
    assert len(heard(rig, SoundSequence)) == 2
    assert rig.body.truth().v == 0
    (change,) = changes(rig, "stops")
    assert "HoldCause.BATTERY" in str(change) and change.before == ()
    rig.base.faults.battery, rig.base.outputs = 16.0, 0  # and the base was switched off and on
    rig.run(1.1, (0.1, 0.0))
    assert all(command.flags & POWER_RAILS == POWER_RAILS for command in heard(rig, GeneralOutput))  # type: ignore[union-attr]
    assert rig.base.outputs == POWER_RAILS and rig.body.truth().v > 0


def test_on_a_noisy_line_stop_is_sent_at_the_line_rate() -> None:
    rig = Rig()
    rig.run(2.0, (0.4, 0.0))
    rig.noise = LineNoise(0.1, 0.1, 0.1)
    rig.run(0.2, (0.4, 0.0))
    assert {stop.cause for stop in rig.driver.allowed.stops} == {HoldCause.NO_FEEDBACK, HoldCause.NOISE}
    assert rig.body.truth().v == 0.0
    before = len(rig.written)
    rig.run(0.1, (0.4, 0.0))
    assert {data for _, data in rig.written[before:]} == {rig.driver.final_bytes() * 5}  # in 5 ms
    rig.noise = NO_NOISE
    rig.run(0.5, (0.4, 0.0))
    assert rig.driver.allowed.stops == () and rig.body.truth().v > 0.0


def test_stop_is_repeated_150_times_per_second_until_the_base_stands() -> None:
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
    ("path", "number", "fragment"),
    [
        ("x", errno.ENOENT, "no such port; plug in the Kobuki and switch it on, or give the correct"),
        ("/dev/kobuki", errno.ENOENT, "without a udev rule, give its kernel name, e.g. /dev/ttyUSB0"),
        ("x", errno.EACCES, "permission denied; join the port's group with `sudo usermod -aG dialout"),
        ("x", errno.EBUSY, "in use by another program; stop it"),
        ("x", errno.ENOTTY, "not a serial port; give the port of the Kobuki: /dev/kobuki or"),
        ("x", errno.EIO, "the port cannot be opened (EIO); replug the Kobuki"),
        ("x", None, "install it with pip install 'acrc-testbed[hardware]'"),
    ],
)
def test_failures_to_open_a_port_are_explained(
    path: str, number: int | None, fragment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> Any:
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial, "Serial", fail)
    if number is None:
        monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(PortError, match=re.escape(fragment)) as failure:
        SerialPort(path, KOBUKI)
    assert str(failure.value).startswith(f"{path}: ")


def test_bytes_are_exchanged_until_the_cable_is_unplugged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pulled(*_: object) -> bytes:
        raise OSError(errno.EIO, "gone")

    link = tmp_path / "kobuki"
    link.symlink_to("/nowhere")  # left behind by a process that was killed
    with closing(PseudoTerminal(link)) as line, closing(SerialPort(str(link), KOBUKI)) as port:
        line.write(b"\x00\x11\x13\n\r\xaa")
        with pytest.raises(PortError, match="in use by another program"):
            SerialPort(str(link), KOBUKI)
        assert _read(port, 6) == b"\x00\x11\x13\n\r\xaa"
        assert port.read() == b""
        port.write(b"\xaa\x55\n")
        assert line.read(1.0) == b"\xaa\x55\n"
        line.write(bytes(100_000))
        assert line.lost > 50_000
        monkeypatch.setattr(os, "read", pulled)
        with pytest.raises(PortError) as failure:
            port.read()
    sentence = f"{link}: connection to the Kobuki lost (EIO); check its USB cable"
    assert str(failure.value) == sentence
    assert not link.is_symlink(), "the link is removed with the device"


def test_files_are_not_replaced_by_links(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("kept")
    with pytest.raises(AcrcError, match="exists and is not a symbolic link; choose another"):
        PseudoTerminal(path)
    assert path.read_text() == "kept"
    with pytest.raises(AcrcError, match=r"the symbolic link cannot be created \(No such file or directory\)"):
        PseudoTerminal(tmp_path / "none" / "kobuki")


def _read(port: SerialPort, count: int) -> bytes:
    """Read `count` bytes, or fewer after a timeout of 5 s."""
    data, end = b"", time.monotonic() + 5
    while len(data) < count and time.monotonic() < end:
        data += port.read()
    return data
