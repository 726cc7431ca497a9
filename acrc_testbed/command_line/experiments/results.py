"""Commands that read campaigns: compare, study plan."""

import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import msgspec
import typer
from rich.console import Console
from rich.table import Table

from acrc_testbed.command_line.options import answer
from acrc_testbed.experiments.campaign import store
from acrc_testbed.experiments.campaign.store import differing, protection
from acrc_testbed.experiments.comparison import decision, metrics
from acrc_testbed.experiments.comparison.across_cells import told as across_told
from acrc_testbed.experiments.comparison.coincidence import coincidences
from acrc_testbed.experiments.comparison.coincidence import told as coincidences_told
from acrc_testbed.experiments.comparison.comparison import Comparison, PairedSample, samples
from acrc_testbed.experiments.comparison.family import primary, tests_of
from acrc_testbed.experiments.comparison.judgement import CampaignJudgement, failures, judge, verdict
from acrc_testbed.experiments.comparison.pilot import Promise, ceilings, promises
from acrc_testbed.experiments.statistics.paired_tests import Effect, Interval, pairs_needed
from acrc_testbed.experiments.study.study import Study
from actors.console import print_table, screen
from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError


def compare(folder: Path, metric: str | None, *, json_output: bool) -> None:
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
        sys.stdout.write(json.dumps(_comparison_json(found)) + "\n")
    else:
        _print_comparison(kept, found)
        _warn(different)
    if different:
        raise typer.Exit(1)


def _warn(different: Sequence[str]) -> None:
    console = screen(stderr=True)
    for line in different:
        console.print(f"acrc: {line}", style="bold red")


def _comparison_json(found: CampaignJudgement) -> dict[str, object]:
    return {
        "failures": found.failures,
        "declared": found.declared,
        "verdicts": [
            {
                "one": one.sample.one,
                "other": one.sample.other,
                "variant": one.sample.variant,
                "says": verdict(one),
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


def _print_comparison(kept: store.Store, found: CampaignJudgement) -> None:
    console = screen()
    for line in (*found.failures, *protection(kept), *found.declared, *found.too_few, *found.family):
        console.print(line)
    for one in found.verdicts:
        console.print(verdict(one))
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


def plan(a12: float, power: float, correlation: float, comparisons: int, *, json: bool) -> None:
    """Print the number of pairs that an effect needs; a comparison has two tests, of places and of times."""
    tests = 2 * comparisons
    try:
        pairs = pairs_needed(Effect(a12, correlation, power, tests))
    except ValueError as error:
        raise OptionError(f"--a12: {error}") from None
    said = (
        f"{pairs} pairs of runs show an effect of A12 = {a12:g} with probability {power:g} at 5 % shared by "
        f"{tests} tests, if two runs with the same seed correlate by {correlation:g}."
    )
    told = {"pairs": pairs, "a12": a12, "power": power, "correlation": correlation, "tests": tests}
    answer([said], told, json=json)


def plan_from_pilot(folder: Path, metric: str | None, power: float, comparisons: int, *, json: bool) -> None:
    """Print how often campaigns of a size would tell the declared strategies apart, and what is too easy."""
    if comparisons > 1:
        raise OptionError("--comparisons: cannot be combined with --pilot, whose study declares them")
    kept = store.load(folder)
    if metric is not None and not metrics.is_metric(metric):
        raise wrong_value("--metric", metric, metrics.CHOICE)
    study = msgspec.structs.replace(kept.study, primary_metric=metric or kept.study.primary_metric)
    records = list(kept.records())
    found = primary(samples(records, study), study)
    if not found or not all(sample.pairs for sample in found):
        raise AcrcError(f"{folder}: has no pair of a declared comparison; must hold at least one of each")
    made = list(promises(found, study, power))
    if json:
        names = [f"{sample.one} and {sample.other}{sample.where}" for sample in found]
        told = {"comparisons": names, "tests": tests_of(study), "power": power, "promises": made}
        answer([], told, json=True)
        return
    console = screen()
    for line in failures(records, study):
        console.print(line)
    _print_promises(console, found, made, study, power)
    for line in ceilings(records):
        console.print(line)
    if not kept.study.tuning:
        console.print(
            "These are seeds of tests, which have been looked at now; a pilot with --tuning has its own."
        )


def _print_promises(
    console: Console, found: Sequence[PairedSample], made: Sequence[Promise], study: Study, power: float
) -> None:
    names = [f"{sample.one} and {sample.other}{sample.where}" for sample in found]
    known = min(len(sample.pairs) for sample in found)
    title = f"Share of campaigns that tell them apart, by {tests_of(study)} tests"
    table = Table("pairs", *names, title=title)
    for one in made:
        shares = zip(one.shares, one.cautious, strict=True)
        table.add_row(str(one.pairs), *(f"{share:.2f} ({cautious:.2f})" for share, cautious in shares))
    print_table(console, table)
    console.print(f"In brackets: if the {known} seeds of the pilot are themselves drawn.")
    last = made[-1]
    if min(last.shares) >= power:
        console.print(f"{last.pairs} pairs tell each of them apart with probability {power:g}.")
    else:
        open_ones = [name for name, share in zip(names, last.shares, strict=True) if share < power]
        console.print(
            f"{last.pairs} pairs do not reach probability {power:g} for {', '.join(open_ones)}.", markup=False
        )
