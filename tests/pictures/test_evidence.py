"""What the recordings show agrees with the run's own result, and with what must be so."""

import shutil
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.messages import Truth
from actors.runtime.recording import RecordingError
from actors.task.words import PlaceKey
from actors.topic import Message
from observation.accounting.account import account, spells
from observation.accounting.time_spent import BY_ROBOTS, Cause
from observation.evidence.run_evidence import EvidenceError, RunEvidence
from observation.evidence.run_reader import read_run
from observation.picture.floor_picture import meetings
from observation.recordings.topics import Recorded


def test_it_says_what_the_result_says(evidence: RunEvidence) -> None:
    result = evidence.result
    assert result is not None
    assert evidence.end == pytest.approx(result.simulated_s)
    assert len({deed.place for deed in evidence.reported}) == result.places_claimed == 6
    assert max(deed.second for deed in evidence.reported) == result.completion_s
    assert evidence.sent.sum() == result.frames["frames_sent"]
    assert evidence.heard.sum() == result.frames["copies_heard"]
    error = np.hypot(*np.moveaxis(evidence.held[..., :2] - evidence.true[..., :2], -1, 0))
    assert np.nanmax(error) < 0.01, "its odometry is exact"


def test_places_change_hands_in_the_doorway(evidence: RunEvidence) -> None:
    assert {deed.robot for deed in evidence.taken_over} == {"r1", "r2"}
    assert all(deed.robot != deed.place.owner for deed in evidence.taken_over)
    first = evidence.taken_over[0]
    at = int(first.second * 10)
    apart = np.hypot(*(evidence.true[at, 0, :2] - evidence.true[at, 1, :2]))
    assert apart < 1.5, "the chapter's distance for an adoption"


def test_spells_are_without_gaps_and_overlap(evidence: RunEvidence) -> None:
    for robot in evidence.robots:
        own = [one for one in spells(evidence) if one.robot == robot]
        assert own[0].begin == 0.0 and own[-1].end == pytest.approx(evidence.end)
        assert all(a.end == b.begin and a.cause != b.cause for a, b in pairwise(own))


def test_a_picture_and_the_accounting_have_the_same_seconds(evidence: RunEvidence) -> None:
    lasted: defaultdict[tuple[str, str], float] = defaultdict(float)
    for one in spells(evidence):
        lasted[one.robot, one.cause.value] += one.end - one.begin
    for robot, causes in account(evidence.out).robots.items():
        assert {cause: lasted[robot, cause] for cause in causes} == pytest.approx(causes)


@pytest.mark.parametrize("cause", [Cause.OFF, Cause.FROZEN], ids=str)
def test_who_takes_no_part_is_off_or_frozen(evidence: RunEvidence, cause: Cause) -> None:
    stepping, powered = evidence.stepping.copy(), evidence.powered.copy()
    stepping[500:, 0] = False
    powered[500:, 0] = cause is Cause.FROZEN
    found = spells(replace(evidence, stepping=stepping, powered=powered))
    last = [one for one in found if one.robot == evidence.robots[0]][-1]
    assert last.cause is cause and last.begin == pytest.approx(50.0)


def test_who_stands_alone_stands_before_nobody(evidence: RunEvidence) -> None:
    alone = replace(
        evidence,
        robots=("r1",),
        **{
            name: getattr(evidence, name)[:, :1]
            for name in ("true", "held", "wished", "powered", "stepping", "left", "sent", "heard")
        },
    )
    assert not {one.cause for one in spells(alone)} & {*BY_ROBOTS}


def test_of_a_run_that_was_cut_goals_are_not_known_and_standing_still_shows(
    evidence: RunEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observation.accounting.tracks.outcomes", lambda record: {})
    assert {one.cause for one in spells(evidence)} & {*BY_ROBOTS}


def test_where_robots_stood_is_as_long_as_somebody_did(evidence: RunEvidence) -> None:
    found = meetings(spells(evidence))
    assert found, "they block each other"
    for x, y, lasted in found:
        assert 5.0 <= lasted <= evidence.end
        assert 11.5 < x < 13.5 and 8.0 < y < 11.5, "in the passage, or before it"


def test_a_run_that_was_cut_shows_what_there_is(folder: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut"
    shutil.copytree(folder, cut)
    (cut / "run.json").unlink()
    shown = read_run(cut)
    assert shown.result is None
    assert {(one.owner, one.place) for one in shown.places} == {
        (r, n) for r in ("r1", "r2") for n in range(3)
    }
    assert PlaceKey("r1", 0) in {deed.place for deed in shown.reported}


def test_what_is_no_run_is_said_in_a_sentence(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no run's folder: there is no \*/\*\.mcap in it"):
        read_run(tmp_path)
    part = tmp_path / "part"
    shutil.copytree(folder / "r1", part / "r1")
    with pytest.raises(
        EvidenceError, match=r"no recording of the world; it should be the folder of a simulated"
    ):
        read_run(part)
    wrong = tmp_path / "wrong"
    shutil.copytree(folder, wrong)
    (wrong / "run.json").write_text("{}")
    with pytest.raises(EvidenceError, match=r"run\.json: is no run's result"):
        read_run(wrong)


def test_a_robot_that_comes_and_goes_is_no_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    say = Recorded.message

    def fickle(one: Recorded) -> Message | None:
        told = say(one)
        if isinstance(told, Truth) and one.step == 5:
            return msgspec.structs.replace(told, robots=told.robots[:1])
        return told

    monkeypatch.setattr(Recorded, "message", fickle)
    with pytest.raises(EvidenceError, match=r"radio\.mcap: its robots change; they should be the same"):
        read_run(folder)
