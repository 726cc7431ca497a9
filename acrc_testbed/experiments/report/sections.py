"""Sections on results and costs of adaptation: places, times, robots, radio, costs."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import binomtest

from acrc_testbed.experiments.paired_tests import CONFIDENCE, Interval, mean_interval
from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Box, Curve, Dot
from acrc_testbed.experiments.report.runs import Cell, Group, ReportView, completed, places, until
from acrc_testbed.experiments.statistical_models import Completion, kaplan_meier, restricted_mean
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.picture.html_page import PagePicture, PageSection, PageTable
from acrc_testbed.results.outcome import means
from acrc_testbed.results.result import RunResult
from actors.ieee802154 import airtime_ns

_MOST_PANELS: Final = 12
"""Of robots' own times; beyond, only the table has them."""
_AT_LEAST: Final = (
    "A hollow triangle is a run that was not so far by its end: its true value lies to the right."
)
_BOX: Final = (
    "A box holds the middle half of the runs, the line in it is the median, whiskers reach to the last run "
    "within one and a half box lengths, and each run is a dot; up to four runs are dots alone."
)
_SPREAD: Final = ("runs", "least", "1st quartile", "median", "3rd quartile", "most", "mean")


def _spread(values: Sequence[float]) -> tuple[Cell, ...]:
    """Return the cells of the columns _SPREAD."""
    quantiles = (float(one) for one in np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0]))
    return len(values), *quantiles, float(np.mean(values))


class _Boxes(NamedTuple):
    """Box plots of one quantity, and their table."""

    name: str
    what: str
    """In the description for readers who do not see the picture."""
    unit: str
    axis: str
    caption: str
    table: str
    """Caption of the table."""
    of: Callable[[RunResult], Completion]
    """Value of a run; not done: its least possible value."""

    def drawn(
        self,
        view: ReportView,
        *columns: str,
        cells: Callable[[Group], Sequence[Cell]] = lambda group: (),
        limit: tuple[float, str] | None = None,
        near: bool = False,
    ) -> tuple[PagePicture, PageTable]:
        """Draw; `columns` and `cells`: what the table has beside the spread; the rest as for charts.boxes."""

        def values(group: Group) -> list[float]:
            return [self.of(run).at for run in group.results]

        boxes = view.panels(
            lambda group: _box(group.label, view, group, [self.of(run) for run in group.results])
        )
        medians = "; ".join(
            f"{view.row_name(group)} {float(np.median(values(group))):.4g}{self.unit}"
            for group in view.groups
        )
        alt = f"Box plots of {self.what}. Medians: {medians}. All numbers are in the table below."
        picture = view.picture(
            self.name, charts.boxes(boxes, self.axis, limit=limit, near=near), alt, self.caption
        )
        table = view.table(
            self.name, self.table, (*_SPREAD, *columns),
            lambda group: [(*_spread(values(group)), *cells(group))],
        )  # fmt: skip
        return picture, table


def _box(name: str, view: ReportView, group: Group, runs: Sequence[Completion]) -> Box:
    open_ones = tuple(run.at for run in runs if not run.done)
    return Box(name, view.look(group), tuple(run.at for run in runs), open_ones)


_PLACES: Final = _Boxes(
    "places", "places done", "", "places done",
    "Places done, run by run (the chapter's Fig. 7.10, one of its two boxes, for each strategy).",
    table="Places done", of=lambda run: Completion(places(run), True),
)  # fmt: skip
_RUNNING: Final = _Boxes(
    "running_time", "running time", " s", "simulated s",
    "Running time until all places were done or given up (Fig. 7.10, the other box).",
    table="Running time until done or given up, s", of=lambda run: until(run.settled_s, run),
)  # fmt: skip
_RADIO: Final = _Boxes(
    "radio", "radio load", " octets/s", "octets on the air per robot and s",
    "Octets on the air per robot and second.",
    table="Octets on the air per robot and s", of=lambda run: Completion(run.radio_bytes_per_robot_s, True),
)  # fmt: skip


def places_done(view: ReportView) -> PageSection:
    """Return the second box plot of Fig. 7.10."""
    runs = [run for group in view.groups for run in group.results]
    totals = {run.places_total for run in runs}
    text = ["Places done at the run's end: the chapter's number of cleaning tasks that were completed."]
    if any(run.places_done is None for run in runs):
        text.append("Places of real robots are as they reported them, without ground truth.")
    limit = (float(max(totals)), f"all {max(totals)} places") if len(totals) == 1 else None
    picture, table = _PLACES.drawn(view, "of", cells=_totals, limit=limit, near=True)
    return PageSection("Places done", (*text, _BOX), picture, (table,))


def _totals(group: Group) -> tuple[Cell]:
    totals = sorted({run.places_total for run in group.results})
    return (totals[0] if len(totals) == 1 else f"{totals[0]} to {totals[-1]}",)


def running(view: ReportView) -> PageSection:
    """Return the first box plot of Fig. 7.10."""
    picture, table = _RUNNING.drawn(
        view, "ended by itself", limit=_end(view),
        cells=lambda group: (sum(run.settled_s is not None for run in group.results),),
    )  # fmt: skip
    text = (
        "The time at which the last place was done or given up: the chapter's total running time till "
        "system completes or gives up. A run that its end cut short counts with its whole length.",
        _AT_LEAST,
    )
    return PageSection("Running time until done or given up", text, picture, (table,))


def _end(view: ReportView) -> tuple[float, str] | None:
    """Return the length of the runs, if it is the same for all."""
    lengths = {run.length_s for group in view.groups for run in group.results}
    return (max(lengths), "end of run") if len(lengths) == 1 else None


def completion(view: ReportView) -> PageSection:
    """Return curves of Kaplan and Meier, and their summary."""
    lengths = view.panels(lambda group: max(run.length_s for run in group.results))
    horizons = {condition: max(some) for condition, some in lengths.items()}

    def runs_of(group: Group) -> tuple[Completion, ...]:
        return tuple(map(completed, group.results))

    def curve(group: Group) -> Curve:
        return Curve(group.label, view.look(group), kaplan_meier(runs_of(group)), runs_of(group))

    def summary(group: Group) -> tuple[Cell, ...]:
        runs, horizon = runs_of(group), horizons[group.condition]
        count = sum(run.done for run in runs)
        return len(runs), count, _share(count, len(runs)), restricted_mean(runs, horizon), horizon

    def steps(group: Group) -> list[tuple[float, ...]]:
        found = curve(group).survival
        return [
            (float(at), 1.0 - float(left), 1.0 - float(high), 1.0 - float(low))
            for at, left, low, high in zip(found.times, found.shares, found.low, found.high, strict=True)
        ]

    told = "; ".join(
        f"{view.row_name(group)} {sum(run.done for run in runs_of(group))} of {len(group.results)}"
        for group in view.groups
    )
    picture = view.picture(
        "completion",
        charts.completion(view.panels(curve), max(horizons.values())),
        f"Curves of the share of runs that are complete over simulated time. Complete at the end: "
        f"{told}. All numbers are in the tables below.",
        "Share of runs in which all places are done, with 95 % bands; ticks are censored runs.",
    )
    return PageSection(
        "Time to complete",
        (
            "The share of runs in which all places were done by a time, by Kaplan and Meier's estimate. A "
            "run that ended before it was complete is censored, not dropped: it is known to take longer, and "
            "is a tick on its curve. The bands are 95 % intervals.",
            "The restricted mean is the mean time until complete, or the run's length, whichever comes "
            "first; it holds all runs, also those that never completed.",
        ),
        picture,
        (
            view.table(
                "completion", "Completion; intervals of 95 %: Wilson's for shares, Student's for means",
                ("runs", "complete", "share complete", "restricted mean, s", "up to, s"),
                lambda group: [summary(group)],
            ),
            view.table(
                "completion_curves", "The curves, step by step", ("time, s", "complete", "low", "high"),
                steps, folded=True,
            ),
        ),
    )  # fmt: skip


def _share(count: int, of: int) -> Interval:
    """Return a proportion with Wilson's 95 % interval."""
    bounds = binomtest(count, of).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(count / of, float(bounds.low), float(bounds.high))


def robots(view: ReportView) -> PageSection:
    """Return when each robot's own places were done."""

    def runs_of(group: Group, robot: str) -> list[Completion]:
        runs = (run for run in group.results if robot in run.per_robot)
        return [until(run.per_robot[robot].completion_s, run) for run in runs]

    def row(group: Group, robot: str) -> tuple[Cell, ...]:
        parts = [run.per_robot[robot] for run in group.results if robot in run.per_robot]
        horizon = max(run.length_s for run in group.results)
        runs = runs_of(group, robot)
        return (
            robot, len(parts), max(part.places_total for part in parts), sum(map(places, parts)) / len(parts),
            sum(run.done for run in runs), restricted_mean(runs, horizon),
        )  # fmt: skip

    boxed = {
        view.row_name(group): [_box(robot, view, group, runs_of(group, robot)) for robot in _robots(group)]
        for group in view.groups
    }
    table = view.table(
        "robots", "Each robot's own places: the mean number done, and when the last one was",
        ("robot", "runs", "given", "done, mean", "all done in", "restricted mean, s"),
        lambda group: [row(group, robot) for robot in _robots(group)],
    )  # fmt: skip
    text = "When the last of the places was done that a robot was given at the start, whichever robot did it."
    if len(boxed) > _MOST_PANELS:
        return PageSection("Robot by robot", (text,), None, (table,))
    picture = view.picture(
        "robots",
        charts.boxes(boxed, "simulated s", limit=_end(view)),
        "Box plots of the time at which each robot's own places were done, a panel for each strategy. "
        "All numbers are in the table below.",
        "Time until a robot's own places were done.",
    )
    return PageSection("Robot by robot", (text, _AT_LEAST), picture, (table,))


def _robots(group: Group) -> list[str]:
    names = {name for run in group.results for name in run.per_robot}
    return sorted(names, key=lambda name: (len(name), name))


def radio(view: ReportView) -> PageSection:
    """Return how much robots send, and the outcomes of frames."""
    picture, table = _RADIO.drawn(view, near=True)
    frames = view.table(
        "frames", "What became of frames, and of their copies at the other robots: mean of a run",
        ("what", "number"), _frames, folded=True,
    )  # fmt: skip
    text = ("Octets of the frames that robots send, with MAC header and check sequence.",)
    return PageSection("Radio load", text, picture, (table, frames))


def _frames(group: Group) -> list[tuple[Cell, ...]]:
    counts = [run.frames for run in group.results]
    found = {name: sum(one.get(name, 0) for one in counts) / len(counts) for one in counts for name in one}
    return [(name.replace("_", " "), mean) for name, mean in found.items() if mean]


def _robot_seconds(run: RunResult) -> float:
    return max(run.robots * run.length_s, 1e-9)


def airtime_percent(run: RunResult) -> float:
    """Return the share of its time that a robot sends, mean over robots, %."""
    frames = run.frames["frames_sent"]
    if not frames:
        return 0.0
    mean_ns = airtime_ns(0) + (airtime_ns(1) - airtime_ns(0)) * run.frames["bytes_sent"] / frames
    return 100.0 * frames * mean_ns / 1e9 / _robot_seconds(run)


def cpu_ms(run: RunResult) -> float | None:
    """Return the CPU of all processes, ms per robot and simulated s; None for real robots."""
    return 1000.0 * run.cpu_s / _robot_seconds(run) if run.is_simulated else None


def _freed(record: TrialRecord) -> float | None:
    """Return the mean time that robots stood which drove on after a decision, s."""
    if record.time is None:
        return None
    told = ((one.blocked_s, one.free_after_s) for one in record.time.decisions)
    times = [before + after for before, after in told if after is not None]
    return sum(times) / len(times) if times else None


def _decisions(record: TrialRecord) -> float | None:
    return None if record.time is None else float(len(record.time.decisions) + record.time.decisions_left_out)


def _adoptions(record: TrialRecord) -> float | None:
    """Return the number of decisions that took a place over; None if unknown or not all are listed."""
    time, run = record.time, record.result
    if time is None or time.decisions_left_out or not (run and run.deeco.counters):
        return None
    return float(sum(one.adopts for one in time.decisions))


class Cost(NamedTuple):
    """One number of a run."""

    says: str
    """Description, with its unit."""
    of_record: Callable[[TrialRecord], float | None] | None = None
    of_run: Callable[[RunResult], float | None] | None = None

    def of(self, record: TrialRecord) -> float | None:
        """Return the number; None: unknown."""
        if self.of_record is not None:
            return self.of_record(record)
        found = self.of_run(record.result) if record.result is not None and self.of_run is not None else None
        return None if found is None else float(found)


COSTS: Final = (
    Cost("octets on the air per robot and s", of_run=lambda run: run.radio_bytes_per_robot_s),
    Cost("air time of a robot, % of the time", of_run=airtime_percent),
    Cost("adoptions in a run", _adoptions),
    Cost("decisions of the adaptation in a run", _decisions),
    Cost("from blocked to free, s", _freed),
    Cost("CPU, ms per robot and simulated s", of_run=cpu_ms),
    Cost("metres driven by all robots", of_run=lambda run: run.driven_m),
    Cost("contacts in a run", of_run=lambda run: run.contacts),
    Cost("age of what robots know of one another, s", of_run=lambda run: run.deeco.replica_age_mean_s),
)


def _own(name: str) -> Cost:
    """Return a number of a strategy's own outcome."""
    return Cost(f"outcome.{name}", of_run=lambda run: means(run.outcome).get(name))


def costs(view: ReportView) -> PageSection:
    """Return all costs that are known of some run, side by side."""

    def values(group: Group, cost: Cost) -> list[float]:
        return [value for record in group.records if (value := cost.of(record)) is not None]

    def mean(group: Group, cost: Cost) -> Interval | None:
        found = values(group, cost)
        return mean_interval(found) if found else None

    own = dict.fromkeys(name for group in view.groups for run in group.results for name in means(run.outcome))
    known = [cost for cost in (*COSTS, *map(_own, own)) if any(values(group, cost) for group in view.groups)]
    drawn = [cost for cost in known if any(any(values(group, cost)) for group in view.groups)]
    dots = {
        cost.says: [Dot(view.row_name(one), view.look(one), mean(one, cost)) for one in view.groups]
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
    picture = view.picture(
        "cost",
        charts.dots(dots),
        f"Means with intervals, a panel for each of: {'; '.join(dots)}. All numbers are in the table below.",
        "Means over runs with 95 % intervals; each panel has an axis of its own, from zero.",
    )
    table = view.table(
        "cost", "Means over runs, with 95 % intervals", [cost.says for cost in known],
        lambda group: [[mean(group, cost) for cost in known]],
    )  # fmt: skip
    return PageSection("What adaptation costs", text, picture, (table,))
