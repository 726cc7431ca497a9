"""What a robot writes to disk is counted, whatever it does to its folder; too much of it names the robot."""

import os
from pathlib import Path

import pytest

from actors.runtime.isolation.resource_limits import ProcessLimits
from deploy.processes.launch import Program
from deploy.run.disk_use import DiskWatch, Use, used

PLENTY = 1 << 40


def program(folder: Path, module: str = "actors.robot") -> Program:
    return Program(folder.name, module, (), folder / "r1.log", folder / "r1.mcap")


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
    everyone = (program(world, "actors.world"), program(folder))
    watch = DiskWatch(ProcessLimits(disk_mb=2), clock)
    assert watch.fault(everyone) is None, "it is not time"
    clock.now_s = 0.6
    assert watch.fault(everyone) == (
        f"r1 has written more than 2 MB to {folder}; --limit disk_mb=N allows more"
    )
    clock.now_s = 1.2
    assert watch.fault(everyone[:1]) is None
    few = DiskWatch(ProcessLimits(disk_files=1), clock)
    (folder / "second").touch()
    clock.now_s = 2.0
    assert few.fault(everyone) == (
        f"r1 has made more than 1 files in {folder}; --limit disk_files=N allows more"
    )


@pytest.mark.parametrize(("look_s", "pause_s"), [(0.001, 0.5), (1.0, 20.0)])
def test_slow_looks_are_rare(tmp_path: Path, look_s: float, pause_s: float) -> None:
    done_s = 10.0 + look_s
    times = iter([0.0, 10.0, done_s, done_s + pause_s - 0.01, done_s + pause_s + 0.01, done_s + 2 * pause_s])
    watch = DiskWatch(ProcessLimits(disk_files=1), lambda: next(times))
    assert watch.fault([]) is None
    (tmp_path / "a").touch()
    (tmp_path / "b").touch()
    assert watch.fault([program(tmp_path)]) is None, "put off"
    assert watch.fault([program(tmp_path)]) is not None
