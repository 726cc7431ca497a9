"""What comes of what robots say about their nodes."""

from pathlib import Path

import msgspec
import pytest

from deeco.instant import Instant, in_seconds, milliseconds
from deeco.statistics import Statistics
from observation.results.outcome import (
    DeecoResult,
    NodeOutcome,
    OutcomeError,
    deeco_result,
    node_outcome,
)

RECORD = Path("/o/r1/r1.mcap")


def said(**values: object) -> dict[str, msgspec.Raw]:
    """The last record's outcome of a robot with a node."""
    whole = {"counters": {}, "exchanges": {}, "replica_age_ms": {}} | values
    return {"other": msgspec.Raw(b"[]"), "deeco": msgspec.Raw(msgspec.json.encode(whole))}


def ages(**counts: int) -> NodeOutcome:
    """A node that saw replicas so old: `b100=3` stands for three in the bin from 50 to 100 ms."""
    return NodeOutcome({}, {}, {int(bound[1:]): count for bound, count in counts.items()})


def test_counters_and_exchanges_add_up_over_the_nodes() -> None:
    one = NodeOutcome({"commits": 2, "published": 5}, {"Swap": 1, "Avoid": 2}, {})
    other = NodeOutcome({"commits": 3, "relayed": 7}, {"Swap": 4}, {})
    assert deeco_result([one, other]) == DeecoResult(
        {"commits": 5, "published": 5, "relayed": 7}, {"Avoid": 2, "Swap": 5}, None, None
    )


def test_without_nodes_everything_is_empty() -> None:
    assert deeco_result([]) == DeecoResult({}, {}, None, None)
    assert deeco_result([ages(b50=0)]) == DeecoResult({}, {}, None, None)


def test_the_mean_age_takes_each_sample_in_the_middle_of_its_bin() -> None:
    result = deeco_result([ages(b50=3), ages(b50=1, b1000=4)])
    assert result.replica_age_mean_s == (4 * 0.025 + 4 * 0.975) / 8


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
def test_the_95th_percentile_is_the_upper_bound_of_the_nearest_rank(
    counts: dict[str, int], p95: float
) -> None:
    assert deeco_result([ages(**counts)]).replica_age_p95_s == p95


def test_a_last_record_is_read() -> None:
    given = said(counters={"commits": 1}, exchanges={"Swap": 2}, replica_age_ms={"150": 3})
    assert node_outcome(RECORD, given) == NodeOutcome({"commits": 1}, {"Swap": 2}, {150: 3})
    assert node_outcome(RECORD, {"other": msgspec.Raw(b"[]")}) is None


def test_what_a_node_counts_is_what_is_read() -> None:
    statistics = Statistics()
    statistics.counters.commits = 4
    statistics.exchanges["Swap"] += 1
    true_ages = [milliseconds(age) for age in (0, 49, 50, 120, 999, 1000)]
    for age in true_ages:
        statistics.sample_age(Instant(0), Instant(age))
    said_by_node = {"deeco": msgspec.Raw(msgspec.json.encode(statistics.outcome()))}
    node = node_outcome(RECORD, said_by_node)
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
            {"replica_age_ms": {"75": 1}},
            "a key of replica_age_ms is wrong, but must be a whole number that is a multiple of 50",
        ),
        (
            {"replica_age_ms": {"50": -1}},
            "replica_age_ms[…] is wrong, but must be a whole number of at least 0",
        ),
    ],
)
def test_what_is_no_outcome_of_a_node_is_named(values: dict[str, object], fault: str) -> None:
    with pytest.raises(OutcomeError) as caught:
        node_outcome(RECORD, said(**values))
    assert str(caught.value) == (f"/o/r1/r1.mcap: the outcome 'deeco' is not that of a node: {fault}")
