"""Causes of lost time on synthetic tracks, in planted and in quiet situations."""

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from acrc_testbed.command_line.app import app
from acrc_testbed.explanation.cause_classification import (
    CAUSES,
    CauseTable,
    blocking_events,
    classify,
    deadlocks,
)
from acrc_testbed.explanation.time_accounting import account_time, decision_events, diagnosis_score
from acrc_testbed.explanation.time_spent import Cause, DeadlockCount, TimeSpent
from acrc_testbed.explanation.true_floor import TrueFloor
from acrc_testbed.run_model.data import RobotReport, RunData
from acrc_testbed.run_model.floor import FloorObject, FloorState
from acrc_testbed.run_model.simulated_runs import read_run
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.instant import seconds
from actors.messages import TaskEvent
from actors.randomness import generator
from actors.robot.behaviour.decisions import AdaptationDecision
from actors.robot.navigation.navigation_counts import GoalRecord
from actors.runtime.recording import RecordingError
from cleaning.task import CleaningTask
from deploy.run import swarm
from deploy.run.options import RunOptions
from tests.experiments import situations
from tests.experiments.situations import NECKS, PLANTED, Plant, Robot, Situation, quiet
from tests.helpers import in_memory, in_order
from tests.run_data import run_data

Record = Callable[[str, object], None]
LEAST_S = 3.0
"""A cause is named if it has so much of a robot's time."""
UNDISTURBED = {Cause.DRIVING, Cause.IDLE, Cause.OFF, Cause.FROZEN}
FIRST_SEED = 1001
"""The parameters of the accounting were chosen on smaller seeds."""


def time_spent(situation: Situation) -> TimeSpent:
    with in_memory(situation.scenario()) as (plan, _):
        return account_time(plan.out)


def is_named(situation: Situation, spent: TimeSpent) -> bool:
    """Return whether the planted cause has most of the lost time, or is a finding."""
    if situation.found:
        return any(one.name == situation.found and one.robots == ("r1",) for one in spent.findings)
    return all(has_most(spent.robots[robot], cause) for robot, cause in situation.expected.items())


def disturbed(lasted: Mapping[str, float]) -> dict[str, float]:
    return {name: s for name, s in lasted.items() if Cause(name) not in UNDISTURBED}


def has_most(lasted: Mapping[str, float], cause: Cause) -> bool:
    lost = disturbed(lasted)
    return lost[cause.value] >= LEAST_S and lost[cause.value] == max(lost.values())


def is_invented(spent: TimeSpent) -> bool:
    lost = any(any(disturbed(each).values()) for each in spent.robots.values())
    return lost or bool(spent.blockings) or bool(spent.findings) or spent.deadlocks != DeadlockCount(0, 0)


@pytest.mark.claim("causes")
@pytest.mark.parametrize("plant", PLANTED)
def test_a_planted_cause_is_named(plant: Plant) -> None:
    situation = plant(3)
    spent = time_spent(situation)
    assert is_named(situation, spent), spent


@pytest.mark.claim("causes")
def test_no_cause_is_invented() -> None:
    spent = time_spent(quiet(3))
    assert not is_invented(spent), spent


@pytest.mark.claim("causes")
@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_nearly_all_planted_causes_are_named(full: bool, record_property: Record) -> None:
    count = 200 if full else len(PLANTED)
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    planted = [plant(seed) for seed in seeds for plant in PLANTED][:count]
    spent = list(in_order(time_spent, [*planted, *map(quiet, seeds)]))
    pairs = list(zip(planted, spent[:count], strict=True))
    missed = [f"{one.kind}, seed {one.seed}" for one, found in pairs if not is_named(one, found)]
    record_property("planted", dict(Counter(one.kind for one in planted)))
    record_property("missed", missed)
    assert len(missed) <= 0.05 * count
    assert not any(map(is_invented, spent[count:]))


def head_on(in_passage: bool, gap: tuple[float, float], seed: int) -> tuple[Robot, Robot]:
    """Two robots head-on, each with its place behind the other one; `gap`: between their centres, m."""
    draw = generator(seed, "causes", "w1" if in_passage else "w2")
    if in_passage:
        x, y = NECKS[int(draw.integers(2))], draw.uniform(8.6, 10.0)
        apart = draw.uniform(*gap)
        return Robot((x, y, math.pi / 2), [(x, 12.3)]), Robot((x, y + apart, -math.pi / 2), [(x, 4.0)])
    x, y = draw.uniform(8, 11), draw.uniform(12, 13)
    apart = draw.uniform(*gap)
    west, east = (max(x - 3, 6.8), 12.4), (x + 8, 12.4)
    return Robot((x, y, 0.0), [east]), Robot((x + apart, y, math.pi), [west])


def comes_apart(situation: Situation) -> bool:
    with in_memory(situation.scenario({"back_off": True})) as (plan, _):
        true = read_run(plan.out).true
    return bool((np.hypot(*(true[:, 0, :2] - true[:, 1, :2]).T) > 1.0).any())


@pytest.mark.claim("wedged")
def test_robots_that_back_off_come_apart(full: bool, record_property: Record) -> None:
    gaps = ((0.36, 0.40), (0.40, 0.45))
    kinds = list(product((True, False), gaps, ("none", "chapter")))
    chosen = kinds if full else [(True, gaps[0], "none"), (False, gaps[1], "chapter")]
    situations = [
        Situation("wedge", seed, head_on(in_passage, gap, seed), 60.0, strategy)
        for in_passage, gap, strategy in chosen
        for seed in range(1, 6 if full else 2)
    ]
    free = list(in_order(comes_apart, situations, None if full else 1))
    record_property("came apart", f"{sum(free)} of {len(free)}")
    assert all(free)


STEP = 100_000
STEPS = 300
GOAL = (GoalRecord(0, 9.0, 3.0),)
WANTS = RobotReport(goals=GOAL)
BACK = RobotReport(goals=(GoalRecord(0, 1.0, 0.5),))
WEST = RobotReport(goals=(GoalRecord(0, 0.4, 3.0),))
IDLE = RobotReport()
SLEEPS = RobotReport(goals=())


def floor(*changes: tuple[int, FloorState]) -> TrueFloor:
    """10 m by 6 m; a wall at x = 5 with a door of 0.8 m around y = 3."""
    cells = np.full((120, 200), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    cells[:52, 100:102] = OCCUPIED
    cells[68:, 100:102] = OCCUPIED
    return TrueFloor(OccupancyGrid(cells, 0.05), 0.177, changes)


def at(x: float, y: float) -> NDArray[np.float64]:
    return np.tile([x, y, 0.0], (STEPS, 1))


def driving(x: float, y: float) -> NDArray[np.float64]:
    return np.column_stack([x + 0.008 * np.arange(STEPS), np.full(STEPS, y), np.zeros(STEPS)])


def tracks(*true: NDArray[np.float64], held: NDArray[np.float64] | None = None) -> RunData:
    together = np.stack(true, axis=1)
    always = np.ones(together.shape[:2], np.bool_)
    names = tuple(f"r{number}" for number in range(1, len(true) + 1))
    said = together if held is None else held
    return run_data(
        names, STEP, true=together, estimated=said, commanded=together, stepping=always,
        items_left=always.astype(np.int64),
    )  # fmt: skip


def reporting(of: RunData, *reports: RobotReport) -> RunData:
    return replace(of, reports=dict(zip(of.robots, reports, strict=True)))


def classified(of: RunData, *said: RobotReport, changes: Sequence[tuple[int, FloorState]] = ()) -> CauseTable:
    """Who wants nothing, and has not been told to be asleep, has nothing left to do."""
    for robot, one in enumerate(said):
        of.items_left[:, robot] *= one is not IDLE
    return classify(reporting(of, *said), floor(*changes))


def causes(
    of: RunData, *said: RobotReport, changes: Sequence[tuple[int, FloorState]] = ()
) -> list[set[Cause]]:
    found = classified(of, *said, changes=changes).causes
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
def test_causes_of_waiting_for_the_first_robot(
    there: tuple[float, float], who: RobotReport, cause: Cause
) -> None:
    assert causes(tracks(at(2.0, 1.0), at(*there)), WANTS, who)[0] == {cause}


def test_a_queue_behind_a_moving_robot_waits_at_the_door() -> None:
    found = classified(tracks(driving(4.6, 3.0), at(3.9, 3.0)), WANTS, WANTS)
    assert CAUSES[found.causes[0, 1]] is Cause.DOOR and CAUSES[found.causes[0, 0]] is Cause.DRIVING


def test_stages_follow_the_recorded_floor_and_jammers_make_none() -> None:
    shut = FloorObject("closed door", ((5.05, 2.6), (5.05, 3.4)), 0.05)
    jammer = FloorObject("jammer", ((1.0, 1.0),), 2.0)
    stages = floor((5, (jammer,)), (30, (jammer, shut)), (40, (shut,)), (50, ())).stages()
    assert [(one.begin, len(one.leaves) > 0) for one in stages] == [(0, False), (30, True), (50, False)]
    here, there = np.array([[2.0, 3.0]]), (8.0, 3.0)
    assert [bool(np.isfinite(one.paths.lengths(here, there))[0]) for one in stages] == [True, False, True]
    assert all(np.isfinite(one.opened.lengths(here, there)[0]) for one in stages)


def test_the_first_applicable_cause_counts() -> None:
    away = at(2.0, 2.5)
    lost = tracks(at(2.0, 1.0), at(2.4, 1.0), held=np.stack([away, at(2.4, 1.0)], axis=1))
    assert causes(lost, WANTS, WANTS)[0] == {Cause.LOST}
    assert causes(lost, IDLE, WANTS)[0] == {Cause.IDLE}
    off = tracks(at(2.0, 1.0), at(2.4, 1.0))
    off.stepping[100:, 0] = False
    assert causes(off, WANTS, WANTS) == [{Cause.DEADLOCK, Cause.OFF}, {Cause.DEADLOCK, Cause.NO_PROGRESS}]
    in_wall = tracks(at(2.0, 1.0), held=np.stack([at(2.0, 0.01)], axis=1))
    assert causes(in_wall, WANTS) == [{Cause.NO_PLAN}]
    planless = RobotReport(goals=GOAL, planless=((0, STEPS * STEP),))
    assert causes(tracks(at(2.0, 1.0)), planless) == [{Cause.NO_PLAN}]
    assert causes(tracks(driving(2.0, 1.0)), WANTS) == [{Cause.DRIVING}]
    apart = tracks(at(4.6, 1.0), at(5.5, 1.0))
    assert causes(apart, WANTS, WANTS) == [{Cause.NO_PROGRESS}] * 2, "with a wall between them"


def test_causes_of_the_task_override_others_but_not_off() -> None:
    task = msgspec.structs.replace(
        CleaningTask.declaration, causes={"charges": ("#4f5a70", ""), "off": ("", "")}
    )
    of = tracks(at(2.0, 1.0), at(2.4, 1.0))
    of.stepping[250:, 0] = False
    events = TaskEvent("r1", 0, "charges"), TaskEvent("r1", 5, "cleaned"), TaskEvent("r1", 200 * STEP, "")
    of = replace(
        of,
        description=replace(of.description, task=task),
        task_events=(*events, TaskEvent("r1", 270 * STEP, "charges")),
    )
    found = classified(of, WANTS, WANTS)
    assert found.names == (*CAUSES, "charges")
    named = [[found.names[one] for one in found.causes[:, robot].tolist()] for robot in (0, 1)]
    assert [*dict.fromkeys(named[0])] == ["charges", Cause.DEADLOCK, Cause.OFF]
    assert named[0].count("charges") == 200 and not found.stood[:200, 0].any()
    assert [*dict.fromkeys(named[1])] == [Cause.OPEN_FLOOR, Cause.DEADLOCK, Cause.NO_PROGRESS]


def test_a_blocking_has_instants_robots_place_and_cause() -> None:
    one = driving(1.0, 3.0)
    one[100:200] = one[100]
    other = at(0.0, 3.0)
    other[:, 0] = 2 * one[100, 0] + 1.3 - one[:, 0]
    other[200:, 1] += 0.02 * np.arange(100)
    pair = tracks(one, other)
    (event,) = blocking_events(pair, classified(pair, WANTS, WEST))
    assert (event.robots, event.place, event.cause) == (("r1", "r2"), "open floor", Cause.DEADLOCK.value)
    assert event.begin_s == pytest.approx(9.0, abs=0.5) and event.end_s == pytest.approx(20.6, abs=0.7)
    assert not event.at_end


def test_deadlocked_pairs_are_counted_with_their_resolution() -> None:
    one, other = at(2.0, 1.0), at(2.4, 1.0)
    other[200:, 0] += 0.02 * np.arange(100)
    for pair, free in ((tracks(one, at(2.4, 1.0)), 0), (tracks(one, other), 1)):
        assert deadlocks(pair, classified(pair, WANTS, WANTS)) == DeadlockCount(1, free)


def test_the_diagnosis_is_scored_by_time() -> None:
    one = driving(1.0, 1.0)
    one[100:200] = one[100]
    pair = tracks(one, at(4.0, 1.0))
    spells = ((seconds(1), seconds(2)), (seconds(15), seconds(20)))
    pair = reporting(pair, RobotReport(goals=GOAL, blocked=spells), IDLE)
    found = classify(pair, floor())
    score = diagnosis_score(pair, found)
    assert score is not None and (score.spells, score.noticed, score.false_alarms) == (1, 1, 1)
    assert score.precision == pytest.approx(5 / 6, abs=0.01)
    assert score.recall == pytest.approx(0.45, abs=0.01) and score.delay_s == pytest.approx(6.2, abs=0.2)
    assert diagnosis_score(reporting(pair, WANTS, IDLE), found) is None


def decision(at_s: float, new: tuple[float, float] | None) -> AdaptationDecision:
    return AdaptationDecision(seconds(at_s), "A.unblock", "changes destination", "r1", 0, (9.0, 3.0), new)


@pytest.mark.parametrize(
    ("moves_from", "again_from", "new", "outcome", "free"),
    [
        (220, STEPS, (9.0, 3.0), "free", 2.0),
        (220, 250, (9.0, 3.0), "blocked again", 2.0),
        (STEPS, STEPS, (9.0, 3.0), "end", None),
        (220, STEPS, (2.0, 2.0), "visited", 2.0),
    ],
)
def test_outcomes_of_a_decision(
    moves_from: int, again_from: int, new: tuple[float, float], outcome: str, free: float | None
) -> None:
    one = at(2.0, 1.0)
    one[moves_from:again_from, 1] += 0.02 * np.arange(again_from - moves_from)
    one[again_from:] = one[again_from - 1]
    pair = tracks(one, at(2.9, 1.6))
    pair.busy[:, 1] = False
    pair = reporting(pair, RobotReport(goals=GOAL, decisions=(decision(20.0, new),)), IDLE)
    (event,) = decision_events(pair, classify(pair, floor()))
    assert event.outcome == outcome and event.blocked_s == pytest.approx(20.1)
    assert event.free_after_s == (None if free is None else pytest.approx(free, abs=0.6))


def test_a_decision_is_superseded_by_the_next_one() -> None:
    still = tracks(at(2.0, 1.0), at(3.0, 1.0))
    both = (decision(10.0, (9.0, 3.0)), decision(15.0, None))
    still = reporting(still, RobotReport(goals=GOAL, decisions=both), IDLE)
    found = decision_events(still, classify(still, floor()))
    assert [one.outcome for one in found] == ["superseded", "end"]


def test_the_time_of_a_run_adds_up_to_the_microsecond(tmp_path: Path) -> None:
    scenario = replace(situations.head_on_floor(1), duration=4.1).scenario()
    swarm.run(scenario, RunOptions(tmp_path / "out", bus="memory", json=True))
    for each in account_time(tmp_path / "out").robots.values():
        assert sum(round(lasted * 1e6) for lasted in each.values()) == 4_100_000
    told = CliRunner().invoke(app, ["causes", str(tmp_path / "out"), "--json"])
    assert json.loads(told.output)["robots"]["r1"]["deadlock"] == 4.1
    assert "deadlock" in CliRunner().invoke(app, ["causes", str(tmp_path / "out")]).output
    with pytest.raises(RecordingError, match="not a run folder"):
        account_time(tmp_path)
