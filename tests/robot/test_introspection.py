"""What robots record of their own computing: equal over every bus, replayed exactly, outside the digest."""

import random
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import replay_actor
from acrc_testbed.results.result import RunResult
from actors.introspection import Introspection
from actors.messages import INTROSPECTION
from actors.processes.launch import launcher
from actors.runtime.codec import decode
from actors.runtime.process_setup import RecordDetail
from actors.runtime.recording import Entry, read_recording
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.recorded_runs import HEAD_ON

_MOST_BYTES = 400
"""Of introspection for each robot-step, in the mean, without the heads of records."""


def run(out: Path, record: RecordDetail, bus: str) -> RunResult:
    scenario = load_scenario(HEAD_ON, Overrides(duration=3.0))
    options = RunOptions(out, bus=bus, record=record)
    if bus == "memory":
        return swarm.run_in_memory(swarm.plan(scenario, options), lambda progress: None)
    with launcher("forkserver") as launched:
        return swarm.run(scenario, options, launched)


def introspection(path: Path) -> list[Entry]:
    return [
        one
        for one in read_recording(path)
        if isinstance(one, Entry) and one.key == INTROSPECTION.key(path.stem)
    ]


def test_what_is_recorded_changes_nothing_and_is_the_same_over_the_mesh(
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
    assert any(commit.decision is not None for one in found for commit in one.commits)
    assert {"driving", "planning"} <= {one.activity.activity for one in found if one.activity is not None}
    assert sum(len(one.payload or b"") for one in entries) <= _MOST_BYTES * 300


@pytest.mark.parametrize("seed", range(5))
def test_a_recording_that_was_cut_anywhere_has_the_introspection_before(
    short_run: Path, tmp_path: Path, seed: int
) -> None:
    path, whole = short_run / "r1" / "r1.mcap", introspection(short_run / "r1" / "r1.mcap")
    data = path.read_bytes()
    cut = tmp_path / "r1.mcap"
    cut.write_bytes(data[: random.Random(seed).randrange(len(data))])
    found = introspection(cut)
    assert found == whole[: len(found)]
