"""Where the time went: on tracks made by hand, in planted situations, and from a run over the mesh."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.instant import seconds
from actors.messages import Jam
from actors.orders import CloseDoor, Obstacle, OpenDoor
from actors.runtime.recording import RecordingError
from command_line.app import app
from deploy.run import swarm
from deploy.run.options import RunOptions
from observation.accounting.account import account, decision_events, diagnosis_score
from observation.accounting.classify import (
    CAUSES,
    Classified,
    FrameCounts,
    blocking_events,
    classify,
    deadlocks,
    findings,
)
from observation.accounting.time_spent import Cause, DeadlockCount
from observation.accounting.tracks import STANDARD, Said, TimedJam, Tracks
from observation.accounting.true_floor import TrueFloor
from observation.evidence.run_evidence import SaidDecision
from observation.replay.recorded_orders import GivenOrder
from observation.results.outcome import GivenGoal
from tests.experiments import situations

STEP = 100_000
STEPS = 300
GOAL = (GivenGoal(0, 9.0, 3.0),)
WANTS = Said(goals=GOAL)
BACK = Said(goals=(GivenGoal(0, 1.0, 0.5),))
WEST = Said(goals=(GivenGoal(0, 0.4, 3.0),))
IDLE = Said()
SLEEPS = Said(goals=())


def floor(*orders: GivenOrder) -> TrueFloor:
    """10 m by 6 m; a wall at x = 5 with a door of 0.8 m around y = 3."""
    cells = np.full((120, 200), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    cells[:52, 100:102] = OCCUPIED
    cells[68:, 100:102] = OCCUPIED
    return TrueFloor(OccupancyGrid(cells, 0.05), 0.177, orders)


def at(x: float, y: float) -> NDArray[np.float64]:
    return np.tile([x, y, 0.0], (STEPS, 1))


def driving(x: float, y: float) -> NDArray[np.float64]:
    return np.column_stack([x + 0.008 * np.arange(STEPS), np.full(STEPS, y), np.zeros(STEPS)])


def tracks(*true: NDArray[np.float64], held: NDArray[np.float64] | None = None) -> Tracks:
    together = np.stack(true, axis=1)
    always = np.ones(together.shape[:2], np.bool_)
    names = tuple(f"r{number}" for number in range(1, len(true) + 1))
    said = together if held is None else held
    return Tracks(names, STEP, together, said, together, always, always.copy())


def classified(of: Tracks, *said: Said, orders: Sequence[GivenOrder] = ()) -> Classified:
    """Who wants nothing, and has not been told to be asleep, has nothing left to do."""
    for robot, one in enumerate(said):
        of.busy[:, robot] &= one is not IDLE
    return classify(of, dict(zip(of.robots, said, strict=True)), floor(*orders))


def causes(of: Tracks, *said: Said, orders: Sequence[GivenOrder] = ()) -> list[set[Cause]]:
    found = classified(of, *said, orders=orders).causes
    return [{CAUSES[cause] for cause in np.unique(found[:, robot])} for robot in range(found.shape[1])]


@pytest.mark.parametrize(
    ("there", "who", "cause"),
    [
        ((2.3, 1.3), BACK, Cause.DEADLOCK),
        ((2.43, 1.0), WANTS, Cause.DEADLOCK),
        ((2.3, 1.3), IDLE, Cause.DONE_IN_WAY),
        ((2.8, 1.6), SLEEPS, Cause.STRATEGY_IDLE),
        ((3.3, 1.9), BACK, Cause.DEADLOCK),
        ((3.3, 1.9), WANTS, Cause.NO_PROGRESS),
        ((3.3, 1.0), IDLE, Cause.NO_PROGRESS),
        ((1.2, 0.5), IDLE, Cause.NO_PROGRESS),
        ((4.0, 2.5), IDLE, Cause.DONE_IN_WAY),
        ((4.8, 3.0), IDLE, Cause.NO_PROGRESS),
    ],
)
def test_who_waits_for_the_first_robot_on_its_way(
    there: tuple[float, float], who: Said, cause: Cause
) -> None:
    assert causes(tracks(at(2.0, 1.0), at(*there)), WANTS, who)[0] == {cause}


def test_head_on_in_a_door_is_a_deadlock_also_for_who_queues_behind() -> None:
    three = tracks(at(4.4, 3.0), at(5.7, 3.0), at(3.2, 2.4))
    found = classified(three, WANTS, BACK, WANTS)
    assert found.is_(Cause.DEADLOCK).all()
    assert found.ring.all(axis=0).tolist() == [True, True, False] and found.before[0].tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    ("root", "cause"), [("off", Cause.BY_DEAD), ("idle", Cause.DONE_IN_WAY), ("asleep", Cause.STRATEGY_IDLE)]
)
def test_a_queue_has_the_cause_of_the_one_at_its_head(root: str, cause: Cause) -> None:
    four = tracks(at(5.0, 3.0), at(4.0, 3.0), at(3.2, 2.4), at(2.5, 1.8))
    four.stepping[:, 0] = root != "off"
    head = {"off": WANTS, "idle": IDLE, "asleep": SLEEPS}[root]
    found = classified(four, head, WANTS, WANTS, WANTS)
    assert found.is_(cause)[:, 1:].all() and not found.root[:, 1:].any()
    assert found.at_door[:, 1:].all(), "the queue leads through the door"


def test_a_queue_before_one_that_gets_on_waits_at_the_door() -> None:
    through = driving(4.6, 3.0)
    two = tracks(through, at(3.9, 3.0))
    found = classified(two, WANTS, WANTS)
    assert CAUSES[found.causes[0, 1]] is Cause.DOOR and CAUSES[found.causes[0, 0]] is Cause.DRIVING


def test_a_closed_door_and_what_lies_on_a_place_keep_a_queue() -> None:
    queue = tracks(at(3.2, 3.0), at(2.4, 2.9))
    close = GivenOrder(0, CloseDoor(5.0, 3.0))
    thing = GivenOrder(0, Obstacle(9.0, 3.0, 0.6))
    for orders, cause in (((close,), Cause.CLOSED_DOOR), ((thing,), Cause.UNREACHABLE)):
        assert causes(queue, WANTS, WANTS, orders=orders) == [{cause}] * 2
    again = (close, GivenOrder(100, OpenDoor(5.0, 3.0)))
    assert causes(queue, WANTS, WANTS, orders=again)[0] == {Cause.CLOSED_DOOR, Cause.NO_PROGRESS}
    assert causes(queue, WANTS, WANTS, orders=(GivenOrder(0, Obstacle(9.0, 3.0, 0.2)),))[0] == {
        Cause.NO_PROGRESS
    }


def test_a_door_closes_once_nobody_stands_in_it() -> None:
    leaves = driving(5.0, 3.0)
    stages = floor(GivenOrder(10, CloseDoor(5.0, 3.0))).stages(np.stack([leaves, at(2.0, 1.0)], axis=1))
    assert [one.begin for one in stages if len(one.leaves)] == pytest.approx([30], abs=5)


def test_who_moves_and_gets_no_nearer_is_in_a_livelock() -> None:
    swings = at(2.0, 1.0)
    swings = np.concatenate([swings, swings])
    swings[:, 0] += 0.6 * np.sin(np.arange(2 * STEPS) / 15)
    together = swings[:, None]
    always = np.ones((2 * STEPS, 1), np.bool_)
    alone = Tracks(("r1",), STEP, together, together, together, always, always.copy())
    assert Cause.LIVELOCK in causes(alone, WANTS)[0]
    nearer = together.copy()
    nearer[:, 0, 0] += np.arange(2 * STEPS) * 0.004
    gets_on = Tracks(("r1",), STEP, nearer, nearer, nearer, always, always.copy())
    assert causes(gets_on, WANTS) == [{Cause.DRIVING}]


def test_a_wall_between_two_robots_is_none_of_their_business() -> None:
    assert causes(tracks(at(4.6, 1.0), at(5.5, 1.0)), WANTS, WANTS) == [{Cause.NO_PROGRESS}] * 2


def test_what_comes_first_decides() -> None:
    away = at(2.0, 2.5)
    lost = tracks(at(2.0, 1.0), at(2.4, 1.0), held=np.stack([away, at(2.4, 1.0)], axis=1))
    assert causes(lost, WANTS, WANTS)[0] == {Cause.LOST}
    assert causes(lost, IDLE, WANTS)[0] == {Cause.IDLE}
    off = tracks(at(2.0, 1.0), at(2.4, 1.0))
    off.stepping[100:, 0] = False
    assert causes(off, WANTS, WANTS) == [{Cause.DEADLOCK, Cause.OFF}, {Cause.DEADLOCK, Cause.NO_PROGRESS}]
    in_wall = tracks(at(2.0, 1.0), held=np.stack([at(2.0, 0.01)], axis=1))
    assert causes(in_wall, WANTS) == [{Cause.NO_PLAN}]
    planless = Said(goals=GOAL, planless=((0, STEPS * STEP),))
    assert causes(tracks(at(2.0, 1.0)), planless) == [{Cause.NO_PLAN}]
    assert causes(tracks(driving(2.0, 1.0)), WANTS) == [{Cause.DRIVING}]
    settled = tracks(at(2.0, 1.0))
    settled.busy[:] = False
    assert causes(settled, WANTS) == [{Cause.IDLE}]


def test_a_robot_whose_strategy_pauses_waits_on_purpose_whatever_is_in_its_way() -> None:
    pauses = Said(goals=GOAL, paused=((seconds(10), seconds(20)), (seconds(29), None)))
    pair = tracks(at(2.0, 1.0), at(2.43, 1.0))
    found = classified(pair, pauses, WANTS)
    assert found.is_(Cause.ON_PURPOSE).sum(axis=0).tolist() == [110, 110], "also who waits for it"
    assert found.is_(Cause.DEADLOCK).sum(axis=0).tolist() == [190, 190]
    assert not found.stood[100:200, 0].any() and found.stood[:100, 0].all()
    short = Said(goals=GOAL, paused=((seconds(1), seconds(2)),))
    assert classified(tracks(driving(2.0, 1.0)), short).is_(Cause.ON_PURPOSE).sum() == 10
    assert causes(tracks(at(2.0, 1.0)), replace(pauses, goals=())) == [{Cause.STRATEGY_IDLE}], (
        "without a goal"
    )


def test_a_turn_on_the_spot_is_driving_and_so_is_a_short_pause() -> None:
    alone = driving(2.0, 1.0)
    alone[50:129] = alone[50]
    assert causes(tracks(alone), WANTS) == [{Cause.DRIVING}]
    before = tracks(alone, at(alone[50, 0] + 0.8, 1.5))
    assert causes(before, WANTS, BACK)[0] == {Cause.DRIVING, Cause.DEADLOCK}


def test_a_blocking_has_instants_robots_place_and_cause() -> None:
    one = driving(1.0, 3.0)
    one[100:200] = one[100]
    other = at(0.0, 3.0)
    other[:, 0] = 2 * one[100, 0] + 1.3 - one[:, 0]
    other[200:, 1] += 0.02 * np.arange(100)
    pair = tracks(one, other)
    (event,) = blocking_events(pair, classified(pair, WANTS, WEST), STANDARD)
    assert (event.robots, event.place, event.cause) == (("r1", "r2"), "open floor", Cause.DEADLOCK.value)
    assert event.begin_s == pytest.approx(9.0, abs=0.5) and event.end_s == pytest.approx(20.6, abs=0.7)
    assert not event.at_end


def test_pairs_in_a_deadlock_are_counted_and_whether_they_come_free() -> None:
    one, other = at(2.0, 1.0), at(2.4, 1.0)
    other[200:, 0] += 0.02 * np.arange(100)
    for pair, free in ((tracks(one, at(2.4, 1.0)), 0), (tracks(one, other), 1)):
        assert deadlocks(pair, classified(pair, WANTS, WANTS), STANDARD) == DeadlockCount(1, free)


def test_the_diagnosis_is_scored_by_time() -> None:
    one = driving(1.0, 1.0)
    one[100:200] = one[100]
    pair = tracks(one, at(4.0, 1.0))
    spells = ((seconds(1), seconds(2)), (seconds(15), seconds(20)))
    said = {"r1": Said(goals=GOAL, blocked=spells), "r2": IDLE}
    found = classify(pair, said, floor())
    score = diagnosis_score(pair, said, found)
    assert score is not None and (score.spells, score.noticed, score.false_alarms) == (1, 1, 1)
    assert score.precision == pytest.approx(5 / 6, abs=0.01)
    assert score.recall == pytest.approx(0.45, abs=0.01) and score.delay_s == pytest.approx(6.2, abs=0.2)
    assert diagnosis_score(pair, {"r1": WANTS, "r2": IDLE}, found) is None


def decision(at_s: float, new: tuple[float, float] | None) -> SaidDecision:
    return SaidDecision(seconds(at_s), "A.unblock", "turns elsewhere", "r1", 0, (9.0, 3.0), new)


@pytest.mark.parametrize(
    ("moves_from", "again_from", "new", "outcome", "free"),
    [
        (220, STEPS, (9.0, 3.0), "free", 2.0),
        (220, 250, (9.0, 3.0), "blocked again", 2.0),
        (STEPS, STEPS, (9.0, 3.0), "end", None),
        (220, STEPS, (2.0, 2.0), "visited", 2.0),
    ],
)
def test_what_came_of_a_decision(
    moves_from: int, again_from: int, new: tuple[float, float], outcome: str, free: float | None
) -> None:
    one = at(2.0, 1.0)
    one[moves_from:again_from, 1] += 0.02 * np.arange(again_from - moves_from)
    one[again_from:] = one[again_from - 1]
    pair = tracks(one, at(2.9, 1.6))
    pair.busy[:, 1] = False
    said = {"r1": Said(goals=GOAL, decisions=(decision(20.0, new),)), "r2": IDLE}
    (event,) = decision_events(pair, said, classify(pair, said, floor()), STANDARD)
    assert event.outcome == outcome and event.blocked_s == pytest.approx(20.1)
    assert event.free_after_s == (None if free is None else pytest.approx(free, abs=0.6))


def test_a_decision_is_overtaken_by_the_next_one() -> None:
    still = tracks(at(2.0, 1.0), at(3.0, 1.0))
    both = (decision(10.0, (9.0, 3.0)), decision(15.0, None))
    said = {"r1": Said(goals=GOAL, decisions=both), "r2": IDLE}
    found = decision_events(still, said, classify(still, said, floor()), STANDARD)
    assert [one.outcome for one in found] == ["overtaken", "end"]


def test_no_contact_is_who_hears_nobody_while_others_within_reach_have_frames_to_send() -> None:
    pair = tracks(at(2.0, 1.0), at(4.0, 1.0), at(8.0, 1.0))
    jammed = replace(pair, jams=(TimedJam(0, Jam(2.5, 1.0, 1.0, seconds(4))),))
    sent, heard = (np.zeros((STEPS, 3), np.int64) for _ in range(2))
    sent[::10], heard[5::10] = 1, 1
    heard[100:180, :2] = 0
    found = findings(jammed, FrameCounts(sent, heard), floor().passages, STANDARD)
    assert [(one.name, one.robots) for one in found] == [("no contact", ("r1",)), ("no contact", ("r2",))]
    assert found[0].says == "r1 heard nobody from 9.6 s to 18.5 s, with r2 within 5 m"
    sent[:, 1] = 0
    assert [one.robots for one in findings(pair, FrameCounts(sent, heard), floor().passages, STANDARD)] == [
        ("r2",)
    ]
    heard[:] = 0
    (deaf,) = findings(jammed, FrameCounts(sent, heard), floor().passages, STANDARD)
    assert deaf.robots == ("r2",), "r3 stands behind a wall"


def test_the_time_of_a_run_adds_up_to_the_microsecond(tmp_path: Path) -> None:
    scenario = replace(situations.head_on_floor(1), duration=4.1).scenario()
    swarm.run(scenario, RunOptions(tmp_path / "out", bus="memory", json=True))
    for each in account(tmp_path / "out").robots.values():
        assert list(each) == [cause.value for cause in Cause]
        assert sum(round(lasted * 1e6) for lasted in each.values()) == 4_100_000
    told = CliRunner().invoke(app, ["causes", str(tmp_path / "out"), "--json"])
    assert json.loads(told.output)["robots"]["r1"]["deadlock"] == 4.1
    assert "deadlock" in CliRunner().invoke(app, ["causes", str(tmp_path / "out")]).output


def test_a_folder_without_a_run_is_said_to_be_none(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no run's folder"):
        account(tmp_path)
