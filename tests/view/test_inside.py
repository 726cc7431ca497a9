"""What is computed of robots and radio from their recordings is what they did, and nothing else."""

from pathlib import Path

import numpy as np
import pytest

from actors.geometry import Point
from actors.observer.drawing.words import Occupation
from actors.radio.medium.state import Outcome
from actors.task.words import PlaceKey
from cleaning.cleaner import State
from observation.evidence.run_evidence import RunEvidence
from observation.trace.coding import PART, TraceError, decode, encode
from observation.trace.frame_fates import by_outcome, read_fates
from observation.trace.program import whole
from observation.trace.rows import ACTIVITIES, Trace
from observation.trace.words import in_words
from observation.view.painted_inside import over


def test_every_copy_has_the_fate_that_the_radio_counted_and_its_sender(
    folder: Path, evidence: RunEvidence
) -> None:
    fates = read_fates(folder, evidence.robots)
    assert evidence.result is not None
    counted = evidence.result.frames
    counts = np.bincount(fates.outcomes, minlength=len(Outcome))
    for outcome in (Outcome.HEARD, Outcome.COLLISION, Outcome.HALF_DUPLEX, Outcome.BELOW_SENSITIVITY):
        name = f"copies_{'' if outcome is Outcome.HEARD else 'lost_'}{outcome.name.lower()}"
        assert counts[outcome] == counted[name], name
    assert counts.sum() == counted["frames_sent"] * (len(evidence.robots) - 1) > 0
    assert (fates.senders != fates.receivers).all()
    heard = fates.outcomes == Outcome.HEARD
    told = sorted((one.second, evidence.robots.index(one.receiver)) for one in evidence.receptions)
    mine = sorted(zip(fates.seconds[heard].tolist(), fates.receivers[heard].tolist(), strict=True))
    assert mine == told
    table = by_outcome(fates, 0.0, 6, 5.0)
    assert table[:, Outcome.HEARD].sum() * 5.0 == pytest.approx(counts[Outcome.HEARD])


def test_a_robot_is_seen_to_hold_itself_where_it_said(
    insides: dict[str, Trace], evidence: RunEvidence
) -> None:
    for index, robot in enumerate(evidence.robots):
        inside = insides[robot]
        steps = inside.instants // evidence.setup.step_us
        np.testing.assert_array_equal(inside.estimates, evidence.held[steps, index])
        assert inside.fault is None and inside.robot == robot
        assert np.diff(inside.instants).tolist() == [500_000] * (len(inside.instants) - 1)
        assert (inside.covariances[:, (0, 2)] > 0).all()


def test_scans_end_on_the_floor_plan_and_particles_are_round_the_robot(
    insides: dict[str, Trace], evidence: RunEvidence
) -> None:
    inside, grid = insides["r1"], evidence.grid
    points = inside.scans.values
    cells = np.floor((points - (grid.origin.x, grid.origin.y)) / grid.resolution).astype(int)
    near = np.zeros(len(points), bool)
    for down in range(-2, 3):
        for right in range(-2, 3):
            rows = np.clip(cells[:, 1] + down, 0, grid.cells.shape[0] - 1)
            columns = np.clip(cells[:, 0] + right, 0, grid.cells.shape[1] - 1)
            near |= grid.cells[rows, columns] != 0
    assert len(points) > 1000 and near.mean() > 0.8  # the rest is the other robot
    last = inside.particles.rows()[-1]
    assert np.hypot(*(last - inside.estimates[-1, :2]).T).max() < 1.5


def test_plans_costs_doings_and_knowledge_tell_of_the_meeting(insides: dict[str, Trace]) -> None:
    inside = insides["r1"]
    ways = [way for way in inside.plans.rows() if len(way)]
    assert ways and all(np.hypot(*np.diff(way, axis=0).T).max() < 0.5 for way in ways)
    assert inside.costs.max() == 254 and inside.costs.shape[1] == inside.costs.shape[2]
    activities = [one.activity for robot in insides.values() for one in robot.doings]
    assert {"driving", "blocked"} <= set(activities) <= set(ACTIVITIES)
    assert {one.destination.partition("/")[0] for one in inside.doings} <= {"", "r1", "r2"}
    names = [name for name, _ in inside.knowledge[-1].rows]
    assert {"position", "destination", "route", "state"} <= set(names) and "parameters" not in names
    assert {one.peer for one in inside.contacts} == {"r2"}
    peers = {change.peer for robot in insides.values() for change, _ in robot.decisions()}
    assert peers & {"r1", "r2"}


def test_the_same_is_seen_in_another_process_and_after_a_way_through_a_pipe(
    folder: Path, insides: dict[str, Trace]
) -> None:
    (here,) = whole(folder, "r2")
    assert encode(here) == encode(insides["r2"]) == encode(decode(encode(here)[PART.size :]))


def test_a_trace_that_does_not_fit_is_refused(insides: dict[str, Trace]) -> None:
    data = encode(insides["r1"])[PART.size :]
    for damaged in (b"", data[:100], data[:-1], b"\x00" + data[1:], data.replace(b"driving", b"DRIVING")):
        with pytest.raises(TraceError):
            decode(damaged)


def test_knowledge_is_told_in_words() -> None:
    told = [in_words(one) for one in (None, (), 1.0, State.FREE, PlaceKey("r1", 3), Point(1.0, 2.5), True)]
    assert told == ["-", "-", "1.00", "free", "r1/3", "1.00, 2.50", "True"]
    assert in_words((PlaceKey("r1", 3), PlaceKey("r2", 0))) == "r1/3 r2/0"
    assert in_words(((((1,),),),)) == "…"
    assert in_words(frozenset({"b", "a"})) == "a b"


def test_ground_truth_has_the_last_word_on_deadlocks_in_a_lane() -> None:
    own = [Occupation(0.0, "driving"), Occupation(4.0, "no trajectory"), Occupation(6.0, "blocked")]
    assert over(own, [(3.0, 5.0)]) == [
        Occupation(0.0, "driving"),
        Occupation(3.0, "deadlock"),
        Occupation(5.0, "no trajectory"),
        Occupation(6.0, "blocked"),
    ]
    assert over(own, [(7.0, 9.0)])[-2:] == [Occupation(7.0, "deadlock"), Occupation(9.0, "blocked")]
    assert over(own, []) == own
