"""Kills, Ctrl-C and exceeded limits end the run, which names the cause and leaves nothing behind."""

import os
import re
import signal
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import replay_actor
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import INSTALLED
from actors.runtime.isolation.sandbox import ProcessLimits
from deploy.run.options import RunOptions, check_options, parse_limits
from deploy.run.swarm_replay import replay_swarm
from tests import in_process
from tests.failures.failing import Death, gone, killed, last_step, process_of, started, until
from tests.swarm.command import acrc, begin, leftovers, processes_of, start

pytestmark = pytest.mark.usefixtures("forked_servers")


@pytest.fixture(scope="module")
def r2_killed(tmp_path_factory: pytest.TempPathFactory) -> Death:
    return killed(tmp_path_factory.mktemp("r2") / "out", "r2")


def test_a_killed_process_ends_the_run_at_once(r2_killed: Death, tmp_path: Path) -> None:
    check_end(r2_killed, "r2")
    check_end(killed(tmp_path / "out", "world"), "world")


def check_end(death: Death, actor: str) -> None:
    assert death.lasted_s < 10  # not the 30 s of a silent actor
    assert death.code == 1
    assert death.said.strip().splitlines()[-1] == f"acrc: {actor} was killed by SIGKILL"
    assert gone(death.out)
    steps = {path.stem: last_step(path) for path in death.out.glob("*/*.mcap")}
    # its own last step may be sent and not yet in its file, while the world is in the one after
    assert len(steps) == 4 and abs(max(steps.values()) - steps.pop(actor)) <= 2
    assert max(steps.values()) - min(steps.values()) <= 1


def test_ctrl_c_ends_the_run_with_130(tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = started(start, out)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert f"acrc: interrupted; recordings are in {out}" in said
    assert gone(out) and last_step(out / "r1" / "r1.mcap") > 0
    assert in_process.acrc("record", "check", out).returncode == 0


def test_nothing_is_left_when_acrc_itself_is_killed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = started(begin, out)
    process.kill()
    process.wait()
    until(lambda: gone(out), timeout_s=5.0)


@pytest.mark.nightly
def test_no_password_is_left_when_world_and_acrc_are_killed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = started(begin, out)
    process.send_signal(signal.SIGSTOP)  # else it might tidy up after the world
    os.kill(process_of(out, "world"), signal.SIGKILL)
    process.kill()
    process.wait()
    until(lambda: gone(out), timeout_s=10.0)


def test_a_run_that_was_cut_can_be_replayed_up_to_the_cut(r2_killed: Death) -> None:
    assert replay_actor(r2_killed.out, "r2").outputs > 0
    again = replay_swarm(r2_killed.out, permit=INSTALLED)
    assert again.messages > 0 and not again.complete


def test_limits_are_words_and_wrong_ones_are_refused(tmp_path: Path) -> None:
    assert parse_limits(("memory_mb=1500", "processes=9")) == ProcessLimits(memory_mb=1500, processes=9)
    assert parse_limits(()) == ProcessLimits()
    for word in ("memory_mb", "memory_mb=0", "disk=3", "file_mb=1e9"):
        with pytest.raises(OptionError) as caught:
            parse_limits((word,))
        assert str(caught.value) == (
            f"--limit: {word}; must be one of memory_mb, open_files, file_mb, disk_mb, disk_files, "
            'processes, "=" and a number from 1 to 999999999'
        )
    out = tmp_path / "out"
    for options, words, sentence in (
        (RunOptions(out, bus="memory"), ("file_mb=1",), "--limit: requires --bus zenoh; it limits a "),
        (RunOptions(out), ("file_mb",), "--limit: file_mb; must be one of memory_mb, "),
        (RunOptions(out, speed="0.02", timeout_s=5.0), (),
         "--timeout: 5; must be more than the 5 s of a step at --speed 0.02"),
    ):  # fmt: skip
        with pytest.raises(OptionError) as refused:
            check_options(options, words)
        assert str(refused.value).startswith(sentence)


def test_a_strategy_that_takes_all_memory_ends_the_run_and_is_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--robots", 2, "--duration", 4, "--limit", "memory_mb=2000", "--timeout", 60)
    done = acrc("run", "--strategy", "tests.failures.saboteur:hoards", *words, "--out", out)
    assert done.returncode == 1
    assert re.search(r"acrc: r2 failed in step 20: MemoryError \(saboteur.py:\d+\)\n$", done.stderr)
    assert processes_of(out) == [] and leftovers(out) == []


def test_a_strategy_that_fills_the_disk_ends_the_run_and_is_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--robots", 2, "--duration", 4, "--isolate", "--limit", "disk_mb=30")
    done = acrc("run", "--strategy", "tests.failures.saboteur:fills", *words, "--out", out)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1] == (
        f"acrc: r2 has written more than 30 MB to {out}/r2; raise the limit with --limit disk_mb=N"
    )
    assert processes_of(out) == [] and leftovers(out) == []
