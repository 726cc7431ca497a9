"""What a small campaign says about how large the next one must be, and whether it asks for too little."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import quantiles
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from acrc_testbed.experiments.campaign.trial_record import TrialRecord
from acrc_testbed.experiments.comparison.comparison import PairedSample
from acrc_testbed.experiments.comparison.family import primary, verdicts
from acrc_testbed.experiments.statistics.paired_tests import LEAST_PAIRS
from acrc_testbed.experiments.study.study import Study
from acrc_testbed.results.result import RunResult

_CAMPAIGNS: Final = 200
"""Drawn for each size."""
_SIZES: Final = (LEAST_PAIRS, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200)
"""Numbers of pairs that somebody might run."""
_HARDER_ROBOTS: Final = 8
_HARDER_S: Final = (300.0, 400.0)
"""Within which a shorter run still lets the robots do most of their places."""


@dataclass(frozen=True)
class Promise:
    """How often campaigns of one size tell the declared comparisons apart."""

    pairs: int
    shares: tuple[float, ...]
    """For each comparison in each variant, if all seeds are as those of the pilot."""
    cautious: tuple[float, ...]
    """The same if the pilot's seeds are themselves drawn."""


def promises(found: Sequence[PairedSample], study: Study, power: float) -> Iterator[Promise]:
    """Larger and larger campaigns, until each declared comparison is told apart with the power.

    Seeds are drawn from the pilot's, each with all its runs, and judged as `acrc compare` judges. The same
    pilot gives the same. Ends at 200 pairs. A pilot must have a pair of each comparison.
    """
    declared = primary(found, study)
    for pairs in _SIZES:
        made = Promise(
            pairs,
            told_apart(declared, study, pairs, np.random.default_rng(1), cautious=False),
            told_apart(declared, study, pairs, np.random.default_rng(1), cautious=True),
        )
        yield made
        if min(made.shares) >= power:
            return


def told_apart(
    declared: Sequence[PairedSample],
    study: Study,
    pairs: int,
    rng: Generator,
    campaigns: int = _CAMPAIGNS,
    *,
    cautious: bool = False,
) -> tuple[float, ...]:
    """The share of drawn campaigns of so many pairs that tell each of these declared samples apart.

    `cautious`: each is drawn from a pilot that is itself drawn from this one.
    """
    known = min(len(sample.pairs) for sample in declared)
    counts = np.zeros(len(declared))
    for _ in range(campaigns):
        seeds = rng.integers(known, size=known) if cautious else np.arange(known)
        drawn = redrawn(declared, seeds[rng.integers(known, size=pairs)])
        counts += [one.deciding is not None for one in verdicts(drawn, study)]
    return tuple((counts / campaigns).tolist())


def redrawn(samples: Sequence[PairedSample], places: NDArray[np.int64]) -> list[PairedSample]:
    """The samples with the pairs at these places, the same in each of them."""
    chosen = places.tolist()
    return [one._replace(pairs=tuple(one.pairs[place] for place in chosen)) for one in samples]


def ceilings(records: Iterable[TrialRecord]) -> Iterator[str]:
    """A sentence for each variant in which half of the runs or more did all there was to do."""
    runs: dict[str, tuple[dict[str, Any], list[RunResult]]] = {}
    for record in records:
        if record.result is not None:
            runs.setdefault(repr(record.variant), (record.variant, []))[1].append(record.result)
    for variant, results in runs.values():
        done = [result.completion_s for result in results if result.completion_s is not None]
        if 2 * len(done) >= len(results):
            where = "".join(f" with {key} = {value}" for key, value in variant.items())
            yield (
                f"{len(done)} of {len(results)} runs{where} have all places: they are at their ceiling there."
                f" A harder condition tells more: {_harder(results, done)}."
            )


def _harder(results: list[RunResult], done: list[float]) -> str:
    """More robots, or less time than three quarters of the runs that were done took."""
    least, most = _HARDER_S
    quarter = quantiles(done, n=4)[0] if len(done) > 1 else done[0]
    seconds = min(max(round(quarter, -1), least), most)
    ways = [f"--robots {_HARDER_ROBOTS}"] if results[0].robots < _HARDER_ROBOTS else []
    if seconds < max(result.simulated_s for result in results):
        ways.append(f"--duration {seconds:g}")
    return " and ".join(ways) or "more robots, or places that lie farther apart"
