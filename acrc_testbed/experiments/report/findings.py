"""Sentences and tables of a report: what was asked and found, what failed, and warnings."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from acrc_testbed.experiments.comparison import Comparison
from acrc_testbed.experiments.judgement import AcrossCells, CampaignJudgement
from acrc_testbed.experiments.paired_tests import LEAST_PAIRS
from acrc_testbed.experiments.report.runs import (
    REAL,
    UPPER_BOUNDS,
    Cell,
    Group,
    ReportView,
    Row,
    RunSource,
    completed,
    label,
    places,
)
from acrc_testbed.experiments.report.time_sections import deadlocks
from acrc_testbed.experiments.study import FIRST_TUNING_SEED, Study, Variant
from acrc_testbed.experiments.verdicts import PairVerdict
from acrc_testbed.picture.html_page import PageTable

_TOLD = ("better", "worse", "as good", "not told apart")
_MOST_TOLD: Final = 8
"""Verdicts that are told in a sentence each."""
_MOST_OPEN: Final = 12
"""Estimates whose table is shown unasked."""


def labelled(found: CampaignJudgement) -> CampaignJudgement:
    """Mark upper bounds among the names of strategies."""
    return replace(
        found,
        verdicts=[replace(one, steps=tuple(map(_labelled, one.steps))) for one in found.verdicts],
        across=[one._replace(one=label(one.one), other=label(one.other)) for one in found.across],
        estimates=list(map(_labelled, found.estimates)),
    )


def _labelled(one: Comparison) -> Comparison:
    return replace(one, sample=one.sample._replace(one=label(one.one), other=label(one.other)))


def sentences(found: CampaignJudgement) -> list[str]:
    """Return failures and results of the declared comparisons; many comparisons are counted."""
    decided = [one for one in found.verdicts if one.steps]
    if len(decided) <= _MOST_TOLD:
        return replace(found, verdicts=decided).sentences()
    return [*replace(found, verdicts=[]).sentences(), *_counted(decided)]


def _counted(verdicts: Sequence[PairVerdict]) -> Iterator[str]:
    """Count for each pair the conditions by the first strategy's result."""
    by_pair: dict[tuple[str, str], list[str]] = {}
    for one in verdicts:
        by_pair.setdefault((one.steps[0].one, one.steps[0].other), []).append(one.word)
    for pair, words in by_pair.items():
        parts = [f"{word} in {words.count(word)}" for word in _TOLD if word in words]
        yield f"{pair[0]} beside {pair[1]}, of {len(words)} conditions: {', '.join(parts)}."


def tables(view: ReportView, name: str, found: CampaignJudgement) -> Iterator[PageTable]:
    """Yield all tests with their p-values, and all estimates with their intervals."""
    varies = any(one.variant for one in found.estimates)
    decided = [one for one in found.verdicts if one.steps]
    if len(decided) > _MOST_TOLD:
        yield view.table(
            f"verdicts_{name}",
            "What each declared comparison came to, by the test of the metric that decided it, or that left "
            "it undecided. As good: within the margin, by every test. Intervals are of 95 %.",
            map(_verdict, decided),
        )
    yield view.table(
        f"tests_{name}",
        "The tests of the declared comparisons. p is of the runs swapped within their pairs in all "
        "ways. Holm's correction holds for the rows that have it; the others have too few pairs that "
        "differ. "
        "Equivalence is that the means differ by less than the margin.",
        [_named(step, varies) | _test(step) for one in decided for step in one.steps],
    )
    yield view.table(
        f"cells_{name}",
        "The declared comparisons over all cells: the mean difference in places within pairs, "
        "what a new cell with as many seeds would show, and standard deviations. Cells and seeds are "
        "random effects, fitted by restricted maximum likelihood; none of it is a test.",
        [_over_cells(one) for one in found.across if one.fitted is not None],
    )
    yield view.table(
        f"without_map_{name}",
        "The same difference without each map in turn.",
        [
            {"first": one.one, "second": one.other, "without": name, "difference": difference}
            for one in found.across
            for name, difference in one.without.items()
        ],
    )
    yield view.table(
        f"comparisons_{name}",
        "Estimates; none of them is a test. Values are means, of times restricted means. A12 is the "
        "probability that a run of the first is better than one of the second, ties counted half. "
        "Intervals are of 95 %.",
        [_estimate(one, varies) for one in found.estimates],
        folded=len(found.estimates) > _MOST_OPEN,
    )


def _named(one: Comparison, varies: bool) -> dict[str, Cell]:
    where = {"condition": _condition(one.variant)} if varies else {}
    return {"first": one.one, "second": one.other, **where, "metric": one.says}


def _condition(variant: Variant) -> str:
    return ", ".join(f"{key} = {value}" for key, value in variant)


def _verdict(one: PairVerdict) -> Row:
    """Return a verdict with the estimates of the metric that was tested last."""
    step = one.deciding or next((step for step in one.steps if not step.equivalent), one.steps[-1])
    names = {"first": step.one, "second": step.other, "condition": _condition(step.variant)}
    decided = {"the first is": one.word, "by": step.says}
    p = {"p after Holm": step.adjusted if step.tested else None}
    return names | decided | _numbers(step, "better on", "worse on") | p


def _numbers(one: Comparison, better: str = "better", worse: str = "worse") -> dict[str, Cell]:
    """Return the estimates of a comparison; of too few pairs they are unknown."""
    columns = ("first has", "second has", "difference", better, worse, "A12")
    if not one.is_estimated:
        return dict.fromkeys(columns)
    cells = (one.ones, one.others, one.difference, one.better, one.worse, one.effect)
    return dict(zip(columns, cells, strict=True))


def _test(step: Comparison) -> dict[str, Cell]:
    return {
        "pairs": len(step.sample.pairs),
        "that differ": step.test.differing,
        "p": step.test.p,
        "Holm": step.adjusted if step.tested else None,
        "margin": step.margin,
        "p of equivalence": step.equivalence_p,
    }


def _over_cells(one: AcrossCells) -> Row:
    assert one.fitted is not None
    return {
        "first": one.one,
        "second": one.other,
        "cells": one.fitted.cells,
        "pairs": one.fitted.values,
        "difference": one.fitted.mean,
        "in a new cell": one.fitted.new_cell,
        "between cells": one.fitted.between_cells,
        "between seeds": one.fitted.between_seeds,
        "of what is left": one.fitted.rest,
    }


def _estimate(one: Comparison, varies: bool) -> Row:
    unit = f", {one.unit}" if one.unit not in {"", one.says} else ""
    return _named(one, varies) | {"metric": one.says + unit} | _numbers(one)


def asked(sources: Sequence[RunSource]) -> list[str]:
    """What the runs were made for, a sentence for each folder."""
    return [_asked(one) for one in sources]


def _asked(source: RunSource) -> str:
    study = source.study
    if study is None:
        if source.conditions == (REAL,):
            return f"{source.name}: what real robots recorded on one field trial."
        (run,) = source.records
        return f"{source.name}: one run of {label(run.strategy)} with seed {run.seed}."
    told = [
        f"{source.name}: {', '.join(map(label, study.strategies))} in {_file(study.scenario)}, each with the "
        f"same {study.seeds} seeds ({_seeds(study)})"
    ]
    told += [f"{factor.key} is {', '.join(map(str, factor.values))} in turn" for factor in study.factors]
    if study.cells:
        drawn = (f"{factor.key} ({', '.join(map(str, factor.values))})" for factor in study.random)
        told.append(f"each in {len(study.cells)} cells, drawn together from {', '.join(drawn)}")
    if study.conditions == "drawn":
        told.append(
            "seeds draw starts, places, odometry's errors and shadowing where the study does not set them"
        )
    if study.settings:
        told.append("with " + ", ".join(f"{key} = {value}" for key, value in study.settings))
    declared = " and ".join(f"{one} against {other}" for one, other in study.primary_pairs)
    told.append(f"the study declares: {declared}" if declared else "the study declares no comparison")
    return "; ".join(told) + "."


def _seeds(study: Study) -> str:
    first = FIRST_TUNING_SEED if study.tuning else 1
    return f"{first} to {first + study.seeds - 1}{', for tuning' if study.tuning else ''}"


def _file(path: str) -> str:
    """File name without folders."""
    return path.replace("\\", "/").rpartition("/")[2]


def failures(view: ReportView, sources: Sequence[RunSource]) -> PageTable:
    """Return the runs without a result, by cause; without rows if there is none."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for source in sources:
        for condition, record in zip(source.conditions, source.records, strict=True):
            if record.failure is not None:
                key = (condition, label(record.strategy), record.failure)
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
    return view.table("failures", "Runs that failed", rows)


_CEILING: Final = 0.5
"""Share of runs at the greatest possible value from which a metric is said to be at its ceiling."""

_MOST_NAMES: Final = 4
"""Groups of runs that are named where one thing holds for many."""


def cautions(sources: Sequence[RunSource], view: ReportView) -> list[str]:
    """One sentence or two each, the gravest first."""
    return [
        *_unfit(sources, view),
        *_told_by_robots(sources),
        *(line for one in sources if one.judgement is not None for line in one.judgement.too_few),
        *_alone(sources),
        *_incomplete(sources),
        *_bounds(view),
        *_limits(view),
        *_deadlocked(view),
        *(line for group in view.groups for line in _unsound(view, group)),
        *_software(sources),
    ]


def _unfit(sources: Sequence[RunSource], view: ReportView) -> Iterator[str]:
    for one in sources:
        if one.study is not None and one.study.tuning:
            yield (
                f"{one.name}: these are seeds for tuning; what was chosen with them is to be judged "
                "by others."
            )
    if any(run.places_done is None for group in view.groups for run in group.results):
        yield (
            "Real robots have no ground truth: places are as they reported them; contacts, errors of "
            "localisation, where time went and CPU time are unknown; completion is when the last report was "
            "made. Their strategy is not recorded, so each field trial stands under the name of its folder."
        )


def _told_by_robots(sources: Sequence[RunSource]) -> Iterator[str]:
    """What `acrc fleet collect` found missing or unknown in a field trial, and what a run did not believe."""
    for one in sources:
        for record in one.records:
            run = record.result
            if run is not None:
                told = (f"{record.strategy}, seed {record.seed}: {said}" for said in run.refused_reports)
                yield from (f"{one.name}: {said}." for said in told)
            if run is not None and not run.is_simulated:
                yield from (f"{one.name}: {note.rstrip('.')}." for note in run.notes)


def _alone(sources: Sequence[RunSource]) -> Iterator[str]:
    singles = sum(one.study is None for one in sources)
    if singles:
        yield (
            f"{singles} of the folders hold one run each: such runs are shown, and no test is made of them; "
            f"a comparison needs at least {LEAST_PAIRS} pairs of runs from one campaign."
        )
    campaigns = len(sources) - singles
    if campaigns > 1:
        yield (
            f"The {campaigns} campaigns are compared within each of them only, and p-values are adjusted "
            "within each only."
        )


def _incomplete(sources: Sequence[RunSource]) -> Iterator[str]:
    for one in sources:
        failed = sum(record.failure is not None for record in one.records)
        pending = 0 if one.kept is None else len(one.kept.pending())
        if pending:
            yield (
                f"{one.name}: {pending} of {pending + len(one.records)} runs are still to be made; "
                "what is said may change with them."
            )
        if failed:
            yield (
                f"{one.name}: {failed} of {len(one.records)} runs failed and are in no picture, so a "
                "strategy that fails where it would do badly looks better there than it is. "
                "Their causes stand below."
            )


def _bounds(view: ReportView) -> Iterator[str]:
    names = dict.fromkeys(one.strategy for one in view.groups if one.strategy in UPPER_BOUNDS)
    for name in names:
        yield f"{name} uses what no robot can know: it is an upper bound, and no rival of the others."


def _limits(view: ReportView) -> Iterator[str]:
    """Metrics that cannot tell good from better, or bad from worse."""
    full = [
        f"{view.row_name(group)} ({done} of {len(group.results)})"
        for group in view.groups
        if len(group.results) > 1 and (done := _all_done(group)) >= _CEILING * len(group.results)
    ]
    if full:
        yield (
            f"Half of the runs or more did all places: {_groups(full)}. The number of places is at its "
            "ceiling there and hides differences; more robots or less time would show them."
        )
    never = [
        view.row_name(group) for group in view.groups if not any(completed(one).done for one in group.results)
    ]
    if never:
        yield (
            f"No run was complete by its end: {_groups(never)}. The restricted mean is the runs' length "
            "there and says only that it takes longer."
        )


def _all_done(group: Group) -> int:
    return sum(places(one) == one.places_total for one in group.results)


def _groups(names: Sequence[str]) -> str:
    """The first of them, and how many more; all of them if these are few."""
    if len(names) <= _MOST_NAMES:
        return "; ".join(names)
    return f"{'; '.join(names[:_MOST_NAMES])}; and {len(names) - _MOST_NAMES} groups more"


def _deadlocked(view: ReportView) -> Iterator[str]:
    """How often robots waited for one another in a ring: it decides many runs."""
    told = [
        f"{view.row_name(group)} {sum(run.pairs for run in runs) / len(runs):.2g} "
        f"({sum(run.came_free for run in runs)} of {sum(run.pairs for run in runs)} came free)"
        for group in view.groups
        if (runs := deadlocks(group))
    ]
    if told:
        yield f"Pairs in a deadlock, in a run on average: {_groups(told)}."
    elif any(one.is_simulated for group in view.groups for one in group.results):
        yield "How often there was a deadlock was not recorded with these runs; that decides many of them."


def _unsound(view: ReportView, group: Group) -> Iterator[str]:
    untrue = sum(one.places_claimed - one.places_done for one in group.results if one.places_done is not None)
    if untrue:
        yield f"{view.row_name(group)}: {untrue} places were reported although no robot had been there."
    lost = sum(one.undelivered > 0 for one in group.results if one.is_simulated)
    if lost:
        yield f"{view.row_name(group)}: in {lost} runs messages between processes were lost."


def _software(sources: Sequence[RunSource]) -> Iterator[str]:
    commits = dict.fromkeys(one.commit for one in sources if one.commit)
    if len(commits) > 1:
        yield f"The folders were made by different software: {', '.join(commit[:12] for commit in commits)}."
    if any(commit.endswith("+") for commit in commits):
        yield "The software had uncommitted changes, so these runs cannot be repeated elsewhere."
