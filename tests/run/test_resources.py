"""Limits of memory, descriptors and disk: a robot that reaches one is named, and reports its failure."""

import os
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import product
from pathlib import Path

import pytest

from acrc_testbed.recordings import sandboxed_replay
from actors.processes.launcher import ChildProcess, Program
from actors.processes.monitor import DiskUsage, ResourceMonitor, disk_usage
from actors.runtime import failure, linux, process_table
from actors.runtime.errors import AcrcError
from actors.runtime.failure import FailureNote, failure_note, failure_sentence
from actors.runtime.isolation.sandbox import ProcessLimits, SandboxPaths, enforce_limits
from actors.runtime.process import report_failure
from actors.runtime.recording import Entry, Recorder, decode_note, read_notes, read_recording
from actors.runtime.recording.format import LARGE

Action = Callable[[], object]
LEFT_KB = {"robot": (300, 2752), "replay": (300,)}
"""Free memory before the limit, which determines the call that fails."""
PLENTY = 1 << 40


def in_child(work: Action) -> int:
    """Run `work` in a forked child; return its exit code, 70 after an exception."""
    pid = os.fork()
    if pid:
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    code = 70
    with suppress(BaseException):
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        work()
        code = 0
    os._exit(code)


def hoard_of(piece: Action) -> Action:
    def take() -> None:
        hoard = []
        while True:
            hoard.append(piece())

    return take


def hoard_all() -> None:
    """Allocate down to the last byte, without gaps between pieces."""
    hoard = []
    for size in (1 << 20, 1 << 16, 4096, 512, 64, 1):
        with suppress(MemoryError):
            while True:
                hoard.append(bytearray(size))
    raise MemoryError


def hoard_frames() -> None:
    def down() -> int:
        return down() + 1

    sys.setrecursionlimit(10_000_000)
    down()


HOARDS: dict[str, Action] = {
    "64 KB": hoard_of(lambda: bytearray(1 << 16)),
    "all sizes": hoard_all,
    "frames": hoard_frames,
}


def hoarding(left_kb: int, name: str) -> None:
    lines = Path("/proc/self/status").read_text().splitlines()
    used_kb = int(next(line for line in lines if line.startswith("VmData:")).split()[1])
    resource.setrlimit(resource.RLIMIT_DATA, ((used_kb + left_kb) * 1024,) * 2)
    HOARDS[name]()


def robot(folder: Path, action: Action) -> None:
    with Recorder(folder / "r2.mcap", 100_000) as recorder:
        failure.hold_reserve(folder)
        try:
            action()
        except BaseException as error:
            failure.release_reserve()
            report_failure(recorder, "r2", 20, error)


def replay(folder: Path, action: Action) -> None:
    failure.hold_reserve(folder)
    try:
        action()
    except Exception as error:
        fault = sandboxed_replay.describe_failure("r2", error)
    (folder / "said").write_text(fault)


def failure_of(folder: Path) -> str:
    path = folder / "r2.mcap"
    return failure_sentence(decode_note(path, "failure", read_notes(path)["failure"], FailureNote))


@pytest.fixture(scope="module")
def hoarded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the children of a fresh process, which has no spare memory; return the results' folder."""
    folder = tmp_path_factory.mktemp("hoarded")
    words = [sys.executable, "-m", "tests.run.test_resources", str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


def main(folder: Path) -> int:
    codes = []
    for what, work in {"robot": robot, "replay": replay}.items():
        for name, left_kb in product(HOARDS, LEFT_KB[what]):
            place = folder / what / name / str(left_kb)
            place.mkdir(parents=True)
            codes.append(in_child(partial(work, place, partial(hoarding, left_kb, name))))
    return max(codes)


@pytest.mark.parametrize("name", HOARDS)
def test_a_strategy_that_uses_up_memory_is_named(hoarded: Path, name: str) -> None:
    for left_kb in LEFT_KB["robot"]:
        said = failure_of(hoarded / "robot" / name / str(left_kb))
        # Python notes the lines of an exception one by one, each with memory of its own; and it loses one
        # that it raises for want of a frame
        error = "SystemError: error return without exception set" if "System" in said else "MemoryError"
        assert re.fullmatch(rf"r2 failed in step 20: {error}( \(test_resources\.py:\d+\))?", said), said
        assert "B" not in name or said.endswith(")")
    for left_kb in LEFT_KB["replay"] if name != "frames" else ():
        assert (hoarded / "replay" / name / str(left_kb) / "said").read_text() == "r2: MemoryError: "


def test_a_strategy_that_opens_all_files_is_named_and_the_process_table_can_be_read(tmp_path: Path) -> None:
    open_all = hoard_of(lambda: os.open(os.devnull, os.O_RDONLY))

    def action() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        open_all()

    def ends_well() -> None:
        failure.hold_reserve(tmp_path)
        with suppress(OSError):
            action()
        with suppress(OSError):
            process_table.processes()
            os._exit(71)
        failure.release_reserve()
        assert os.getpid() in process_table.processes()

    assert in_child(lambda: robot(tmp_path, action)) == 0
    assert re.fullmatch(
        r"r2 failed in step 20: OSError: \[Errno 24\] Too many open files: '/dev/null' "
        r"\(test_resources\.py:\d+\)",
        failure_of(tmp_path),
    )
    assert in_child(ends_well) == 0


def fill(folder: Path, limit: Action) -> None:
    """Record until the disk or the limit refuses more; report the failure."""
    recorder = Recorder(folder / "r2.mcap", 100_000)
    failure.hold_reserve(folder)
    limit()
    with recorder:
        try:
            for step in range(20_000):
                recorder.sent("swarm/toy", step, step, bytes(LARGE + 1), bytes(32))
                recorder.flush()
        except AcrcError as error:
            report_failure(recorder, "r2", 20, error)


def messages(path: Path) -> int:
    return sum(isinstance(item, Entry) for item in read_recording(path))


def test_a_recording_that_may_not_grow_has_its_last_record(tmp_path: Path) -> None:
    limits = ProcessLimits(file_mb=1)
    assert in_child(lambda: fill(tmp_path, lambda: enforce_limits(limits, isolated=False))) == 0
    assert (
        failure_of(tmp_path) == f"r2 failed in step 20: {tmp_path}/r2.mcap: cannot be written: file too large"
    )
    assert messages(tmp_path / "r2.mcap") > 7000


def test_a_recording_on_a_disk_that_is_full_has_its_last_record(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()

    def work() -> None:
        user, group = os.getuid(), os.getgid()
        linux.unshare(linux.CLONE_NEWUSER | linux.CLONE_NEWNS)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
        linux.mount("tmpfs", disk, "tmpfs", 0, "size=1m")
        fill(disk, lambda: None)
        (tmp_path / "said").write_text(f"{failure_of(disk)} {messages(disk / 'r2.mcap') > 7000}")

    assert in_child(work) == 0
    assert (tmp_path / "said").read_text() == (
        f"r2 failed in step 20: {disk}/r2.mcap: cannot be written: no space left on device True"
    )


def test_a_reserve_is_held_once_and_released_whole(tmp_path: Path) -> None:
    before = {entry.name for entry in Path("/proc/self/fd").iterdir()}
    failure.hold_reserve(tmp_path)
    try:
        held = {entry.name for entry in Path("/proc/self/fd").iterdir()} - before
        sizes = [
            os.fstat(int(number)).st_blocks * 512 for number in held if Path("/proc/self/fd", number).exists()
        ]
        assert max(sizes) >= 64 * 1024 and list(tmp_path.iterdir()) == []
        failure.hold_reserve(tmp_path)
        assert len({entry.name for entry in Path("/proc/self/fd").iterdir()} - before) == len(held)
    finally:
        failure.release_reserve()
    assert {entry.name for entry in Path("/proc/self/fd").iterdir()} == before
    failure.release_reserve()
    assert failure_note("r2", 3, MemoryError()).cause == "MemoryError"


def child(
    folder: Path, module: str = "actors.robot", pid: int = 0, names: SandboxPaths | None = None
) -> ChildProcess:
    return ChildProcess(Program(folder.name, module, (), folder / "r1.log", folder / "r1.mcap", names), pid)


def test_disk_use_counts_blocks_below_a_folder_and_follows_no_link(tmp_path: Path) -> None:
    outside, folder = tmp_path / "outside", tmp_path / "r1"
    outside.write_bytes(bytes(10_000_000))
    deep = folder / "a" / "b" / "c"
    deep.mkdir(parents=True)
    (deep / "file").write_bytes(bytes(200_000))
    (folder / "link").symlink_to(outside)
    (folder / "loop").symlink_to(folder)
    with (folder / "sparse").open("wb") as file:
        file.truncate(1 << 33)
    size, files = disk_usage(folder, PLENTY, PLENTY)
    assert files == 7 and 200_000 <= size < 300_000
    for number in range(50):
        (deep / f"{number}").touch()
    assert disk_usage(deep, PLENTY, 10).files == 11, "counting ends at the limit"
    assert disk_usage(tmp_path / "none", PLENTY, PLENTY) == DiskUsage(0, 0)


def test_a_robot_that_writes_too_much_is_named_and_the_world_is_not(tmp_path: Path) -> None:
    now_s = 0.0
    folder, world = tmp_path / "r1", tmp_path / "world"
    for one in (folder, world):
        one.mkdir()
        (one / "file").write_bytes(os.urandom(2_100_000))
    everyone = (child(world, "actors.world"), child(folder))
    watch = ResourceMonitor(ProcessLimits(disk_mb=2), lambda: now_s)
    assert watch.fault(everyone) is None, "it is not time"
    now_s = 0.6
    assert watch.fault(everyone) == (
        f"r1 has written more than 2 MB to {folder}; raise the limit with --limit disk_mb=N"
    )
    now_s = 1.2
    assert watch.fault(everyone[:1]) is None
    few = ResourceMonitor(ProcessLimits(disk_files=1), lambda: now_s)
    (folder / "second").touch()
    now_s = 2.0
    assert few.fault(everyone) == (
        f"r1 has created more than 1 files in {folder}; raise the limit with --limit disk_files=N"
    )


@pytest.mark.parametrize(("look_s", "pause_s"), [(0.001, 0.5), (1.0, 2.0)])
def test_slow_checks_are_postponed_briefly(tmp_path: Path, look_s: float, pause_s: float) -> None:
    done_s = 10.0 + look_s
    times = iter([0.0, 10.0, done_s, done_s + pause_s - 0.01, done_s + pause_s + 0.01, done_s + 2 * pause_s])
    watch = ResourceMonitor(ProcessLimits(disk_files=1), lambda: next(times))
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
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, where], stdout=subprocess.PIPE, start_new_session=True
    ) as robot:
        assert robot.stdout is not None
        assert [robot.stdout.readline() for _ in range(4)] == [b"held\n"] * 4
        suspects = [child(tmp_path, pid=robot.pid, names=SandboxPaths("", ""))]
        faults = []
        for limits in (ProcessLimits(), ProcessLimits(memory_mb=200), ProcessLimits(processes=1)):
            times = iter((0.0, *[1.0] * 9))
            watch = ResourceMonitor(limits, times.__next__)
            faults.append(watch.fault(suspects))
        for pid in process_table.descendants([robot.pid], process_table.processes()):
            os.kill(pid, signal.SIGKILL)
    name = tmp_path.name
    assert faults == [
        None,
        f"{name} has used more than 200 MB of memory in all its processes; "
        "raise the limit with --limit memory_mb=N",
        f"{name} has more than 1 processes and threads; raise the limit with --limit processes=N",
    ]
    assert process_table.process_usage(robot.pid) == (0, 0), "it has ended"


HIDES = """
import ctypes, mmap, resource, time
from actors.runtime.isolation.sandbox import ProcessLimits, enforce_limits
enforce_limits(ProcessLimits(memory_mb=100), isolated=False)
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
    now_s = 0.0
    with subprocess.Popen([sys.executable, "-c", HIDES], stdout=subprocess.PIPE) as robot:
        assert robot.stdout is not None and robot.stdout.readline() == b"held\n"
        watch = ResourceMonitor(ProcessLimits(memory_mb=100), lambda: now_s)
        now_s += 1.0
        fault = watch.fault([child(tmp_path, pid=robot.pid)])
        robot.kill()
    assert fault == (
        f"{tmp_path.name} has used more than 100 MB of memory in all its processes; "
        "raise the limit with --limit memory_mb=N"
    )


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
