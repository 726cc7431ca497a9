"""Until when the runs of two strategies with the same seed are one and the same."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median
from typing import Any, Final

from acrc_testbed.experiments.campaign.trial_record import TrialRecord, coincide_s

_FEW: Final = 4
"""Combinations of which each is told by itself."""


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
    """A sentence for each, and one more where whole runs coincide; many combinations have one together."""
    pairs: dict[tuple[str, str], list[Coincidence]] = {}
    for one in found:
        pairs.setdefault((one.one, one.other), []).append(one)
    lines: list[str] = []
    for same in pairs.values():
        lines += _together(same) if len(same) > _FEW else [line for one in same for line in _alone(one)]
    return lines


def _alone(one: Coincidence) -> Iterator[str]:
    where = "".join(f", {key} = {value}" for key, value in one.variant)
    yield (
        f"{one.one} and {one.other}{where}: the first {one.half_s} s of {one.sharing} of"
        f" {len(one.seconds)} pairs coincide ({_range(one.seconds)})"
    )
    if one.whole:
        seeds = ", ".join(map(str, one.whole[:10])) + (" …" if len(one.whole) > 10 else "")
        yield f"    {len(one.whole)} from beginning to end, so they tell no difference: seeds {seeds}"


def _together(same: Sequence[Coincidence]) -> Iterator[str]:
    """All combinations of two strategies in one sentence."""
    seconds = [second for one in same for second in one.seconds]
    name = f"{same[0].one} and {same[0].other}, in {len(same)} combinations"
    yield f"{name}: {len(seconds)} pairs coincide at first ({_range(seconds)})"
    whole = [one for one in same if one.whole]
    if whole:
        most = max(whole, key=lambda one: len(one.whole))
        where = ", ".join(f"{key} = {value}" for key, value in most.variant)
        count = sum(len(one.whole) for one in whole)
        yield (
            f"    {count} from beginning to end, so they tell no difference, in {len(whole)} combinations;"
            f" most ({len(most.whole)}) with {where}"
        )


def _range(seconds: Sequence[int]) -> str:
    return f"least {min(seconds)} s, median {median(seconds):g} s, most {max(seconds)} s"
