"""Recordings with different clocks give the result of the simulated run; wrong input is refused."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from acrc_testbed.results.field_recordings import FieldTrialError
from acrc_testbed.results.result import RunResult
from actors.messages import MESSAGE_VERSION, TRUTH, Truth
from actors.runtime.codec import decode, encode
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Entry, Note, Recorder, read_notes, read_recording, recorder
from actors.runtime.replay_bus import topic_of
from deploy.fleet.collect import collect
from firmware_bridge.laboratory.laboratory import SAMPLE, LaboratoryResult, LaboratoryTruth
from tests.field_trial.conftest import Run
from tests.field_trial.runs import Clock, clock, copies, noise, rewrite, table
from tests.swarm.command import acrc

EPOCH = 1_700_000_000_000_000
"""A day in 2023, µs."""
TOLD = ("owner", "place", "x", "y", "reported_by", "given_up_by", "reason", "in_route_of")


def test_a_simulated_run_gives_its_own_result_without_ground_truth(head_on: Run, tmp_path: Path) -> None:
    ours, truth = collect([head_on.out], tmp_path / "out"), head_on.result
    for name in ("robots", "radio_bytes_per_robot_s", "deeco", "declaration"):
        assert getattr(ours, name) == getattr(truth, name), name
    assert ours.task == truth.task | {"places_done": None, "places_reported": 6}
    assert ours.task_summary == "reported 6 of 6 places as cleaned"
    assert (ours.duration_s, ours.notes) == (truth.simulated_s, ())
    assert ours.task["places_done"] is ours.contacts is None
    for name in ("frames_sent", "bytes_sent", "copies_heard"):
        assert ours.frames[name] == truth.frames[name]
    for row, true in zip(
        *(table(out / "places.csv") for out in (tmp_path / "out", head_on.out)), strict=True
    ):
        assert row == true | {"verdict": "claimed", "reached_s": "", "reached_by": ""}
    written = (tmp_path / "out" / "run.json").read_bytes()
    assert msgspec.json.decode(written) == msgspec.json.decode(msgspec.json.encode(ours))


def test_clock_offset_and_drift_are_corrected(head_on: Run, tmp_path: Path) -> None:
    clocks = {"r1": clock(EPOCH), "r2": clock(EPOCH + 7_654_321, drift_ppm=120.0)}
    late = copies(head_on.out, tmp_path / "late", clocks, noise(3, 3000.0))
    (noisy,) = collect([late]).per_robot["r2"].clock
    assert noisy.error_s is not None and noisy.scatter_s is not None
    assert abs(noisy.offset_s - 7.654321) <= noisy.scatter_s < noisy.error_s < 3e-3
    ours = collect([copies(head_on.out, tmp_path / "far", clocks)], tmp_path / "out")
    (r2,) = ours.per_robot["r2"].clock
    assert r2.error_s is not None and r2.scatter_s is not None and r2.scatter_s < 2e-4 < r2.error_s < 2.1e-3
    assert abs(r2.offset_s - 7.654321) <= r2.scatter_s
    assert r2.drift_ppm == pytest.approx(120.0, abs=2e6 * r2.scatter_s / ours.duration_s)
    assert ours.reference == "r1" and r2.surely_within_s is not None and r2.surely_within_s >= r2.error_s
    assert_same_table(tmp_path / "out", head_on.out, within_s=2 * r2.scatter_s)
    completed = head_on.result.task["completion_s"]
    assert ours.task["completion_s"] == pytest.approx(completed, abs=2 * r2.scatter_s)


def test_more_robots_one_killed_and_one_started_again(crowd: Run, tmp_path: Path) -> None:
    clocks = {f"r{n}": clock(EPOCH + n * 1_000_000_000, 25.0 * n) for n in range(1, 5)}
    ours = collect([copies(crowd.out, tmp_path / "far", clocks)], tmp_path / "out")
    for name in ("places_claimed", "places_lost"):
        assert ours.task[name] == crowd.result.task[name]
    assert crowd.result.task["places_lost"] == 3
    assert ours.frames["copies_heard"] == crowd.result.frames["copies_heard"]
    assert [one.epoch for one in ours.per_robot["r2"].recordings] == [0, 1]
    assert_same_table(tmp_path / "out", crowd.out, within_s=0.003)
    for n in (2, 3, 4):
        (one,) = ours.per_robot[f"r{n}"].clock  # a robot that is started again has the same base
        assert one.error_s is not None
        assert abs(one.offset_s - (n - 1) * 1000.0) <= one.error_s + 1e-5


def test_a_clock_set_between_two_starts_is_two_segments(crowd: Run, tmp_path: Path) -> None:
    clocks = {f"r{n}": clock(EPOCH) for n in (1, 3, 4)}
    far = copies(crowd.out, tmp_path / "far", clocks)
    for name, ahead in (("r2", -3_000_000), ("r2.1", 86_400_000_000)):
        rewrite(crowd.out / "r2" / f"{name}.mcap", far / "r2" / f"{name}.mcap", {"r2": clock(EPOCH + ahead)})
    ours = collect([far], tmp_path / "out")
    before, after = ours.per_robot["r2"].clock
    assert abs(before.offset_s + 3.0) <= (before.error_s or 0.0)
    assert abs(after.offset_s - 86_400.0) <= (after.error_s or 0.0)
    assert (before.from_s, after.from_s, after.to_s) == pytest.approx((0.0, 30.0, 60.0), abs=1e-3)
    assert ours.notes == ()
    assert_same_table(tmp_path / "out", crowd.out, within_s=0.003)


def test_a_set_clock_of_a_bridge_is_corrected_to_within_a_step(head_on: Run, tmp_path: Path) -> None:
    copies(head_on.out, tmp_path, {"r1": clock(EPOCH)})
    far = tmp_path / "r2" / "r2.mcap"
    rewrite(head_on.out / "r2" / "r2.mcap", far, {"r2": clock(EPOCH)}, bridge=clock(EPOCH + 3_600_000_000))
    ours = collect([tmp_path])
    (r2,) = ours.per_robot["r2"].clock
    assert r2.error_s is not None and abs(r2.offset_s) <= r2.error_s and 0.1 <= r2.error_s < 0.12
    assert ours.notes == (
        f"{far}: the clock for frames was set while the clock for steps ran on; corrected to within a step",
    )


def test_a_robot_without_common_frames_stays_unaligned_with_a_note(head_on: Run, tmp_path: Path) -> None:
    def keep(item: Entry | Note) -> bool:
        return isinstance(item, Note) or ("received" not in item.key and "transmit" not in item.key)

    rewrite(head_on.out / "r1" / "r1.mcap", tmp_path / "r1" / "r1.mcap", {"r1": clock(EPOCH)})
    own = {"r2": clock(EPOCH + 2_000_000)}
    rewrite(head_on.out / "r2" / "r2.mcap", tmp_path / "r2" / "r2.mcap", own, keep=keep)
    ours = collect([tmp_path])
    (r2,) = ours.per_robot["r2"].clock
    assert (r2.error_s, r2.surely_within_s, r2.from_s, r2.frames) == (None, None, 2.0, 0)
    assert ours.notes == (
        "r2: no common frame with r1, so its instants are those of its own clock, with an unknown error",
    )


@pytest.mark.parametrize("share", [0.2, 0.93])
def test_a_truncated_recording_is_used_up_to_its_end(head_on: Run, far: Path, share: float) -> None:
    path = far / "r2" / "r2.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    ours = collect([far])
    (report,) = ours.per_robot["r2"].recordings
    steps = report.steps
    whole = 10 * head_on.result.simulated_s
    assert report.ended == "cut short" and abs(steps / whole - share) < 0.1
    assert ours.notes == (
        f"{path}: truncated at step {steps - 1}: no final record, as after a power-off",
        f"{path}: no final record, so the counters of its node are unknown",
    )
    rows = table(head_on.out / "places.csv")
    known = [
        row for row in rows if row["reported_by"] == "r1" or float(row["reported_s"]) < steps * 0.1 - 0.2
    ]
    assert ours.task["places_claimed"] == len(known)


def test_large_messages_are_taken_from_their_receivers(
    head_on: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Treat all frames and answers as too large to be recorded by their sender."""
    whole: dict[str, Clock] = {"r1": clock(), "r2": clock()}
    with monkeypatch.context() as patch:
        patch.setattr(recorder, "LARGE", 16)
        copies(head_on.out, tmp_path, whole)
    alone, r1 = collect([tmp_path]), tmp_path / "r1" / "r1.mcap"
    assert alone.task["places_claimed"] == 0
    assert alone.frames["frames_sent"] == head_on.result.frames["frames_sent"]
    published = head_on.result.frames_by_robot["r1"]["frames_sent"]
    assert alone.notes[:2] == (
        f"{r1}: {10 * head_on.result.simulated_s:.0f} answers are recorded as hashes only, so their reports "
        "are unknown; add the recording of the base or the world",
        f"{r1}: the frames of {published} messages are recorded as hashes only; add the recording of the "
        "bridge or the radio",
    )
    for name in ("world", "radio"):
        rewrite(head_on.out / name / f"{name}.mcap", tmp_path / name / f"{name}.mcap", whole)
    monkeypatch.setattr("acrc_testbed.results.field_recordings.LARGE", 16)
    both = collect([tmp_path], tmp_path / "out")
    assert both.notes == () and both.task["completion_s"] == head_on.result.task["completion_s"]
    assert both.per_robot["r2"].clock[0].error_s == collect([head_on.out]).per_robot["r2"].clock[0].error_s


def test_the_lateness_is_that_of_the_robots_base(head_on: Run, far: Path) -> None:
    for start, lateness in (("r2.base", {"2": 90, "7": 8}), ("r2.base.1", {"3": 1, "45": 1})):
        write_base(far / "r2.base" / f"{start}.mcap", head_on.out, lateness)
    whole = collect([far]).per_robot
    assert (whole["r2"].lateness_p50_ms, whole["r2"].lateness_p99_ms, whole["r2"].overruns) == (2, 7, 6)
    assert (whole["r1"].lateness_p50_ms, whole["r1"].overruns) == (None, None)
    assert collect([far / "r1", far / "r2"]).per_robot["r2"] == whole["r2"]  # what lies beside


def write_base(path: Path, run: Path, lateness: dict[str, int]) -> None:
    """Write a base's recording: its first and its final record."""
    notes = read_notes(run / "world" / "world.mcap")
    first = msgspec.json.decode(notes["run"], type=RunNote)
    outcome = {"steps": 100, "overruns": 3, "late_air": 0, "stale_drives": 0, "lateness_ms": lateness}
    raw = {name: msgspec.Raw(msgspec.json.encode(value)) for name, value in outcome.items()}
    final = msgspec.structs.replace(msgspec.json.decode(notes["final"], type=FinalNote), outcome=raw)
    path.parent.mkdir(exist_ok=True)
    with Recorder(path, 100_000) as recorder:
        recorder.note("run", msgspec.structs.replace(first, actor="base", setup=msgspec.Raw(b'{"id": "r2"}')))
        recorder.note("final", final)


def assert_same_table(ours: Path, simulated: Path, within_s: float) -> None:
    for row, true in zip(table(ours / "places.csv"), table(simulated / "places.csv"), strict=True):
        assert {name: row[name] for name in TOLD} == {name: true[name] for name in TOLD}
        for name in ("reported_s", "given_up_s"):
            assert bool(row[name]) == bool(true[name])
            if row[name]:
                assert abs(float(row[name]) - float(true[name])) <= within_s
        assert (row["reached_s"], row["reached_by"]) == ("", "")


def test_the_command_prints_a_table_or_json(head_on: Run, tmp_path: Path) -> None:
    copies(head_on.out, tmp_path / "far", {"r1": clock(EPOCH), "r2": clock(EPOCH + 2_500_000)})
    said = acrc("fleet", "collect", tmp_path / "far", "--out", tmp_path / "out")
    assert (said.returncode, said.stderr) == (0, "")
    lines, frames = said.stdout.splitlines(), head_on.result.frames
    assert lines[-1] == f"Result: {tmp_path / 'out'}"
    cells = [[cell.strip() for cell in line.strip("│ ").split("│")] for line in lines if "│" in line]
    counted = [str(frames["frames_sent"]), str(frames["copies_heard"])]
    assert cells[2] == ["all", "6 of 6", f"{head_on.result.task['completion_s']:.1f} s", *counted]
    assert cells[1][:2] == ["r2", "3 of 3"] and cells[1][5].startswith("+2.5000 s ± ")
    done = acrc("fleet", "collect", tmp_path / "far" / "r1", tmp_path / "far" / "r2", "--json")
    result = msgspec.json.decode(done.stdout, type=RunResult)
    assert (result.task["places_claimed"], result.out, done.stderr) == (6, None, "")


BEGAN = EPOCH - 5_000_000
"""The emulation started 5 s before the robots."""


def laboratory(run: Run, path: Path, *, moved_m: float = 0.0, **other: object) -> Path:
    """Write the result that the emulation would give for a simulated run, with all robots moved."""
    truths = [
        truth
        for item in read_recording(run.out / "radio" / "radio.mcap")
        if isinstance(item, Entry) and item.key == TRUTH.key() and item.payload is not None
        if isinstance(truth := decode(topic_of(item.key), item.key, item.payload), Truth) and truth.robots
    ]
    samples = np.array([[(one.x + moved_m, one.y) for one in truth.robots] for truth in truths])
    before = np.repeat(samples[:1], (EPOCH - BEGAN) // SAMPLE, axis=0)
    result = LaboratoryResult(
        began_us=BEGAN, simulated_s=100.0, contacts=3, lines={}, boards={}, behind_ms={}, lost_ms=0,
        robots={one.id: LaboratoryTruth((one.x, one.y, one.heading), 0.0) for one in truths[-1].robots},
        positions=np.concatenate([before, samples]).astype("<f4").tobytes(),
    )  # fmt: skip
    path.write_bytes(msgspec.json.encode(msgspec.structs.replace(result, **other)))
    return path


def test_with_ground_truth_the_table_is_that_of_the_simulation(head_on: Run, tmp_path: Path) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(EPOCH), "r2": clock(EPOCH)})
    truth = laboratory(head_on, tmp_path / "result.json", frames=head_on.result.frames)
    ours = collect([far], tmp_path / "out", truth)
    assert ours.frames | head_on.result.frames == ours.frames
    assert (tmp_path / "out" / "places.csv").read_text() == (head_on.out / "places.csv").read_text()
    assert (ours.task, ours.contacts) == (head_on.result.task, 3)
    assert [part.task["places_done"] for part in ours.per_robot.values()] == [3, 3]
    part = {"frames_sent": 5, "copies_lost_collision": 2}
    truth = laboratory(head_on, tmp_path / "part.json", frames=part, frames_by_robot={"r1": part})
    robots = collect([far], None, truth).per_robot
    assert robots["r1"].frames["frames_sent"] == 5 != robots["r2"].frames["frames_sent"]


def test_a_report_of_an_unvisited_place_is_mistaken(crowd: Run, tmp_path: Path) -> None:
    far = copies(crowd.out, tmp_path / "far", {f"r{n}": clock(EPOCH) for n in range(1, 5)})
    truth = laboratory(crowd, tmp_path / "result.json", moved_m=1000.0, lost_ms=40)
    ours = collect([far], tmp_path / "out", truth)
    verdicts = [row["verdict"] for row in table(tmp_path / "out" / "places.csv")]
    claimed = crowd.result.task["places_claimed"]
    assert (verdicts.count("mistaken"), verdicts.count("done")) == (claimed, 0) and len(verdicts) > 1
    assert (ours.task["places_claimed"], ours.task["places_done"]) == (claimed, 0)
    assert ours.notes == ("the emulation fell behind, so the true instants are early by up to 40 ms",)


def test_another_field_trials_truth_is_one_sentence(head_on: Run, far: Path, tmp_path: Path) -> None:
    with pytest.raises(FieldTrialError, match="--truth: the emulation began 1699999995 s after the field"):
        collect([far], None, laboratory(head_on, tmp_path / "result.json"))
    (tmp_path / "junk.json").write_text("{}")
    with pytest.raises(
        FieldTrialError, match=r"/junk\.json is not a result of emulated devices: began_us is"
    ):
        collect([far], None, tmp_path / "junk.json")


def sentence(*folders: Path, out: Path | None = None) -> str:
    with pytest.raises(AcrcError) as error:
        collect(folders, out)
    return str(error.value)


def test_folders_that_are_not_one_field_trial_are_refused(head_on: Run, crowd: Run, tmp_path: Path) -> None:
    gone, bare, world = tmp_path / "gone", tmp_path / "bare", tmp_path / "no" / "world"
    bare.mkdir()
    shutil.copytree(head_on.out / "world", world)
    one = copies(head_on.out, tmp_path / "one", {"r1": clock(), "r2": clock()})
    two = copies(head_on.out, tmp_path / "two", {"r2": clock()})
    later = copies(crowd.out, tmp_path / "later", {"r2": clock(86_400_000_000)})
    assert sentence(gone).startswith(f"{gone}: no such folder; give a robot's folder")
    assert sentence(bare) == f"{bare}: no recordings (*.mcap or */*.mcap)"
    assert sentence(world.parent) == f"{world.parent}: no recording of a robot, such as r2.mcap"
    assert f"{one}/r2/r2.mcap and {two}/r2/r2.mcap: two recordings of r2 in epoch 0" in sentence(one, two)
    assert "their recordings share no frame" in sentence(one / "r1", later)
    assert (
        sentence(head_on.out, out=one) == f"--out: {one} already exists and is not empty; choose a new folder"
    )
    assert collect([one, one / "r2"]).robots == 2, "the same file twice is one"


def test_junk_files_and_implausible_instants_are_skipped_with_a_note(head_on: Run, tmp_path: Path) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock(1 << 61)})
    (far / "r1" / "a.mcap").write_bytes(b"anything")
    (far / "r1" / "empty.mcap").touch()
    ours = collect([far])
    assert ours.notes[:3] == (
        f"{far}/r1/a.mcap: not a recording, or damaged at its start",
        f"{far}/r1/empty.mcap: empty or not an actor's recording; skipped",
        f"{far}/r2/r2.mcap: damaged: implausible instant {1 << 61} µs; used up to there",
    )


def test_a_recording_truncated_before_its_first_step_is_ignored(far: Path) -> None:
    path = far / "r2" / "r2.mcap"
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"swarm/")])
    ours = collect([far])
    assert ours.per_robot["r2"].clock == () and ours.per_robot["r2"].recordings[0].steps == 0
    assert ours.notes[0] == (
        f"{path}: truncated before its first step: no final record, as after a power-off"
    )
    path.unlink()
    (far / "r1" / "r1.mcap").write_bytes(whole[: whole.index(b"swarm/")])
    assert sentence(far) == f"{far}/r1/r1.mcap: no robot took a step"


@pytest.mark.parametrize("seed", range(4))
def test_damage_anywhere_gives_at_most_a_sentence(far: Path, seed: int) -> None:
    path = far / "r2" / "r2.mcap"
    generator = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    for position in generator.integers(0, len(data), 3):
        data[position] ^= int(generator.integers(1, 256))
    path.write_bytes(data)
    try:
        ours = collect([far])
    except AcrcError as error:
        assert "\n" not in str(error)
    else:
        assert ours.per_robot["r1"].task["places_claimed"] is not None
        assert ours.per_robot["r1"].recordings[0].ended == "as planned"


def test_unknown_data_of_a_missing_robot_are_noted(head_on: Run) -> None:
    ours = collect([head_on.out / "r1"])
    others = [row for row in table(head_on.out / "places.csv") if row["reported_by"] == "r1"]
    own = [row for row in others if row["owner"] == "r1"]
    assert (ours.robots, ours.task["places_total"], ours.task["places_claimed"]) == (1, 3, len(own))
    heard = head_on.result.frames_by_robot["r1"]["copies_heard"]
    assert 0 < len(own) < len(others)
    assert ours.notes == (
        f"{heard} frames were received from address 2, of which there is no recording; its reports and route "
        "are unknown",
        f"{len(others) - len(own)} reports are left out; the first: r1 reports place 0 of 'r2', which does "
        "not exist",
    )


def test_messages_of_another_version_are_a_sentence(
    head_on: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock()})
    monkeypatch.setattr("tests.field_trial.runs.encode", lambda message: b"\x07" + encode(message)[1:])
    copies(head_on.out, far, {"r2": clock()})
    ours = collect([far])
    assert ours.per_robot["r2"].recordings[0].ended == "damaged"
    assert ours.notes[0] == (
        f"{far}/r2/r2.mcap: swarm/down/r2/senses: version 7, expected message version {MESSAGE_VERSION}; "
        "used up to there"
    )
