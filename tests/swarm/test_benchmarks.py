"""Reports of swarm benchmarks, and the counted cost of a step; no test depends on speed."""

import json
import math
import subprocess
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from acrc_testbed.benchmarks import budget, commit_comparison
from acrc_testbed.benchmarks import swarm_runs as runs
from acrc_testbed.benchmarks import swarm_speed as benchmark
from acrc_testbed.benchmarks.budget import CountedSteps, StepCounts
from acrc_testbed.benchmarks.commit_comparison import PairedCase, open_state
from acrc_testbed.benchmarks.swarm_runs import (
    Function,
    MemoryFigures,
    MemoryUsage,
    MeshFigures,
    Range,
    SwarmTask,
    plan_run,
)
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError

SAVED_FIELDS = budget.saved_counts()
SMALL = StepCounts({"deeco": 60.0, "actors/world": 40.0}, {"a": 2.0}, {"a": 50.0}, {"world": 9.0}, {})


@pytest.mark.nightly
@pytest.mark.usefixtures("forked_servers")
def test_swarm_figures_are_consistent(capsys: pytest.CaptureFixture[str]) -> None:
    measured = benchmark.measure((4,), 3.0, repeat=1)
    assert json.dumps(measured.figures) and measured.holds is None
    (swarm,) = measured.figures["swarms"]
    mesh, memory, air = swarm["mesh"], swarm["memory"], swarm["traffic"]
    assert sum(memory["packages"].values()) == pytest.approx(memory["ms"])
    assert {"actors/world", "deeco", "actors/runtime/recording"} <= memory["packages"].keys()
    assert sum(mesh["by_actor"].values()) == pytest.approx(mesh["ms"]["median"])
    assert mesh["memory"]["robots"]["processes"] == 4
    for kind in mesh["memory"].values():
        assert 0 < kind["private_mb"] <= kind["pss_mb"] <= kind["rss_mb"]
    assert 0 < swarm["idle_memory_ms"] < memory["ms"]
    assert air["copies"] == pytest.approx(3 * air["frames"], rel=0.15), "at the three others"
    assert 0 < air["heard"] <= air["copies"] and 0 <= air["stale"] <= air["packets"]
    measured.report(json_output=False)
    printed = capsys.readouterr().out
    for title in ("chapter.toml, over Zenoh", "CPU by package", "processes:", "radio traffic"):
        assert title in printed
    assert "goal, 4 robots: simulated seconds per second over Zenoh, at least 100:" in printed


def swarm_figures(
    robots: int, speed: float, ms: float = 5.0, memory_ms: float = 1.0, start_s: float = 6.0
) -> benchmark.SwarmFigures:
    mesh = Mock(spec=MeshFigures)
    mesh.real_time_factor, mesh.ms, mesh.startup_s = (Range.of([value]) for value in (speed, ms, start_s))
    mesh.memory = {"robots": MemoryUsage(robots, 0.0, 25.0 * robots, 0.0)}
    found = Mock(spec=benchmark.SwarmFigures, robots=robots, mesh=mesh)
    found.memory = Mock(spec=MemoryFigures, ms=memory_ms)
    return found


def test_goals_apply_to_the_sizes_that_were_measured() -> None:
    goals = benchmark.speed_goals(
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
    assert benchmark.speed_goals([Mock(spec=benchmark.SwarmFigures, robots=200, mesh=None)]) == []


def test_many_robots_start_closer_and_for_less_time() -> None:
    with plan_run(150, SwarmTask(seconds=1.0), "zenoh") as plan:
        places = [robot.start[:2] for robot in plan.world.robots]
    assert [SwarmTask().simulated_s(robots) for robots in (1, 20, 50, 500)] == [60, 40, 16, 2]
    assert len(places) == 150
    assert min(math.dist(one, other) for one, other in combinations(places, 2)) >= 0.42 - 1e-9


@pytest.mark.skipif(SAVED_FIELDS is None, reason=f"{budget.TABLE.name} is for another version of Python")
def test_a_step_costs_the_saved_counts() -> None:
    with ProcessPoolExecutor(
        1, get_context("forkserver")
    ) as pool:  # other tests may have changed this process
        found = pool.submit(budget.count_steps, CountedSteps()).result()
    assert SAVED_FIELDS is not None
    assert list(budget.differences(found, SAVED_FIELDS)) == []


def test_differences_name_the_packages_that_changed_most() -> None:
    more = replace(SMALL, calls={"deeco": 58.9, "actors/world": 42.0, "actors": 2.0}, sent={"a": 50.9})
    (sentence,) = budget.differences(more, SMALL)
    assert (
        "102.9 Python calls" in sentence
        and "(+2.9%): actors/world +2.0, actors +2.0, deeco -1.1;" in sentence
    )
    (sentence,) = budget.differences(replace(SMALL, messages={"a": 1.9}), SMALL)
    assert "1.9 messages" in sentence and "(-5.0%): a -0.1;" in sentence


def test_saved_counts_are_written_and_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "TABLE", tmp_path / "python3.11.toml")
    assert budget.saved_counts() is None
    budget.TABLE.write_text(budget.counts_text(replace(SMALL, functions={"len": 9.0})))
    assert budget.saved_counts() == SMALL


def test_calls_outside_the_project_count_for_their_callers() -> None:
    ours: Function = (f"{REPOSITORY}/deeco/node.py", 1, "f")
    theirs: Function = (f"{REPOSITORY}/actors/world/core.py", 1, "g")
    package: Function = (f"{REPOSITORY}/.venv/lib/p.py", 1, "h")
    built_in: Function = ("~", 0, "<built-in len>")
    lost: Function = ("~", 0, "<lost>")
    found = runs.sum_by_package(
        {
            ours: (5, {}),
            theirs: (7, {}),
            package: (4, {ours: 3, theirs: 1}),
            built_in: (10, {package: 8, ours: 2}),
            lost: (1, {}),
        }
    )
    assert found == {"deeco": 5 + 3 + 2 + 6, "actors/world": 7 + 1 + 2, runs.NO_PACKAGE: 1}


ACRC = """#!/bin/sh
echo "@NAME@ $3 $4 $5 $6 PYTHONPATH=$PYTHONPATH NUMBA_CACHE_DIR=$NUMBA_CACHE_DIR" >>@LOG@
if [ ! -x .venv/bin/python ]; then
    mkdir -p .venv/bin
    printf '#!/bin/sh\\necho Python @VERSION@\\n' >.venv/bin/python
    chmod +x .venv/bin/python
fi
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
    monkeypatch.setattr(commit_comparison, "clone", lambda command: folder)
    monkeypatch.setattr(commit_comparison, "REPOSITORY", folder)
    return folder


@pytest.mark.usefixtures("mine")
def test_states_run_in_alternating_order(tmp_path: Path) -> None:
    theirs = clone(tmp_path / "theirs", "theirs", 1.5)
    found = commit_comparison.measure(str(theirs), robots=(4, 20), bus="memory", pairs=3)
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
    clone(tmp_path / "other", "other", 1.5, "3.13.1", "e")
    (tmp_path / "other" / "scenarios" / "chapter.toml").write_text("[run]\nseed = 2\n")
    found = commit_comparison.measure(str(tmp_path / "other"), robots=(4,), bus="memory", pairs=2)
    assert found.shown[1:] == [
        "digests: different: the two states do different work",
        "Python: Python 3.11.7 here, Python 3.13.1 there; times are not comparable",
        "scenario chapter: differs; use --scenario FILE to run the same one in both",
    ]


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
    with open_state("HEAD") as there:
        assert there.name == "HEAD" and there.folder != committed
        assert there.run(PairedCase(2, 1.0, "memory")).wall_s == 1.0
        assert there.properties()["Python"] == "Python 3.11.7"
    (committed / "acrc").write_text("#!/bin/sh\necho 'acrc: no disk' >&2\nexit 1\n")
    git(committed, "commit", "-q", "-a", "-m", "fails")
    with pytest.raises(AcrcError, match=" fails: acrc: no disk"), open_state("HEAD") as there:
        there.run(PairedCase(2, 1.0, "memory"))
    git(committed, "rm", "-q", "acrc")
    git(committed, "commit", "-q", "-m", "none")
    for what, sentence in (
        ("deadbeef", "COMMIT: deadbeef; must be a commit of this repository"),
        ("--force", "COMMIT: --force; must be a commit of this repository"),
        (str(tmp_path), "must be a clone, which contains a file acrc"),
        ("HEAD", "COMMIT: HEAD; must be a commit that contains a file acrc"),
    ):
        with pytest.raises(OptionError, match=sentence), open_state(what):
            pass
    assert not list((tmp_path / "scratch").iterdir()) and "\n" not in git(committed, "worktree", "list")


@pytest.mark.parametrize(
    ("measure", "options", "sentence"),
    [
        (budget.measure, {"bus": "tcp"}, "--bus: tcp; must be zenoh or memory"),
        (budget.measure, {"duration": 2.0}, "--duration: 2; must be at least 3 for budget"),
        (budget.measure, {"duration": 30.0, "write": True}, "--write: cannot be combined with"),
        (commit_comparison.measure, {}, "COMMIT: missing; example: acrc bench beside HEAD~1"),
        (
            commit_comparison.measure,
            {"commit": "HEAD", "scenario": Path("none.toml")},
            "--scenario: none.toml; must be",
        ),
        (
            commit_comparison.measure,
            {"commit": "HEAD", "navigation": "better"},
            "--navigation: better; must be chapter",
        ),
    ],
)
def test_wrong_options_are_refused(measure: Any, options: dict[str, object], sentence: str) -> None:
    with pytest.raises(OptionError, match=sentence):
        measure(**options)
