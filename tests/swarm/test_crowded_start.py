"""Runs beside processes that keep every core busy: slower, and otherwise the same."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.swarm.command import acrc


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep so many processes computing."""
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


@pytest.mark.claim("crowded-start")
@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_many_robots_start_on_a_busy_computer(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    robots, hogs = (100, 4) if full else (4, 1)
    digests = set()
    for name, words, each_core in (
        ("in memory", ("--bus", "memory"), 0),
        ("processes", (), 0),
        ("processes, busy computer", (), hogs),
    ):
        began = time.monotonic()
        with busy(each_core * (os.cpu_count() or 1)):
            folder = ("--out", tmp_path / name, "--json")
            done = acrc("run", "--robots", robots, "--duration", 2, *words, *folder, timeout_s=1800.0)
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)
        record_property(f"{name}: whole run, s", round(time.monotonic() - began, 1))
        assert result["undelivered"] == 0
        digests.add(result["digest"])
    assert len(digests) == 1
