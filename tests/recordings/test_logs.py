"""What a strategy prints: with simulated time and step, bounded, in memory, as processes, and in replays."""

import json
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import ReplayOptions, replay_actor
from actors.installation.repository import REPOSITORY
from actors.processes.robot_logs import ALL_ROBOTS, LogTail, log_files
from actors.runtime import captured_output
from tests.in_process import acrc
from tests.recorded_runs import HEAD_ON, record
from tests.swarm.command import run

ENTRY = "tests.recordings.talkative:behaviour"
R1 = (
    "     0.000 s  step 0  made r1\n"
    "     1.000 s  step 10  half of a line and the rest\x1b[31m\n"
    "     1.000 s  step 10  r1 warns\n"
)


@pytest.fixture(scope="module")
def talked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("talked") / "out"
    record(out, duration=3.0, strategy=ENTRY)
    return out


def test_a_flood_is_bounded_and_counted(talked: Path) -> None:
    assert (talked / "r1" / "r1.log").read_text() == R1
    text = (talked / "r2" / "r2.log").read_text()
    assert text.startswith(R1.replace("r1", "r2"))
    assert captured_output.MAX_CHARACTERS < len(text) < 1.2 * captured_output.MAX_CHARACTERS
    *_, before, last = text.splitlines()
    assert before == "     2.000 s  step 20  output limit reached; further output is discarded"
    lines, characters = (int(word) for word in last.split() if word.isdigit())
    printed = 10_001 + 5000 * 1001 + len("made r2\nhalf of a line and the rest\x1b[31m\nr2 warns\n")
    kept = sum(len(line.split("  ", 2)[-1].split("  ", 1)[-1]) for line in text.splitlines()[:-2])
    assert (
        lines > 500
        and characters <= printed - captured_output.MAX_CHARACTERS + captured_output.MAX_LINE
        and kept > captured_output.MAX_CHARACTERS // 2
    )
    assert max(map(len, text.splitlines())) < captured_output.MAX_LINE + 40


def test_output_of_processes_and_digest_are_equal(talked: Path, tmp_path: Path) -> None:
    out = tmp_path / "processes"
    result = run(out, HEAD_ON, "--duration", 3, "--strategy", ENTRY)
    assert (out / "r1" / "r1.log").read_text() == R1
    assert (out / "r2" / "r2.log").read_text() == (talked / "r2" / "r2.log").read_text()
    assert f'"digest": "{result["digest"]}"' in (talked / "run.json").read_text()


def test_record_echo_shows_logs(talked: Path) -> None:
    assert acrc("record", "echo", talked, "r1/log").stdout == R1.replace("\x1b", "\\x1b")
    both = acrc("record", "echo", talked, "*/log").stdout.splitlines()
    assert both[0] == "r1       0.000 s  step 0  made r1" and both[3].startswith("r2  ")
    late = acrc("record", "echo", talked, "r1/log", "--from", 1, "--json").stdout.splitlines()
    assert json.loads(late[1]) == {"seconds": 1.0, "key": "r1/log", "text": "r1 warns"} and len(late) == 2
    table = acrc("record", "echo", talked, "r1/log", "--to", 0.5, "--csv").stdout
    assert table == "seconds,key,text\n0.0,r1/log,made r1\n"
    done = acrc("record", "echo", talked, "r9/log")
    assert done.returncode == 1
    assert done.stderr == f"acrc: {talked}: no robot 'r9'; there are r1, r2, and '*' for all\n"


def test_terminal_shows_output_during_the_run(tmp_path: Path) -> None:
    words = ("run", HEAD_ON, "--duration", 2, "--strategy", ENTRY, "--bus", "memory", "--json")
    done = acrc(*words, "--out", tmp_path / "out", "--log", "r1")
    assert done.returncode == 0, done.stderr
    assert R1.replace("\x1b", "\\x1b") in done.stderr
    done = acrc(*words, "--out", tmp_path / "other", "--log", "r7")
    assert (done.returncode, "--log: no robot 'r7'; there are r1, r2" in done.stderr) == (1, True)


def test_replay_prints_the_same(talked: Path) -> None:
    done = acrc("replay", talked, "--robot", "r1", "--modules", REPOSITORY)
    assert done.returncode == 0 and "     1.000 s  step 10  half of a line and the rest" in done.stderr
    said: list[str] = []
    replay_actor(
        talked,
        "r1",
        ReplayOptions(prints=lambda step_us: captured_output.CapturedOutput(step_us, said.append)),
    )
    assert "".join(said) == R1


def test_a_growing_log_gives_whole_lines(tmp_path: Path) -> None:
    (tmp_path / "r1").mkdir()
    (tmp_path / "r1" / "r1.mcap").touch()
    tail = LogTail(tmp_path, (ALL_ROBOTS,))
    assert list(tail.poll()) == [] == log_files(tmp_path, "r1")
    with (tmp_path / "r1" / "r1.log").open("w") as log:
        for text, shown in (("a\nb", [("r1", "a")]), ("c\n", [("r1", "bc")]), ("d", [])):
            log.write(text)
            log.flush()
            assert list(tail.poll()) == shown
    assert list(tail.close()) == [("r1", "d")]
