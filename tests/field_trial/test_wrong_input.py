"""What is wrong with the folders or in them is one sentence, and what can be read is read."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from actors.messages import DRIVE, MESSAGE_VERSION, Drive
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Entry, read_recording
from deploy.fleet.collect import collect
from tests.field_trial.conftest import Run
from tests.field_trial.rewriting import clock
from tests.field_trial.runs import copies


def sentence(*folders: Path, out: Path | None = None) -> str:
    with pytest.raises(AcrcError) as error:
        collect(folders, out)
    return str(error.value)


def test_folders_that_make_no_field_trial_are_refused(head_on: Run, crowd: Run, tmp_path: Path) -> None:
    gone, bare, world = tmp_path / "gone", tmp_path / "bare", tmp_path / "no" / "world"
    bare.mkdir()
    shutil.copytree(head_on.out / "world", world)
    one = copies(head_on.out, tmp_path / "one", {"r1": clock(), "r2": clock()})
    two = copies(head_on.out, tmp_path / "two", {"r2": clock()})
    later = copies(crowd.out, tmp_path / "later", {"r2": clock(86_400_000_000)})
    assert sentence(gone) == f"{gone}: no such folder; it should be a robot's, or one that holds robots'"
    assert sentence(bare) == f"{bare}: no recording in it; there should be *.mcap or */*.mcap"
    assert sentence(world.parent) == f"{world.parent}: no robot's recording in there, such as r2.mcap"
    assert f"{one}/r2/r2.mcap and {two}/r2/r2.mcap: both are recordings of r2 in epoch 0" in sentence(
        one, two
    )
    assert "no frame connects their recordings" in sentence(one / "r1", later)
    assert (
        sentence(head_on.out, out=one) == f"--out: {one} exists and is not an empty folder; must be a new one"
    )
    assert collect([one, one / "r2"]).robots == 2, "the same file twice is one"


def test_junk_beside_recordings_and_impossible_instants_are_named_and_left_out(
    head_on: Run, tmp_path: Path
) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock(1 << 61)})
    (far / "r1" / "a.mcap").write_bytes(b"anything")
    (far / "r1" / "empty.mcap").touch()
    ours = collect([far])
    assert ours.notes[:3] == (
        f"{far}/r1/a.mcap: not a recording of this project, or damaged at its start",
        f"{far}/r1/empty.mcap: ends before its first record, or is no actor's recording; left out",
        f"{far}/r2/r2.mcap: damaged: an instant is {1 << 61} µs, as no clock shows; what "
        "comes before is taken",
    )


def test_a_robots_file_cut_before_its_first_step_counts_for_nothing(head_on: Run, tmp_path: Path) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock()})
    path = far / "r2" / "r2.mcap"
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"swarm/")])
    ours = collect([far])
    assert ours.per_robot["r2"].clock == () and ours.per_robot["r2"].recordings[0].steps == 0
    assert ours.notes[0] == (
        f"{path}: cut short before its first step, without a last record, as by switching off"
    )
    path.unlink()
    (far / "r1" / "r1.mcap").write_bytes(whole[: whole.index(b"swarm/")])
    assert sentence(far) == f"{far}/r1/r1.mcap: no robot has taken a step in there"


@pytest.mark.parametrize("seed", range(8))
def test_damage_anywhere_is_a_sentence_at_most(head_on: Run, tmp_path: Path, seed: int) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock(), "r2": clock()})
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
        assert ours.per_robot["r1"].places_claimed >= 0
        assert ours.per_robot["r1"].recordings[0].ended == "as planned"


def test_what_nobody_knows_of_a_robot_that_is_missing_is_said(head_on: Run) -> None:
    ours = collect([head_on.out / "r1"])
    assert (ours.robots, ours.places_claimed) == (1, 3)
    spoken: set[tuple[str, int]] = set()
    for item in read_recording(head_on.out / "r1" / "r1.mcap"):
        if isinstance(item, Entry) and item.key == "swarm/up/r1/drive" and item.payload is not None:
            drive = decode(at(DRIVE, "r1").topic, item.key, item.payload)
            assert isinstance(drive, Drive)
            spoken |= {(report.owner, report.place) for report in drive.reports}
            spoken |= {(place.owner, place.place) for place in drive.route or ()}
    assert ours.places_total == len(spoken | {("r1", place) for place in range(3)})
    heard = head_on.result.frames_by_robot["r1"]["copies_heard"]
    assert ours.notes == (
        f"{heard} frames were heard of address 2, which is no robot's here: what it did and where it still "
        "meant to go is not known",
        "r2: its list of places is not known, so the table has those that others spoke of, without where "
        "they are",
    )


def test_messages_of_another_version_are_a_sentence(
    head_on: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = copies(head_on.out, tmp_path / "far", {"r1": clock()})
    monkeypatch.setattr("tests.field_trial.rewriting.encode", lambda message: b"\x07" + encode(message)[1:])
    copies(head_on.out, far, {"r2": clock()})
    ours = collect([far])
    assert ours.per_robot["r2"].recordings[0].ended == "damaged"
    assert ours.notes[0] == (
        f"{far}/r2/r2.mcap: swarm/down/r2/senses: version 7 where message version {MESSAGE_VERSION} was due; "
        "what comes before is taken"
    )
