"""Sections on what runs came to and what adaptation costs: places, times, robots, radio, costs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from acrc_testbed.experiments.report import charts, quantities
from acrc_testbed.experiments.report.cases import Case
from acrc_testbed.experiments.report.charts import Box, Curve, Dot
from acrc_testbed.experiments.report.quantities import BoxSpread, Cell, share, spread
from acrc_testbed.experiments.report.section import (
    BOX,
    SPREAD,
    Group,
    Picture,
    ReportView,
    Section,
    medians,
    spread_cells,
)
from acrc_testbed.experiments.statistics.models import Completion, kaplan_meier, restricted_mean
from acrc_testbed.experiments.statistics.paired_tests import Interval, mean_interval
from acrc_testbed.results.result import RunResult

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


def _times(group: Group, when: Callable[[RunResult], Completion]) -> BoxSpread:
    return spread(when(one).at for one in group.outcomes)


def _end(view: ReportView) -> tuple[float, str] | None:
    """The length of the runs, if they are all as long."""
    lengths = {quantities.length_s(one) for group in view.groups for one in group.outcomes}
    return (max(lengths), "end of run") if len(lengths) == 1 else None


def _time_box(view: ReportView, group: Group, when: Callable[[RunResult], Completion]) -> Box:
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


@dataclass(frozen=True)
class Cost:
    """One number of a run."""

    says: str
    """What it is, with its unit."""
    of: Callable[[Case], float | None]
    """None: unknown."""


def _of_outcome(value: Callable[[RunResult], float | None]) -> Callable[[Case], float | None]:
    return lambda case: None if case.outcome is None else value(case.outcome)


def _freed(case: Case) -> float | None:
    """Mean time for which robots had stood that got on after a decision of the adaptation, s."""
    if case.time is None:
        return None
    told = [(one.blocked_s, one.free_after_s) for one in case.time.decisions]
    times = [blocked + after for blocked, after in told if after is not None]
    return sum(times) / len(times) if times else None


def _decisions(case: Case) -> float | None:
    return None if case.time is None else float(len(case.time.decisions) + case.time.decisions_left_out)


def _adoptions(case: Case) -> float | None:
    """Return how many decisions took a place over; None if decisions are unknown or not all listed."""
    if (
        case.time is None
        or case.time.decisions_left_out
        or not (case.outcome and case.outcome.deeco.counters)
    ):
        return None
    return float(sum(one.adopts for one in case.time.decisions))


COSTS: Final = (
    Cost("octets on the air per robot and s", _of_outcome(quantities.octets)),
    Cost("air time of a robot, % of the time", _of_outcome(quantities.airtime_percent)),
    Cost("adoptions in a run", _adoptions),
    Cost("decisions of the adaptation in a run", _decisions),
    Cost("from blocked to free, s", _freed),
    Cost("CPU, ms per robot and simulated s", _of_outcome(quantities.cpu_ms)),
    Cost("metres driven by all robots", _of_outcome(quantities.driven_m)),
    Cost("contacts in a run", _of_outcome(quantities.contacts)),
    Cost("age of what robots know of one another, s", _of_outcome(quantities.age_s)),
)


def _own(name: str) -> Cost:
    """Return a number of a strategy's own outcome."""
    return Cost(f"outcome.{name}", _of_outcome(lambda run: quantities.own_means(run).get(name)))


def radio(view: ReportView) -> Section:
    """How much robots send, and what becomes of it."""

    def found(group: Group) -> tuple[float, ...]:
        return tuple(map(quantities.octets, group.outcomes))

    return Section(
        "Radio load",
        ("Octets of the frames that robots send, with MAC header and check sequence.",),
        Picture(
            "radio",
            charts.boxes(
                view.panels(lambda group: Box(group.label, view.look(group), spread(found(group)))),
                "octets on the air per robot and s", near=True,
            ),
            medians(view, "radio load", " octets/s", lambda group: spread(found(group))),
            "Octets on the air per robot and second.",
        ),
        (
            view.table(
                "radio", "Octets on the air per robot and s", SPREAD,
                lambda group: [spread_cells(spread(found(group)))],
            ),
            view.table(
                "frames", "What became of frames, and of their copies at the other robots: mean of a run",
                ("what", "number"), _frames, folded=True,
            ),
        ),
    )  # fmt: skip


def _frames(group: Group) -> list[tuple[Cell, ...]]:
    counts = [one.frames for one in group.outcomes]
    means = {name: sum(one.get(name, 0) for one in counts) / len(counts) for one in counts for name in one}
    return [(name.replace("_", " "), mean) for name, mean in means.items() if mean]


def costs(view: ReportView) -> Section:
    """Every cost that is known of some run, side by side."""
    own = dict.fromkeys(
        name for group in view.groups for one in group.outcomes for name in quantities.own_means(one)
    )
    known = [cost for cost in (*COSTS, *map(_own, own)) if any(_values(group, cost) for group in view.groups)]
    drawn = [cost for cost in known if any(any(_values(group, cost)) for group in view.groups)]
    dots = {
        cost.says: [
            Dot(view.row_name(group), view.look(group), _mean(_values(group, cost))) for group in view.groups
        ]
        for cost in drawn
    }
    text = [
        "Means over runs with Student's 95 % intervals. An adoption is a decision to take over what another "
        "robot had to do. CPU is that of the whole simulation: physics, scans and navigation are in it.",
    ]
    zero = [cost.says for cost in known if cost not in drawn]
    if zero:
        text.append(f"Zero in every run: {'; '.join(zero)}.")
    if own:
        text.append(
            "outcome.NAME is what the strategy's own outcome() returned, the mean over robots; unchecked."
        )
    missing = [cost.says for cost in COSTS if cost not in known]
    if missing:
        text.append(f"Not recorded in these runs: {'; '.join(missing)}.")
    return Section(
        "What adaptation costs",
        tuple(text),
        Picture(
            "cost",
            charts.dots(dots),
            f"Means with intervals, a panel for each of: {'; '.join(dots)}. "
            "All numbers are in the table below.",
            "Means over runs with 95 % intervals; each panel has an axis of its own, from zero.",
        ),
        (
            view.table(
                "cost", "Means over runs, with 95 % intervals", [cost.says for cost in known],
                lambda group: [[_mean(_values(group, cost)) for cost in known]],
            ),
        ),
    )  # fmt: skip


def _values(group: Group, cost: Cost) -> list[float]:
    return [value for case in group.cases if (value := cost.of(case)) is not None]


def _mean(values: list[float]) -> Interval | None:
    return mean_interval(values) if values else None
