"""What the nodes of the component model did in a run, from what each robot's process said at its end."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec

from observation.results.outcome import MOST_LISTED, MOST_NAMES, Count, Name, told

SUBJECT: Final = "deeco"
"""Under which a robot's last record holds what its node counted."""
_BIN_MS: Final = 50
"""Width of the bins that `deeco.statistics` counts the ages of replicas in."""
_Bound = Annotated[int, msgspec.Meta(gt=0, le=1 << 53, multiple_of=_BIN_MS)]
_Counts = Annotated[dict[Name, Count], msgspec.Meta(max_length=MOST_NAMES)]


class NodeOutcome(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one node counted, from the start of its process to its end."""

    counters: _Counts
    exchanges: _Counts
    """By ensemble: exchanges that changed the local knowledge."""
    replica_age_ms: Annotated[dict[_Bound, Count], msgspec.Meta(max_length=MOST_LISTED)]
    """Time since each replica was heard, at each own publication: count by the bin's upper bound, ms."""


class DeecoResult(msgspec.Struct, frozen=True):
    """What all nodes counted, over all processes that a robot had; all empty where no robot has a node."""

    counters: dict[str, int]
    """What the nodes did, dropped or refused, by name."""
    exchanges: dict[str, int]
    """How often an exchange of knowledge changed the knowledge of the robot that made it, by ensemble: any
    change, also one by which a robot leaves a place to another one."""
    replica_age_mean_s: float | None
    """Mean time since a replica had been heard, over every replica at each publication of its holder; each
    sample stands in the middle of its bin, 50 ms wide. None without samples."""
    replica_age_p95_s: float | None
    """What 95 % of these samples do not exceed: the upper bound of the bin of the nearest rank, that is of
    sample number ceil(0.95 n) in order of age. None without samples."""


def node_outcome(record: Path, outcome: Mapping[str, msgspec.Raw]) -> NodeOutcome | None:
    """What a process's last record says about its node; None if it says nothing."""
    return told(record, outcome, SUBJECT, NodeOutcome, "a node")


def deeco_result(nodes: Iterable[NodeOutcome]) -> DeecoResult:
    """What the nodes did together."""
    counters: Counter[str] = Counter()
    exchanges: Counter[str] = Counter()
    ages: Counter[int] = Counter()
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
    """What `percent` of the counted values do not exceed: sample number ceil(percent n / 100) in order."""
    rank = math.ceil(counts.total() * percent / 100)
    for value in sorted(counts):
        rank -= counts[value]
        if rank <= 0 < counts[value]:
            return value
    return None
