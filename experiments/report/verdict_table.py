"""Verdicts of a study with many cells: one row each in a table, and a sentence for each declared pair."""

from collections.abc import Iterator, Sequence

from experiments.comparison.family import ComparedMetric, PairVerdict
from experiments.comparison.metrics import named
from experiments.report.numbers import Cell, NumberTable

_TOLD = ("better", "worse", "as good", "not told apart")


def verdict_table(name: str, verdicts: Sequence[PairVerdict]) -> NumberTable:
    """A row for each verdict, with the estimates of the metric by which it came about."""
    return NumberTable(
        f"verdicts_{name}",
        "What each declared comparison came to, by the test of the metric that decided it, or that left it "
        "undecided. As good: within the margin, by every test. Intervals are of 95 %.",
        (
            *("first", "second", "condition", "the first is", "by", "first has", "second has"),
            *("difference", "better on", "worse on", "A12", "p after Holm"),
        ),
        tuple(_row(one) for one in verdicts),
    )


def counted(verdicts: Sequence[PairVerdict]) -> Iterator[str]:
    """For each pair in how many conditions the first is better, worse, as good, or not told apart."""
    pairs = dict.fromkeys((one.sample.one, one.sample.other) for one in verdicts)
    for pair in pairs:
        words = [_word(one) for one in verdicts if (one.sample.one, one.sample.other) == pair]
        parts = [f"{word} in {words.count(word)}" for word in _TOLD if word in words]
        yield f"{pair[0]} beside {pair[1]}, of {len(words)} conditions: {', '.join(parts)}."


def _word(one: PairVerdict) -> str:
    if one.deciding is not None:
        return "better" if one.deciding.test.direction > 0 else "worse"
    return "as good" if one.equivalent else "not told apart"


def _asked_last(one: PairVerdict) -> ComparedMetric:
    return one.deciding or next((step for step in one.steps if not step.equivalent), one.steps[-1])


def _row(one: PairVerdict) -> tuple[Cell, ...]:
    sample, step = one.sample, _asked_last(one)
    found = step.estimated()
    estimates: tuple[Cell, ...] = (None,) * 6
    if found is not None:
        estimates = (found.ones, found.others, found.difference, found.better, found.worse, found.effect)
    condition = ", ".join(f"{key} = {value}" for key, value in sample.variant)
    p = step.adjusted if step.tested else None
    return (sample.one, sample.other, condition, _word(one), named(step.metric).says, *estimates, p)
