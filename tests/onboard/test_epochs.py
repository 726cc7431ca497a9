"""A robot's epochs only grow: over restarts, folders, crashes, whatever becomes of the file that counts."""

import threading
from pathlib import Path

import msgspec
import pytest

from actors.runtime.errors import AcrcError
from actors.runtime.process import RunNote
from actors.runtime.recording import Recorder
from deploy.fleet.epochs import EpochCounter

NOW = 1_800_000_000.0
"""2027-01-15."""
BY_CLOCK = 222_163_200
"""Seconds from 2020-01-01 to NOW."""


class Robot:
    """One robot's computer."""

    def __init__(self, folder: Path, now: float = NOW) -> None:
        self.state, self.runs, self.now = folder / "state", folder / "runs", now
        self.said: list[str] = []

    @property
    def file(self) -> Path:
        return self.state / "r1.epochs"

    def counter(self, runs: Path | None = None, robot: str = "r1") -> EpochCounter:
        return EpochCounter(robot, runs or self.runs, self.said.append, self.state, lambda: self.now)

    def claim(self) -> int:
        """As a new supervisor does."""
        return self.counter().claim()

    def record(self, epoch: int, run: str = "one", robot: str = "r1") -> None:
        """Leave a recording of that epoch, which ends in its first step."""
        path = self.runs / run / robot / f"{robot}.mcap"
        path.parent.mkdir(parents=True, exist_ok=True)
        setup = msgspec.Raw(msgspec.json.encode({"id": robot, "epoch": epoch, "seed": 1}))
        with Recorder(path, 100_000) as recorder:
            recorder.note("run", RunNote(robot, 1, 100_000, "", setup))


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


def test_every_start_is_one_more_whatever_folder_it_records_into(robot: Robot, tmp_path: Path) -> None:
    assert [robot.counter(tmp_path / f"runs{number}").claim() for number in range(20)] == list(range(20))
    assert robot.counter(robot="r2").claim() == 0
    assert robot.said == []
    assert len(robot.file.read_bytes()) < 100


@pytest.mark.parametrize("left", (0, 1, 2, 5, 11))
def test_a_torn_file_never_gives_an_epoch_again(robot: Robot, left: int) -> None:
    for _ in range(12):
        last = robot.claim()
    whole = robot.file.read_bytes()
    assert len(whole) == 12
    robot.file.write_bytes(whole[:left])
    first, second = robot.claim(), robot.claim()
    assert last < first < second and len(robot.said) == 1


@pytest.mark.parametrize("bit", range(2, 12 * 8, 7))
def test_a_flipped_bit_never_gives_an_epoch_again(robot: Robot, bit: int) -> None:
    for _ in range(12):
        last = robot.claim()
    damaged = bytearray(robot.file.read_bytes())
    damaged[bit // 8] ^= 1 << bit % 8
    robot.file.write_bytes(damaged)
    assert last < robot.claim()


def test_an_empty_file_goes_on_by_the_clock_and_says_so(robot: Robot) -> None:
    for _ in range(3):
        robot.claim()
    robot.file.write_bytes(b"")
    assert [robot.claim(), robot.claim()] == [BY_CLOCK, BY_CLOCK + 1]
    assert robot.said == [
        f"{robot.file} was damaged: it holds no epoch that can be read; r1 goes on with {BY_CLOCK}, "
        "by the clock"
    ]
    robot.file.write_bytes(b"\0" * 10_000)
    robot.now += 60
    assert robot.claim() == BY_CLOCK + 60
    robot.file.write_bytes(b"")
    robot.record(BY_CLOCK + 1000)
    assert robot.claim() == BY_CLOCK + 1001, "the later one of recordings and clock"
    robot.file.write_bytes(b"")
    robot.now = 100.0
    with pytest.raises(AcrcError, match="and the clock, at 1970-01-01, was never set"):
        robot.claim()


def test_a_lost_file_goes_on_behind_the_latest_recording(robot: Robot) -> None:
    robot.record(4)
    robot.record(41, "two")
    robot.record(99, "two", "r2")
    (robot.runs / "two" / "r1" / "r1.1.mcap").write_bytes(b"no recording")
    assert [robot.claim(), robot.claim()] == [42, 43]


def test_two_at_once_get_two(robot: Robot) -> None:
    claimed: list[int] = []
    threads = [threading.Thread(target=lambda: claimed.append(robot.claim())) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(claimed) == list(range(16))
