"""A base process that is stopped together with its guardian: somebody else says stop to its wheels."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from deploy.fleet.onboard_run import StandIn
from tests.onboard.kobuki_line import KobukiLine

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
