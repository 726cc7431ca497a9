"""A comparison in words that can be quoted."""

from collections.abc import Iterable, Iterator, Sequence

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import FEWEST, Comparison, PairedSample
from observation.results.result import RunResult


def summaries(records: Iterable[TrialRecord]) -> Iterator[str]:
    """A line for each strategy in each variant, over the runs that came to an end."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for record in records:
        where = "".join(f", {key} = {value}" for key, value in record.variant.items())
        if record.result is not None:
            groups.setdefault((where, record.strategy), []).append(record.result)
    for (where, strategy), runs in groups.items():
        complete = sum(run.completion_s is not None for run in runs)
        yield (
            f"{strategy}{where}: all places in {complete} of {len(runs)} runs,"
            f" {sum(run.places_done for run in runs)} of {sum(run.places_total for run in runs)} places,"
            f" {sum(run.places_given_up for run in runs)} given up,"
            f" {sum(run.places_lost for run in runs)} lost,"
            f" {sum(run.contacts for run in runs)} contacts{_half(runs)}"
        )


def _half(runs: Sequence[RunResult]) -> str:
    """When half of the runs were settled; nothing where fewer ever were, which no median can tell."""
    settled = sorted(run.settled_s for run in runs if run.settled_s is not None)
    half = (len(runs) + 1) // 2
    return f", half of them settled by {settled[half - 1]:.1f} s" if len(settled) >= half else ""


def sentence(comparison: Comparison) -> str:
    """What the test that counts says, with the effect and its interval."""
    c = comparison
    verdict = (
        "cannot be told from"
        if not c.differ
        else "is better than"
        if c.effect.value > 0.5
        else "is worse than"
    )
    p, adjusted = c.tests[0].p, c.adjusted[0]
    return (
        f"{c.one} {verdict} {c.other} by {c.says}{_where(c.variant)}: {c.ones:.4g} against {c.others:.4g}, "
        f"A12 = {c.effect.value:.2f} [{c.effect.low:.2f}, {c.effect.high:.2f}], {c.tests[0].name} test of "
        f"{c.pairs} pairs p = {p:.2g}, after Holm {adjusted:.2g}."
    )


def chapter_order(comparisons: Sequence[Comparison]) -> list[str]:
    """The chapter's order (7.2.2) for each pair: places decide; only if they do not differ, time does."""
    by_pair: dict[tuple[object, ...], dict[str, Comparison]] = {}
    for one in comparisons:
        by_pair.setdefault((one.one, one.other, one.variant), {})[one.metric] = one
    said = []
    for metrics in by_pair.values():
        places, time = metrics.get("places"), metrics.get("completion")
        if places is not None and (places.differ or time is None):
            said.append(sentence(places))
        elif places is not None and time is not None:
            said.append(f"{sentence(places)} So time decides: {sentence(time)}")
    return said


def too_few(samples: Sequence[PairedSample]) -> list[str]:
    """One sentence for each pair of strategies of which nothing can be said yet."""
    return [
        f"{one.one} and {one.other}{_where(one.variant)}: {len(one.pairs)} pairs of runs; "
        f"at least {FEWEST} are needed before any test could tell them apart."
        for one in samples
        if len(one.pairs) < FEWEST
    ]


def _where(variant: tuple[tuple[str, object], ...]) -> str:
    return f" with {', '.join(f'{key} = {value}' for key, value in variant)}" if variant else ""
