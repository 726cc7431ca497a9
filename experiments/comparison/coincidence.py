"""Until when the runs of two strategies with the same seed are one and the same."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median
from typing import Any

from experiments.campaign.trace import coincide_s
from experiments.campaign.trial_record import TrialRecord


@dataclass(frozen=True)
class Coincidence:
    """Two strategies in one variant, over the seeds that both have a run of."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
    seconds: tuple[int, ...]
    """For each seed, for how many whole seconds from the start on all robots were in the same places."""
    whole: tuple[int, ...]
    """Seeds whose two runs are the same from beginning to end."""

    @property
    def half_s(self) -> int:
        """So many seconds coincide in at least half of the pairs."""
        return sorted(self.seconds, reverse=True)[(len(self.seconds) - 1) // 2]

    @property
    def sharing(self) -> int:
        """How many pairs coincide for that long."""
        return sum(seconds >= self.half_s for seconds in self.seconds)


def coincidences(records: Iterable[TrialRecord]) -> list[Coincidence]:
    """Of every two strategies in every variant; failed runs have none."""
    traces: dict[str, tuple[tuple[tuple[str, Any], ...], dict[str, dict[int, str]]]] = {}
    for record in records:
        if record.trace:
            variant = tuple(record.variant.items())
            _, by_strategy = traces.setdefault(repr(variant), (variant, {}))
            by_strategy.setdefault(record.strategy, {})[record.seed] = record.trace
    return [
        _coincidence(one, other, variant, mine, theirs)
        for variant, strategies in traces.values()
        for (one, mine), (other, theirs) in combinations(strategies.items(), 2)
        if mine.keys() & theirs.keys()
    ]


def _coincidence(
    one: str, other: str, variant: tuple[tuple[str, Any], ...], mine: dict[int, str], theirs: dict[int, str]
) -> Coincidence:
    seeds = [seed for seed in mine if seed in theirs]
    return Coincidence(
        one,
        other,
        variant,
        tuple(coincide_s(mine[seed], theirs[seed]) for seed in seeds),
        tuple(seed for seed in seeds if mine[seed] == theirs[seed]),
    )


def told(found: Sequence[Coincidence]) -> list[str]:
    """A sentence for each, and one more where whole runs coincide."""
    lines = []
    for one in found:
        where = "".join(f", {key} = {value}" for key, value in one.variant)
        longest = f"least {min(one.seconds)} s, median {median(one.seconds):g} s, most {max(one.seconds)} s"
        lines.append(
            f"{one.one} and {one.other}{where}: the first {one.half_s} s of {one.sharing} of"
            f" {len(one.seconds)} pairs coincide ({longest})"
        )
        if one.whole:
            seeds = ", ".join(map(str, one.whole[:10])) + (" …" if len(one.whole) > 10 else "")
            lines.append(f"    {len(one.whole)} from beginning to end, which tell nothing: seeds {seeds}")
    return lines
