"""That a robot's step costs what the table keeps, and that what is counted is what it is said to be."""

import cProfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import pytest

from actors.geometry import Pose, Twist
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from benchmarks.swarm.counted import calls, command, over_mesh, table
from benchmarks.swarm.counted.blocks import counted_blocks
from benchmarks.swarm.counted.calls import Function
from benchmarks.swarm.counted.in_memory import StepCounts, counted
from benchmarks.swarm.counted.steps import CountedSteps

KEPT = table.read()
SMALL = StepCounts({"deeco": 60.0, "actors/world": 40.0}, {"a": 2.0}, {"a": 50.0}, {"world": 9.0}, {})


@pytest.mark.skipif(KEPT is None, reason=f"no {table.TABLE.name}: another Python calls other functions")
def test_a_step_costs_what_the_table_keeps() -> None:
    with ProcessPoolExecutor(1, get_context("forkserver")) as pool:  # whatever other tests have left here
        counts = pool.submit(counted, CountedSteps()).result()
    assert KEPT is not None
    assert list(table.differences(counts, KEPT)) == []


def test_what_has_grown_is_named() -> None:
    more = replace(SMALL, calls={"deeco": 58.9, "actors/world": 42.0, "actors": 2.0}, sent={"a": 50.9})
    assert list(table.differences(more, SMALL)) == [
        f"a robot-step has 102.9 Python calls, {table.TABLE.name} keeps 100.0 (+2.9%): actors/world +2.0, "
        "actors +2.0, deeco -1.1; if that is meant, `acrc bench budget --write` keeps it, and the commit "
        "says why"
    ]
    assert list(table.differences(replace(SMALL, messages={"a": 1.9}), SMALL)) == [
        f"a robot-step has 1.9 messages, {table.TABLE.name} keeps 2.0 (-5.0%): a -0.1; if that is meant, "
        "`acrc bench budget --write` keeps it, and the commit says why"
    ]


def test_what_is_written_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "TABLE", tmp_path / "python3.11.toml")
    assert table.read() is None
    table.TABLE.write_text(table.written(replace(SMALL, functions={"len": 9.0})))
    assert table.read() == SMALL


def test_what_is_no_rooms_counts_for_those_who_call_it() -> None:
    ours: Function = (f"{REPOSITORY}/deeco/node.py", 1, "f")
    theirs: Function = (f"{REPOSITORY}/actors/world/core.py", 1, "g")
    package: Function = (f"{REPOSITORY}/.venv/lib/p.py", 1, "h")
    built_in: Function = ("~", 0, "<built-in len>")
    lost: Function = ("~", 0, "<lost>")
    found = calls.by_room(
        {
            ours: (5, {}),
            theirs: (7, {}),
            package: (4, {ours: 3, theirs: 1}),
            built_in: (10, {package: 8, ours: 2}),
            lost: (1, {}),
        }
    )
    assert found == {"deeco": 5 + 3 + 2 + 6, "actors/world": 7 + 1 + 2, calls.NOBODY: 1}


def test_makers_of_all_named_tuples_count() -> None:
    """They have one name, and `pstats` would keep one of them."""
    profile = cProfile.Profile()
    profile.runcall(lambda: [(Pose(1.0, 2.0, 3.0), Twist(1.0, 2.0, 3.0)) for _ in range(10)])
    made = [times for (file, _, name), (times, _) in calls.entries(profile).items() if file == "<string>"]
    assert made == [20]


def test_every_call_of_a_profile_is_in_a_room() -> None:
    profile = cProfile.Profile()
    profile.runcall(table.written, SMALL)
    called = calls.entries(profile)
    rooms = calls.by_room(called)
    assert rooms["benchmarks/swarm/counted"] > 10 and rooms["deploy/scenario"] > 10
    assert sum(rooms.values()) == pytest.approx(sum(times for times, _ in called.values()))
    names = {calls.name_of(function) for function in called}
    assert {"benchmarks/swarm/counted/table.py: written", "built-in method builtins.round"} <= names


def test_every_block_is_counted_while_it_is_asked_for() -> None:
    with counted_blocks() as count:
        before = count.blocks
        kept = [object() for _ in repeat(None, 5000)]
        assert 5000 <= count.blocks - before < 5100
    after = count.blocks
    kept += [object() for _ in repeat(None, 5000)]
    assert count.blocks == after


def test_the_table_of_strace_is_read() -> None:
    text = (
        "syscall          calls\n-------------- ---------\nfutex              120\nread                 3\n"
    )
    text += "-------------- ---------\ntotal              123\n"
    assert over_mesh.read_calls(text) == {"futex": 120.0, "read": 3.0}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"bus": "tcp"}, "--bus: tcp; must be zenoh or memory"),
        ({"duration": 2.0}, "--duration: 2; must be at least 3 for budget"),
        (
            {"duration": 30.0, "write": True},
            "--write: keeps counts in memory as a test repeats them; cannot be combined with --bus zenoh or "
            "--duration",
        ),
    ],
)
def test_what_cannot_be_counted_is_said(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(OptionError) as caught:
        command.measure(**options)  # type: ignore[arg-type]
    assert str(caught.value) == sentence
