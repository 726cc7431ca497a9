"""`acrc compare`: tables and sentences."""

import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table

from actors.installation.usage import wrong_value
from experiments.campaign import store
from experiments.campaign.trust import differing, protection
from experiments.comparison import decision, metrics
from experiments.comparison.coincidence import coincidences
from experiments.comparison.coincidence import told as coincidences_told
from experiments.comparison.comparison import Comparison, PairedSample, compare, samples
from experiments.comparison.sentences import chapter_order, sentence, too_few


def run(folder: Path, metric: str | None, *, json_output: bool) -> None:
    """Compare every pair of strategies of a campaign, and print what comes of it.

    Exit code 1 if a repeated run was another one in memory: then it says so before and after all else.
    """
    if metric is not None and metric not in metrics.NAMES:
        raise wrong_value("--metric", metric, f"one of {', '.join(metrics.NAMES)}")
    kept = store.load(folder)
    found = samples(kept.records(), kept.study.primary_pairs)
    made = compare(found, metric)
    different = differing(kept)
    _warn(different)
    if json_output:
        sys.stdout.write(json.dumps([dataclasses.asdict(one) for one in made]) + "\n")
    else:
        _print(kept, found, made, metric)
        _warn(different)
    if different:
        raise typer.Exit(1)


def _warn(different: Sequence[str]) -> None:
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    for line in different:
        console.print(f"acrc: {line}", style="bold red", markup=False)


def _print(
    kept: store.Store, found: Sequence[PairedSample], made: Sequence[Comparison], metric: str | None
) -> None:
    console = Console(soft_wrap=True, highlight=False)
    for line in protection(kept):
        console.print(line, markup=False)
    for line in too_few(found):
        console.print(line, markup=False)
    declared = set(kept.study.primary_pairs)
    primary = [one for one in made if (one.one, one.other) in declared]
    others = [one for one in made if (one.one, one.other) not in declared]
    if kept.study.primary and primary:
        console.print("Declared beforehand:")
    for part in (primary, others):
        if part is others and primary and others:
            console.print("All other pairs:")
        for table in _tables(part):
            console.print(table)
        for line in chapter_order(part) if metric is None else map(sentence, part):
            console.print(line, markup=False)
    for line in _about(kept):
        console.print(line, markup=False)


def _about(kept: store.Store) -> Iterator[str]:
    """What is to be known beside the tests."""
    if kept.looks is not None:
        watch = decision.Watch(kept)
        yield from decision.told(watch.verdicts(), watch.rule, kept.study.primary_metric)
        yield "The p-values above are of all runs; the interim looks decide the primary comparisons."
    yield from coincidences_told(coincidences(kept.records()))
    if kept.study.tuning:
        yield "These are tuning seeds: test what was chosen with them on other seeds."


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
