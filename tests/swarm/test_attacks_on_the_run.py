"""Attacks of a robot on its own run over processes: links, forged counts, floods of messages."""

import json
import re
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.processes.launcher import LaunchError, Program, create_launcher
from actors.runtime.isolation.sandbox import isolation_fault
from actors.runtime.linux import create_log
from actors.runtime.process_setup import SETUP, ActorSetup, ProcessSetup
from actors.runtime.recording import Entry, read_recording
from tests import in_process
from tests.refusals import refused
from tests.swarm.command import acrc, leftovers, processes_of, run

MEMORY = ("--bus", "memory", "--json")
SCENARIO = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"

[run]
duration = 3.0
seed = 1
strategy = "tests.swarm.intruder:behaviour"

[robots]
count = 2

[places]
preset = "free"
per_robot = 1

[[event]]
at = 2.0
restart = "r1"
"""


@pytest.mark.skipif(isolation_fault() is not None, reason="robots cannot be isolated here")
def test_links_created_by_a_robot_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    victim = tmp_path / "victim.txt"
    victim.write_text("untouched")
    out = tmp_path / "out"
    assert run(out, tmp_path / "scenario.toml", "--isolate", "--modules", ".")["undelivered"] == 0
    assert victim.read_text() == "untouched"
    assert (out / "r1" / "own" / "diary.txt").read_text() == "what is mine"
    records = ("r1.mcap", "r1.1.mcap", "r1.log", "r1.1.log")
    assert not any((out / "r1" / name).is_symlink() for name in records)
    assert {path.name for path in (out / "r1").glob("*.mcap")} == {"r1.mcap", "r1.1.mcap"}
    assert in_process.acrc("record", "check", out).returncode == 0


def test_forged_counters_of_a_robot_are_reported_and_change_no_digest(tmp_path: Path) -> None:
    words = ("--duration", 3, "--robots", 2)
    honest = json.loads(in_process.acrc("run", *words, *MEMORY, "--out", tmp_path / "honest").stdout)
    out = tmp_path / "forged"
    done = acrc("run", *words, "--strategy", "tests.swarm.intruder:forges", "--out", out, "--json")
    result = json.loads(done.stdout)
    assert result["digest"] == honest["digest"]
    key = "swarm/up/r1/transmit"
    taken = [item for item in read_recording(out / "radio" / "radio.mcap") if isinstance(item, Entry)]
    frames = sum(item.key == key for item in taken)
    gaps = [
        "swarm/up/r1/drive: 1000000000 sent by r1, 30 received by world",
        "swarm/up/r1/ready: 0 sent by no process, 1 received by world",
        f"swarm/up/r1/transmit: 0 sent by no process, {frames} received by radio",
    ]
    assert result["not_delivered"] == gaps
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"acrc: {result['undelivered']} messages were not delivered: {'; '.join(gaps)}"
    )
    checked = in_process.acrc("record", "check", out)
    assert checked.returncode == 1 and checked.stderr.startswith(f"acrc: {out}/r1/r1.mcap: contains ")


def test_logs_and_set_ups_are_not_written_through_links(tmp_path: Path) -> None:
    victim, file = tmp_path / "victim.txt", tmp_path / SETUP
    victim.write_text("untouched")
    file.symlink_to(victim)
    (tmp_path / "r1.log").symlink_to(victim)
    (tmp_path / "r2.log").touch()
    (tmp_path / "r3.log").symlink_to(tmp_path / "nothing.txt")
    with create_launcher("exec") as launched:
        for name in ("r1", "r2", "r3"):
            log = tmp_path / f"{name}.log"
            with pytest.raises(FileExistsError):
                create_log(log)
            with refused(f"{name} cannot be started: {log}: File exists", LaunchError):
                launched.start(Program(name, "this", (), log, None))
        for number in range(2):
            told = ActorSetup({"epoch": number}, ProcessSetup(record="r1.mcap", router="router.sock"))
            launched.start(Program("r1", "this", (), tmp_path / f"r1.{number}.log", None, setup=told))
            assert json.loads(file.read_text())["actor"] == {"epoch": number}
        file.unlink()
        file.mkdir()
        with refused(f"r1 cannot be started: {file}: Is a directory", LaunchError):
            launched.start(Program("r1", "this", (), tmp_path / "r1.2.log", None, setup=told))
    assert victim.read_text() == "untouched" and not (tmp_path / "nothing.txt").exists()


def test_a_flood_ends_the_run_and_names_its_sender(tmp_path: Path) -> None:
    """Full queues block the sender in its own step."""
    out = tmp_path / "out"
    words = ("--robots", 2, "--timeout", 5, "--strategy", "tests.swarm.flooding:transmit", "--out", out)
    done = acrc("run", *words)
    assert done.returncode == 1
    sentence = r"acrc: (step 1[01] .*no Drive from r2 .*|radio failed in step 1[01]: r2 floods .*)"
    assert re.fullmatch(sentence, done.stderr.strip().splitlines()[-1]), done.stderr
    assert processes_of(out) == [] and leftovers(out) == []
