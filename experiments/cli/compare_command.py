"""`acrc compare`: tables and sentences."""

import dataclasses
import json
import sys
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.table import Table

from deploy.usage import wrong_value
from experiments.campaign import store
from experiments.comparison import metrics
from experiments.comparison.comparison import Comparison, compare, samples
from experiments.comparison.sentences import chapter_order, sentence, too_few


def run(folder: Path, metric: str | None, *, json_output: bool) -> None:
    """Compare every pair of strategies of a campaign, and print what comes of it."""
    if metric is not None and metric not in metrics.NAMES:
        raise wrong_value("--metric", metric, f"one of {', '.join(metrics.NAMES)}")
    kept = store.load(folder)
    found = samples(kept.records())
    made = compare(found, metric)
    if json_output:
        sys.stdout.write(json.dumps([dataclasses.asdict(one) for one in made]) + "\n")
        return
    console = Console(soft_wrap=True, highlight=False)
    for line in too_few(found):
        console.print(line)
    for table in _tables(made):
        console.print(table)
    primary = {frozenset(pair) for pair in kept.study.primary}
    said = chapter_order(made) if metric is None else [sentence(one) for one in made]
    if primary:
        console.print(f"declared beforehand: {', '.join(' and '.join(sorted(pair)) for pair in primary)}")
    for line in said:
        console.print(line)
    if kept.study.tuning:
        console.print("These are seeds for tuning: what was chosen with them is to be judged by others.")


def _tables(made: list[Comparison]) -> Iterator[Table]:
    """One for each pair of strategies in each variant; a row for each test."""
    for (one, other, variant), group in groupby(made, key=lambda c: (c.one, c.other, c.variant)):
        title = ", ".join([f"{one} and {other}", *(f"{key} = {value}" for key, value in variant)])
        table = Table("metric", one, other, "A12", "test", "p", "Holm", title=title)
        for each in group:
            effect = f"{each.effect.value:.2f} [{each.effect.low:.2f}, {each.effect.high:.2f}]"
            first = (each.metric, f"{each.ones:.4g}", f"{each.others:.4g}", effect)
            for test, adjusted in zip(each.tests, each.adjusted, strict=True):
                table.add_row(*first, test.name, f"{test.p:.2g}", f"{adjusted:.2g}")
                first = ("", "", "", "")
        yield table
