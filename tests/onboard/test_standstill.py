"""A robot in the loop stands whatever becomes of its processes, and drives again once it knows where it is.

How soon is a matter of wall time, so nothing runs beside these; what takes 0.2 s at most is given more.
The figures come from `acrc verify standstill --full`, which does the same for all processes.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from actors.runtime.recording import RecordingError, read_notes
from benchmarks.hardware.standstill import StandstillCase, events, measured, meets
from benchmarks.hardware.standstill_rig import GUARDIAN, Rig, killed, stopped
from firmware_bridge.kobuki.motion import LONGEST_GAP
from tests.onboard.test_live import senses
from tests.swarm.command import processes_of

pytestmark = pytest.mark.alone
SOON_S, NEAR_M = 0.8, 0.4
ROBOT, BASE = "actors.robot", "firmware_bridge.onboard.base"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with Rig(tmp_path_factory.mktemp("standstill")) as rig:
        yield rig


def stands_soon(rig: Rig, event: Callable[[Rig], None]) -> None:
    rig.until_driving()
    found = measured(rig, event)
    assert found.told_s is not None and found.told_s <= SOON_S, found
    assert found.told_m <= NEAR_M, found


def test_a_robot_that_is_stopped_stands_and_goes_on_when_it_does(rig: Rig) -> None:
    stands_soon(rig, lambda rig: stopped(rig.processes(ROBOT)))
    for process in rig.processes(ROBOT):
        os.kill(process, signal.SIGCONT)


def test_without_a_guardian_it_stands_until_there_is_another(rig: Rig) -> None:
    (before,) = rig.processes(GUARDIAN)
    stands_soon(rig, lambda rig: killed(rig.processes(GUARDIAN)))
    rig.until_driving()
    (after,) = rig.processes(GUARDIAN)
    assert after != before


def test_a_lidar_that_sees_nothing_stops_it(rig: Rig) -> None:
    stands_soon(rig, lambda rig: rig.expect_ok("darken r1"))
    rig.expect_ok("heal r1")


def test_a_killed_base_stands_and_its_successor_drives_once_the_robot_has_been_located(rig: Rig) -> None:
    stands_soon(rig, lambda rig: killed(rig.processes(BASE)))
    stood = rig.where()
    rig.until_driving()
    records = sorted((rig.out / "r1").glob("*.mcap"), key=lambda path: path.stat().st_mtime)
    scans = [one.scan is not None for one in senses(records[-1])]
    assert sum(scans) >= 5, "it looked round before it drove"
    assert rig.where().way - stood.way < 2.0
    assert doubtful(rig)


def test_a_serial_line_that_is_silent_for_long_leaves_the_robot_in_doubt_about_its_motion(rig: Rig) -> None:
    rig.until_driving()
    before = rig.processes(BASE)
    rig.expect_ok("silence r1 base")
    time.sleep(1.1 * LONGEST_GAP)
    rig.expect_ok("heal r1")
    deadline = time.monotonic() + 60.0  # how soon it then drives depends on how much it sees where it stands
    while not (anew := begins_anew(rig, before) and doubtful(rig)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert anew, "what the base moved meanwhile is not known, so it begins anew"
    logs = [path.read_text() for path in rig.out.rglob("*base*.log")]
    assert sum("the base was not heard for too long" in log for log in logs) == 1


def test_what_is_killed_with_the_supervisor_stands(tmp_path: Path) -> None:
    with Rig(tmp_path) as rig:
        stands_soon(rig, lambda rig: killed(rig.processes("onboard")))
        assert processes_of(rig.out / "nothing") == []


def begins_anew(rig: Rig, before: list[int]) -> bool:
    """A base runs that did not run before; a guardian it has just forked may look like it for an instant."""
    bases = rig.processes(BASE)
    return bool(bases) and not set(bases) & set(before)


def doubtful(rig: Rig) -> bool:
    """The robot was started not knowing where it is, as the recording of its last start says."""
    starts = sorted((rig.out / "r1").glob("r1*.mcap"), key=lambda path: path.stat().st_mtime)
    try:
        return json.loads(read_notes(starts[-1])["run"])["setup"]["doubt"] is not None
    except (IndexError, KeyError, OSError, RecordingError):
        return False


def test_the_bench_has_a_case_for_each_process_and_judges_them() -> None:
    cases = events()
    assert {case[0] for case in cases} >= {"robot", "bridge", "base", "guardian", "supervisor", "lidar"}
    late = StandstillCase(0.31, 0.1, 0.5, 0.2, 0.5)
    assert meets(("base", "killed"), [StandstillCase(0.3, 0.15, 0.6, 0.3, 0.5)])
    assert not meets(("base", "killed"), [late])
    assert not meets(("base", "killed"), [StandstillCase(None, 0.9, None, 0.9, 0.5)])
    assert meets(("bridge", "killed"), [StandstillCase(None, 0.9, None, 0.9, 0.5)])
