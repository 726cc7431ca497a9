"""What a small campaign says about how large the next one must be, and whether it asks for too little."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from statistics import quantiles
from typing import Any, Final

from scipy.stats import spearmanr

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import FEWEST, PairedSample, scores
from experiments.statistics.effect_size import Interval, a12, interval
from experiments.statistics.sample_size import Effect, pairs_needed
from observation.results.result import RunResult

_MOST: Final = 1000
"""Pairs that somebody might run."""
_HARDER_ROBOTS: Final = 8
_HARDER_S: Final = (300.0, 400.0)
"""Within which a shorter run still lets the robots do most of their places."""


@dataclass(frozen=True)
class PilotEstimate:
    """One pair of strategies in a pilot."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
    metric: str
    pairs: int
    effect: Interval | None
    """A12 of `one`; None with too few pairs."""
    correlation: float
    """Spearman's, of the two runs of a pair; 0 where one of them never changes."""
    needed: int | None
    """Pairs for that effect; None: more than anybody would run."""
    needed_at_least: int | None
    """Pairs for the end of the interval that is nearer to no difference; None: the interval holds 0.5."""
    power: float
    comparisons: int


def estimate(sample: PairedSample, metric: str, power: float, comparisons: int) -> PilotEstimate:
    """Effect and correlation as the pilot has them, and the pairs that they ask for."""
    ones, others = scores(metric, sample.pairs)
    found = (sample.one, sample.other, sample.variant, metric, len(sample.pairs))
    if len(sample.pairs) < FEWEST:
        return PilotEstimate(*found, None, 0.0, None, None, power, comparisons)
    effect = interval(ones, others, a12, paired=True)
    constant = len(set(ones)) == 1 or len(set(others)) == 1
    correlation = 0.0 if constant else float(spearmanr(ones, others).statistic)
    weaker = effect.low if effect.value > 0.5 else effect.high
    same_side = (weaker - 0.5) * (effect.value - 0.5) > 0
    return PilotEstimate(
        *found,
        effect,
        correlation,
        _needed(effect.value, correlation, power, comparisons),
        _needed(weaker, correlation, power, comparisons) if same_side else None,
        power,
        comparisons,
    )


def _needed(share: float, correlation: float, power: float, comparisons: int) -> int | None:
    within = min(max(share, 0.001), 0.999), min(max(correlation, -0.95), 0.95)
    try:
        return pairs_needed(Effect(*within, power=power, comparisons=comparisons), most=_MOST)
    except ValueError:
        return None


def told(one: PilotEstimate) -> str:
    """The estimate in a sentence."""
    where = "".join(f", {key} = {value}" for key, value in one.variant)
    name = f"{one.one} and {one.other}{where} by {one.metric}"
    if one.effect is None:
        return f"{name}: {one.pairs} pairs; at least {FEWEST} are needed before they say anything."
    effect = f"A12 = {one.effect.value:.2f} [{one.effect.low:.2f}, {one.effect.high:.2f}]"
    begin = f"{name}: {effect}, correlation {one.correlation:.2f} in {one.pairs} pairs; "
    if one.needed is None:
        return begin + f"more than {_MOST} pairs would be needed to show an effect so small."
    shared = f" shared by {one.comparisons} comparisons" if one.comparisons > 1 else ""
    seen = f"{one.needed} pairs show it with probability {one.power:g} at 5 %{shared}"
    if one.needed_at_least is None:
        return f"{begin}{seen}, if it is there: the pilot does not tell whether it is."
    return f"{begin}{seen}, {one.needed_at_least} if it is as small as its interval allows."


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
