"""What the supervisor on board tells systemd, and that it stops the wheels of a base that is stopped."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from deploy.fleet.onboard_run import ServiceNotice, StandIn
from tests.onboard.kobuki_line import KobukiLine


@pytest.mark.parametrize("abstract", [False, True])
def test_systemd_hears_that_a_service_is_up_and_lives(tmp_path: Path, abstract: bool) -> None:
    name = f"acrc-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{name}" if abstract else name)
        systemd.settimeout(10)
        notice = ServiceNotice({"NOTIFY_SOCKET": f"@{name}" if abstract else name})
        notice.ready()
        notice.lives()
        assert [systemd.recv(100), systemd.recv(100)] == [b"READY=1", b"WATCHDOG=1"]
    notice.lives()  # nobody listens any more


def test_elsewhere_nothing_happens() -> None:
    for environment in ({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "nonsense"}):
        ServiceNotice(environment).lives()


STOPPED = "base is stopped (SIGSTOP or a debugger): stop is said in its place"


def test_stop_is_said_once_for_a_base_that_is_stopped_and_not_for_one_that_runs(tmp_path: Path) -> None:
    said: list[str] = []
    waits = [sys.executable, "-c", "input()"]
    with KobukiLine(tmp_path / "base") as line, subprocess.Popen(waits, stdin=subprocess.PIPE) as base:
        stand_in = StandIn(str(line.link), said.append)
        line.body.drive(0.3, 0.0)
        stand_in.look(None)
        stand_in.look(base.pid)
        time.sleep(0.1)
        assert line.speed == pytest.approx(0.3) and not said
        os.kill(base.pid, signal.SIGSTOP)
        deadline = time.monotonic() + 20.0
        while (line.speed or not said) and time.monotonic() < deadline:
            stand_in.look(base.pid)
            time.sleep(0.01)
        assert (said, line.speed) == ([STOPPED], 0.0)
        base.kill()
