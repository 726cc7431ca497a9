"""A robot on board, its devices emulated on pseudo-terminals: it drives, records, stops, and is replayed."""

import itertools
import json
import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.messages import SENSES, Senses
from actors.runtime.codec import decode
from actors.runtime.recording import Note, read_notes, read_recording
from tests.laboratory.hosts import Running, setup
from tests.small_disk import on_small_disk
from tests.swarm.command import ACRC, ROOT, acrc, begin, leftovers, processes_of
from tests.warm import Begun

pytestmark = pytest.mark.timeout(300)  # all in real time, beside whatever else there is to do

FLEET = """
map = "{root}/maps/corridor.yaml"
[run]
strategy = "chapter"
[[robot]]
id = "r1"
address = 1
start = [12.0, 12.5, 0.0]
places = [[20.0, 12.5], [4.0, 12.5]]
base = "{links}/base"
radio = "{links}/radio"
range = "{links}/range"
"""


@pytest.fixture(scope="module")
def links(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the emulated devices of a robot in the corridor are plugged in.

    They stay on, as real ones do, while one run on board after the other ends.
    """
    with Running(tmp_path_factory.mktemp("laboratory"), setup(1)) as laboratory:
        yield laboratory.links / "r1"


def onboard(folder: Path, out: Path) -> Begun:
    return begin("fleet", "onboard", folder, "--robot", "r1", "--out", out)


def until(path: Path, steps: int, speed: float = 0.0, patience_s: float = 100.0) -> None:
    """Wait until a robot has recorded so many steps, and has been so fast, m/s."""
    deadline = time.monotonic() + patience_s
    while len(heard := senses(path)) < steps or max(abs(one.odometry.vx) for one in heard) < speed:
        told = f"{path} has not got {steps} steps and {speed} m/s within {patience_s} s"
        assert time.monotonic() < deadline, told
        time.sleep(0.3)


def senses(path: Path) -> list[Senses]:
    if not path.exists():
        return []
    key = SENSES.key("r1")
    found = [
        decode(SENSES, key, entry.payload)  # type: ignore[arg-type]
        for entry in read_recording(path)
        if not isinstance(entry, Note) and entry.key == key and entry.payload is not None
    ]
    return [one for one in found if isinstance(one, Senses)]


def test_it_drives_records_stops_and_is_executed_again(links: Path, tmp_path: Path) -> None:
    fleet, out = tmp_path / "fleet.toml", tmp_path / "runs" / "one"
    fleet.write_text(FLEET.format(root=ROOT, links=links))
    running = onboard(fleet, out)
    try:
        until(out / "r1" / "r1.mcap", steps=60, speed=0.15)
        os.kill(running.pid, signal.SIGTERM)
        _, said = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 128 + signal.SIGTERM
    assert said.splitlines()[-1] == f"acrc: ended from outside; what was recorded is in {out}"
    heard = senses(out / "r1" / "r1.mcap")
    assert heard[-1].halt and any(one.scan is not None for one in heard)
    assert max(abs(one.odometry.vx) for one in heard) > 0.1, "it drove"
    gaps = {later.instant - sooner.instant for sooner, later in itertools.pairwise(heard[:-1])}
    assert all(gap > 0 and gap % 100_000 == 0 for gap in gaps), "on the grid of its steps"
    base = json.loads(read_notes(out / "r1.base" / "r1.base.mcap")["final"])
    assert base["outcome"]["steps"] >= 60
    board = json.loads(read_notes(out / "r1.radio" / "r1.radio.mcap")["final"])["outcome"]["board"]
    assert board["sent"] >= 3 and board["ups"] == 1
    again = acrc("replay", out, "--robot", "r1")
    assert again.returncode == 0 and ": identical: " in again.stdout, again.stderr
    assert processes_of(out) == [] and leftovers(out) == []


def test_processes_that_die_are_started_again_and_the_operator_watches_and_stops_over_tls(
    links: Path, tmp_path: Path
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    fleet, out = tmp_path / "fleet.toml", tmp_path / "runs" / "one"
    fleet.write_text(FLEET.format(root=ROOT, links=links) + f'listen = "{endpoint}"\n')
    made = acrc("fleet", "keys", fleet)
    assert made.returncode == 0, made.stderr
    keys = tmp_path / "fleet-keys" / "operator"
    running = onboard(fleet, out)
    watcher = None
    try:
        until(out / "r1" / "r1.mcap", steps=5)
        kill("actors.robot", out)
        until(out / "r1" / "r1.1.mcap", steps=5)
        kill("firmware_bridge.onboard.base", out)
        until(out / "r1" / "r1.2.mcap", steps=5)
        watcher = begin("fleet", "watch", endpoint, "--keys", keys)
        line = next(line for line in watcher.stdout if "places left" in line)
        # on a busy computer the emulated lidar is late, and then the robot says so
        progress = r"  step \d+: 2 places left, 0 reported, running(, .+)?\n"
        assert re.fullmatch(re.escape(endpoint) + progress, line)
        stopped = acrc("fleet", "stop", endpoint, "--keys", keys)
        assert (stopped.returncode, stopped.stdout, stopped.stderr) == (
            0,
            f"acrc: {endpoint}: has stopped\n",
            "",
        )
        _, said = running.communicate(timeout=30)
    finally:
        running.kill()
        if watcher is not None:
            watcher.kill()
            watcher.wait()
    assert running.returncode == 0, said
    lines = said.splitlines()
    assert lines[-1] == "r1 was told to stop"
    assert "r1 has ended by signal SIGKILL" in lines
    assert any(line.startswith("base has ended by signal SIGKILL") for line in lines)
    assert senses(out / "r1" / "r1.2.mcap")[-1].halt
    assert processes_of(out) == [] and leftovers(out) == []


@pytest.mark.nightly
def test_a_full_disk_costs_records_that_are_counted_and_no_stop(links: Path, tmp_path: Path) -> None:
    fleet, disk = tmp_path / "fleet.toml", tmp_path / "disk"
    fleet.write_text(FLEET.format(root=ROOT, links=links))
    out = disk / "one"
    words = [*ACRC, "fleet", "onboard", str(fleet), "--robot", "r1", "--out", str(out)]
    running = subprocess.Popen(
        on_small_disk(disk, "448k", words),  # of which three processes hold 64 KB each
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    full = "cannot be written: no space left on device"
    records = {"base": out / "r1.base" / "r1.base.mcap", "r1": out / "r1" / "r1.mcap"}
    said: list[str] = []
    missing = {f"{name}: {path}: {full}; records are lost from here on\n" for name, path in records.items()}

    def still_missing() -> bool:
        text = "".join(said)  # two processes may say something in one line
        return any(sentence not in text for sentence in missing)

    try:
        assert running.stderr is not None
        while still_missing():
            said.append(line := running.stderr.readline())
            assert line, said
        time.sleep(3)  # it drives on
        os.kill(running.pid, signal.SIGTERM)
        _, rest = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 128 + signal.SIGTERM, rest
    assert "has ended" not in "".join(said) + rest
    lost = re.escape(f"r1: {records['r1']}: {full}; ")
    counted = re.search(rf"^{lost}(\d+) records are missing$", rest, re.MULTILINE)
    assert counted is not None and int(counted[1]) > 40, "ten steps a second went on"


def kill(module: str, out: Path) -> None:
    """Kill the process of that module."""
    for process in processes_of(out):
        command = Path(f"/proc/{process}/cmdline").read_bytes().decode(errors="replace").split("\0")
        if module in command or (module, command[0]) == ("actors.robot", "acrc r1"):  # in its sandbox
            os.kill(process, signal.SIGKILL)
            return
    raise AssertionError(f"no process of {module}")
