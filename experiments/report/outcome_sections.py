"""What runs came to: places, running time, completion, and each robot's own part of it."""

from collections.abc import Callable
from typing import Final

from experiments.report import charts, quantities
from experiments.report.cases import Outcome
from experiments.report.charts import Box, Curve
from experiments.report.numbers import BoxSpread, Cell, share, spread
from experiments.report.section import BOX, SPREAD, Group, Picture, ReportView, Section, medians, spread_cells
from experiments.statistics.survival import Completion, kaplan_meier, restricted_mean

_MOST_PANELS: Final = 12
"""Of robots' own times; beyond, only the table has them."""
_AT_LEAST: Final = (
    "A hollow triangle is a run that was not so far by its end: its true value lies to the right."
)


def places(view: ReportView) -> Section:
    """The second box plot of Fig. 7.10."""

    def found(group: Group) -> tuple[float, ...]:
        return tuple(quantities.places(one) for one in group.outcomes)

    totals = {one.places_total for group in view.groups for one in group.outcomes}
    limit = (float(max(totals)), f"all {max(totals)} places") if len(totals) == 1 else None
    boxed = view.panels(lambda group: Box(group.label, view.look(group), spread(found(group))))
    text = ["Places done at the run's end: the chapter's number of cleaning tasks that were completed."]
    if not all(quantities.is_watched(one) for group in view.groups for one in group.outcomes):
        text.append("Real robots' places are those that they reported: nobody watched whether it is true.")
    return Section(
        "Places done",
        (*text, BOX),
        Picture(
            "places",
            charts.boxes(boxed, "places done", limit=limit, near=True),
            medians(view, "places done", "", lambda group: spread(found(group))),
            "Places done, run by run (the chapter's Fig. 7.10, one of its two boxes, for each strategy).",
        ),
        (
            view.table(
                "places", "Places done", (*SPREAD, "of"),
                lambda group: [(*spread_cells(spread(found(group))), _totals(group))],
            ),
        ),
    )  # fmt: skip


def _totals(group: Group) -> Cell:
    totals = sorted({one.places_total for one in group.outcomes})
    return totals[0] if len(totals) == 1 else f"{totals[0]} to {totals[-1]}"


def running(view: ReportView) -> Section:
    """The first box plot of Fig. 7.10."""

    def ended(group: Group) -> int:
        return sum(quantities.running(one).done for one in group.outcomes)

    return Section(
        "Running time until done or given up",
        (
            "The time at which the last place was done or given up: the chapter's total running time till "
            "system completes or gives up. A run that its end cut short counts with its whole length.",
            _AT_LEAST,
        ),
        Picture(
            "running_time",
            charts.boxes(
                view.panels(lambda group: _time_box(view, group, quantities.running)), "simulated s",
                limit=_end(view),
            ),
            medians(view, "running time", " s", lambda group: _times(group, quantities.running)),
            "Running time until all places were done or given up (Fig. 7.10, the other box).",
        ),
        (
            view.table(
                "running_time", "Running time until done or given up, s", (*SPREAD, "ended by itself"),
                lambda group: [(*spread_cells(_times(group, quantities.running)), ended(group))],
            ),
        ),
    )  # fmt: skip


def _times(group: Group, when: Callable[[Outcome], Completion]) -> BoxSpread:
    return spread(when(one).at for one in group.outcomes)


def _end(view: ReportView) -> tuple[float, str] | None:
    """The length of the runs, if they are all as long."""
    lengths = {quantities.length_s(one) for group in view.groups for one in group.outcomes}
    return (max(lengths), "end of run") if len(lengths) == 1 else None


def _time_box(view: ReportView, group: Group, when: Callable[[Outcome], Completion]) -> Box:
    open_ones = tuple(run.at for run in map(when, group.outcomes) if not run.done)
    return Box(group.label, view.look(group), _times(group, when), open_ones)


def completion(view: ReportView) -> Section:
    """Curves of Kaplan and Meier, with what summarizes them."""
    horizons = {
        condition: max(lengths)
        for condition, lengths in view.panels(
            lambda group: max(map(quantities.length_s, group.outcomes))
        ).items()
    }

    def curve(group: Group) -> Curve:
        runs = tuple(map(quantities.completion, group.outcomes))
        return Curve(group.label, view.look(group), kaplan_meier(runs), runs)

    curves = view.panels(curve)
    told = "; ".join(
        f"{view.row_name(group)} {sum(run.done for run in map(quantities.completion, group.outcomes))} of "
        f"{len(group.outcomes)}"
        for group in view.groups
    )
    return Section(
        "Time to complete",
        (
            "The share of runs in which all places were done by a time, by Kaplan and Meier's estimate. A "
            "run that ended before it was complete is censored, not dropped: it is known to take longer, and "
            "is a tick on its curve. The bands are 95 % intervals.",
            "The restricted mean is the mean time until complete, or the run's length, whichever comes "
            "first; it holds all runs, also those that never completed.",
        ),
        Picture(
            "completion",
            charts.completion(curves, max(horizons.values())),
            f"Curves of the share of runs that are complete over simulated time. Complete at the end: "
            f"{told}. All numbers are in the tables below.",
            "Share of runs in which all places are done, with 95 % bands; ticks are censored runs.",
        ),
        (
            view.table(
                "completion", "Completion; intervals of 95 %: Wilson's for shares, Student's for means",
                ("runs", "complete", "share complete", "restricted mean, s", "up to, s"),
                lambda group: [_summary(group, horizons[group.condition])],
            ),
            view.table(
                "completion_curves", "The curves, step by step", ("time, s", "complete", "low", "high"),
                lambda group: _steps(curve(group)), folded=True,
            ),
        ),
    )  # fmt: skip


def _summary(group: Group, horizon: float) -> tuple[Cell, ...]:
    runs = tuple(map(quantities.completion, group.outcomes))
    count = sum(run.done for run in runs)
    return len(runs), count, share(count, len(runs)), restricted_mean(runs, horizon), horizon


def _steps(curve: Curve) -> list[tuple[float, ...]]:
    found = curve.survival
    return [
        (float(at), 1.0 - float(left), 1.0 - float(high), 1.0 - float(low))
        for at, left, low, high in zip(found.times, found.shares, found.low, found.high, strict=True)
    ]


def robots(view: ReportView) -> Section:
    """When each robot's own places were done."""

    def runs_of(group: Group, robot: str) -> tuple[Completion, ...]:
        return tuple(
            quantities.robot_completion(one, robot) for one in group.outcomes if robot in one.per_robot
        )

    def box(group: Group, robot: str) -> Box:
        runs = runs_of(group, robot)
        left = tuple(run.at for run in runs if not run.done)
        return Box(robot, view.look(group), spread(run.at for run in runs), left)

    boxed = {view.row_name(group): [box(group, robot) for robot in _names(group)] for group in view.groups}
    table = view.table(
        "robots", "Each robot's own places: the mean number done, and when the last one was",
        ("robot", "runs", "given", "done, mean", "all done in", "restricted mean, s"),
        lambda group: [_robot_row(group, robot, runs_of(group, robot)) for robot in _names(group)],
    )  # fmt: skip
    text = "When the last of the places was done that a robot was given at the start, whichever robot did it."
    if len(boxed) > _MOST_PANELS:
        return Section("Robot by robot", (text,), None, (table,))
    picture = Picture(
        "robots",
        charts.boxes(boxed, "simulated s", limit=_end(view)),
        "Box plots of the time at which each robot's own places were done, a panel for each strategy. "
        "All numbers are in the table below.",
        "Time until a robot's own places were done.",
    )
    return Section("Robot by robot", (text, _AT_LEAST), picture, (table,))


def _names(group: Group) -> list[str]:
    names = {name for one in group.outcomes for name in one.per_robot}
    return sorted(names, key=lambda name: (len(name), name))


def _robot_row(group: Group, robot: str, runs: tuple[Completion, ...]) -> tuple[Cell, ...]:
    parts = [one.per_robot[robot] for one in group.outcomes if robot in one.per_robot]
    horizon = max(map(quantities.length_s, group.outcomes))
    return (
        robot, len(parts), max(part.places_total for part in parts),
        sum(map(quantities.places, parts)) / len(parts), sum(run.done for run in runs),
        restricted_mean(runs, horizon),
    )  # fmt: skip
