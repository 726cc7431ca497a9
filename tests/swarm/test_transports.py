"""One scenario and seed give one digest, over every transport and way of starting processes."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest

from acrc_testbed.recordings.record_replay import recheck, replay_actor
from acrc_testbed.results.result import RunResult
from actors.runtime.isolation.sandbox import isolation_fault
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests import in_process
from tests.swarm.command import ROOT, acrc, leftovers, processes_of, run

CROWD = Path(__file__).parent / "crowd.toml"
SHORT_S = 5.0
"""Simulated duration, s; sufficient, since a digest covers all messages."""
SAME = ("digest", "task", "contacts", "frames", "deeco", "per_robot")
"""Keys of a result that do not depend on the transport."""
EVENTS = """
[[event]]
at = 4.0
jam = [14.5, 11.0]
radius = 4.0
duration = 2.0
[[event]]
at = 4.0
kill = "r8"
[[event]]
at = 6.0
restart = "r8"
[[event]]
at = 6.5
freeze = "r2"
[[event]]
at = 8.0
thaw = "r2"
"""
"""Events of the crowd scenario in quick succession."""
ADVERSARIES = "".join(
    f'[[robot]]\nid = "{robot}"\nadversary = "{kind}"\n'
    for robot, kind in (("r13", "flooder"), ("r14", "replayer"), ("r15", "liar"), ("r16", "forger"))
)
PEOPLE = """
[people]
count = 6
"""
RESTART = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 8.0
strategy = "chapter"
[robots]
count = 2
battery = 0.001
[deeco]
key = "00112233445566778899aabbccddeeff"
[[event]]
at = 3.0
kill = "r2"
[[event]]
at = 5.0
restart = "r2"
"""


class Run(NamedTuple):
    out: Path
    result: dict[str, Any]


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The crowd scenario of 11 s with adversaries, people and events, and its result in memory."""
    folder = tmp_path_factory.mktemp("eventful")
    crowd = CROWD.read_text().partition("[[event]]")[0]
    for old, new in (
        ("duration = 65.0", "duration = 11.0"),
        ("../../maps", f"{ROOT}/maps"),
        ("blind.toml", f"{CROWD.parent}/blind.toml"),
    ):
        assert old in crowd
        crowd = crowd.replace(old, new)
    return in_memory(folder, crowd + ADVERSARIES + EVENTS + PEOPLE)


@pytest.fixture(scope="module")
def restarted(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return in_memory(tmp_path_factory.mktemp("restart"), RESTART)


def in_memory(folder: Path, text: str) -> Run:
    scenario = folder / "scenario.toml"
    scenario.write_text(text)
    done = in_process.acrc("run", scenario, "--bus", "memory", "--json", "--out", folder / "memory")
    assert done.returncode == 0, done.stderr
    return Run(scenario, json.loads(done.stdout))


@pytest.fixture(scope="module")
def recorded(eventful: Run, tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("zenoh") / "out"
    return Run(out, run(out, eventful.out, "--isolate"))


def check_one_digest(reference: dict[str, object], made: Run) -> None:
    result = made.result
    assert result["undelivered"] == result["unread"] == 0
    assert {key: result[key] for key in SAME} == {key: reference[key] for key in SAME}
    assert processes_of(made.out) == [] and leftovers(made.out) == []


def test_all_its_events_have_effects(eventful: Run) -> None:
    frames = eventful.result["frames"]
    assert frames["copies_lost_disturbed"] > 0 and frames["copies_lost_collision"] > 0
    assert eventful.result["contacts"] > 40 and eventful.result["deeco"]["counters"]["relayed"] > 100


def test_one_digest_with_isolated_robots(eventful: Run, recorded: Run) -> None:
    assert recorded.result["isolation"] == "full"
    assert recorded.result["people_contacts"] == eventful.result["people_contacts"]
    check_one_digest(eventful.result, recorded)


@pytest.mark.nightly
def test_one_digest_with_a_view_and_at_a_limited_speed(eventful: Run, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="`./acrc run --view` installs rerun")
    scenario, reference = eventful
    out = tmp_path / "out"
    check_one_digest(reference, made := Run(out, run(out, scenario, "--view", "--speed", "4")))
    assert made.result["wall_s"] >= 2.7  # 11 s less the last step, at four times


def test_one_digest_with_a_new_interpreter_per_process(restarted: Run, tmp_path: Path) -> None:
    scenario, reference = restarted
    out = tmp_path / "out"
    check_one_digest(reference, Run(out, run(out, scenario, "--spawn", "exec", "--isolate")))
    assert (out / "r2" / "r2.1.mcap").is_file()
    assert replay_actor(out, "r1").outputs > 50, "with the key of the recording"


def test_another_seed_step_or_strategy_gives_another_digest(tmp_path: Path) -> None:
    changes = (Overrides(seed=6), Overrides(step=50), Overrides(strategy="none"))
    first, again, *others = [
        short_digest(change, tmp_path / str(number))
        for number, change in enumerate((Overrides(), Overrides(), *changes))
    ]
    assert first == again
    assert len({first, *others}) == 1 + len(changes)


def short_digest(overrides: Overrides, out: Path) -> str:
    """Return the digest of the crowd's first seconds in memory, without its events."""
    crowd = load_scenario(CROWD, overrides)
    short = msgspec.structs.replace(crowd, run=msgspec.structs.replace(crowd.run, duration=SHORT_S), event=())
    plan = swarm.plan(short, RunOptions(out, bus="memory"))
    result = swarm.run_in_memory(plan, lambda progress: None)
    assert result.simulated_s == SHORT_S
    return result.digest


def test_recordings_give_the_digest_and_every_actor_can_be_replayed(eventful: Run, recorded: Run) -> None:
    done = in_process.acrc("record", "check", recorded.out)
    assert done.returncode == 0 and str(eventful.result["digest"]) in done.stdout
    for actor in ("world", "radio", "r1", "r16"):
        assert replay_actor(recorded.out, actor).outputs > 100
    done = in_process.acrc("replay", recorded.out, "--robot", "r8.1")
    assert re.fullmatch(r"r8\.1: matches the recording: \d+ outputs\n", done.stdout), done.stderr


TRANSPORTS: dict[str, dict[str, Any]] = {
    "forked": {"isolate": False},
    "isolated": {"isolate": True},
    "executed": {"spawn": "exec", "isolate": False},
    "timed": {"speed": "20", "isolate": False},
}


def chapter(out: Path, full: bool, **options: Any) -> RunResult:
    """Run four robots of the chapter for 120 s, or two for 3 s."""
    overrides = Overrides(duration=120.0) if full else Overrides(robots=2, duration=3.0)
    scenario = load_scenario(ROOT / "scenarios" / "chapter.toml", overrides)
    return swarm.run(scenario, RunOptions(out, json=True, **options))


@pytest.fixture(scope="module")
def digest(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    full = bool(request.config.getoption("--full"))
    return chapter(tmp_path_factory.mktemp("memory") / "out", full, bus="memory").digest


@pytest.mark.claim("same-bits")
@pytest.mark.nightly  # the suite compares the longer runs above
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_processes_have_the_digest_of_the_run_in_memory(
    transport: str, digest: str, full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    if transport == "isolated" and (reason := isolation_fault()) is not None:
        pytest.skip(reason)
    result = chapter(tmp_path / "out", full, **TRANSPORTS[transport])
    assert (result.digest, result.undelivered) == (digest, 0)
    if transport == "isolated":
        replayed = recheck(tmp_path / "out").outputs  # raises if a replayed message differs
        record_property("messages replayed equal", replayed)
        assert replayed > 0


@contextmanager
def busy(processes: int) -> Iterator[None]:
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


@pytest.mark.claim("crowded-start")
@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_many_robots_start_on_a_busy_computer(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    robots, hogs = (100, 4) if full else (4, 1)
    digests = set()
    for name, words, each_core in (
        ("memory", ("--bus", "memory"), 0),
        ("processes", (), 0),
        ("busy", (), hogs),  # names are folders of sockets, whose paths are limited to 107 bytes
    ):
        began = time.monotonic()
        with busy(each_core * (os.cpu_count() or 1)):
            folder = ("--out", tmp_path / name, "--json")
            done = acrc("run", "--robots", robots, "--duration", 2, *words, *folder, timeout_s=1800.0)
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)
        record_property(f"{name}: whole run, s", round(time.monotonic() - began, 1))
        assert result["undelivered"] == 0
        digests.add(result["digest"])
    assert len(digests) == 1
