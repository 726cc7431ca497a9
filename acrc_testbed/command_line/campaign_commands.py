"""Implementation of the commands campaign, compare, study plan and study freeze."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from statistics import NormalDist
from typing import Final

import msgspec
import numpy as np
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from acrc_testbed.command_line.shared_options import answer
from acrc_testbed.experiments import campaign as campaigns
from acrc_testbed.experiments import frozen_plan, verdicts
from acrc_testbed.experiments.campaign import CampaignOptions
from acrc_testbed.experiments.comparison import (
    Comparison,
    comparison_of,
    identical_start_sentences,
    identical_starts,
    samples,
)
from acrc_testbed.experiments.evaluation import (
    CampaignEvaluation,
    evaluate,
    failure_sentences,
    metric_fault_sentences,
    overall_sentences,
    summary_sentences,
    verdict_sentence,
)
from acrc_testbed.experiments.metrics import chosen_metric
from acrc_testbed.experiments.paired_tests import ALPHA, MIN_PAIRS, AssumedEffect, Interval, pairs_needed
from acrc_testbed.experiments.store import (
    Store,
    create_store,
    difference_sentences,
    find_plan,
    isolation_sentences,
    load_store,
    plan_text,
    record_plan,
)
from acrc_testbed.experiments.study import load_study
from acrc_testbed.experiments.trial_settings import (
    StudyOptions,
    check_study,
    make_study,
    resolve_study,
    study_path,
)
from acrc_testbed.experiments.verdicts import (
    PowerEstimate,
    ceiling_sentences,
    family_size,
    power_estimates,
    power_warnings,
    primary_samples,
)
from acrc_testbed.results.seal import seal
from actors.console import create_console
from actors.installation.usage import OptionError, command_line, wrong_value
from actors.installation.version import software_version
from actors.processes.signals import Interruption
from actors.robot.behaviour.code_permit import Permit
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import choose_isolation
from deploy.hosts.address import dask_address
from deploy.run import out_folder
from deploy.run.progress import line_printer


def campaign(
    study_options: StudyOptions,
    out: Path | None,
    options: CampaignOptions,
    permit: Permit,
    *,
    plan: Path | None,
    until_decided: bool,
    json_output: bool,
) -> None:
    """Run the study and print its state. Exit code 1 if a repeated run gave another digest."""
    if options.on is not None:
        options = replace(options, on=dask_address(options.on))  # reports errors before anything is written
    study_options, notes = resolve_study(study_options)
    study = make_study(study_options)
    if study.isolated and options.on is None:
        choose_isolation(True)  # fails once here, not in each run
    source = study_path(study_options)
    warnings, folders = check_study(study, permit, source)
    plan_file = find_plan(plan, None if study.tuning else source)
    options = replace(options, folders=folders)
    folder = out or Path("campaigns", study.name + ("-tuning" if study.tuning else ""))
    store = create_store(folder.absolute(), study)
    analysis = verdicts.InterimAnalysis(store) if until_decided else None
    if analysis is not None:
        store.declare_looks()
    frozen = record_plan(store, plan_file, source, looks=until_decided)
    console = create_console(stderr=True)
    least = MIN_PAIRS if analysis is None else analysis.rules.least
    for line in [] if json_output else (*notes, *warnings, *power_warnings(study, least), *frozen):
        console.print(line)
    is_decided = (lambda: False) if analysis is None else analysis.is_decided
    try:
        with progress_display(quiet=json_output) as on_progress:
            progress = campaigns.run_campaign(store, options, on_progress, is_decided)
    except Interruption as interrupt:
        console.print(f"acrc: interrupted; the same command resumes from {folder}")
        raise typer.Exit(interrupt.exit_code) from None
    finally:
        campaigns.write_tables(store)
        seal(store.folder)
    different = difference_sentences(store)
    data = {
        "out": folder,
        **msgspec.to_builtins(progress),
        "protection": isolation_sentences(store),
        "differing": different,
        "checks": [msgspec.to_builtins(one) | {"agrees": one.agrees} for one in store.checks()],
        "coincide": identical_starts(store.records()),
    }
    answer(() if json_output else _final_sentences(store, folder, progress, analysis), data, json=json_output)
    _print_warnings(different)
    if different:
        raise typer.Exit(1)


def _final_sentences(
    store: Store,
    folder: Path,
    progress: campaigns.CampaignProgress,
    analysis: verdicts.InterimAnalysis | None,
) -> Iterator[str]:
    """Yield the final sentences."""
    yield from isolation_sentences(store)
    failed: dict[str, list[str]] = {}
    for record in store.records():
        if record.failure is not None:
            failed.setdefault(record.failure, []).append(f"{record.strategy} with seed {record.seed}")
    for cause, runs in failed.items():
        yield f"failed: {cause} ({len(runs)} runs, first {runs[0]})"
    yield from metric_fault_sentences(store.records(), store.study)
    yield from summary_sentences(store.records())
    yield from identical_start_sentences(identical_starts(store.records()))
    if analysis is not None:
        yield from verdicts.look_sentences(analysis.verdicts(), analysis.rules)
    yield (
        f"{progress.done} of {progress.total} runs done, {progress.failed} failed; {folder} contains tables "
        f"results.csv and results.parquet; to compare strategies: {command_line('compare', folder)}"
    )


@contextmanager
def progress_display(*, quiet: bool) -> Iterator[campaigns.OnProgress]:
    """Report progress on standard error, by a bar at a terminal, otherwise by occasional lines."""
    console = create_console(stderr=True, soft_wrap=False)
    if quiet:
        yield lambda progress: None
        return
    if not console.is_terminal:
        log = line_printer(console)
        yield lambda progress: log(f"{progress.done} of {progress.total} runs{_state(progress)}")
        return
    bar = Progress(
        TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[stands]}"),
        console=console,
    )  # fmt: skip
    with bar:
        task = bar.add_task("runs", total=None, stands="")
        yield lambda progress: bar.update(
            task,
            total=progress.total,
            completed=progress.done,
            stands=_state(progress).removeprefix(", "),
        )


def _state(progress: campaigns.CampaignProgress) -> str:
    """Return failures, a decision and the remaining time, each behind a comma."""
    failed = f", {progress.failed} failed" if progress.failed else ""
    decided = ", decided" if progress.enough else ""
    if not progress.left_s:
        return failed + decided
    checking = ", repeating some to check them" if progress.done == progress.total else ""
    seconds = progress.left_s
    left = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
    return f"{failed}{decided}{checking}, about {left} left"


def freeze(study_file: Path, out: Path | None, *, until_decided: bool, json: bool) -> None:
    """Freeze the study into `out`, by default beside its file. Raises AcrcError if that file exists."""
    target = out or study_file.with_suffix(frozen_plan.SUFFIX)
    if target.exists():
        raise AcrcError(f"{target}: already exists; a frozen plan is not replaced: choose another file")
    study = load_study(study_file)
    study.step_metrics()
    rules = verdicts.stopping_rules(study) if until_decided else None
    looks = () if rules is None else rules.differ.looks
    content = frozen_plan.freeze(study, software_version(), looks)
    with out_folder.convert_write_errors(target):
        regular_file.write_atomically(target, content)
    plan = frozen_plan.read_plan(target)
    answer(
        [
            f"Frozen {plan_text(plan)}",
            f"written to {target}; publish the hash before the first run, since it does not prove a date",
            *power_warnings(study, MIN_PAIRS if rules is None else rules.least),
        ],
        {"file": target, "commit": plan.commit, "sha256": plan.sha256},
        json=json,
    )


def compare(folder: Path, metric: str | None, *, json_output: bool) -> None:
    """Compare every pair of strategies of a campaign and print the results.

    Exit code 1, and a warning first and last, if a repeated run had another digest in memory.
    """
    store = load_store(folder)
    evaluation = evaluate(store, chosen_metric("--metric", metric, store.study.metrics()))
    different = difference_sentences(store)
    _print_warnings(different)
    answer(_comparison_output(store, evaluation), _comparison_json(evaluation), json=json_output)
    if not json_output:
        _print_warnings(different)
    if different:
        raise typer.Exit(1)


def _print_warnings(different: Sequence[str]) -> None:
    console = create_console(stderr=True)
    for line in different:
        console.print(f"acrc: {line}", style="bold red")


def _comparison_json(evaluation: CampaignEvaluation) -> dict[str, object]:
    return {
        "failures": evaluation.failures,
        "declared": evaluation.declared,
        "verdicts": [
            {
                "one": one.sample.one,
                "other": one.sample.other,
                "variant": one.sample.variant,
                "says": verdict_sentence(one),
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
            for one in evaluation.verdicts
        ],
        "across_cells": [one.builtins() for one in evaluation.across],
        "too_few": evaluation.too_few,
        "estimates": [one.estimates() for one in evaluation.estimates],
    }  # fmt: skip


def _comparison_output(store: Store, found: CampaignEvaluation) -> Iterator[str | Table]:
    """Yield the results of the tests, tables of estimates, interim looks, coincidences and warnings."""
    yield from (
        *found.failures,
        *isolation_sentences(store),
        *found.declared,
        *found.too_few,
        *found.family,
    )
    yield from map(verdict_sentence, found.verdicts)
    for across in found.across:
        yield from overall_sentences(across)
    if found.estimates:
        yield "Estimates with 95 % confidence intervals (descriptive, not tests):"
    yield from _tables(found.estimates)
    if store.looks is not None:
        yield from verdicts.look_sentences(found.looks, verdicts.stopping_rules(store.study))
    yield from identical_start_sentences(identical_starts(store.records()))
    if store.study.tuning:
        yield "These are tuning seeds: confirm settings chosen with them on other seeds."


def _tables(comparisons: Sequence[Comparison]) -> Iterator[Table]:
    """Yield a table per pair of strategies and variant, with a row per metric."""
    for (one, other, variant), group in groupby(comparisons, key=lambda c: (c.one, c.other, c.variant)):
        title = ", ".join([f"{one} and {other}", *(f"{key} = {value}" for key, value in variant)])
        table = Table("metric", one, other, "difference", "better", "worse", "A12", title=title)
        for each in group:
            table.add_row(
                each.metric,
                "" if each.ones is None else f"{each.ones:.4g}",
                "" if each.others is None else f"{each.others:.4g}",
                "" if each.difference is None else f"{_interval_text(each.difference, '+.3g')} {each.unit}",
                str(each.better),
                str(each.worse),
                _interval_text(each.effect, ".2f"),
            )
        yield table


def _interval_text(interval: Interval, form: str) -> str:
    return f"{interval.value:{form}} [{interval.low:{form}}, {interval.high:{form}}]"


def plan(a12: float, power: float, correlation: float, comparisons: int, *, json: bool) -> None:
    """Print the number of pairs that an effect requires; a comparison by two metrics has two tests."""
    tests = 2 * comparisons
    try:
        pairs = pairs_needed(AssumedEffect(a12, correlation, power, tests))
    except ValueError as error:
        raise OptionError(f"--a12: {a12:g}: {error}") from None
    answer(
        [
            f"{pairs} pairs of runs detect an effect of A12 = {a12:g} with probability {power:g} at 5 % "
            f"shared by {tests} tests (two metrics of each comparison), if runs with the same seed have "
            f"correlation {correlation:g}."
        ],
        {"pairs": pairs, "a12": a12, "power": power, "correlation": correlation, "tests": tests},
        json=json,
    )


def plan_from_pilot(
    folder: Path, metric: str | None, power: float, difference: str | None, *, json: bool
) -> None:
    """Print the power of the declared comparisons by campaign size, and ceiling effects.

    `difference`: percentage of the second strategy's mean; instead print the pairs that it requires.
    """
    store = load_store(folder)
    chosen_metric("--metric", metric, store.study.metrics())
    study = msgspec.structs.replace(store.study, primary_metric=metric or store.study.primary_metric)
    records = list(store.records())
    paired = primary_samples(samples(records, study), study)
    if not paired or not all(sample.pairs for sample in paired):
        raise AcrcError(f"{folder}: a declared comparison has no pair of runs; run at least one of each")
    steps = [comparison_of(sample, study.step_metrics()[0]) for sample in paired]
    names, tests = [sample.name for sample in paired], family_size(study)
    planned: list[str | Table]
    data: dict[str, object] = {"comparisons": names, "tests": tests, "power": power}
    if difference is None:
        estimates = list(power_estimates(paired, study, power))
        data["promises"] = estimates
        seeds = min(len(sample.pairs) for sample in paired)
        planned = list(_power_table(names, estimates, tests, power, seeds))
    else:
        planned = [_difference_sentence(step, difference, power, tests) for step in steps]
        data["says"] = planned
    output = [
        *failure_sentences(records, study),
        *planned,
        *(
            f"{one.sample.name}: only {differing} of {one.pairs} pairs of the pilot differ in {one.says}, so "
            f"these numbers are uncertain; {_SMALL_PILOT} pairs or more should differ."
            for one in steps
            if (differing := one.better + one.worse) < _SMALL_PILOT
        ),
        *ceiling_sentences(records, study),
    ]
    if not store.study.tuning:
        output.append(
            "This pilot uses the seeds of tests, which are no longer unseen; run pilots with --tuning."
        )
    answer(output, data, json=json)


_SMALL_PILOT: Final = 10
"""Pairs that differ below which a pilot is reported as small."""
_MAX_DEVIATIONS: Final = 5.0
"""Larger differences need no fewer pairs."""


def _difference_sentence(step: Comparison, percent: str, power: float, tests: int) -> str:
    """Return how many pairs detect a difference of a percentage of the second strategy's mean."""
    deviation = float(np.std(step.scores.gains, ddof=1))
    if deviation == 0.0:
        raise AcrcError(f"{step.sample.name}: pairs of the pilot do not vary in {step.says}")
    try:
        difference = (step.others or 0.0) * float(percent.rstrip("%")) / 100.0
        a12 = NormalDist().cdf(min(difference / deviation, _MAX_DEVIATIONS))
        pairs = pairs_needed(AssumedEffect(a12, power=power, tests=tests))
    except ValueError:
        right = "a percentage, such as 10%, that needs at most 1000 pairs"
        raise wrong_value("--difference", percent, right) from None
    return (
        f"{pairs} pairs detect a difference of {difference:.3g} {step.unit} in {step.says}{step.sample.where}"
        f" ({percent.rstrip('%')} % of the mean of {step.other}) with probability {power:g} at"
        f" p ≤ {ALPHA / tests:.2g}, if differences are normal with the pilot's standard deviation of"
        f" {deviation:.3g} {step.unit}."
    )


def _power_table(
    names: Sequence[str], estimates: Sequence[PowerEstimate], tests: int, power: float, seeds: int
) -> Iterator[str | Table]:
    title = f"Power: share of campaigns that detect the difference, by {tests} tests"
    table = Table("pairs", *names, title=title)
    for one in estimates:
        shares = zip(one.shares, one.cautious, strict=True)
        table.add_row(str(one.pairs), *(f"{share:.2f} ({cautious:.2f})" for share, cautious in shares))
    yield table
    as_in_pilot = _pairs_text([(one.pairs, *one.shares) for one in estimates], power)
    cautious = _pairs_text([(one.pairs, *one.cautious) for one in estimates], power)
    yield f"If differences are as large as in the pilot, {as_in_pilot}."
    yield f"With the uncertainty of its {seeds} seeds (in brackets; plan with these numbers), {cautious}."


def _pairs_text(estimates: Sequence[tuple[float, ...]], power: float) -> str:
    """Return the least number of pairs with this power; `estimates`: pairs and power of each comparison."""
    for pairs, *shares in estimates:
        if min(shares) >= power:
            return f"{pairs} pairs detect each with probability {power:g}"
    return f"{estimates[-1][0]} pairs do not detect each with probability {power:g}"
