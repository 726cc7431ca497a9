"""Robots' final reports: strategy outcomes, counters of deeco nodes, navigation, items."""

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, Final, TypeVar

import msgspec

from actors.robot.behaviour.decisions import NodeReport
from actors.robot.navigation.navigation_counts import NavigationReport
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.typed_json import Name
from actors.task.task import Column, Value

T = TypeVar("T")
Outcomes = dict[str, dict[str, bool | int | float | str]]
"""Values returned by behaviours' `outcome()`, by name and robot."""

_RESERVED: Final = frozenset({"adaptation", "deeco", "localisation", "navigation"})
"""Subjects reserved for the robot program and the component model."""
_MAX_OWN, _MAX_NAME_LENGTH = 20, 100
"""Limits of a behaviour's outcome: values, and characters of a name."""
_Own = bool | Annotated[int, msgspec.Meta(ge=-(1 << 53), le=1 << 53)] | float | Name | list[Any] | None
_OwnSubject = _Own | dict[str, _Own]


class OutcomeError(AcrcError):
    """A malformed subject of an outcome."""


def decode_subject(
    record: Path, outcome: Mapping[str, msgspec.Raw], subject: str, kind: type[T], origin: str
) -> T | None:
    """Decode a subject of the final record of the file `record`; None if absent. Raises OutcomeError.

    `origin`: expected origin of the outcome, for the error message.
    """
    if subject not in outcome:
        return None
    try:
        return typed_json.decode(outcome[subject], kind)
    except ValueError as error:
        raise OutcomeError(f"{record}: outcome {subject!r} is not that of {origin}: {error}") from None


def strategy_outcome(record: Path, outcome: Mapping[str, msgspec.Raw]) -> dict[str, bool | int | float | str]:
    """Return the numbers, texts and booleans of a behaviour's `outcome()`, by name.

    Names in nested dicts are joined by a dot. Lists and null (also NaN, which JSON lacks) are left out.
    Raises OutcomeError above the limits.
    """
    values: dict[str, Any] = {}
    for subject in sorted(outcome.keys() - _RESERVED):
        value: Any = decode_subject(record, outcome, subject, _OwnSubject, "a behaviour")  # type: ignore[arg-type]
        parts = {f".{name}": part for name, part in value.items()} if isinstance(value, dict) else {"": value}
        values |= {subject + name: part for name, part in parts.items() if not isinstance(part, list | None)}
    if len(values) > _MAX_OWN or max(map(len, values), default=0) > _MAX_NAME_LENGTH:
        raise OutcomeError(
            f"outcome has {len(values)} values; must have at most {_MAX_OWN}, "
            f"with names of at most {_MAX_NAME_LENGTH} characters"
        )
    return values


def outcome_means(outcomes: Outcomes) -> dict[str, float]:
    """Return the mean of each numeric value over the robots that have it; true counts as 1."""
    numbers = {
        name: [one for one in by_robot.values() if not isinstance(one, str)]
        for name, by_robot in outcomes.items()
    }
    return {name: fmean(values) for name, values in numbers.items() if values}


_BIN_MS: Final = 50
"""Width of the histogram bins of replica ages in `deeco.statistics`."""


class DeecoResult(msgspec.Struct, frozen=True):
    """Counters of all nodes, over all processes of each robot; empty if no robot has a node."""

    counters: dict[str, int]
    """Actions, drops and refusals of the nodes, by name."""
    exchanges: dict[str, int]
    """Exchanges that changed the knowledge of the robot that made them, by ensemble."""
    replica_age_mean_s: float | None
    """Mean age of replicas, sampled for each replica at each publication of its holder; samples count as the
    middle of their 50 ms bin. None without samples."""
    replica_age_p95_s: float | None
    """95th percentile of these samples by nearest rank: upper bound of the bin of sample ceil(0.95 n) in
    order of age. None without samples."""


def deeco_result(nodes: Iterable[NodeReport]) -> DeecoResult:
    """Add up the reports of all nodes."""
    counters, exchanges, ages = Counter[str](), Counter[str](), Counter[int]()
    for node in nodes:
        counters.update(node.counters)
        exchanges.update(node.exchanges)
        ages.update(node.replica_age_ms)
    p95_ms = nearest_rank(ages, 95)
    return DeecoResult(
        counters=dict(counters),
        exchanges=dict(sorted(exchanges.items())),
        replica_age_mean_s=_mean_s(ages),
        replica_age_p95_s=None if p95_ms is None else p95_ms / 1000,
    )


def _mean_s(ages: Counter[int]) -> float | None:
    samples = ages.total()
    if not samples:
        return None
    total_ms = sum((bound - _BIN_MS / 2) * count for bound, count in ages.items())
    return round(total_ms / samples / 1000, 4)


def nearest_rank(counts: Counter[int], percent: int) -> int | None:
    """Return a percentile by nearest rank: sample ceil(percent n / 100) in order; None without samples."""
    rank = math.ceil(counts.total() * percent / 100)
    for value in sorted(counts):
        rank -= counts[value]
        if rank <= 0 < counts[value]:
            return value
    return None


class NavigationResult(msgspec.Struct, frozen=True):
    """Counters of the navigation of all robots, over all processes of each robot."""

    goals: int
    """Goals requested by behaviours, repeated requests included."""
    succeeded: int
    """Goals reached."""
    aborted: dict[str, int]
    """Aborted goals by reason: "no plan", "blocked" (no valid trajectory for too long) or "no progress".
    Other goals were replaced, cancelled, or open at the end."""
    recoveries: int
    """Recoveries: costmap cleared away from the robot, then another attempt."""
    retreats: int
    """Retreats after a bumper contact."""
    no_valid_trajectory: dict[str, int]
    """Intervals in which the local planner found no valid trajectory, by how they ended: by "itself", with an
    "abort", with another "order", with the "run", or "unlisted" where there were too many to list."""
    no_valid_trajectory_s: float
    """Total length of the listed intervals, s."""


_NAVIGATION_COUNTS: Final = ("goals", "succeeded", "recoveries", "retreats")


def navigation_result(reports: Iterable[NavigationReport]) -> NavigationResult:
    """Add up the reports of all robots' navigation."""
    counts, aborted, intervals = Counter[str](), Counter[str](), Counter[str]()
    lasted_us = 0
    for outcome in reports:
        counts.update({name: getattr(outcome, name) for name in _NAVIGATION_COUNTS})
        aborted.update(outcome.aborted)
        intervals.update(end_cause for _, _, end_cause in outcome.no_valid_trajectory)
        intervals["unlisted"] += outcome.no_valid_trajectory_unlisted
        lasted_us += sum(end - begin for begin, end, _ in outcome.no_valid_trajectory)
    return NavigationResult(
        aborted=dict(sorted(aborted.items())),
        no_valid_trajectory={end_cause: count for end_cause, count in sorted(intervals.items()) if count},
        no_valid_trajectory_s=lasted_us / 1_000_000,
        **{name: counts[name] for name in _NAVIGATION_COUNTS},
    )


def write_items(items: Iterable[Mapping[str, Value]], columns: Sequence[Column], path: Path) -> None:
    """Write the task's table of items as CSV."""
    names = [column.name for column in columns]
    rows = ([item.get(name) for name in names] for item in items)
    regular_file.write_atomically(path, csv_text([names, *rows]).encode())


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows as CSV; empty fields for None."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
