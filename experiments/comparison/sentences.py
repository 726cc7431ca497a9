"""A comparison in words that can be quoted."""

from collections.abc import Sequence

from experiments.comparison.comparison import FEWEST, Comparison, PairedSample


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
