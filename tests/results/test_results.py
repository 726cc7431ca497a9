"""Robots' own reports are counted if well formed, else named; sums over robots."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from acrc_testbed.results.outcome import (
    DeecoResult,
    OutcomeError,
    Outcomes,
    decode_subject,
    deeco_result,
    navigation_result,
    outcome_means,
)
from acrc_testbed.results.result import RobotReports, robot_reports
from actors.robot.behaviour.decisions import NodeReport
from actors.robot.navigation.navigation_counts import NavigationReport
from actors.runtime.process import FinalNote
from actors.runtime.shell import MessageHash
from deeco.instant import Instant, in_seconds, milliseconds
from deeco.statistics import Statistics

RECORD = Path("out/r1/r1.mcap")
NAVIGATION: dict[str, Any] = {
    "goals": 3,
    "succeeded": 1,
    "cancelled": 1,
    "recoveries": 2,
    "retreats": 0,
    "aborted": {"blocked": 1, "no plan": 0, "no progress": 0},
    "no_valid_trajectory": [[1_000_000, 2_000_000, "abort"]],
    "no_valid_trajectory_unlisted": 0,
    "given": [{"begin": 0, "x": 1.0, "y": 2.0, "end": 100_000, "how": "replaced"}],
    "given_unlisted": 0,
    "without_plan": [[0, 100_000]],
    "paused": [[0, 100_000], [200_000, None]],
}
NODE: dict[str, Any] = {
    "counters": {"published": 20, "frames_sent": 20, "packets": 30},
    "exchanges": {"Adoption": 2},
    "replica_age_ms": {"50": 3},
}


def reports(
    navigation: object = None, node: object = None, unread: int = 0, own: dict[str, Any] | None = None
) -> RobotReports:
    said = {"navigation": navigation or NAVIGATION, "deeco": node or NODE, "adaptation": {}, **(own or {})}
    final = FinalNote(
        MessageHash().digest("r1"), 0, 5, unread, 1.0, 0.5, 0.0, 1.0, {}, {"swarm/down/r1/senses": 5},
        {name: msgspec.Raw(json.dumps(value).encode()) for name, value in said.items()},
    )  # fmt: skip
    return robot_reports([("r1", RECORD, final)])


def test_valid_reports_are_counted() -> None:
    found = reports(unread=5)
    assert found.refused == ()
    assert (found.navigation.goals, found.deeco.counters["packets"], found.unread) == (3, 30, 5)


FORMLESS = (
    NAVIGATION | {"goals": -1},
    NAVIGATION | {"goals": 1.5},
    NAVIGATION | {"goals": 1 << 60},
    NAVIGATION | {"goals": "many"},
    NAVIGATION | {"applause": 1},
    NAVIGATION | {"given": [{"begin": 0, "x": 1e300, "y": 0.0}]},
    NAVIGATION | {"given": [{"begin": 0, "x": float("nan"), "y": 0.0}]},
    NAVIGATION | {"without_plan": [[0, 0]] * 10_001},
    NAVIGATION | {"no_valid_trajectory": [[0, 1, "magic"]]},
    [NAVIGATION],
)


@pytest.mark.parametrize("report", FORMLESS, ids=lambda one: str(one)[-60:])
def test_malformed_reports_are_named_and_not_counted(report: object) -> None:
    found = reports(report)
    assert len(found.refused) == 1 and found.navigation.goals == 0
    assert found.refused[0].startswith(
        "r1: malformed navigation report, not counted: "
        f"{RECORD}: outcome 'navigation' is not that of a robot's navigation: "
    )
    assert "\n" not in found.refused[0] and len(found.refused[0]) < 400


def test_numbers_texts_and_booleans_of_a_behaviour_are_its_own_outcome() -> None:
    own = {
        "tokens": {"taken": 3, "share": 0.5, "list": [1]}, "done": True, "note": "=1", "nothing": None,
    }  # fmt: skip
    found = reports(own=own)
    assert found.refused == ()
    kept = {"done": True, "note": "=1", "tokens.share": 0.5, "tokens.taken": 3}
    assert found.outcomes == {name: {"r1": value} for name, value in kept.items()}
    two: Outcomes = {"a": {"r1": 1, "r2": 2.0}, "b": {"r1": True, "r2": False}, "c": {"r1": "x"}}
    assert outcome_means(two) == {"a": 1.5, "b": 0.5}


OUT_OF_BOUNDS: dict[str, dict[str, Any]] = {
    "outcome has 21 values; must have at most 20": {f"n{number}": 1 for number in range(21)},
    "outcome has 1 values; must have at most 20, with names of at most 100": {"x" * 101: 1},
    "outcome 'note' is not that of a behaviour: it is": {"note": "x" * 201},
    "outcome 'count' is not that of a behaviour: it is": {"count": 1 << 60},
    "outcome 'deep' is not that of a behaviour: [": {"deep": {"x": {"y": 1}}},
    "outcome 'gap' is not that of a behaviour: JSON is malformed": {"gap": math.nan},
}


@pytest.mark.parametrize("why", OUT_OF_BOUNDS)
def test_an_outcome_above_the_limits_is_named_and_not_counted(why: str) -> None:
    found = reports(own=OUT_OF_BOUNDS[why])
    (refused,) = found.refused
    assert refused.startswith("r1: malformed outcome report, not counted: ") and why in refused
    assert found.outcomes == {} and found.navigation.goals == 3


def said(**values: object) -> dict[str, msgspec.Raw]:
    """Return the outcome in the final record of a robot with a node."""
    whole = {"counters": {}, "exchanges": {}, "replica_age_ms": {}} | values
    return {"other": msgspec.Raw(b"[]"), "deeco": msgspec.Raw(msgspec.json.encode(whole))}


def ages(**counts: int) -> NodeReport:
    """Return a report with replica ages; `b100=3`: three in the bin from 50 to 100 ms."""
    return NodeReport({}, {}, {int(bound[1:]): count for bound, count in counts.items()})


def test_counters_and_exchanges_add_up_over_the_nodes() -> None:
    one = NodeReport({"commits": 2, "published": 5}, {"Swap": 1, "Avoid": 2}, {})
    other = NodeReport({"commits": 3, "relayed": 7}, {"Swap": 4}, {})
    assert deeco_result([one, other]) == DeecoResult(
        {"commits": 5, "published": 5, "relayed": 7}, {"Avoid": 2, "Swap": 5}, None, None
    )


def test_the_mean_age_takes_each_sample_in_the_middle_of_its_bin() -> None:
    result = deeco_result([ages(b50=3), ages(b50=1, b1000=4)])
    assert result.replica_age_mean_s == (4 * 0.025 + 4 * 0.975) / 8
    assert deeco_result([]) == deeco_result([ages(b50=0)]) == DeecoResult({}, {}, None, None)


@pytest.mark.parametrize(
    ("counts", "p95"),
    [
        ({"b50": 1}, 0.05),
        ({"b50": 19, "b1000": 1}, 0.05),  # the 19th of 20
        ({"b50": 18, "b1000": 2}, 1.0),
        ({"b50": 94, "b700": 1, "b1000": 5}, 0.7),
        ({"b100": 0, "b250": 20}, 0.25),
    ],
)
def test_95th_percentile_is_the_nearest_rank(counts: dict[str, int], p95: float) -> None:
    assert deeco_result([ages(**counts)]).replica_age_p95_s == p95


def test_counters_of_a_node_are_read_unchanged() -> None:
    statistics = Statistics()
    statistics.counters.commits = 4
    statistics.exchanges["Swap"] += 1
    true_ages = [milliseconds(age) for age in (0, 49, 50, 120, 999, 1000)]
    for age in true_ages:
        statistics.sample_ages([Instant(0)], Instant(age))
    said_by_node = {"deeco": msgspec.Raw(msgspec.json.encode(statistics.outcome()))}
    node = decode_subject(RECORD, said_by_node, "deeco", NodeReport, "a node")
    assert node is not None
    result = deeco_result([node])
    assert (result.counters["commits"], result.exchanges) == (4, {"Swap": 1})
    assert result.replica_age_mean_s == pytest.approx(in_seconds(sum(true_ages)) / 6, abs=0.025)
    assert result.replica_age_p95_s == 1.05


@pytest.mark.parametrize(
    ("values", "fault"),
    [
        ({"counters": {"commits": 1.5}}, "counters[…] is wrong, but must be a whole number"),
        ({"exchanges": [1]}, "exchanges is [1], but must be an object"),
        (
            {"replica_age_ms": {"0": 1}},
            "a key of replica_age_ms is wrong, but must be a whole number of at least 1",
        ),
        (
            {"replica_age_ms": {"50": -1}},
            "replica_age_ms[…] is wrong, but must be a whole number of at least 0",
        ),
    ],
)
def test_a_malformed_node_report_is_refused(values: dict[str, object], fault: str) -> None:
    with pytest.raises(OutcomeError) as caught:
        decode_subject(RECORD, said(**values), "deeco", NodeReport, "a node")
    assert str(caught.value) == (f"out/r1/r1.mcap: outcome 'deeco' is not that of a node: {fault}")


FIRST = NavigationReport(
    5, 2, 1, 3, 0, {"blocked": 2, "no plan": 0}, [(0, 500_000, "itself"), (10, 1_000_010, "abort")], 4
)
SECOND = NavigationReport(1, 1, 0, 0, 1, {"blocked": 0, "no plan": 1}, [(7, 250_007, "itself")], 0)


def test_outcomes_add_up() -> None:
    both = navigation_result((FIRST, SECOND))
    assert (both.goals, both.succeeded, both.recoveries, both.retreats) == (6, 3, 3, 1)
    assert both.aborted == {"blocked": 2, "no plan": 1}
    assert both.no_valid_trajectory == {"abort": 1, "itself": 2, "unlisted": 4}
    assert both.no_valid_trajectory_s == pytest.approx(1.75)


def test_a_navigation_report_can_be_decoded_from_its_record() -> None:
    raw = msgspec.Raw(msgspec.json.encode(FIRST))
    assert (
        decode_subject(Path("r1.mcap"), {"navigation": raw}, "navigation", NavigationReport, "a robot")
        == FIRST
    )
    assert decode_subject(Path("r1.mcap"), {}, "navigation", NavigationReport, "a robot") is None
