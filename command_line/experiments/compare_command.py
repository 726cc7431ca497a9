"""`acrc compare`: tables and sentences."""

import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import typer
from rich.table import Table

from actors.console import print_table, screen
from actors.installation.usage import wrong_value
from experiments.campaign import store
from experiments.campaign.trust import differing, protection
from experiments.comparison import decision, metrics, sentences
from experiments.comparison.across_cells import told as across_told
from experiments.comparison.coincidence import coincidences
from experiments.comparison.coincidence import told as coincidences_told
from experiments.comparison.comparison import Comparison
from experiments.comparison.judgement import CampaignJudgement, judge
from experiments.statistics.effect_size import Interval


def run(folder: Path, metric: str | None, *, json_output: bool) -> None:
    """Compare every pair of strategies of a campaign, and print what comes of it.

    Exit code 1 if a repeated run was another one in memory: then it says so before and after all else.
    """
    if metric is not None and not metrics.is_metric(metric):
        raise wrong_value("--metric", metric, metrics.CHOICE)
    kept = store.load(folder)
    found = judge(kept, metric)
    different = differing(kept)
    _warn(different)
    if json_output:
        sys.stdout.write(json.dumps(_told(found)) + "\n")
    else:
        _print(kept, found)
        _warn(different)
    if different:
        raise typer.Exit(1)


def _warn(different: Sequence[str]) -> None:
    console = screen(stderr=True)
    for line in different:
        console.print(f"acrc: {line}", style="bold red")


def _told(found: CampaignJudgement) -> dict[str, object]:
    return {
        "failures": found.failures,
        "declared": found.declared,
        "verdicts": [
            {
                "one": one.sample.one,
                "other": one.sample.other,
                "variant": one.sample.variant,
                "says": sentences.verdict(one),
                "decided_by": one.deciding.metric if one.deciding is not None else None,
                "steps": [
                    {
                        "metric": step.metric, "pairs": len(step.sample.pairs),
                        **step.test._asdict(), "tested": step.tested, "adjusted": step.adjusted,
                        "threshold": step.threshold, "differs": step.differs, "margin": step.margin,
                        "equivalence_p": step.equivalence_p, "equivalent": step.equivalent,
                    }
                    for step in one.steps
                ],
            }
            for one in found.verdicts
        ],
        "across_cells": [
            one._asdict()
            | {
                "fitted": None if one.fitted is None else dataclasses.asdict(one.fitted),
                "without": [each._asdict() for each in one.without],
                "says": across_told(one),
            }
            for one in found.across
        ],
        "too_few": list(found.too_few),
        "estimates": [dataclasses.asdict(one) for one in found.estimates],
    }  # fmt: skip


def _print(kept: store.Store, found: CampaignJudgement) -> None:
    console = screen()
    for line in (*found.failures, *protection(kept), *found.declared, *found.too_few, *found.family):
        console.print(line)
    for one in found.verdicts:
        console.print(sentences.verdict(one))
    for across in found.across:
        for line in across_told(across):
            console.print(line)
    if found.estimates:
        console.print("Estimates with 95 % intervals, of which none is a test:")
    for table in _tables(found.estimates):
        print_table(console, table)
    for line in _about(kept, found):
        console.print(line)


def _about(kept: store.Store, found: CampaignJudgement) -> Iterator[str]:
    """What is to be known beside the tests."""
    if kept.looks is not None:
        yield from decision.told(found.looks, decision.rules_for(kept.study))
    yield from coincidences_told(coincidences(kept.records()))
    if kept.study.tuning:
        yield "These are tuning seeds: test what was chosen with them on other seeds."


def _tables(made: Sequence[Comparison]) -> Iterator[Table]:
    """One for each pair of strategies in each variant; a row for each metric."""
    for (one, other, variant), group in groupby(made, key=lambda c: (c.one, c.other, c.variant)):
        title = ", ".join([f"{one} and {other}", *(f"{key} = {value}" for key, value in variant)])
        table = Table("metric", one, other, "difference", "better", "worse", "A12", title=title)
        for each in group:
            table.add_row(
                each.metric,
                "" if each.ones is None else f"{each.ones:.4g}",
                "" if each.others is None else f"{each.others:.4g}",
                "" if each.difference is None else f"{_interval(each.difference, '+.3g')} {each.unit}",
                str(each.better),
                str(each.worse),
                _interval(each.effect, ".2f"),
            )
        yield table


def _interval(found: Interval, form: str) -> str:
    return f"{found.value:{form}} [{found.low:{form}}, {found.high:{form}}]"
