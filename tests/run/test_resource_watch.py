"""What a robot writes to disk is counted, whatever it does to its folder; too much of it names the robot."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from actors.processes.launch import Child, Program
from actors.processes.resource_watch import ResourceWatch, Use, used
from actors.runtime.isolation.resource_limits import ProcessLimits
from actors.runtime.isolation.sandbox import Names
from actors.runtime.lifecycle import process_table

PLENTY = 1 << 40


def child(folder: Path, module: str = "actors.robot", pid: int = 0, names: Names | None = None) -> Child:
    return Child(Program(folder.name, module, (), folder / "r1.log", folder / "r1.mcap", names), pid)


class Clock:
    """Shows what it is set to."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_everything_below_a_folder_counts_and_nothing_that_a_link_leads_to(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.write_bytes(bytes(10_000_000))
    folder = tmp_path / "r1"
    deep = folder / "a" / "b" / "c"
    deep.mkdir(parents=True)
    (deep / "file").write_bytes(bytes(200_000))
    (folder / "link").symlink_to(outside)
    (folder / "loop").symlink_to(folder)
    size, files = used(folder, PLENTY, PLENTY)
    assert files == 6 and 200_000 <= size < 300_000


def test_a_hole_in_a_file_takes_no_disk(tmp_path: Path) -> None:
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(1 << 33)
    assert used(tmp_path, PLENTY, PLENTY).size < 1_000_000


def test_counting_ends_where_it_is_too_much(tmp_path: Path) -> None:
    for number in range(50):
        (tmp_path / f"{number}").touch()
    assert used(tmp_path, PLENTY, 10) == Use(0, 11)


def test_a_folder_that_is_gone_or_closed_is_no_fault(tmp_path: Path) -> None:
    assert used(tmp_path / "none", PLENTY, PLENTY) == Use(0, 0)


def test_who_writes_too_much_is_named_and_the_world_may(tmp_path: Path) -> None:
    clock = Clock()
    folder, world = tmp_path / "r1", tmp_path / "world"
    for one in (folder, world):
        one.mkdir()
        (one / "file").write_bytes(os.urandom(2_100_000))
    everyone = (child(world, "actors.world"), child(folder))
    watch = ResourceWatch(ProcessLimits(disk_mb=2), clock)
    assert watch.fault(everyone) is None, "it is not time"
    clock.now_s = 0.6
    assert watch.fault(everyone) == (
        f"r1 has written more than 2 MB to {folder}; --limit disk_mb=N allows more"
    )
    clock.now_s = 1.2
    assert watch.fault(everyone[:1]) is None
    few = ResourceWatch(ProcessLimits(disk_files=1), clock)
    (folder / "second").touch()
    clock.now_s = 2.0
    assert few.fault(everyone) == (
        f"r1 has made more than 1 files in {folder}; --limit disk_files=N allows more"
    )


@pytest.mark.parametrize(("look_s", "pause_s"), [(0.001, 0.5), (1.0, 2.0)])
def test_slow_looks_are_put_off_and_not_for_long(tmp_path: Path, look_s: float, pause_s: float) -> None:
    done_s = 10.0 + look_s
    times = iter([0.0, 10.0, done_s, done_s + pause_s - 0.01, done_s + pause_s + 0.01, done_s + 2 * pause_s])
    watch = ResourceWatch(ProcessLimits(disk_files=1), lambda: next(times))
    assert watch.fault([]) is None
    (tmp_path / "a").touch()
    (tmp_path / "b").touch()
    assert watch.fault([child(tmp_path)]) is None, "put off"
    assert watch.fault([child(tmp_path)]) is not None


HOLDS = """
import os, sys, time
os.fork(), os.fork()
hoard = bytearray(b"x") * 60_000_000
if sys.argv[1] == "session" and os.getpid() != os.getsid(0):
    os.setsid()
os.write(1, b"held\\n")
time.sleep(100)
"""


@pytest.mark.parametrize("where", ["child", "session"])
def test_all_processes_of_a_robot_count(tmp_path: Path, where: str) -> None:
    clock = Clock()
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, where], stdout=subprocess.PIPE, start_new_session=True
    ) as robot:
        assert robot.stdout is not None
        assert [robot.stdout.readline() for _ in range(4)] == [b"held\n"] * 4
        suspects = [child(tmp_path, pid=robot.pid, names=Names("", ""))]
        faults = []
        for limits in (ProcessLimits(), ProcessLimits(memory_mb=200), ProcessLimits(processes=1)):
            watch = ResourceWatch(limits, clock)
            clock.now_s += 1.0
            faults.append(watch.fault(suspects))
        for pid in process_table.descendants([robot.pid], process_table.table()):
            os.kill(pid, signal.SIGKILL)
    name = tmp_path.name
    assert faults == [
        None,
        f"{name} has taken more than 200 MB of memory with all its processes; "
        "--limit memory_mb=N allows more",
        f"{name} has more than 1 processes and threads; --limit processes=N allows more",
    ]
    assert process_table.held(robot.pid) == (0, 0), "it has ended"


HIDES = """
import ctypes, mmap, resource, time
from actors.runtime.isolation.resource_limits import ProcessLimits, enforce
enforce(ProcessLimits(memory_mb=100), isolated=False)
hidden = []
for _ in range(5):
    piece = mmap.mmap(-1, 40_000_000, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    piece.write(bytes(len(piece)))
    place = ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(piece)))
    assert ctypes.CDLL(None).mprotect(place, ctypes.c_size_t(len(piece)), mmap.PROT_READ) == 0
    hidden.append(piece)
print("held", flush=True)
time.sleep(100)
"""


def test_memory_that_was_made_readonly_counts_although_it_is_not_data(tmp_path: Path) -> None:
    clock = Clock()
    with subprocess.Popen([sys.executable, "-c", HIDES], stdout=subprocess.PIPE) as robot:
        assert robot.stdout is not None and robot.stdout.readline() == b"held\n"
        watch = ResourceWatch(ProcessLimits(memory_mb=100), clock)
        clock.now_s += 1.0
        fault = watch.fault([child(tmp_path, pid=robot.pid)])
        robot.kill()
    assert fault == (
        f"{tmp_path.name} has taken more than 100 MB of memory with all its processes; "
        "--limit memory_mb=N allows more"
    )
