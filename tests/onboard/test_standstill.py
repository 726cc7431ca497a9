"""The base stands when a process or a device fails, and drives again once the robot knows its pose.

These tests measure wall time; all but the full size allow for tests that run beside them.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from actors.runtime.recording import RecordingError, read_notes
from firmware_bridge.device_lines import RADIO, RANGE
from firmware_bridge.kobuki.motion import LONGEST_GAP
from tests.onboard.standstill_rig import GUARDIAN, Rig, Where, held, killed, stopped
from tests.onboard.test_live import senses
from tests.swarm.command import processes_of

pytestmark = pytest.mark.claim("standstill")
SOON_S, NEAR_M = 1.6, 0.7
ROBOT, BASE, BRIDGE = "actors.robot", "firmware_bridge.onboard.base", "firmware_bridge.onboard.bridge"
PROCESSES = {"robot": ROBOT, "bridge": BRIDGE, "base": BASE, "guardian": GUARDIAN, "supervisor": "onboard"}
"""By a word of their command lines."""
DEVICES = {
    "lidar silent": f"silence r1 {RANGE}",
    "lidar unplugged": f"unplug r1 {RANGE}",
    "lidar without echo": "darken r1",
    "lidar held fast": "jam r1",
    "base's feedback silent": "silence r1 base",
    "motor over-current": "strain r1 left",
    "battery nearly empty": "battery r1 13.0",
    "radio unplugged": f"unplug r1 {RADIO}",
}
MAY_DRIVE_ON = {
    *(f"bridge {how}" for how in ("killed", "stopped", "held")),
    *("supervisor stopped", "supervisor held", "radio unplugged"),
}
"""After these the robot still knows its pose, sees and obeys."""
FEW = ("robot killed", "base stopped", "lidar silent")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with Rig(tmp_path_factory.mktemp("standstill")) as rig:
        yield rig


def told_to_stand(rig: Rig, event: Callable[[Rig], None]) -> tuple[Where, Where | None, Where | None]:
    """Ground truth before the event, at the command to stand, and at standstill."""
    rig.until_driving()
    before = rig.where()
    event(rig)
    return before, *rig.standing(patience_s=3.0)


def stands_soon(
    rig: Rig, event: Callable[[Rig], None], within_s: float = SOON_S, within_m: float = NEAR_M
) -> Where:
    before, told, _ = told_to_stand(rig, event)
    assert told is not None and told.time - before.time <= within_s
    assert told.way - before.way <= within_m
    return told


def events() -> dict[str, Callable[[Rig], None]]:
    ways = {"killed": killed, "stopped": stopped, "held": held}
    made: dict[str, Callable[[Rig], None]] = {
        f"{process} {way}": lambda rig, word=word, act=act: act(rig.processes(word))  # type: ignore[misc]
        for process, word in PROCESSES.items()
        for way, act in ways.items()
    }
    made["base and guardian stopped"] = lambda rig: stopped([*rig.processes(BASE), *rig.processes(GUARDIAN)])
    for case, order in DEVICES.items():
        made[case] = lambda rig, order=order: rig.expect_ok(order)  # type: ignore[misc]
    return made


@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_the_base_stands_whatever_fails(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """In full size three trials of each case, within 0.3 s and 0.15 m, as docs/deployment.md reports."""
    limits = (0.3, 0.15) if full else (SOON_S, NEAR_M)
    missed = []
    for case, event in events().items():
        for trial in range(3 if full else int(case in FEW)):
            (folder := tmp_path / f"{len(list(tmp_path.iterdir()))}").mkdir()
            with Rig(folder) as rig:
                before, *after = told_to_stand(rig, event)
            told, stood = (one and (one.time - before.time, one.way - before.way) for one in after)
            record_property(f"{case}, trial {trial}: told, stood (s, m)", (told, stood))
            in_time = told is not None and told[0] <= limits[0] and told[1] <= limits[1]
            if not in_time and case not in MAY_DRIVE_ON:
                missed.append((case, told))
    assert missed == []


def test_a_robot_that_is_stopped_stands_and_goes_on_when_it_does(rig: Rig) -> None:
    stands_soon(rig, lambda rig: stopped(rig.processes(ROBOT)))
    for process in rig.processes(ROBOT):
        os.kill(process, signal.SIGCONT)


@pytest.mark.nightly
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


@pytest.mark.nightly
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


@pytest.mark.nightly
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
