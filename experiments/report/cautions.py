"""What a reader must know before quoting a number."""

from collections.abc import Iterator, Sequence
from typing import Final

from experiments.report import quantities
from experiments.report.cases import CaseSource
from experiments.report.findings import Findings
from experiments.report.section import UPPER_BOUNDS, Group, ReportView
from experiments.report.time_sections import deadlocks
from experiments.statistics.paired_tests import LEAST_PAIRS
from observation.field_trial.trial_result import TrialResult
from observation.results.result import RunResult

_CEILING: Final = 0.5
"""Share of runs at the greatest possible value from which a metric is said to be at its ceiling."""

_MOST_NAMES: Final = 4
"""Groups of runs that are named where one thing holds for many."""


def cautions(sources: Sequence[CaseSource], findings: Sequence[Findings], view: ReportView) -> list[str]:
    """One sentence or two each, the gravest first."""
    return [
        *_unfit(sources),
        *_told_by_robots(sources),
        *(line for one in findings for line in one.judgement.too_few),
        *_alone(sources, findings),
        *_incomplete(sources),
        *_bounds(view),
        *_limits(view),
        *_deadlocked(view),
        *(line for group in view.groups for line in _unsound(view, group)),
        *_software(sources),
    ]


def _unfit(sources: Sequence[CaseSource]) -> Iterator[str]:
    for one in sources:
        if one.study is not None and one.study.tuning:
            yield (
                f"{one.name}: these are seeds for tuning; what was chosen with them is to be judged "
                "by others."
            )
    if any(not quantities.is_watched(case.outcome) for one in sources for case in one.cases if case.outcome):
        yield (
            "Of real robots nobody knows the truth: places are as they reported them; contacts, errors of "
            "localisation, where time went and CPU time are unknown; completion is when the last report was "
            "made. Their strategy is not recorded, so each field trial stands under the name of its folder."
        )


def _told_by_robots(sources: Sequence[CaseSource]) -> Iterator[str]:
    """What `acrc fleet collect` found missing or unknown in a field trial, and what a run did not believe."""
    for one in sources:
        for case in one.cases:
            if isinstance(case.outcome, RunResult):
                told = (f"{case.strategy}, seed {case.seed}: {said}" for said in case.outcome.refused_reports)
                yield from (f"{one.name}: {said}." for said in told)
            if isinstance(case.outcome, TrialResult):
                yield from (f"{one.name}: {note.rstrip('.')}." for note in case.outcome.notes)


def _alone(sources: Sequence[CaseSource], findings: Sequence[Findings]) -> Iterator[str]:
    singles = sum(one.study is None for one in sources)
    if singles:
        yield (
            f"{singles} of the folders hold one run each: such runs are shown, and no test is made of them; "
            f"a comparison needs at least {LEAST_PAIRS} pairs of runs from one campaign."
        )
    campaigns = len(findings)
    if campaigns > 1:
        yield (
            f"The {campaigns} campaigns are compared within each of them only, and p-values are adjusted "
            "within each only."
        )


def _incomplete(sources: Sequence[CaseSource]) -> Iterator[str]:
    for one in sources:
        failed = sum(case.failure is not None for case in one.cases)
        if one.pending:
            yield (
                f"{one.name}: {one.pending} of {one.pending + len(one.cases)} runs are still to be made; "
                "what is said may change with them."
            )
        if failed:
            yield (
                f"{one.name}: {failed} of {len(one.cases)} runs failed and are in no picture, so a strategy "
                "that fails where it would do badly looks better there than it is. Their causes stand below."
            )


def _bounds(view: ReportView) -> Iterator[str]:
    names = dict.fromkeys(one.strategy for one in view.groups if one.strategy in UPPER_BOUNDS)
    for name in names:
        yield f"{name} uses what no robot can know: it is an upper bound, and no rival of the others."


def _limits(view: ReportView) -> Iterator[str]:
    """Metrics that cannot tell good from better, or bad from worse."""
    full = [
        f"{view.row_name(group)} ({done} of {len(group.outcomes)})"
        for group in view.groups
        if len(group.outcomes) > 1 and (done := _all_done(group)) >= _CEILING * len(group.outcomes)
    ]
    if full:
        yield (
            f"Half of the runs or more did all places: {_some(full)}. The number of places is at its ceiling "
            "there and hides differences; a harder condition (more robots, less time) would show them."
        )
    never = [
        view.row_name(group)
        for group in view.groups
        if not any(quantities.completion(one).done for one in group.outcomes)
    ]
    if never:
        yield (
            f"No run was complete by its end: {_some(never)}. The restricted mean is the runs' length there "
            "and says only that it takes longer."
        )


def _all_done(group: Group) -> int:
    return sum(quantities.places(one) == one.places_total for one in group.outcomes)


def _some(names: Sequence[str]) -> str:
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
        yield f"Pairs in a deadlock, in a run on average: {_some(told)}."
    elif any(isinstance(one, RunResult) for group in view.groups for one in group.outcomes):
        yield "How often there was a deadlock was not recorded with these runs; that decides many of them."


def _unsound(view: ReportView, group: Group) -> Iterator[str]:
    untrue = sum(
        one.places_claimed - one.places_done for one in group.outcomes if one.places_done is not None
    )
    if untrue:
        yield f"{view.row_name(group)}: {untrue} places were reported although no robot had been there."
    lost = sum(one.undelivered > 0 for one in group.outcomes if isinstance(one, RunResult))
    if lost:
        yield f"{view.row_name(group)}: in {lost} runs messages between processes were lost."


def _software(sources: Sequence[CaseSource]) -> Iterator[str]:
    commits = dict.fromkeys(one.commit for one in sources if one.commit)
    if len(commits) > 1:
        yield f"The folders were made by different software: {', '.join(commit[:12] for commit in commits)}."
    if any(commit.endswith("+") for commit in commits):
        yield "The software had been changed since its last commit, so nobody else can make these runs again."
