"""Every quantity of results, accounting, report and export, recounted from the recorded messages.

The recordings are read message by message, and the strategy counts its own decisions; nothing here uses the
code that computes the quantities.
"""

import json
import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import pytest

from acrc_testbed.experiments.metrics import find_metric, task_metrics, value_of
from acrc_testbed.experiments.report.sections import COSTS
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.explanation.time_accounting import account_time
from acrc_testbed.explanation.time_spent import TimeSpent
from acrc_testbed.export import table_rows
from acrc_testbed.export.parquet_files import tables_of
from acrc_testbed.results.outcome import outcome_means as own_means
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.recording_readers import final_outcomes, messages_on, world_setup
from actors.installation.repository import REPOSITORY
from actors.messages import (
    DRIVE,
    RECEIVED,
    TRUTH,
    AccessFailure,
    Drive,
    FrameOverflow,
    FrameReceived,
    FrameSent,
    Truth,
)
from cleaning.task import CleaningTask
from tests.recorded_runs import record
from tests.recordings.counting import PAUSE

LENGTH, STEP = 20.0, 0.1
EVENTS = """
[[event]]
at = 5.0
kill = "r4"

[[event]]
at = 6.5
restart = "r4"

[[event]]
at = 8.0
freeze = "r3"

[[event]]
at = 12.0
thaw = "r3"

[[event]]
at = 4.0
give = "r1"
places = [[9.0, 12.0], [10.0, 12.0]]
"""
Key = tuple[str, int]
METRICS = task_metrics(CleaningTask.declaration)


@dataclass(frozen=True)
class Counted:
    result: RunResult
    time: TimeSpent
    truths: Sequence[Truth]
    drives: Sequence[tuple[str, Drive]]
    received: Sequence[tuple[str, Any]]
    """Transceiver events with their robots."""
    places: Mapping[Key, tuple[float, float]]
    given_at: Mapping[Key, float]
    tables: Mapping[str, list[dict[str, Any]]]
    own: Mapping[str, dict[str, int]]
    """Counters of the strategy, by process."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Counted:
    folder = tmp_path_factory.mktemp("counted")
    text, out = (REPOSITORY / "scenarios" / "corridor.toml").read_text() + EVENTS, folder / "out"
    result = record(out, text, duration=LENGTH, seed=3, strategy="tests.recordings.counting:behaviour")
    setup = world_setup(out / "world" / "world.mcap")
    places = {(body.id, n): place for body in setup.robots for n, place in enumerate(body.items)}
    given = dict.fromkeys(places, 0.0)
    own = len(setup.robots[0].items)
    for number, place in enumerate(((9.0, 12.0), (10.0, 12.0))):
        places["r1", own + number], given["r1", own + number] = place, 4.0
    robots = {path.stem: path for path in out.glob("r[0-9]/*.mcap")}
    found = table_rows.tables(out)
    return Counted(
        own={
            name: msgspec.json.decode(final_outcomes(path)["counted"], type=dict[str, int])
            for name, path in robots.items()
        },
        result=result,
        time=account_time(out),
        truths=[truth for _, truth in messages_on(out / "radio" / "radio.mcap", TRUTH) if not truth.halt],
        drives=list(messages_on(out / "world" / "world.mcap", DRIVE)),
        received=[
            (path.parent.name, event)
            for path in robots.values()
            for _, message in messages_on(path, RECEIVED)
            for event in message.events
        ],
        places=places,
        given_at=given,
        tables={
            table.name: [
                dict(zip([one.name for one in table.columns], row, strict=True))
                for row in found.rows[table.name]
            ]
            for table in tables_of(found.task)
        },
    )


def reported(run: Counted) -> dict[Key, float]:
    """Return the time of the first report of each place, s."""
    found: dict[Key, float] = {}
    for _, drive in run.drives:
        for report in drive.reports:
            owner, number, instant = report
            at = instant / 1e6
            found[owner, number] = min(at, found.get((owner, number), at))
    return found


def reached(run: Counted) -> dict[Key, float]:
    """Return the time at which a robot was first within reach of each place, s."""
    found: dict[Key, float] = {}
    for truth in run.truths:
        for key, (x, y) in run.places.items():
            near = any(math.hypot(one.x - x, one.y - y) <= 0.7 for one in truth.robots)
            if near and key not in found and truth.instant / 1e6 >= run.given_at[key]:
                found[key] = truth.instant / 1e6
    return found


def test_places_are_those_reported_and_reached(run: Counted) -> None:
    result, when, there = run.result, reported(run), reached(run)
    done = {key for key, at in when.items() if there.get(key, math.inf) <= at}
    given_up = {(one.owner, one.number) for _, drive in run.drives for one in drive.given_up} - when.keys()
    assert len(done) > 3
    assert (result.task["places_total"], result.task["places_done"]) == (len(run.places), len(done))
    assert (result.task["places_claimed"], result.task["places_given_up"]) == (len(when), len(given_up))
    assert value_of(METRICS["places"], result) == len(done)
    assert result.task["last_reached_s"] == max(when.values())
    assert (result.task["completion_s"], result.task["settled_s"]) == (None, None), "places are left"
    for robot, part in result.per_robot.items():
        own = {key for key in run.places if key[0] == robot}
        assert (part.task["places_total"], part.task["places_done"]) == (len(own), len(done & own))
        claimed = part.task["places_claimed"], part.task["places_given_up"]
        assert claimed == (len(when.keys() & own), len(given_up & own))
        assert part.task["completion_s"] is None or own <= done
    rows_of = {(row["owner"], row["place"]): row for row in run.tables["places"]}
    for key in run.places:
        row = rows_of[key]
        assert (row["reported"], row["reached"]) == (when.get(key), there.get(key))
        assert (row["given"], row["verdict"] == "done") == (run.given_at[key], key in done)


def costs(run: Counted) -> dict[str, float | None]:
    record = TrialRecord("auction", 3, {}, run.result, time=run.time)
    return {name: measure(run.result, record) for name, measure in COSTS.items()}


def test_lost_places_are_in_no_final_route(run: Counted) -> None:
    routes = {robot: {key for key in run.places if key[0] == robot} for robot in run.result.per_robot}
    restarts = [
        truth.step for truth in run.truths if next(r for r in truth.robots if r.id == "r4").epoch == 1
    ]
    begun = False
    for robot, drive in run.drives:
        if robot == "r4" and drive.step >= restarts[0] and not begun:
            begun, routes["r4"] = True, {key for key in run.places if key[0] == "r4"}
        if drive.route is not None:
            routes[robot] = {(key.owner, key.number) for key in drive.route}
    spoken = reported(run).keys() | {(o.owner, o.number) for _, drive in run.drives for o in drive.given_up}
    lost = run.places.keys() - spoken - set().union(*routes.values())
    assert run.result.task["places_lost"] == len(lost)


def test_adoptions_are_decisions_by_which_a_route_has_a_place_more(run: Counted) -> None:
    def keys(route: str) -> set[Key]:
        return {(one["owner"], one["index"]) for one in json.loads(route)}

    adoptions = [
        row
        for row in run.tables["knowledge"]
        if row["field"] == "route" and row["adaptation"] and keys(row["after"]) - keys(row["before"])
    ]
    assert costs(run)["adoptions in a run"] == len(adoptions) > 5
    assert len(adoptions) == run.result.deeco.exchanges["Auction"], "by this strategy's ensemble"
    assert sum(run.result.deeco.exchanges.values()) > len(adoptions), "others leave what was taken"


def test_exchanges_are_those_of_the_results(run: Counted) -> None:
    made = {(row["process"], row["change"]): row["ensemble"] for row in run.tables["exchanges"]}
    assert run.result.deeco.exchanges == Counter(name.partition(".")[0] for name in made.values())
    seen = {(row["process"], row["change"]) for row in run.tables["knowledge"]}
    assert made.keys() <= seen


def test_frames_match_transceiver_events(run: Counted) -> None:
    kinds = Counter(type(event).__name__ for _, event in run.received)
    result, frames = run.result, run.result.frames
    rows_of = run.tables["frames"]
    sent = {row["frame"]: row["size"] for row in rows_of if row["fate"] == "sent"}
    assert frames["frames_sent"] == len(sent) > 50
    assert frames["bytes_sent"] == sum(size + 9 for size in sent.values())
    assert frames["copies_heard"] == sum(row["copy"] == "heard" for row in rows_of)
    # messages of the last step, and those to a robot that is off or frozen, are not delivered
    for name, most in (
        (FrameSent.__name__, frames["frames_sent"]),
        (FrameReceived.__name__, frames["copies_heard"]),
    ):
        assert 0.9 * most <= kinds[name] <= most
    assert kinds[AccessFailure.__name__] <= frames["frames_access_failure"]
    assert kinds[FrameOverflow.__name__] <= frames["frames_overflowed"]
    for name in ("frames_sent", "copies_heard"):
        assert frames[name] == sum(own[name] for own in result.frames_by_robot.values())
    assert result.radio_bytes_per_robot_s == pytest.approx(frames["bytes_sent"] / 4 / LENGTH, abs=1e-3)
    assert value_of(METRICS["radio"], result) == pytest.approx(frames["bytes_sent"] / 4 / LENGTH, abs=1e-3)
    air = sum((6 + size + 9) * 32e-6 for size in sent.values())
    assert costs(run)["air time of a robot, % of the time"] == pytest.approx(100 * air / (4 * LENGTH))
    heard = Counter(robot for robot, event in run.received if isinstance(event, FrameReceived))
    for robot, own in result.frames_by_robot.items():
        assert 0.9 * own["copies_heard"] <= heard[robot] <= own["copies_heard"]


def test_paths_and_errors_match_poses(run: Counted) -> None:
    way, errors = defaultdict[str, float](float), defaultdict[str, list[float]](list)
    for before, after in zip(run.truths, run.truths[1:], strict=False):
        for one, other in zip(before.robots, after.robots, strict=True):
            way[one.id] += math.hypot(other.x - one.x, other.y - one.y)
    true = {(truth.step, one.id): one for truth in run.truths for one in truth.robots}
    for robot, drive in run.drives:
        if drive.pose is not None:
            one = true[drive.step, robot]
            errors[robot].append(math.hypot(drive.pose[0] - one.x, drive.pose[1] - one.y))
    for robot, part in run.result.per_robot.items():
        assert part.driven_m == pytest.approx(way[robot], rel=0.02, abs=0.05)
        found = part.pose_error
        assert found.samples == len(errors[robot])
        assert found.greatest == pytest.approx(max(errors[robot]))
        assert found.rmse == pytest.approx(np.sqrt(np.mean(np.square(errors[robot]))))
        assert found.lost_share == pytest.approx(np.mean(np.array(errors[robot]) > 1.0))
    assert run.result.driven_m == pytest.approx(sum(way.values()), rel=0.02)
    made = run.result
    assert value_of(METRICS["driven"], made) == run.result.driven_m
    assert value_of(METRICS["contacts"], made) == run.result.contacts
    assert (made.task["settled_s"], made.task["completion_s"], made.simulated_s) == (None, None, LENGTH)
    assert run.result.simulated_s == LENGTH == len(run.truths) * STEP
    assert len(run.tables["poses"]) == 4 * len(run.truths)
    row = next(row for row in run.tables["poses"] if (row["robot"], row["step"]) == ("r1", 100))
    assert (row["x"], row["y"]) == (true[100, "r1"].x, true[100, "r1"].y)
    said = [row["error"] for row in run.tables["estimates"] if row["robot"] == "r1"]
    assert said == pytest.approx(errors["r1"])


def test_goals_and_outcomes_match_the_strategys_counts(run: Counted) -> None:
    own = run.result.outcome
    assert own["robot"] == {robot: robot for robot in run.result.per_robot}
    goals = run.result.navigation
    assert goals.goals == sum(each["goals"] for each in run.own.values()) > 4
    statuses = Counter(row["reason"] or row["status"] for row in run.tables["goals"])
    assert (goals.succeeded, goals.aborted.get("blocked", 0)) == (statuses["succeeded"], statuses["blocked"])
    steps = Counter(
        one.id
        for truth in run.truths
        for one in truth.robots
        if one.stepping and (one.id, one.epoch) != ("r4", 0)
    )
    assert own["counted.steps"] == dict(steps)
    means = own_means(run.result.outcome)
    assert means["counted.steps"] == pytest.approx(np.mean(list(steps.values()))) and "robot" not in means
    counted = find_metric("outcome.counted.steps", METRICS)
    assert counted is not None and value_of(counted, run.result) == means["counted.steps"]


def test_seconds_of_causes_are_those_of_the_steps(run: Counted) -> None:
    for robot, spent in run.time.robots.items():
        mine = [one for truth in run.truths for one in truth.robots if one.id == robot]
        assert math.fsum(spent.values()) == pytest.approx(LENGTH)
        assert spent["off"] == pytest.approx(STEP * sum(not one.powered for one in mine))
        frozen = sum(one.powered and not one.stepping for one in mine)
        assert spent["frozen"] == pytest.approx(STEP * frozen)
        pause = (PAUSE[1] - PAUSE[0]) / 1e6 if robot == "r2" else 0.0
        assert spent["waits on purpose"] == pytest.approx(pause, abs=STEP)
    assert run.time.robots["r3"]["frozen"] > 3 and run.time.robots["r4"]["off"] > 1


def test_decisions_and_costs_are_those_of_the_tables(run: Counted) -> None:
    told = run.tables["decisions"]
    assert sorted((one.instant_s, one.robot, one.words) for one in run.time.decisions) == sorted(
        (row["seconds"], row["robot"], row["words"]) for row in told
    )
    found = costs(run)
    assert found["decisions of the adaptation in a run"] == len(told) > 10
    assert found["contacts in a run"] == run.result.contacts
    assert found["metres driven by all robots"] == run.result.driven_m
    assert found["CPU, ms per robot and simulated s"] == pytest.approx(1000 * run.result.cpu_s / 4 / LENGTH)
    assert found["age of replicas, s"] == run.result.deeco.replica_age_mean_s
    freed = [one.blocked_s + one.free_after_s for one in run.time.decisions if one.free_after_s is not None]
    assert found["time from blocked to driving on, s"] == (pytest.approx(np.mean(freed)) if freed else None)
