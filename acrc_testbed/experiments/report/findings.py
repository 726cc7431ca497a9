"""Sentences and tables of a report: study, results, failures and caveats."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from acrc_testbed.experiments.comparison import Comparison
from acrc_testbed.experiments.evaluation import CampaignEvaluation, OverallEstimate
from acrc_testbed.experiments.metrics import is_full, known_values
from acrc_testbed.experiments.paired_tests import MIN_PAIRS
from acrc_testbed.experiments.report.report_view import (
    REAL,
    UPPER_BOUNDS,
    Cell,
    Group,
    ReportView,
    Row,
    RunSource,
    strategy_label,
)
from acrc_testbed.experiments.report.time_sections import deadlock_counts
from acrc_testbed.experiments.study import Study, variant_text
from acrc_testbed.experiments.verdicts import PairVerdict
from acrc_testbed.picture.html_page import PageTable

_VERDICTS = ("better", "worse", "equivalent", "undecided")
_MAX_SENTENCES: Final = 8
"""Number of verdicts up to which each has a sentence."""
_MAX_UNFOLDED_ROWS: Final = 12
"""Rows up to which the table of estimates is unfolded."""


def with_upper_bounds_marked(found: CampaignEvaluation) -> CampaignEvaluation:
    """Return the judgement with upper bounds marked in names of strategies."""
    return replace(
        found,
        verdicts=[replace(one, steps=tuple(map(_with_marked_names, one.steps))) for one in found.verdicts],
        across=[
            one._replace(one=strategy_label(one.one), other=strategy_label(one.other)) for one in found.across
        ],
        estimates=list(map(_with_marked_names, found.estimates)),
    )


def _with_marked_names(one: Comparison) -> Comparison:
    return replace(
        one, sample=one.sample._replace(one=strategy_label(one.one), other=strategy_label(one.other))
    )


def sentences(found: CampaignEvaluation) -> list[str]:
    """Return sentences on failures and declared comparisons; many comparisons are summarised."""
    decided = [one for one in found.verdicts if one.steps]
    if len(decided) <= _MAX_SENTENCES:
        return replace(found, verdicts=decided).sentences()
    return [*replace(found, verdicts=[]).sentences(), *_verdict_counts(decided)]


def _verdict_counts(verdicts: Sequence[PairVerdict]) -> Iterator[str]:
    """Yield the number of conditions by verdict for each pair of strategies."""
    by_pair: dict[tuple[str, str], list[str]] = {}
    for one in verdicts:
        by_pair.setdefault((one.steps[0].one, one.steps[0].other), []).append(one.label)
    for pair, labels in by_pair.items():
        parts = [f"{labels.count(verdict)} {verdict}" for verdict in _VERDICTS if verdict in labels]
        yield f"{pair[0]} versus {pair[1]}, in {len(labels)} conditions: {', '.join(parts)}."


def tables(view: ReportView, name: str, found: CampaignEvaluation) -> Iterator[PageTable]:
    """Yield tables of all tests with p-values, and all estimates with intervals."""
    varies = any(one.variant for one in found.estimates)
    decided = [one for one in found.verdicts if one.steps]
    if len(decided) > _MAX_SENTENCES:
        yield view.table(
            f"verdicts_{name}",
            "Verdict on each declared comparison, with the metric that decided it or left it undecided. "
            "Equivalent: within the margin by every test. Intervals: 95 %.",
            map(_verdict_row, decided),
        )
    yield view.table(
        f"tests_{name}",
        "Tests of the declared comparisons: exact randomisation tests of pairs. Equivalence: means "
        "differ by less than the margin. n/a: too few pairs (differ), no margin, or an event in no run.",
        [_comparison_names(step, varies) | _test_cells(step) for one in decided for step in one.steps],
    )
    metric = next((f" in {one.metric}" for one in found.across), "")
    yield view.table(
        f"cells_{name}",
        f"Declared comparisons over all cells: mean difference within pairs{metric}, prediction interval "
        "for a new cell with as many seeds, and standard deviations. Mixed model with random effects of "
        "cells and seeds, fitted by restricted maximum likelihood; not a test.",
        [_overall_row(one) for one in found.across if one.fitted is not None],
    )
    yield view.table(
        f"without_map_{name}",
        "Difference without each map in turn.",
        [
            {"first": one.one, "second": one.other, "without": name, "difference": difference}
            for one in found.across
            for name, difference in one.without.items()
        ],
    )
    yield view.table(
        f"comparisons_{name}",
        "Estimates, without tests: means (restricted means for times). A12: probability that a run of the "
        "first is better than one of the second, ties counted half. Intervals: 95 %.",
        [_estimate_row(one, varies) for one in found.estimates],
        folded=len(found.estimates) > _MAX_UNFOLDED_ROWS,
    )


def _comparison_names(one: Comparison, varies: bool) -> dict[str, Cell]:
    where = {"condition": variant_text(one.variant)} if varies else {}
    return {"first": one.one, "second": one.other, **where, "metric": one.says}


def _verdict_row(one: PairVerdict) -> Row:
    """Return a verdict with the estimates of the metric tested last."""
    step = one.deciding or next((step for step in one.steps if not step.equivalent), one.steps[-1])
    names = {"first": step.one, "second": step.other, "condition": variant_text(step.variant)}
    decided = {"result for the first": one.label, "metric": step.says}
    p = {"p (Holm)": step.adjusted if step.tested else None}
    return names | decided | _estimate_cells(step, "better on", "worse on") | p


def _estimate_cells(one: Comparison, better: str = "better", worse: str = "worse") -> dict[str, Cell]:
    """Return the estimates of a comparison; None for too few pairs."""
    columns = ("mean of first", "mean of second", "difference", better, worse, "A12")
    if not one.is_estimated:
        return dict.fromkeys(columns)
    cells = (one.ones, one.others, one.difference, one.better, one.worse, one.effect)
    return dict(zip(columns, cells, strict=True))


def _test_cells(step: Comparison) -> dict[str, Cell]:
    return {
        "pairs": len(step.sample.pairs),
        "differing pairs": step.test.differing,
        "p": step.test.p if step.happened else None,
        "p (Holm)": step.adjusted if step.tested else None,
        "margin": step.margin,
        "p (equivalence)": step.equivalence_p if step.happened and step.margin is not None else None,
    }


def _overall_row(one: OverallEstimate) -> Row:
    assert one.fitted is not None
    return {
        "first": one.one,
        "second": one.other,
        "cells": one.fitted.cells,
        "pairs": one.fitted.values,
        "difference": one.fitted.mean,
        "new cell": one.fitted.new_cell,
        "between cells": one.fitted.between_cells,
        "between seeds": one.fitted.between_seeds,
        "residual": one.fitted.rest,
    }


def _estimate_row(one: Comparison, varies: bool) -> Row:
    unit = f", {one.unit}" if one.unit not in {"", one.says} else ""
    return _comparison_names(one, varies) | {"metric": one.says + unit} | _estimate_cells(one)


def study_sentence(source: RunSource) -> str:
    """Return a description of a folder's runs."""
    study = source.study
    if study is None:
        if source.conditions == (REAL,):
            return f"{source.name}: recordings of real robots from a field trial."
        (run,) = source.records
        return f"{source.name}: one run of {strategy_label(run.strategy)} with seed {run.seed}."
    scenario = study.scenario.replace("\\", "/").rpartition("/")[2]
    parts = [
        f"{source.name}: {', '.join(map(strategy_label, study.strategies))} in {scenario}, "
        f"each with {study.seeds} common seeds ({_seed_range(study)})"
    ]
    parts += [f"{factor.key} varies: {', '.join(map(str, factor.values))}" for factor in study.factors]
    if study.cells:
        drawn = (f"{factor.key} ({', '.join(map(str, factor.values))})" for factor in study.random)
        parts.append(f"{len(study.cells)} random cells of {', '.join(drawn)}")
    if study.conditions == "drawn":
        parts.append(
            f"starts, {study.task.items}, odometry errors and shadowing are drawn for each seed unless set "
            "by the study"
        )
    if study.settings:
        parts.append(f"with {variant_text(study.settings)}")
    parts += [f"own metrics: {', '.join(one.name for one in study.metric)}"] if study.metric else []
    declared = " and ".join(f"{one} versus {other}" for one, other in study.primary_pairs)
    parts.append(f"declared comparisons: {declared or 'none'}")
    return "; ".join(parts) + "."


def _seed_range(study: Study) -> str:
    first = study.first_seed
    return f"{first} to {first + study.seeds - 1}{', for tuning' if study.tuning else ''}"


def failures(view: ReportView, sources: Sequence[RunSource]) -> PageTable:
    """Return a table of failed runs by cause; may be empty."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for source in sources:
        for condition, record in zip(source.conditions, source.records, strict=True):
            if record.failure is not None:
                key = (condition, strategy_label(record.strategy), record.failure)
                found.setdefault(key, []).append(str(record.seed))
    rows: list[Row] = [
        {
            "condition": condition,
            "strategy": strategy,
            "cause": cause,
            "runs": len(seeds),
            "seeds": ", ".join(seeds[:12]) + (", …" if len(seeds) > 12 else ""),
        }
        for (condition, strategy, cause), seeds in found.items()
    ]
    return view.table("failures", "Failed runs", rows)


_CEILING: Final = 0.5
"""Share of complete runs from which a ceiling effect is reported."""

_MAX_NAMED_GROUPS: Final = 4
"""Groups named in a sentence about several groups."""


def caveats(sources: Sequence[RunSource], view: ReportView) -> list[str]:
    """Return caveats, the most serious first."""
    return [
        *_limited_use(sources, view),
        *_notes(sources),
        *(line for one in sources if one.evaluation is not None for line in one.evaluation.too_few),
        *_single_runs(sources),
        *_incomplete_campaigns(sources),
        *_upper_bounds(view),
        *_ceiling_and_floor(view),
        *_deadlock_caveats(view),
        *(line for group in view.groups for line in _fault_caveats(view, group)),
        *_software_caveats(sources),
    ]


def _limited_use(sources: Sequence[RunSource], view: ReportView) -> Iterator[str]:
    for one in sources:
        if one.study is not None and one.study.tuning:
            yield f"{one.name}: tuning seeds; judge settings chosen with them on other seeds."
    if any(run.contacts is None for run in view.results):
        yield (
            f"Real robots have no ground truth: {view.task.items} are as reported; contacts, localisation "
            "errors, causes of lost time and CPU time are unknown; times of events are those of reports. The "
            "strategy is not recorded, so each field trial is named after its folder."
        )


def _notes(sources: Sequence[RunSource]) -> Iterator[str]:
    """Yield malformed reports of robots, and missing data of field trials."""
    for one in sources:
        for record in one.records:
            run = record.result
            if run is not None:
                lines = (
                    f"{record.strategy}, seed {record.seed}: {sentence}" for sentence in run.refused_reports
                )
                yield from (f"{one.name}: {sentence}." for sentence in lines)
            if run is not None and not run.is_simulated:
                yield from (f"{one.name}: {note.rstrip('.')}." for note in run.notes)


def _single_runs(sources: Sequence[RunSource]) -> Iterator[str]:
    singles = sum(one.study is None for one in sources)
    if singles:
        yield (
            f"{singles} of the folders contain a single run each, which is shown but not tested; "
            f"a comparison needs at least {MIN_PAIRS} pairs of runs of one campaign."
        )
    campaigns = len(sources) - singles
    if campaigns > 1:
        yield f"The {campaigns} campaigns are evaluated separately, and p-values are adjusted within each."


def _incomplete_campaigns(sources: Sequence[RunSource]) -> Iterator[str]:
    for one in sources:
        failed = sum(record.failure is not None for record in one.records)
        pending = 0 if one.store is None else len(one.store.pending())
        if pending:
            yield (
                f"{one.name}: {pending} of {pending + len(one.records)} runs are missing; results may change."
            )
        if failed:
            yield (
                f"{one.name}: {failed} of {len(one.records)} runs failed and are not in the pictures, which "
                "favours strategies that fail on hard seeds. Causes are listed below."
            )


def _upper_bounds(view: ReportView) -> Iterator[str]:
    names = dict.fromkeys(one.strategy for one in view.groups if one.strategy in UPPER_BOUNDS)
    for name in names:
        yield f"{name} uses information that robots do not have; it is an upper bound, not a competitor."


def _ceiling_and_floor(view: ReportView) -> Iterator[str]:
    """Yield caveats on ceiling and floor effects."""
    for metric in view.task.metrics:
        full = [
            f"{view.row_name(group)} ({count} of {len(group.results)})"
            for group in view.groups
            if len(group.results) > 1
            and (count := sum(is_full(metric, run) for run in group.results)) >= _CEILING * len(group.results)
        ]
        if full:
            yield (
                f"At least half of the runs have the largest possible value of {metric.description}: "
                f"{_group_list(full)}. This ceiling effect hides differences; use more robots or less time."
            )
        never = [
            view.row_name(group)
            for group in view.groups
            if metric.event and not known_values(metric, group.results)
        ]
        if never:
            yield (
                f"Without a run that was {metric.event}: {_group_list(never)}. Their restricted mean is the "
                "length of the runs, a lower bound."
            )


def _group_list(names: Sequence[str]) -> str:
    """List the first groups, and the number of others."""
    if len(names) <= _MAX_NAMED_GROUPS:
        return "; ".join(names)
    return f"{'; '.join(names[:_MAX_NAMED_GROUPS])}; and {len(names) - _MAX_NAMED_GROUPS} more groups"


def _deadlock_caveats(view: ReportView) -> Iterator[str]:
    """Yield the mean number of deadlocked pairs, which often decide a run."""
    counts = [
        f"{view.row_name(group)} {sum(run.pairs for run in runs) / len(runs):.2g} "
        f"({sum(run.came_free for run in runs)} of {sum(run.pairs for run in runs)} resolved)"
        for group in view.groups
        if (runs := deadlock_counts(group))
    ]
    if counts:
        yield f"Mean number of deadlocked pairs per run: {_group_list(counts)}."
    elif any(one.is_simulated for one in view.results):
        yield "Deadlocks were not recorded in these runs, although they often decide a run."


def _fault_caveats(view: ReportView, group: Group) -> Iterator[str]:
    for metric in (one for one in view.task.metrics if one.reported):
        known = [run for run in group.results if known_values(metric, (run,))]
        reported = sum(known_values(metric._replace(column=metric.reported), known))
        if false := reported - sum(known_values(metric, known)):
            yield (
                f"{view.row_name(group)}: {false:g} {metric.unit} were reported as {view.task.done}, but "
                "they were not."
            )
    lost = sum(one.undelivered > 0 for one in group.results if one.is_simulated)
    if lost:
        yield f"{view.row_name(group)}: in {lost} runs messages between processes were lost."


def _software_caveats(sources: Sequence[RunSource]) -> Iterator[str]:
    commits = dict.fromkeys(one.commit for one in sources if one.commit)
    if len(commits) > 1:
        yield f"The folders were made with different commits: {', '.join(commit[:12] for commit in commits)}."
    if any(commit.endswith("+") for commit in commits):
        yield "The software had uncommitted changes, so these runs cannot be reproduced elsewhere."
