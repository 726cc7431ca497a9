"""Implementation of the commands campaign, compare, report, bundle, study plan and study freeze."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import msgspec
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from acrc_testbed.command_line.shared_options import answer
from acrc_testbed.experiments import campaign as campaigns
from acrc_testbed.experiments import comparison, frozen_plan, store, verdicts
from acrc_testbed.experiments.campaign import CampaignOptions
from acrc_testbed.experiments.comparison import (
    Comparison,
    identical_start_sentences,
    identical_starts,
    samples,
)
from acrc_testbed.experiments.evaluation import (
    CampaignEvaluation,
    evaluate,
    failure_sentences,
    overall_sentences,
    summary_sentences,
    verdict_sentence,
)
from acrc_testbed.experiments.paired_tests import MIN_PAIRS, AssumedEffect, Interval, pairs_needed
from acrc_testbed.experiments.store import difference_sentences, isolation_sentences, plan_text
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
    step_metrics,
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
from deploy.hosts.address import plain
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
        options = replace(options, on=plain(options.on))  # reports errors before anything is written
    study_options, notes = resolve_study(study_options)
    study = make_study(study_options)
    if study.isolated and options.on is None:
        choose_isolation(True)  # fails once here, not in each run
    source = study_path(study_options)
    hints, modules = check_study(study, permit, source)
    plan_file = store.find_plan(plan, None if study.tuning else source)
    options = replace(options, modules=modules)
    folder = out or Path("campaigns", study.name + ("-tuning" if study.tuning else ""))
    kept = store.create(folder.absolute(), study)
    watch = verdicts.InterimAnalysis(kept) if until_decided else None
    if watch is not None:
        kept.declare_looks()
    frozen = store.record_plan(kept, plan_file, source, looks=until_decided)
    say = create_console(stderr=True)
    least = MIN_PAIRS if watch is None else watch.rules.least
    for line in [] if json_output else (*notes, *hints, *power_warnings(study, least), *frozen):
        say.print(line)
    enough = (lambda: False) if watch is None else watch.is_decided
    try:
        with progress_display(quiet=json_output) as follow:
            progress = campaigns.run_campaign(kept, options, follow, enough)
    except Interruption as interrupt:
        say.print(f"acrc: interrupted; the same command resumes from {folder}")
        raise typer.Exit(interrupt.exit_code) from None
    finally:
        campaigns.write_tables(kept)
        seal(kept.folder)
    different = difference_sentences(kept)
    data = {
        "out": folder,
        **msgspec.to_builtins(progress),
        "protection": isolation_sentences(kept),
        "differing": different,
        "checks": [msgspec.to_builtins(one) | {"agrees": one.agrees} for one in kept.checks()],
        "coincide": identical_starts(kept.records()),
    }
    answer(() if json_output else _lines(kept, folder, progress, watch), data, json=json_output)
    _warn(different)
    if different:
        raise typer.Exit(1)


def _lines(
    kept: store.Store,
    folder: Path,
    progress: campaigns.CampaignProgress,
    watch: verdicts.InterimAnalysis | None,
) -> Iterator[str]:
    """Yield the final sentences."""
    yield from isolation_sentences(kept)
    failed: dict[str, list[str]] = {}
    for record in kept.records():
        if record.failure is not None:
            failed.setdefault(record.failure, []).append(f"{record.strategy} with seed {record.seed}")
    for cause, runs in failed.items():
        yield f"failed: {cause} ({len(runs)} runs, first {runs[0]})"
    yield from summary_sentences(kept.records())
    yield from identical_start_sentences(identical_starts(kept.records()))
    if watch is not None:
        yield from verdicts.look_sentences(watch.verdicts(), watch.rules)
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
        yield lambda progress: log(f"{progress.done} of {progress.total} runs{_stands(progress)}")
        return
    bar = Progress(
        TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[stands]}"),
        console=console,
    )  # fmt: skip
    with bar:
        task = bar.add_task("runs", total=None, stands="")
        yield lambda progress: bar.update(
            task, total=progress.total, completed=progress.done, stands=_stands(progress).removeprefix(", ")
        )


def _stands(progress: campaigns.CampaignProgress) -> str:
    """Return failures, a decision and the remaining time, each behind a comma."""
    failed = f", {progress.failed} failed" if progress.failed else ""
    decided = ", decided" if progress.enough else ""
    if not progress.left_s:
        return failed + decided
    checking = ", repeating some to check them" if progress.done == progress.total else ""
    return f"{failed}{decided}{checking}, about {_span(progress.left_s)} left"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def freeze(study_file: Path, out: Path | None, *, until_decided: bool, json: bool) -> None:
    """Freeze the study into `out`, by default beside its file. Raises AcrcError if that file exists."""
    target = out or study_file.with_suffix(frozen_plan.SUFFIX)
    if target.exists():
        raise AcrcError(f"{target}: already exists; a frozen plan is not replaced: choose another file")
    study = load_study(study_file)
    step_metrics(study)
    looks = verdicts.stopping_rules(study).differ.looks if until_decided else ()
    content = frozen_plan.freeze(study, software_version(), looks)
    with out_folder.convert_write_errors(target):
        regular_file.write_atomically(target, content)
    plan = frozen_plan.read_plan(target)
    answer(
        [
            f"Frozen {plan_text(plan)}",
            f"written to {target}; publish the hash before the first run, since it does not prove a date",
        ],
        {"file": target, "commit": plan.commit, "sha256": plan.sha256},
        json=json,
    )


def report(folders: Sequence[Path], out: Path | None, *, json: bool) -> None:
    """Write the report to `out`, by default in the first folder."""
    from acrc_testbed.experiments.report import report_page as reports  # draws with matplotlib

    target = out or folders[0] / "report"
    with out_folder.convert_write_errors(target):
        page = reports.write(folders, out or regular_file.check_no_link(target))
    answer([f"written to {page}, with pictures and tables"], {"page": page}, json=json)


def bundle(folder: Path, out: Path | None, authors: Sequence[str], *, json: bool) -> None:
    """Write the bundle to `out`, by default beside the campaign's folder."""
    from acrc_testbed.experiments.report import campaign_bundle  # draws with matplotlib

    target = out or folder.resolve().parent / f"{folder.resolve().name}.zip"
    with out_folder.convert_write_errors(target):
        has_software = campaign_bundle.make_bundle(folder, target, authors)
    lines = [f"written to {target}; unpack it and run ./reproduce.sh to repeat the runs"]
    if not has_software:
        lines.append("the software is not included: it has uncommitted changes, or its commit is missing")
    if not authors:
        lines.append("CITATION.cff has no author; add --author NAME")
    answer(lines, {"file": target, "has_software": has_software, "authors": authors}, json=json)


def compare(folder: Path, metric: str | None, *, json_output: bool) -> None:
    """Compare every pair of strategies of a campaign and print the results.

    Exit code 1, and a warning first and last, if a repeated run had another digest in memory.
    """
    if metric is not None and not comparison.is_metric(metric):
        raise wrong_value("--metric", metric, comparison.CHOICE)
    kept = store.load(folder)
    found = evaluate(kept, metric)
    different = difference_sentences(kept)
    _warn(different)
    answer(_comparison(kept, found), _comparison_json(found), json=json_output)
    if not json_output:
        _warn(different)
    if different:
        raise typer.Exit(1)


def _warn(different: Sequence[str]) -> None:
    console = create_console(stderr=True)
    for line in different:
        console.print(f"acrc: {line}", style="bold red")


def _comparison_json(found: CampaignEvaluation) -> dict[str, object]:
    return {
        "failures": found.failures,
        "declared": found.declared,
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
            for one in found.verdicts
        ],
        "across_cells": [one.builtins() for one in found.across],
        "too_few": found.too_few,
        "estimates": [one.estimates() for one in found.estimates],
    }  # fmt: skip


def _comparison(kept: store.Store, found: CampaignEvaluation) -> Iterator[str | Table]:
    """Yield the results of the tests, tables of estimates, interim looks, coincidences and warnings."""
    yield from (*found.failures, *isolation_sentences(kept), *found.declared, *found.too_few, *found.family)
    yield from map(verdict_sentence, found.verdicts)
    for across in found.across:
        yield from overall_sentences(across)
    if found.estimates:
        yield "Estimates with 95 % confidence intervals (descriptive, not tests):"
    yield from _tables(found.estimates)
    if kept.looks is not None:
        yield from verdicts.look_sentences(found.looks, verdicts.stopping_rules(kept.study))
    yield from identical_start_sentences(identical_starts(kept.records()))
    if kept.study.tuning:
        yield "These are tuning seeds: confirm settings chosen with them on other seeds."


def _tables(made: Sequence[Comparison]) -> Iterator[Table]:
    """Yield a table per pair of strategies and variant, with a row per metric."""
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
    """Print the number of pairs that an effect requires; a comparison has two tests (places, times)."""
    tests = 2 * comparisons
    try:
        pairs = pairs_needed(AssumedEffect(a12, correlation, power, tests))
    except ValueError as error:
        raise OptionError(f"--a12: {error}") from None
    answer(
        [
            f"{pairs} pairs of runs detect an effect of A12 = {a12:g} with probability {power:g} at 5 % "
            f"shared by {tests} tests, if runs with the same seed have correlation {correlation:g}."
        ],
        {"pairs": pairs, "a12": a12, "power": power, "correlation": correlation, "tests": tests},
        json=json,
    )


def plan_from_pilot(folder: Path, metric: str | None, power: float, comparisons: int, *, json: bool) -> None:
    """Print the power of the declared comparisons by campaign size, and ceiling effects."""
    if comparisons > 1:
        raise OptionError("--comparisons: cannot be combined with --pilot; the study declares them")
    kept = store.load(folder)
    if metric is not None and not comparison.is_metric(metric):
        raise wrong_value("--metric", metric, comparison.CHOICE)
    study = msgspec.structs.replace(kept.study, primary_metric=metric or kept.study.primary_metric)
    records = list(kept.records())
    found = primary_samples(samples(records, study), study)
    if not found or not all(sample.pairs for sample in found):
        raise AcrcError(f"{folder}: a declared comparison has no pair of runs; run at least one of each")
    made = list(power_estimates(found, study, power))
    names = [sample.name for sample in found]
    data = {"comparisons": names, "tests": family_size(study), "power": power, "promises": made}
    seeds = min(len(sample.pairs) for sample in found)
    shown = [
        *failure_sentences(records, study),
        *_promised(names, made, family_size(study), power, seeds),
        *ceiling_sentences(records),
    ]
    if not kept.study.tuning:
        shown.append(
            "This pilot uses the seeds of tests, which are no longer unseen; run pilots with --tuning."
        )
    answer(shown, data, json=json)


def _promised(
    names: Sequence[str], made: Sequence[PowerEstimate], tests: int, power: float, seeds: int
) -> Iterator[str | Table]:
    title = f"Power: share of campaigns that detect the difference, by {tests} tests"
    table = Table("pairs", *names, title=title)
    for one in made:
        shares = zip(one.shares, one.cautious, strict=True)
        table.add_row(str(one.pairs), *(f"{share:.2f} ({cautious:.2f})" for share, cautious in shares))
    yield table
    yield f"In brackets: with the {seeds} seeds of the pilot resampled, too."
    last = made[-1]
    if min(last.shares) >= power:
        yield f"{last.pairs} pairs detect each difference with probability {power:g}."
    else:
        open_ones = [name for name, share in zip(names, last.shares, strict=True) if share < power]
        yield f"{last.pairs} pairs do not reach probability {power:g} for {', '.join(open_ones)}."
