"""The wheels stop in time after failures of base process, guardian or supervisor; wall time."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.instant import Instant
from deploy.fleet.onboard_run import READY, RESET_WATCHDOG, FallbackStop, connect_stop, notify_systemd
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.kobuki import guardian, kobuki_motion
from firmware_bridge.kobuki.emulated_kobuki import EmulatedKobuki
from firmware_bridge.kobuki.guardian import Standstill
from firmware_bridge.kobuki.kobuki_packets import (
    BaseControl,
    BasicSensorData,
    encode_command,
    encode_feedback,
    encode_frame,
)
from firmware_bridge.onboard.vehicle import GuardianLink, start_guardian
from firmware_bridge.serial_port import KOBUKI, SerialPort
from tests import helpers
from tests.kobuki.rig import Room, Unicycle


class KobukiLine:
    """An emulated Kobuki on a pseudo-terminal, in wall time; a context manager."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.body = Unicycle(None, Room(40.0, 40.0))
        self.base = EmulatedKobuki(self.body, np.random.default_rng(1))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._line = PseudoTerminal(self.link)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()
        self._line.close()

    @property
    def speed(self) -> float:
        return self.body.truth().v

    def stands_soon(self) -> bool:
        """Wait for standstill, up to SOON_S."""
        begun = time.monotonic()
        while self.speed and time.monotonic() - begun < SOON_S:
            time.sleep(0.002)
        return self.speed == 0

    def _run(self) -> None:
        begun = time.monotonic()
        while not self._ended.is_set():
            data = self._line.read(0.002)
            now = Instant(round(1e6 * (time.monotonic() - begun)))
            self.base.take(now, data)
            self._line.write(self.base.run(now))


SOON_S = 0.5
DRIVE = encode_frame(encode_command(kobuki_motion.base_control(0.3, 0.0)))


HUNG_BASE = """
import socket, subprocess, sys, time
ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
number = theirs.fileno()
command = [sys.executable, "-I", "-S", sys.argv[1], "beside", str(number), "port"]
subprocess.Popen(command, pass_fds=(number,))
time.sleep(60)
"""


class BaseProcess:
    """Base process played by the test: its port and its guardian."""

    def __init__(self, link: Path) -> None:
        self.port: SerialPort = SerialPort(str(link), KOBUKI)
        self.guardians: list[subprocess.Popen[bytes]] = []
        self.guardian_link = GuardianLink(str(link), self._start)

    def serve(self, until: Callable[[], bool], patience_s: float = 10.0) -> None:
        """Serve the port and the guardian without commands, until a condition holds."""

        def served() -> bool:
            self.guardian_link.serve(now(), self.port)
            self.port.read()
            return until()

        helpers.until(served, patience_s)

    def die(self) -> None:
        """Simulate SIGKILL: close all descriptors without a stop command."""
        assert self.guardian_link._channel is not None
        self.guardian_link._channel.close()
        self.port.close()

    def _start(self, channel: int, name: str) -> "subprocess.Popen[bytes]":
        self.guardians.append(start_guardian(channel, name))
        return self.guardians[-1]


def now() -> Instant:
    return Instant(time.monotonic_ns() // 1000)


@pytest.fixture
def line(tmp_path: Path) -> Iterator[KobukiLine]:
    with KobukiLine(tmp_path / "kobuki") as line:
        yield line


@pytest.fixture
def process(line: KobukiLine) -> Iterator[BaseProcess]:
    """Yield a driving base with a guardian."""
    base = BaseProcess(line.link)
    base.serve(lambda: base.guardian_link.is_operational(now()))
    base.port.write(DRIVE)
    base.serve(lambda: line.speed > 0)
    yield base
    for one in base.guardians:
        one.kill()
        one.wait()


def test_a_killed_base_stops_although_first_commands_are_lost(line: KobukiLine, process: BaseProcess) -> None:
    line.base.faults.deaf = True
    process.die()
    time.sleep(0.1)
    assert line.speed > 0.29, "several stop commands were lost"
    line.base.faults.deaf = False
    assert line.stands_soon()
    assert process.guardians[0].wait(5) == 0, "it exits at standstill"


def test_a_hanging_base_stops_and_drives_again_when_it_continues(
    line: KobukiLine, process: BaseProcess
) -> None:
    assert line.stands_soon()  # no heartbeats
    process.serve(lambda: process.guardian_link.is_operational(now()))
    process.port.write(DRIVE)
    process.serve(lambda: line.speed > 0)
    begun = time.monotonic()
    process.serve(lambda: time.monotonic() - begun > 0.3)
    assert line.speed > 0.29, "the guardian does not intervene"


def test_a_base_that_hangs_forever_is_killed(tmp_path: Path) -> None:
    """The base starts a copy of the guardian with a shorter timeout and then does nothing."""
    impatient = tmp_path / "guardian.py"
    impatient.write_text(
        Path(guardian.__file__).read_text().replace("HUNG_S: Final = 5.0", "HUNG_S: Final = 0.3")
    )
    base = subprocess.run(
        [sys.executable, "-c", HUNG_BASE, str(impatient)], timeout=30, capture_output=True, check=False
    )
    assert base.returncode == -signal.SIGKILL


def test_a_killed_or_suspended_guardian_prevents_motion_and_is_replaced(
    process: BaseProcess,
) -> None:
    for number in (signal.SIGKILL, signal.SIGSTOP):
        os.kill(process.guardians[-1].pid, number)
        begun = time.monotonic()
        process.serve(lambda: not process.guardian_link.is_operational(now()))
        assert time.monotonic() - begun < SOON_S
        process.serve(lambda: process.guardian_link.is_operational(now()))
    assert process.guardian_link.started == len(process.guardians) == 3


def test_the_guardian_ignores_signals_and_stops_the_base_on_a_reopened_port(
    line: KobukiLine, process: BaseProcess
) -> None:
    for number in (signal.SIGTERM, signal.SIGHUP):
        os.kill(process.guardians[0].pid, number)
    process.port.write(encode_frame(encode_command(BaseControl(0, 0))))
    process.port.close()
    time.sleep(0.02)
    process.guardian_link.serve(now(), None)
    assert not process.guardian_link.is_operational(now())
    time.sleep(0.1)
    process.port = SerialPort(str(line.link), KOBUKI)
    process.serve(lambda: process.guardian_link.is_operational(now()))
    process.port.write(DRIVE)
    process.serve(lambda: line.speed > 0)
    process.die()
    assert line.stands_soon()


def test_alone_it_opens_the_port_and_sends_stop_until_standstill(line: KobukiLine) -> None:
    with closing(SerialPort(str(line.link), KOBUKI)) as port:
        port.write(DRIVE)
        while not line.speed:
            time.sleep(0.005)
    done = alone(line.link)
    assert line.speed == 0 and done.returncode == 0
    assert done.stdout.startswith(f"{line.link}: sent stop ")
    assert done.stdout.endswith(" times, until the wheels stood\n")
    nowhere = alone(line.link.with_name("nothing"))
    assert nowhere.returncode == 1
    assert nowhere.stdout == (
        f"{line.link.with_name('nothing')}: stop cannot be sent: No such file or directory\n"
    )


def alone(port: Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-I", "-S", guardian.__file__, "alone", str(port)]
    return subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)


def test_missing_standstill_is_reported() -> None:
    silent = os.open("/dev/ptmx", os.O_RDWR | os.O_NONBLOCK)
    said = guardian.stop_until_standstill(guardian.SerialStop(silent), limit_s=0.05)
    os.close(silent)
    assert "no standstill was detected: the base may still be driving" in said
    assert encode_frame(encode_command(BaseControl(0, 0))) == guardian.STOP


def feedback(stamp: int, left: int, right: int) -> bytes:
    basic = BasicSensorData(stamp & 0xFFFF, 0, 0, 0, left & 0xFFFF, right & 0xFFFF, 0, 0, 0, 0, 160, 0)
    return encode_frame(encode_feedback(basic))


@settings(max_examples=100, deadline=None)
@given(
    speed=st.sampled_from([0, 1, 3, 40, -40]),
    begin=st.integers(0, 0xFFFF),
    noise=st.binary(max_size=12),
    cut=st.integers(1, 40),
)
def test_standstill_is_detected_for_standing_wheels_only(
    speed: int, begin: int, noise: bytes, cut: int
) -> None:
    """Test with `speed`: ticks of the right wheel between feedbacks."""
    heard = Standstill()
    data = b"".join(noise + feedback(20 * i, 7, begin + speed * i) for i in range(40))
    for at in range(0, len(data), cut):
        heard.take(data[at : at + cut])
        assert not (speed and heard.is_reached)
    assert heard.is_reached == (speed == 0)
    repeated = Standstill()
    repeated.take(20 * feedback(7, 1, 2))
    assert not repeated.is_reached, "repeated feedback is no evidence"


@pytest.mark.parametrize("abstract", [False, True])
def test_systemd_is_notified(tmp_path: Path, abstract: bool) -> None:
    name = f"acrc-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{name}" if abstract else name)
        systemd.settimeout(10)
        environment = {"NOTIFY_SOCKET": f"@{name}" if abstract else name}
        notify_systemd(READY, environment)
        notify_systemd(RESET_WATCHDOG, environment)
        assert [systemd.recv(100), systemd.recv(100)] == [b"READY=1", b"WATCHDOG=1"]
    notify_systemd(RESET_WATCHDOG, environment)  # no receiver
    for without_effect in ({}, {"NOTIFY_SOCKET": "nonsense"}):
        notify_systemd(RESET_WATCHDOG, without_effect)


STOPPED = "base process suspended (SIGSTOP or a debugger): sending stop commands to the wheels"


def test_stop_is_sent_for_a_suspended_base_only(tmp_path: Path) -> None:
    said: list[str] = []
    waits = [sys.executable, "-c", "input()"]
    with KobukiLine(tmp_path / "base") as line, subprocess.Popen(waits, stdin=subprocess.PIPE) as base:
        stand_in = FallbackStop(lambda: connect_stop(str(line.link)), said.append)
        line.body.drive(0.3, 0.0)
        stand_in.update(None)
        stand_in.update(base.pid)
        time.sleep(0.1)
        assert line.speed == pytest.approx(0.3) and not said
        os.kill(base.pid, signal.SIGSTOP)
        deadline = time.monotonic() + 20.0
        while (line.speed or not said) and time.monotonic() < deadline:
            stand_in.update(base.pid)
            time.sleep(0.01)
        assert (said, line.speed) == ([STOPPED], 0.0)
        base.kill()
