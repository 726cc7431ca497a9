"""A process can report its failure although a strategy has used up memory, descriptors or disk."""

import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import product
from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from actors.runtime.isolation.resource_limits import ProcessLimits, enforce
from actors.runtime.lifecycle import linux, reserve
from actors.runtime.lifecycle.failure import FailureNote, failure_note, in_words
from actors.runtime.lifecycle.process_table import table
from actors.runtime.process import tell
from actors.runtime.recording import Entry, Recorder, decoded, read_notes, read_recording
from actors.runtime.recording.form import LARGE
from observation.replay import sandboxed

Deed = Callable[[], object]


def in_child(work: Deed) -> int:
    """The exit code of a forked child that does the work; 70 if an exception comes out of that."""
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


def short_of_memory(left_kb: int) -> None:
    """From now on this process may have so much more."""
    lines = Path("/proc/self/status").read_text().splitlines()
    used_kb = int(next(line for line in lines if line.startswith("VmData:")).split()[1])
    resource.setrlimit(resource.RLIMIT_DATA, ((used_kb + left_kb) * 1024,) * 2)


def hoard_of(piece: Callable[[], object]) -> Deed:
    def take() -> None:
        hoard = []
        while True:
            hoard.append(piece())

    return take


def hoard_all() -> None:
    """To the last byte, so that nothing at all is left between the pieces."""
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


HOARDS: dict[str, Deed] = {
    "64 KB": hoard_of(lambda: bytearray(1 << 16)),
    "all sizes": hoard_all,
    "frames": hoard_frames,
}


def robot(folder: Path, deed: Deed) -> None:
    """A robot's process: records, does the deed, and tells what came of that."""
    recorder = Recorder(folder / "r2.mcap", 100_000)
    with recorder:
        reserve.hold(folder)
        try:
            deed()
        except BaseException as error:
            reserve.release()
            tell(recorder, "r2", 20, error)


def told(folder: Path) -> str:
    path = folder / "r2.mcap"
    return in_words(decoded(path, "failure", read_notes(path)["failure"], FailureNote))


LEFT_KB = {"robot": range(300, 4000, 1226), "replay": range(300, 4000, 3022)}
"""The distance to the limit decides in which call the last byte goes; so many are tried."""


@pytest.fixture(scope="module")
def hoarded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where each deed was done, with each distance, by children of a process that has no memory to spare: one
    that has run other tests has much, and all of that would have to be taken first."""
    folder = tmp_path_factory.mktemp("hoarded")
    done = subprocess.run(
        [sys.executable, "-m", "tests.run.test_reserve", str(folder)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return folder


def main(folder: Path) -> int:
    """What `hoarded` starts; the exit code."""
    codes = []
    for what, work in {"robot": robot, "replay": replay}.items():
        for name, left_kb in product(HOARDS, LEFT_KB[what]):
            place = folder / what / name / str(left_kb)
            place.mkdir(parents=True)
            codes.append(in_child(partial(work, place, partial(hoarding, left_kb, name))))
    return max(codes)


def hoarding(left_kb: int, name: str) -> None:
    short_of_memory(left_kb)
    HOARDS[name]()


def replay(folder: Path, deed: Deed) -> None:
    """A program that replays, and whose code does the deed."""
    reserve.hold(folder)
    try:
        deed()
    except Exception as error:
        fault = sandboxed.bug("r2", error)
    (folder / "said").write_text(fault)


@pytest.mark.parametrize("name", HOARDS)
def test_a_strategy_that_uses_up_memory_is_named(hoarded: Path, name: str) -> None:
    for left_kb in LEFT_KB["robot"]:
        said = told(hoarded / "robot" / name / str(left_kb))
        # Python notes the lines of an exception one by one, each with memory of its own; and it loses one
        # that it raises for want of a frame
        error = "SystemError: error return without exception set" if "System" in said else "MemoryError"
        assert re.fullmatch(rf"r2 failed in step 20: {error}( \(test_reserve\.py:\d+\))?", said), said
        if "B" in name:
            assert said.endswith(")")


@pytest.mark.parametrize("name", ["64 KB", "all sizes"])
def test_a_replay_answers_although_its_code_uses_up_memory(hoarded: Path, name: str) -> None:
    for left_kb in LEFT_KB["replay"]:
        said = (hoarded / "replay" / name / str(left_kb) / "said").read_text()
        assert said == "r2: MemoryError: "


def test_a_strategy_that_ends_well_with_all_files_open_is_looked_after(tmp_path: Path) -> None:
    def deed() -> None:
        with suppress(OSError):
            while True:
                os.open(os.devnull, os.O_RDONLY)

    def work() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        reserve.hold(tmp_path)
        deed()
        with suppress(OSError):
            table()
            os._exit(71)
        reserve.release()
        assert os.getpid() in table()

    assert in_child(work) == 0


def test_a_strategy_that_opens_all_files_is_named(tmp_path: Path) -> None:
    def deed() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
        hoard_of(lambda: os.open(os.devnull, os.O_RDONLY))()

    assert in_child(lambda: robot(tmp_path, deed)) == 0
    assert re.fullmatch(
        r"r2 failed in step 20: OSError: \[Errno 24\] Too many open files: '/dev/null' "
        r"\(test_reserve\.py:\d+\)",
        told(tmp_path),
    )


def test_a_recording_that_has_become_as_large_as_a_file_may_be_has_its_last_record(tmp_path: Path) -> None:
    def work() -> None:
        recorder = Recorder(tmp_path / "r2.mcap", 100_000)
        reserve.hold(tmp_path)
        enforce(ProcessLimits(file_mb=1), isolated=False)
        with recorder:
            try:
                fill(recorder)
            except AcrcError as error:
                tell(recorder, "r2", 20, error)

    assert in_child(work) == 0
    assert told(tmp_path) == f"r2 failed in step 20: {tmp_path}/r2.mcap: cannot be written: file too large"
    assert check_recording(tmp_path / "r2.mcap") > 7000


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
        recorder = Recorder(disk / "r2.mcap", 100_000)
        reserve.hold(disk)
        with recorder:
            try:
                fill(recorder)
            except AcrcError as error:
                tell(recorder, "r2", 20, error)
        (tmp_path / "said").write_text(f"{told(disk)} {check_recording(disk / 'r2.mcap') > 7000}")

    assert in_child(work) == 0
    assert (tmp_path / "said").read_text() == (
        f"r2 failed in step 20: {disk}/r2.mcap: cannot be written: no space left on device True"
    )


def fill(recorder: Recorder) -> None:
    for step in range(20_000):
        recorder.sent("swarm/toy", step, step, bytes(LARGE + 1), bytes(32))
        recorder.flush()


def check_recording(path: Path) -> int:
    """Messages in it, each of which is sealed."""
    return sum(isinstance(item, Entry) for item in read_recording(path))


def test_a_reserve_is_held_once_and_let_go_whole(tmp_path: Path) -> None:
    def descriptors() -> set[str]:
        return {entry.name for entry in Path("/proc/self/fd").iterdir()}

    before = descriptors()
    room = reserve.hold(tmp_path)
    try:
        assert os.fstat(room).st_blocks * 512 >= 64 * 1024 and list(tmp_path.iterdir()) == []
        assert reserve.hold(tmp_path) == -1
    finally:
        reserve.release()
        os.close(room)
    assert descriptors() == before
    reserve.release()


def test_an_error_whose_lines_are_lost_is_told_without() -> None:
    assert failure_note("r2", 3, MemoryError()).cause == "MemoryError"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
