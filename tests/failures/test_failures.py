"""A crash, hang or exception of a robot ends the run, which names the cause and leaves nothing behind."""

import json
import os
import re
import signal
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace as replace_struct

from actors.messages import Progress
from actors.processes.monitor import Timeout
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Entry, read_notes, read_recording
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests import in_process, warm
from tests.failures import saboteur
from tests.failures.failing import gone, last_step, process_of, until
from tests.run.doomed import Doom, sentence
from tests.swarm.command import ROOT, acrc, begin, leftovers, processes_of, run

pytestmark = pytest.mark.usefixtures("forked_servers")


def place(text: str, *, after: str = "") -> str:
    """File and line of the first line of the saboteur that holds `text`, below the one that holds `after`."""
    lines = Path(saboteur.__file__).read_text().splitlines()
    below = next(number for number, line in enumerate(lines) if after in line)
    return f"saboteur.py:{next(n for n, line in enumerate(lines[below:], below + 1) if text in line)}"


def test_an_exception_is_named_with_its_place(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = acrc("run", "--strategy", "tests.failures.saboteur:raises", "--robots", 2, "--out", out)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1] == (
        "acrc: r2 failed in step 20: ZeroDivisionError: my strategy divides by the number of its friends "
        f"({place('raise ZeroDivisionError')})"
    )
    log = (out / "r2" / "r2.log").read_text()
    assert "Traceback" in log and "in step 20 (2 s): behaviour 'tests.failures.saboteur:raises' of r2" in log
    assert gone(out) and last_step(out / "r1" / "r1.mcap") in (19, 20)


def test_in_memory_an_exception_is_the_guilty_actors(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = in_process.acrc(
        "run", "--strategy", "tests.failures.saboteur:raises", "--out", out, "--bus", "memory"
    )
    assert done.returncode == 1
    assert "ZeroDivisionError: my strategy divides by the number of its friends" in done.stderr
    failures = {path.stem for path in out.glob("*/*.mcap") if "failure" in read_notes(path)}
    assert failures == {"r2"}
    assert last_step(out / "r1" / "r1.mcap") == 20


def failure(out: Path, behaviour: str, bus: str = "zenoh", spawn: str = "forkserver", **limits: float) -> str:
    """Return the error of a run with this behaviour of r2; check that nothing is left behind."""
    doom = Doom(str(out), behaviour, bus, spawn, limits)
    if bus == "memory":
        said = sentence(doom)
    else:
        words = (msgspec.json.encode(doom).decode(),)
        done = warm.run(words, ROOT, os.environ, 100.0, finds_cwd=True, program="tests.run.doomed")
        assert done.returncode == 0, done.stderr
        said = done.stdout
    assert said and gone(out)
    return said


NIGHTLY = pytest.mark.nightly
PROCESSES = "its child processes were still running at its end"
THREADS = "its threads were still running at its end (mine)"
MUST_NOT = "a strategy must not start processes or threads"


@pytest.mark.parametrize(
    ("behaviour", "bus", "said"),
    [
        (
            "hangs", "zenoh",
            f"step 20 (2 s): no Drive from r2 for 1 s; r2 is at {place('time.sleep(1)')} (_sleep)",
        ),
        # without isolation the server alone finds a process that has lost its parent
        pytest.param("forks_twice", "zenoh", f"r2 failed: {PROCESSES}: {MUST_NOT}", marks=NIGHTLY),
        pytest.param("forks", "isolated", f"r2 failed in step 30: {PROCESSES}: {MUST_NOT}", marks=NIGHTLY),
        ("forks", "memory", f"a strategy failed: {PROCESSES}: {MUST_NOT}"),
        pytest.param(
            "forks_twice", "isolated", f"r2 failed in step 30: {PROCESSES}: {MUST_NOT}", marks=NIGHTLY
        ),
        ("starts_a_thread", "memory", f"a strategy failed: {THREADS}: {MUST_NOT}"),
        pytest.param(
            "starts_a_thread", "zenoh", f"r2 failed in step 30: {THREADS}: {MUST_NOT}", marks=NIGHTLY
        ),
        (
            "crashes", "isolated",
            f"r2 was killed by SIGABRT; it was at {place('self._deed()')} (advance)",
        ),
        pytest.param(
            "cannot_be_made", "zenoh",
            f"r2 failed in step 0: ZeroDivisionError: my strategy has no friends ({place('no friends')})",
            marks=NIGHTLY,
        ),
        (
            "says_much", "memory",
            "r2 failed in step 20: ValueError: first line\nsecond \\x1b[31mline\\udc80 "
            f"({place('raise ValueError')})",
        ),
    ],
)  # fmt: skip
def test_a_failure_is_named(tmp_path: Path, behaviour: str, bus: str, said: str) -> None:
    step_s = 1.0 if behaviour == "hangs" else 30.0
    # in memory the frames of the strategy's own code follow
    found = failure(tmp_path / "out", behaviour, bus, step_s=step_s)
    assert found == said or (bus == "memory" and found.startswith(f"{said}\n"))


@pytest.mark.parametrize("bus", ["memory", pytest.param("zenoh", marks=NIGHTLY)])
def test_an_endless_loop_is_named_by_its_line(tmp_path: Path, bus: str) -> None:
    said = failure(tmp_path / "out", "spins", bus, step_s=1.0)
    where = rf"({place('while True:', after='def _spin')}|{place('count += 1')}) \(_spin\)"
    # a machine that takes the processor away for a moment makes the loop look as if it waited as well
    used = r"(after 1 s of CPU time|for 1 s, 1 s of it CPU time)"
    if bus == "zenoh":
        expected = rf"step 20 \(2 s\): no Drive from r2 {used}; r2 is at {where}"
    else:
        expected = rf"step 20: r2 has not finished the step {used}; it is at {where}"
    assert re.fullmatch(expected, said)


def in_memory(out: Path, behaviour: str, timeout_s: int) -> warm.ForkedCommand:
    words = ("--bus", "memory", "--robots", 2, "--duration", 4, "--timeout", timeout_s)
    return begin("run", "--strategy", f"tests.failures.saboteur:{behaviour}", *words, "--out", out)


def in_step_20(out: Path) -> bool:
    """Return whether r2's sabotage is due; its own recording ends before."""
    recording = out / "r2" / "r2.mcap"
    if not recording.exists():
        return False
    steps = (item.step for item in read_recording(recording) if isinstance(item, Entry))
    return max(steps, default=0) >= 19


@pytest.mark.parametrize("behaviour", ["vforks", pytest.param("never_returns", marks=pytest.mark.nightly)])
def test_in_memory_a_call_that_never_returns_is_ended_and_named(tmp_path: Path, behaviour: str) -> None:
    process = in_memory(tmp_path / "out", behaviour, 1)
    _, said = process.communicate(timeout=100)
    assert process.returncode == -signal.SIGKILL
    assert said.splitlines()[-1] == "acrc: step 20: r2 has not finished the step for 11 s"
    assert processes_of(tmp_path / "out") == []
    assert in_process.acrc("record", "check", tmp_path / "out").returncode == 0


@pytest.mark.parametrize(
    ("behaviour", "number"),
    [
        ("vforks", signal.SIGTERM),
        pytest.param("never_returns", signal.SIGINT, marks=pytest.mark.nightly),
        pytest.param("catches_all", signal.SIGINT, marks=pytest.mark.nightly),
    ],
)
def test_in_memory_ctrl_c_ends_a_strategy_that_ignores_it(
    tmp_path: Path, behaviour: str, number: signal.Signals
) -> None:
    process = in_memory(tmp_path / "out", behaviour, 100)
    until(lambda: in_step_20(tmp_path / "out"), timeout_s=80)
    time.sleep(2)  # from the step's begin until it is in there, which nothing tells
    process.send_signal(number)
    _, said = process.communicate(timeout=100)
    assert process.returncode == -signal.SIGKILL
    where = r"; it is at saboteur\.py:\d+ \(\w+\)" if behaviour == "catches_all" else ""
    told = said.splitlines()[-1]
    assert re.fullmatch(
        rf"acrc: step 20: r2 has not finished the step within 10 s of a signal to exit{where}", told
    )
    assert processes_of(tmp_path / "out") == []


@pytest.mark.nightly
@pytest.mark.parametrize("bus", ["zenoh", "memory"])
def test_a_delay_of_steps_is_reported_and_ends_nothing(tmp_path: Path, bus: str) -> None:
    words = ("--robots", 3, "--duration", 3, "--timeout", 10, "--bus", bus, "--out", tmp_path / "out")
    done = acrc("run", "--strategy", "tests.failures.saboteur:naps", *words)
    assert done.returncode == 0, done.stderr
    held_up = json.loads((tmp_path / "out" / "run.json").read_text())["held_up"]
    assert held_up.keys() == {"r2"} and held_up["r2"]["steps"] == 3
    assert 1.5 < held_up["r2"]["most_s"] < 3.5 and 4.5 < held_up["r2"]["total_s"] < 9.0
    sentence = r"r2 delayed 3 steps, by up to \d\.\d s, \d\.\d s in total\."
    assert re.search(rf"(?m)^{sentence}$", done.stdout)


@pytest.mark.parametrize("bus", [pytest.param("zenoh", marks=NIGHTLY), "memory"])
def test_a_strategy_that_exits_is_named_at_once(tmp_path: Path, bus: str) -> None:
    began = time.monotonic()
    if bus == "memory":
        assert failure(tmp_path / "soft", "exits", bus) == (
            f"r2 failed in step 20: its code called sys.exit(0) ({place('sys.exit(0)')})"
        )
    said = failure(tmp_path / "hard", "exits_hard", bus)
    if bus == "memory":
        line = place("os._exit(0)", after="exits_hard =")
        assert said == f"r2 failed in step 20: its code called os._exit(0) ({line})"
    else:
        log = tmp_path / "hard" / "r2" / "r2.log"
        assert said == (f"r2 ended with exit code 0 during the run, as by os._exit(0); log: {log}")
    assert time.monotonic() - began < 25  # not the 30 s of a silent actor


def test_a_stopped_world_is_waited_for(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    plan = swarm.plan(load_scenario(None, Overrides(robots=1, duration=20)), RunOptions(out))
    seen: list[int] = []

    def stop_the_world(progress: Progress) -> None:
        if not seen:
            seen.append(process_of(out, "world"))
            os.kill(seen[0], signal.SIGSTOP)
            threading.Timer(2.5, os.kill, (seen[0], signal.SIGCONT)).start()

    plan = replace(plan, timeout=Timeout(step_s=1.0))
    assert swarm.run_processes(plan, "forkserver", stop_the_world).simulated_s == 20.0
    assert "acrc: world stopped by a signal; the run waits for SIGCONT" in capfd.readouterr().err


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    done = in_process.acrc("run", "--out", tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr.strip() == f"acrc: --out: {tmp_path} already exists and is not empty; choose a new folder"
    )
    assert list(tmp_path.iterdir()) == [tmp_path / "mine.txt"]


@pytest.mark.nightly
def test_isolation_is_full_also_where_everything_lies_in_shared_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A robot's own /dev/shm is closed to it, but for its folder where that lies there."""
    with tempfile.TemporaryDirectory(prefix="acrc-test-", dir="/dev/shm") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        result = run(Path(folder) / "out", "--duration", 2, "--robots", 2)
        assert result["isolation"] == "full"
        assert leftovers(Path(folder)) == []


def test_a_world_that_cannot_begin_ends_the_run(tmp_path: Path) -> None:
    out = tmp_path / "out"
    plan = swarm.plan(load_scenario(None, Overrides(robots=1)), RunOptions(out))
    spoilt = replace(plan, world=replace_struct(plan.world, step_us=12_345))
    with pytest.raises(AcrcError) as caught:
        swarm.run_processes(spoilt, "forkserver", lambda progress: None)
    assert str(caught.value) == (
        "world ended with exit code 2: step_us is 12345 µs; must be a multiple of 10000 µs"
    )
    assert gone(out)
