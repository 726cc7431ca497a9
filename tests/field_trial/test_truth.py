"""What the laboratory of emulated devices saw stands beside what the robots say."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.task.referee import PlaceOutcome
from deploy.fleet.collect import collect
from firmware_bridge.laboratory.laboratory_setup import LaboratoryResult
from observation.field_trial.recordings import FieldTrialError
from observation.field_trial.trial_result import read_truth, with_true_frames
from tests.field_trial.conftest import Run
from tests.field_trial.rewriting import clock
from tests.field_trial.runs import copies, table

EPOCH = 1_700_000_000_000_000
BEGAN = EPOCH - 5_000_000
"""The laboratory was there 5 s before the robots."""


def laboratory(run: Run, path: Path, **other: object) -> Path:
    """What it would have said of a simulated run."""
    places = []
    for row in table(run.out / "places.csv"):
        at = round(float(row["reached_s"]) * 1e6) + EPOCH - BEGAN if row["reached_s"] else None
        nothing: dict[str, Any] = dict.fromkeys(
            ("reported_at", "reported_by", "given_up_at", "given_up_by", "reason"), None
        )
        places.append(
            PlaceOutcome(
                owner=row["owner"], place=int(row["place"]), x=0.0, y=0.0, reached_at=at,
                reached_by=row["reached_by"] or None, in_route_of=(), **nothing,
            )
        )  # fmt: skip
    result = LaboratoryResult(
        began_us=BEGAN, simulated_s=100.0, contacts=3, places=tuple(places), lines={}, boards={},
        behind_ms={}, lost_ms=0,
    )  # fmt: skip
    path.write_bytes(msgspec.json.encode(msgspec.structs.replace(result, **other)))
    return path


def test_with_truth_the_table_is_the_simulated_runs_whole_one(head_on: Run, tmp_path: Path) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(EPOCH), "r2": clock(EPOCH)})
    truth = laboratory(head_on, tmp_path / "result.json", frames=head_on.result.frames)
    ours = collect([far], tmp_path / "out", truth)
    assert ours.frames | head_on.result.frames == ours.frames
    assert (tmp_path / "out" / "places.csv").read_text() == (head_on.out / "places.csv").read_text()
    assert (ours.places_done, ours.contacts, ours.completion_s) == (6, 3, head_on.result.completion_s)
    assert [part.places_done for part in ours.per_robot.values()] == [3, 3]


def test_a_report_of_what_nobody_reached_is_mistaken(crowd: Run, tmp_path: Path) -> None:
    far = copies(crowd.out, tmp_path / "far", {f"r{n}": clock(EPOCH) for n in range(1, 5)})
    truth = laboratory(crowd, tmp_path / "result.json", lost_ms=40)
    seen = msgspec.json.decode(truth.read_bytes(), type=LaboratoryResult)
    blind = [msgspec.structs.replace(place, reached_at=None, reached_by=None) for place in seen.places]
    truth.write_bytes(msgspec.json.encode(msgspec.structs.replace(seen, places=tuple(blind))))
    ours = collect([far], tmp_path / "out", truth)
    verdicts = [row["verdict"] for row in table(tmp_path / "out" / "places.csv")]
    claimed = crowd.result.places_claimed
    assert (verdicts.count("mistaken"), verdicts.count("done")) == (claimed, 0) and claimed > 1
    assert (ours.places_claimed, ours.places_done) == (claimed, 0)
    assert ours.notes == ("the laboratory fell behind, so the true instants are early by up to 40 ms",)


def test_the_air_knows_what_became_of_frames_and_robots_which_never_came_so_far(
    head_on: Run, tmp_path: Path
) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(EPOCH), "r2": clock(EPOCH)})
    air = {"frames_sent": 5, "frames_overflowed": 0, "frames_refused": 0, "copies_lost_collision": 2}
    plain = collect([far])
    told = msgspec.structs.replace(plain, frames=plain.frames | {"frames_overflowed": 1500})
    truth = laboratory(head_on, tmp_path / "result.json", frames=air, frames_by_robot={"r1": air})
    ours = with_true_frames(told, read_truth(truth))
    assert ours.frames == told.frames | {"frames_sent": 5, "copies_lost_collision": 2}
    assert ours.per_robot["r1"].frames["frames_sent"] == 5
    assert ours.per_robot["r2"].frames == plain.per_robot["r2"].frames


def test_another_field_trials_truth_is_one_sentence(head_on: Run, tmp_path: Path) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock()})
    with pytest.raises(FieldTrialError) as error:
        collect([far], None, laboratory(head_on, tmp_path / "result.json"))
    assert str(error.value) == (
        "--truth: the laboratory began 1699999995 s after the field trial and went on for 100 s; it should "
        "be that of this field trial"
    )
    (tmp_path / "junk.json").write_text("{}")
    with pytest.raises(FieldTrialError) as error:
        collect([far], None, tmp_path / "junk.json")
    assert str(error.value) == (
        f"--truth: {tmp_path}/junk.json is no result of a laboratory: began_us is missing, but must be there"
    )
