"""Introspection of robots: equal over every bus, replayed exactly, not part of the digest."""

import random
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from acrc_testbed.recordings.record_replay import replay_actor
from acrc_testbed.results.result import RunResult
from actors.installation.usage import OptionError
from actors.instant import Instant
from actors.introspection import Introspection
from actors.messages import INTROSPECTION
from actors.processes.launcher import create_launcher
from actors.robot.introspector import Introspector
from actors.runtime.codec import decode
from actors.runtime.process_setup import RecordDetail
from actors.runtime.recording import LARGEST_RECORD, Entry, read_recording
from deeco.knowledge import Knowledge
from deeco.local import Commit
from deploy.run import swarm
from deploy.run.options import RunOptions, check_options
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.recorded_runs import HEAD_ON

_MOST_BYTES = 400
"""Mean size of introspection per robot and step, without record headers."""


def run(out: Path, record: RecordDetail, bus: str) -> RunResult:
    scenario = load_scenario(HEAD_ON, Overrides(duration=3.0))
    options = RunOptions(out, bus=bus, record=record)
    if bus == "memory":
        return swarm.run_in_memory(swarm.plan(scenario, options), lambda progress: None)
    with create_launcher("forkserver") as launched:
        return swarm.run(scenario, options, launched)


def introspection(path: Path) -> list[Entry]:
    return [
        one
        for one in read_recording(path)
        if isinstance(one, Entry) and one.key == INTROSPECTION.key(path.stem)
    ]


def test_introspection_has_no_side_effects_and_is_equal_over_the_mesh(
    short_run: Path, tmp_path: Path
) -> None:
    lean, mesh = run(tmp_path / "lean", "lean", "memory"), run(tmp_path / "mesh", "full", "zenoh")
    assert lean.digest == mesh.digest
    assert not introspection(tmp_path / "lean" / "r1" / "r1.mcap")
    for robot in ("r1", "r2"):
        full = introspection(short_run / robot / f"{robot}.mcap")
        assert full == introspection(tmp_path / "mesh" / robot / f"{robot}.mcap")
    for out in (short_run, tmp_path / "lean"):
        assert replay_actor(out, "r1").whole


def test_a_robot_records_its_estimate_plan_window_and_decisions(recorded_run: Path) -> None:
    entries = introspection(recorded_run / "r1" / "r1.mcap")
    told = [decode(INTROSPECTION, one.key, one.payload or b"") for one in entries]  # type: ignore[arg-type]
    found = [one for one in told if isinstance(one, Introspection)]
    samples = [one.sample for one in found if one.sample is not None]
    assert [one.step for one in found if one.sample is not None] == list(range(0, 300, 5))
    assert any(one.particles for one in samples)
    assert any(one.plan for one in samples)
    assert any(one.window is not None and one.window.marked for one in samples)
    steps = [step for one in found for step in one.steps]
    assert [step.step for step in steps] == sorted({step.step for step in steps})
    assert any(commit.decision is not None for step in steps for commit in step.commits)
    assert {"driving", "planning"} <= {step.activity.activity for step in steps if step.activity is not None}
    assert sum(len(one.payload or b"") for one in entries) <= _MOST_BYTES * 300


@pytest.mark.parametrize("seed", range(5))
def test_a_truncated_recording_has_the_introspection_before_the_end(
    short_run: Path, tmp_path: Path, seed: int
) -> None:
    path, whole = short_run / "r1" / "r1.mcap", introspection(short_run / "r1" / "r1.mcap")
    data = path.read_bytes()
    cut = tmp_path / "r1.mcap"
    cut.write_bytes(data[: random.Random(seed).randrange(len(data))])
    found = introspection(cut)
    assert found == whole[: len(found)]


@dataclass(frozen=True)
class LargeKnowledge(Knowledge):
    id: str
    texts: tuple[str, ...] = ()
    table: Mapping[str, str] = field(default_factory=dict)


def test_knowledge_of_any_size_stays_within_a_record() -> None:
    navigation: Any = SimpleNamespace(local_planner=None, goal=None)
    introspector = Introspector("r1", cast(Any, None), navigation)
    kept = LargeKnowledge(id="r1")
    for number in range(12_000):
        text = chr(ord("a") + number % 26) * 15_000
        new = replace(kept, texts=(text,), table={f"{number}-{key}": text for key in range(3)})
        introspector.committed(
            Commit("LargeKnowledge.hoard", Instant(number), kept, new, adaptation=False), None
        )
        kept = new
    introspector._instant = Instant(-1)
    assert introspector.end(0, cast(Any, None)) is None
    told = introspector.rest(1)
    assert told is not None
    ((*_, commits),) = map(msgspec.structs.astuple, told.steps)
    size = len(msgspec.msgpack.encode(commits))
    assert 500_000 < size < LARGEST_RECORD / 4
    assert commits[-1].changed[-1].after == '"further changes omitted"'
    assert introspector.rest(2) is None


def test_the_level_of_detail_is_checked_everywhere(tmp_path: Path) -> None:
    options = RunOptions(tmp_path / "out", bus="memory", record=cast(RecordDetail, "Full"))
    with pytest.raises(OptionError) as caught:
        check_options(options)
    assert str(caught.value) == "--record: Full; must be lean or full"
