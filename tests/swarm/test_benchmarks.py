"""Benchmarks of swarms: what they report, never how fast anything is; and the counted cost of a step."""

import cProfile
import json
import math
import signal
import subprocess
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import combinations, repeat
from multiprocessing import get_context
from pathlib import Path
from unittest.mock import Mock

import pytest

from actors.geometry import Pose, Twist
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from benchmarks.commands import spent
from benchmarks.swarm import benchmark, beside, budget, counts, profiles
from benchmarks.swarm.beside import PairedCase, ProjectState, other
from benchmarks.swarm.counts import CountedSteps, StepCounts
from benchmarks.swarm.over_mesh import Memory, MeshFigures
from benchmarks.swarm.profiles import Function
from benchmarks.swarm.runs import MemoryFigures, Range, SwarmTask, planned

KEPT = counts.kept_counts()
SMALL = StepCounts({"deeco": 60.0, "actors/world": 40.0}, {"a": 2.0}, {"a": 50.0}, {"world": 9.0}, {})


@pytest.mark.usefixtures("forked_servers")
def test_swarm_figures_are_consistent(capsys: pytest.CaptureFixture[str]) -> None:
    measured = benchmark.measure((4,), 3.0, repeat=1)
    assert json.dumps(measured.figures) and measured.holds is None
    (swarm,) = measured.figures["swarms"]
    mesh, memory, air = swarm["mesh"], swarm["memory"], swarm["traffic"]
    assert sum(memory["rooms"].values()) == pytest.approx(memory["ms"])
    assert {"actors/world", "deeco", "actors/runtime/recording"} <= memory["rooms"].keys()
    assert sum(mesh["by_actor"].values()) == pytest.approx(mesh["ms"]["median"])
    assert mesh["memory"]["robots"]["processes"] == 4
    for kind in mesh["memory"].values():
        assert 0 < kind["private_mb"] <= kind["pss_mb"] <= kind["rss_mb"]
    assert 0 < swarm["idle_memory_ms"] < memory["ms"]
    assert air["copies"] == pytest.approx(3 * air["frames"], rel=0.15), "at the three others"
    assert 0 < air["heard"] <= air["copies"] and 0 <= air["stale"] <= air["packets"]
    measured.show()
    printed = capsys.readouterr().out
    for title in ("chapter.toml, over Zenoh", "CPU by package", "processes:", "the air"):
        assert title in printed
    assert "goal, 4 robots: simulated seconds per second over Zenoh, at least 100:" in printed


def swarm_figures(
    robots: int, speed: float, ms: float = 5.0, memory_ms: float = 1.0, start_s: float = 6.0
) -> benchmark.SwarmFigures:
    mesh = Mock(spec=MeshFigures)
    mesh.real_time_factor, mesh.ms, mesh.startup_s = (Range.of([value]) for value in (speed, ms, start_s))
    mesh.memory = {"robots": Memory(robots, 0.0, 25.0 * robots, 0.0)}
    found = Mock(spec=benchmark.SwarmFigures, robots=robots, mesh=mesh)
    found.memory = Mock(spec=MemoryFigures, ms=memory_ms)
    return found


def test_goals_apply_to_the_sizes_that_were_measured() -> None:
    goals = benchmark.judged(
        [
            swarm_figures(4, 100.0, memory_ms=2.6),
            swarm_figures(20, 15.9),
            swarm_figures(100, 2.0, 6.6, memory_ms=5.0, start_s=6.1),
        ]
    )
    assert [(goal.words.partition(" robots: ")[0], goal.figure, goal.goal, goal.met) for goal in goals] == [
        ("4", 100.0, 100.0, True),
        ("20", 15.9, 16.0, False),
        ("100", 2.0, 2.0, True),
        ("4", pytest.approx(3846.2, abs=0.1), 4000.0, False),
        ("20", 10_000.0, 3180.0, True),
        ("100", 2000.0, 2000.0, True),
        ("100", pytest.approx(1.32), 1.3, False),
        ("100", 6.1, 6.0, False),
        ("100", 25.0, 25.0, True),
    ]
    assert benchmark.judged([Mock(spec=benchmark.SwarmFigures, robots=200, mesh=None)]) == []


def test_simulated_time_shrinks_with_the_number_of_robots() -> None:
    task = SwarmTask()
    assert [task.simulated_s(robots) for robots in (1, 4, 20, 50, 100, 500)] == [60, 60, 40, 16, 8, 2]
    assert SwarmTask(seconds=90.0, robot_seconds=None).simulated_s(500) == 90.0


def test_more_robots_than_the_scenario_has_room_for_start_closer() -> None:
    with planned(150, SwarmTask(seconds=1.0), "zenoh") as plan:
        places = [robot.start[:2] for robot in plan.world.robots]
    assert len(places) == 150
    assert min(math.dist(one, other) for one, other in combinations(places, 2)) >= 0.42 - 1e-9


@pytest.mark.skipif(KEPT is None, reason=f"{counts.TABLE.name} is for another version of Python")
def test_a_step_costs_what_the_kept_counts_say() -> None:
    with ProcessPoolExecutor(
        1, get_context("forkserver")
    ) as pool:  # other tests may have changed this process
        found = pool.submit(counts.counted, CountedSteps()).result()
    assert KEPT is not None
    assert list(counts.differences(found, KEPT)) == []


def test_differences_name_the_packages_that_changed_most() -> None:
    more = replace(SMALL, calls={"deeco": 58.9, "actors/world": 42.0, "actors": 2.0}, sent={"a": 50.9})
    (sentence,) = counts.differences(more, SMALL)
    assert (
        "102.9 Python calls" in sentence
        and "(+2.9%): actors/world +2.0, actors +2.0, deeco -1.1;" in sentence
    )
    (sentence,) = counts.differences(replace(SMALL, messages={"a": 1.9}), SMALL)
    assert "1.9 messages" in sentence and "(-5.0%): a -0.1;" in sentence


def test_kept_counts_are_written_and_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counts, "TABLE", tmp_path / "python3.11.toml")
    assert counts.kept_counts() is None
    counts.TABLE.write_text(counts.written(replace(SMALL, functions={"len": 9.0})))
    assert counts.kept_counts() == SMALL


def test_calls_outside_the_project_count_for_their_callers() -> None:
    ours: Function = (f"{REPOSITORY}/deeco/node.py", 1, "f")
    theirs: Function = (f"{REPOSITORY}/actors/world/core.py", 1, "g")
    package: Function = (f"{REPOSITORY}/.venv/lib/p.py", 1, "h")
    built_in: Function = ("~", 0, "<built-in len>")
    lost: Function = ("~", 0, "<lost>")
    found = profiles.by_room(
        {
            ours: (5, {}),
            theirs: (7, {}),
            package: (4, {ours: 3, theirs: 1}),
            built_in: (10, {package: 8, ours: 2}),
            lost: (1, {}),
        }
    )
    assert found == {"deeco": 5 + 3 + 2 + 6, "actors/world": 7 + 1 + 2, profiles.NO_ROOM: 1}


def test_functions_with_one_label_are_summed() -> None:
    profile = cProfile.Profile()
    profile.runcall(lambda: [(Pose(1.0, 2.0, 3.0), Twist(1.0, 2.0, 3.0)) for _ in range(10)])
    called = profiles.entries(profile)
    assert [times for (file, _, name), (times, _) in called.items() if file == "<string>"] == [20]
    rooms = profiles.by_room(called)
    assert sum(rooms.values()) == pytest.approx(sum(times for times, _ in called.values()))


def test_blocks_are_counted_only_inside_the_context() -> None:
    with profiles.counted_blocks() as count:
        before = count.blocks
        kept = [object() for _ in repeat(None, 5000)]
        assert 5000 <= count.blocks - before < 5100
    after = count.blocks
    kept += [object() for _ in repeat(None, 5000)]
    assert count.blocks == after


def test_the_table_of_strace_is_read() -> None:
    rule = "-------------- ---------\n"
    text = (
        f"syscall          calls\n{rule}futex              120\nread                 3\n{rule}total    123\n"
    )
    assert counts.read_calls(text) == {"futex": 120.0, "read": 3.0}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"bus": "tcp"}, "--bus: tcp; must be zenoh or memory"),
        ({"duration": 2.0}, "--duration: 2; must be at least 3 for budget"),
        ({"duration": 30.0, "write": True}, "--write: keeps counts in memory"),
    ],
)
def test_wrong_options_of_the_budget_are_refused(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(OptionError, match=sentence):
        budget.measure(**options)  # type: ignore[arg-type]


ACRC = """#!/bin/sh
echo "@NAME@ $3 $4 $5 $6 PYTHONPATH=$PYTHONPATH NUMBA_CACHE_DIR=$NUMBA_CACHE_DIR" >>@LOG@
mkdir -p .venv/bin
printf '#!/bin/sh\\necho Python @VERSION@\\n' >.venv/bin/python
chmod +x .venv/bin/python
echo '{"digest": "@DIGEST@", "wall_s": @WALL@}'
"""
"""A stand-in for `acrc` that logs its options and reports a fixed result."""


def clone(folder: Path, name: str, wall: float, version: str = "3.11.7", digest: str = "d") -> Path:
    folder.mkdir()
    log = folder.parent / "log"
    words = {"NAME": name, "LOG": str(log), "WALL": str(wall), "VERSION": version, "DIGEST": digest}
    text = ACRC
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    (folder / "acrc").write_text(text)
    (folder / "acrc").chmod(0o755)
    (folder / "scenarios").mkdir()
    (folder / "scenarios" / "chapter.toml").write_text('[run]\nseed = 1\nstrategy = "chapter"\n')
    return folder


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = clone(tmp_path / "mine", "mine", 1.0)
    monkeypatch.setattr(beside, "clone", lambda command: folder)
    monkeypatch.setattr(beside, "REPOSITORY", folder)
    return folder


@pytest.mark.usefixtures("mine")
def test_states_run_in_alternating_order(tmp_path: Path) -> None:
    theirs = clone(tmp_path / "theirs", "theirs", 1.5)
    found = beside.measure(str(theirs), robots=(4, 20), bus="memory", pairs=3)
    lines = (tmp_path / "log").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [
        *("mine", "theirs"),
        *("mine", "theirs", "theirs", "mine", "mine", "theirs") * 2,
    ]
    assert lines[0] == "mine --robots 4 --duration 2 PYTHONPATH= NUMBA_CACHE_DIR="
    assert {line.split()[4] for line in lines[2:8]} == {"120"}
    few, many = found.figures["cases"]
    assert found.figures["unlike"] == [] and few["digests_equal"] and many["robots"] == 20
    assert few["times_as_fast"]["wall_s"] == {name: pytest.approx(1.5) for name in ("value", "low", "high")}
    assert found.shown[1] == "digests: equal"


def test_differences_of_the_states_are_named(mine: Path, tmp_path: Path) -> None:
    theirs = clone(tmp_path / "theirs", "theirs", 1.5, "3.13.1", "e")
    (theirs / "scenarios" / "chapter.toml").write_text('[run]\nseed = 2\nstrategy = "none"\n')
    found = beside.measure(str(theirs), robots=(4,), bus="memory", pairs=2)
    assert found.shown[1:] == [
        "digests: different, so the two do different work",
        "Python: Python 3.11.7 here, Python 3.13.1 there; times do not compare",
        "scenario chapter: differs; --scenario FILE has both run the same one",
    ]
    chapter = mine / "scenarios" / "chapter.toml"
    again = beside.measure(str(theirs), robots=(4,), bus="memory", pairs=2, seed=7, scenario=chapter)
    assert len(again.figures["unlike"]) == 1


@pytest.fixture
def committed(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    git(mine, "init", "-q")
    git(mine, "add", ".")
    git(mine, "commit", "-q", "-m", "initial")
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    return mine


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=Ada", "-c", "user.email=ada@example.org")
    done = subprocess.run(["git", *who, *words], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_commit_runs_in_a_worktree_that_is_removed(committed: Path, tmp_path: Path) -> None:
    with other("HEAD") as there:
        assert there.name == "HEAD" and there.folder != committed
        assert there.run(PairedCase(2, 1.0, "memory")).wall_s == 1.0
        assert there.properties()["Python"] == "Python 3.11.7"
    (committed / "acrc").write_text("#!/bin/sh\necho 'acrc: no disk' >&2\nexit 1\n")
    git(committed, "commit", "-q", "-a", "-m", "fails")
    with pytest.raises(AcrcError, match=" fails: acrc: no disk"), other("HEAD") as there:
        there.run(PairedCase(2, 1.0, "memory"))
    git(committed, "rm", "-q", "acrc")
    git(committed, "commit", "-q", "-m", "none")
    for what, sentence in (
        ("deadbeef", "COMMIT: deadbeef; must be a commit of this repository"),
        ("--force", "COMMIT: --force; must be a commit of this repository"),
        (str(tmp_path), "must be a clone, which has a file acrc"),
        ("HEAD", "COMMIT: HEAD; must be one that has a file acrc"),
    ):
        with pytest.raises(OptionError, match=sentence), other(what):
            pass
    assert not list((tmp_path / "scratch").iterdir()) and "\n" not in git(committed, "worktree", "list")


def test_an_interrupted_command_ends_its_children(tmp_path: Path) -> None:
    def end(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        with pytest.raises(KeyboardInterrupt):
            spent(["sh", "-c", f"sleep 60 & echo $! >{tmp_path}/pid; wait"])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    words = Path("/proc") / (tmp_path / "pid").read_text().strip() / "cmdline"
    until = time.monotonic() + 20.0
    while words.exists() and words.read_bytes() and time.monotonic() < until:  # a zombie has no command line
        time.sleep(0.05)
    assert not words.exists() or not words.read_bytes()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "COMMIT: is missing; must be as in acrc bench beside HEAD~1"),
        ({"commit": "HEAD", "bus": "tcp"}, "--bus: tcp; must be zenoh or memory"),
        ({"commit": "HEAD", "scenario": Path("none.toml")}, "--scenario: none.toml; must be a file"),
        ({"commit": "HEAD", "navigation": "better"}, "--navigation: better; must be chapter or robust"),
    ],
)
def test_wrong_options_of_beside_are_refused(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(OptionError, match=sentence):
        beside.measure(**options)  # type: ignore[arg-type]


def test_an_answer_without_a_result_is_an_error(mine: Path) -> None:
    (mine / "acrc").write_text("#!/bin/sh\necho '{}'\n")
    with pytest.raises(AcrcError, match="no result"):
        ProjectState("here", mine).run(PairedCase(2, 1.0, "memory"))
