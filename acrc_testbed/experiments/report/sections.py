"""Report sections on the task's metrics, robots, radio and costs."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from scipy.stats import binomtest

from acrc_testbed.experiments.metrics import total_of, value_of, values
from acrc_testbed.experiments.paired_tests import CONFIDENCE, Interval, mean_interval
from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Box, Curve, Dot
from acrc_testbed.experiments.report.report_view import (
    Cell,
    Group,
    ReportView,
    Row,
    in_order,
    is_known,
    metric_value,
)
from acrc_testbed.experiments.statistical_models import Completion, kaplan_meier, restricted_mean
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.picture.html_page import PagePicture, PageSection, PageTable
from acrc_testbed.results.outcome import outcome_means
from acrc_testbed.results.result import RunResult
from actors.ieee802154 import airtime_ns
from actors.task.task import Metric

_MAX_PANELS: Final = 12
"""Groups up to which times by robot are drawn; tables always have them."""
_AT_LEAST: Final = "A hollow triangle is a censored run: its true value is larger."
_BOX: Final = (
    "Boxes show quartiles and median, whiskers the last run within 1.5 box lengths, dots single runs; up to "
    "four runs are shown as dots alone."
)
_SPREAD: Final = ("minimum", "1st quartile", "median", "3rd quartile", "maximum")


def _box_plot(
    view: ReportView,
    name: str,
    measure: Callable[[RunResult], Completion],
    *,
    what: str,
    unit: str,
    axis: str,
    caption: str,
    table: str,
    more: Callable[[Group], Row] = lambda group: {},
    limit: tuple[float, str] | None = None,
    near: bool,
) -> tuple[PagePicture, PageTable]:
    """Draw box plots of one quantity, and write its table.

    `measure`: returns the value of a run, or a lower bound. `what`: name in the alternative text. `table`:
    caption of the table; `more`: returns further cells of a group. For the others see `charts.draw_boxes`.
    """
    measured = {group: [measure(run) for run in group.results] for group in view.groups}
    numbers = {group: [one.at for one in runs] for group, runs in measured.items()}
    medians = "; ".join(
        f"{view.row_name(group)} {float(np.median(known)):.4g}{unit}" for group, known in numbers.items()
    )
    boxes = view.panels(lambda group: _box_of(group.label, view, group, measured[group]))
    picture = view.picture(
        name,
        charts.draw_boxes(boxes, axis, limit=limit, near=near),
        f"Box plots of {what}. Medians: {medians}. The table below has all numbers.",
        caption,
    )

    def row(group: Group) -> Iterator[Row]:
        known = numbers[group]
        quantiles = np.quantile(known, np.linspace(0.0, 1.0, 5)).tolist()
        spread = dict(zip(_SPREAD, quantiles, strict=True))
        yield {"runs": len(known), **spread, "mean": float(np.mean(known)), **more(group)}

    return picture, view.group_table(name, table, row)


def _box_of(name: str, view: ReportView, group: Group, runs: Sequence[Completion]) -> Box:
    lower_bounds = tuple(run.at for run in runs if not run.done)
    return Box(name, view.look(group), tuple(run.at for run in runs), lower_bounds)


def task_sections(view: ReportView) -> Iterator[PageSection]:
    """Yield the sections on the task's metrics: box plots of ranked ones, survival curves of events."""
    for metric in view.task.metrics:
        known = is_known(metric, view.results)
        if known and metric.rank is not None:
            yield _distribution(view, metric)
        if known and metric.event:
            yield _survival(view, metric)


def titled(metric: Metric) -> str:
    """Return the metric's description with its unit."""
    unit = metric.unit if metric.unit and metric.unit not in metric.description else ""
    return f"{metric.description}, {unit}" if unit else metric.description


def _distribution(view: ReportView, metric: Metric) -> PageSection:
    """Return the section with box plots of a metric."""
    totals = {total_of(metric, run) for run in view.results}
    limit = _run_end(view) if metric.event else None
    if len(totals) == 1 and (total := max(filter(None, totals), default=None)):
        limit = (total, f"all {total:g} {metric.unit}")

    def more(group: Group) -> Row:
        if metric.event:
            return {metric.event: sum(value_of(metric, run) is not None for run in group.results)}
        known = sorted({total for run in group.results if (total := total_of(metric, run)) is not None})
        return {"total": f"{known[0]:g}" + (f" to {known[-1]:g}" if len(known) > 1 else "")} if known else {}

    picture, table = _box_plot(
        view, metric.name, lambda run: metric_value(metric, run), what=metric.description,
        unit=f" {metric.unit}".rstrip(), axis=titled(metric), table=titled(metric), more=more,
        limit=limit, near=not metric.event, caption=f"{titled(metric).capitalize()}, in each run.",
    )  # fmt: skip
    text = [f"{metric.description.capitalize()}; {metric.better} is better."]
    if metric.event:
        text += [f"Runs that were not {metric.event} count with their full length.", _AT_LEAST]
    if metric.reported and any(run.contacts is None for run in view.results):
        text.append("Values of real robots are as reported, without ground truth.")
    return PageSection(metric.description.capitalize(), (*text, _BOX), picture, (table,))


def _run_end(view: ReportView) -> tuple[float, str] | None:
    """Return the length of the runs with a label, if equal for all."""
    lengths = {run.length_s for run in view.results}
    return (max(lengths), "end of run") if len(lengths) == 1 else None


def _survival(view: ReportView, metric: Metric) -> PageSection:
    """Return the section on when an event happened: Kaplan-Meier curves and their summary."""
    lengths = view.panels(lambda group: max(run.length_s for run in group.results))
    horizons = {condition: max(values) for condition, values in lengths.items()}
    runs = {group: tuple(metric_value(metric, run) for run in group.results) for group in view.groups}
    done = {group: sum(run.done for run in group_runs) for group, group_runs in runs.items()}
    event, name = metric.event, metric.name if metric.rank is None else f"{metric.name}_share"

    def curve(group: Group) -> Curve:
        return Curve(group.label, view.look(group), kaplan_meier(runs[group]), runs[group])

    def summary(group: Group) -> Iterator[Row]:
        horizon, count = horizons[group.condition], len(runs[group])
        bounds = binomtest(done[group], count).proportion_ci(CONFIDENCE, method="wilson")
        yield {
            "runs": count,
            event: done[group],
            f"share {event}": Interval(done[group] / count, float(bounds.low), float(bounds.high)),
            "restricted mean, s": restricted_mean(runs[group], horizon),
            "up to, s": horizon,
        }

    def steps(group: Group) -> Iterator[Row]:
        found = curve(group).survival
        for at, *shares in zip(found.times, found.shares, found.high, found.low, strict=True):
            share, low, high = (1.0 - float(one) for one in shares)
            yield {"time, s": float(at), event: share, "low": low, "high": high}

    counts = "; ".join(f"{view.row_name(one)} {done[one]} of {len(one.results)}" for one in view.groups)
    picture = view.picture(
        name,
        charts.draw_survival(view.panels(curve), max(horizons.values()), f"share of runs {event}"),
        f"Share of runs {event} over simulated time. At the end: {counts}. The tables below have all "
        "numbers.",
        f"Share of runs {event}, with 95 % bands; ticks are censored runs.",
    )
    caption = f"Runs {event}, with 95 % intervals (Wilson for shares, Student for means)"
    return PageSection(
        f"{metric.description.capitalize()}: share of runs",
        (
            f"Kaplan-Meier estimate of the share of runs {event}, with 95 % bands. Runs that ended before "
            "are censored (ticks).",
            "The restricted mean is the mean of the time or the run's length, whichever comes first; it "
            "includes censored runs.",
        ),
        picture,
        (
            view.group_table(name, caption, summary),
            view.group_table(f"{name}_curves", "Steps of the curves", steps, folded=True),
        ),
    )


def robots(view: ReportView) -> PageSection | None:
    """Return the section on each robot's own items; None if the task has no metric of robots."""
    metrics = [
        one
        for one in view.task.metrics
        if is_known(one, (_of_robot(run, robot) for run in view.results for robot in run.per_robot))
    ]
    timed = [one for one in metrics if one.event]

    def values_of(group: Group, robot: str, metric: Metric) -> list[Completion]:
        own = (_of_robot(run, robot) for run in group.results if robot in run.per_robot)
        return [metric_value(metric, run) for run in own]

    def rows(group: Group) -> Iterator[Row]:
        horizon = max(run.length_s for run in group.results)
        for robot in in_order(run.per_robot for run in group.results):
            count = sum(robot in run.per_robot for run in group.results)
            row: dict[str, Cell] = {"robot": robot, "runs": count}
            for one in metrics:
                found = values_of(group, robot, one)
                if one.event:
                    row[f"{one.event} in"] = sum(run.done for run in found)
                    row[f"{one.description}, restricted mean, s"] = restricted_mean(found, horizon)
                else:
                    row[f"{one.description}, mean"] = float(np.mean([run.at for run in found]))
            yield row

    if not metrics:
        return None
    table = view.group_table("robots", f"Each robot's own {view.task.items}: means over runs", rows)
    text = f"Results of each robot's own {view.task.items}, whichever robot did them."
    if len(view.groups) > _MAX_PANELS or not timed:
        return PageSection("Results by robot", (text,), None, (table,))
    boxed = {
        view.row_name(group): [
            _box_of(robot, view, group, values_of(group, robot, timed[-1]))
            for robot in in_order(run.per_robot for run in group.results)
        ]
        for group in view.groups
    }
    picture = view.picture(
        "robots",
        charts.draw_boxes(boxed, "simulated s", limit=_run_end(view)),
        f"Box plots of {timed[-1].description} for each robot's own {view.task.items}, a panel for each "
        "strategy. The table below has all numbers.",
        f"{timed[-1].description.capitalize()}, for each robot's own {view.task.items}.",
    )
    return PageSection("Results by robot", (text, _AT_LEAST), picture, (table,))


def _of_robot(run: RunResult, robot: str) -> RunResult:
    """Return the result with the values of one robot instead of those of the task."""
    return msgspec.structs.replace(run, task=run.per_robot[robot].task)


def radio(view: ReportView) -> PageSection:
    """Return the section on radio load and outcomes of frames."""

    def frames(group: Group) -> Iterator[Row]:
        counts = [run.frames for run in group.results]
        for name in dict.fromkeys(name for one in counts for name in one):
            mean = sum(one.get(name, 0) for one in counts) / len(counts)
            if mean:
                yield {"counter": name.replace("_", " "), "mean": mean}

    picture, table = _box_plot(
        view, "radio", lambda run: Completion(run.radio_bytes_per_robot_s, True), what="radio load",
        unit=" octets/s", axis="octets on the air per robot and s", near=True,
        caption="Octets on the air per robot and second.", table="Octets on the air per robot and s",
    )  # fmt: skip
    caption = "Outcomes of frames; copies count once per receiving robot. Means per run"
    text = ("Octets of the frames sent by robots, including MAC header and FCS.",)
    outcomes = view.group_table("frames", caption, frames, folded=True)
    return PageSection("Radio load", text, picture, (table, outcomes))


Measure = Callable[[RunResult, TrialRecord], float | None]
"""Function that returns a value of a run; None: unknown."""


def _robot_seconds(run: RunResult) -> float:
    return max(run.robots * run.length_s, 1e-9)


def airtime_percent(run: RunResult) -> float:
    """Return the mean share of time in which a robot transmits, %."""
    frames = run.frames["frames_sent"]
    if not frames:
        return 0.0
    mean_ns = airtime_ns(0) + (airtime_ns(1) - airtime_ns(0)) * run.frames["bytes_sent"] / frames
    return 100.0 * frames * mean_ns / 1e9 / _robot_seconds(run)


def cpu_ms(run: RunResult) -> float | None:
    """Return the CPU time of all processes, ms per robot and simulated s; None for real robots."""
    return 1000.0 * run.cpu_s / _robot_seconds(run) if run.is_simulated else None


def _mean_time_to_drive_on(run: RunResult, record: TrialRecord) -> float | None:
    """Return the mean time from being blocked to driving on after a decision, s."""
    decisions = () if record.time is None else record.time.decisions
    times = [one.blocked_s + one.free_after_s for one in decisions if one.free_after_s is not None]
    return sum(times) / len(times) if times else None


def _decision_count(run: RunResult, record: TrialRecord) -> float | None:
    return None if record.time is None else float(len(record.time.decisions) + record.time.decisions_left_out)


def _adoption_count(run: RunResult, record: TrialRecord) -> float | None:
    """Return the number of adoptions; None if unknown or not all decisions are listed."""
    if record.time is None or record.time.decisions_left_out or not run.deeco.counters:
        return None
    return float(sum(one.adopts for one in record.time.decisions))


def _column(of: Metric | str) -> Measure:
    """Return a measure of a metric or a column; an event that did not happen counts as the end of the run."""
    metric = of if isinstance(of, Metric) else Metric(of, of, "", of)

    def measure(run: RunResult, _: TrialRecord) -> float | None:
        (value,) = values(metric, (run,), run.length_s)
        return None if math.isnan(value) else value

    return measure


def _cost_name(metric: Metric) -> str:
    unit = f", {metric.unit}" if metric.unit else ""
    return f"{metric.description}{unit} ({metric.better} is better)"


COSTS: Final[Mapping[str, Measure]] = {
    "octets on the air per robot and s": _column("radio_bytes_per_robot_s"),
    "air time of a robot, % of the time": lambda run, _: airtime_percent(run),
    "adoptions in a run": _adoption_count,
    "decisions of the adaptation in a run": _decision_count,
    "time from blocked to driving on, s": _mean_time_to_drive_on,
    "CPU, ms per robot and simulated s": lambda run, _: cpu_ms(run),
    "metres driven by all robots": _column("driven_m"),
    "energy used by all robots, J": _column("energy_j"),
    "contacts in a run": _column("contacts"),
    "contacts with people in a run": _column("people_contacts"),
    "time in contact with people, s": _column("people_contact_s"),
    "age of replicas, s": lambda run, _: run.deeco.replica_age_mean_s,
}
"""Measure of each cost, whose name contains the unit."""


def costs(view: ReportView) -> PageSection:
    """Return the section on all known costs."""
    outcome_names = dict.fromkeys(name for run in view.results for name in outcome_means(run.outcome))
    further = [one for one in view.task.metrics if one.rank is None and not one.event]
    own = {_cost_name(one): _column(one) for one in (*view.metrics.values(), *further)}
    outcomes = {f"outcome.{name}": _column(f"outcome.{name}") for name in outcome_names}
    found = {
        (name, group): [
            float(value)
            for record in group.records
            if record.result is not None and (value := measure(record.result, record)) is not None
        ]
        for name, measure in {**own, **COSTS, **outcomes}.items()
        for group in view.groups
    }
    names = dict.fromkeys(name for name, _ in found)
    known = [name for name in names if any(found[name, group] for group in view.groups)]
    drawn = [name for name in known if any(any(found[name, group]) for group in view.groups)]

    def mean(name: str, group: Group) -> Interval | None:
        known_values = found[name, group]
        return mean_interval(known_values) if known_values else None

    dots = {
        name: [Dot(view.row_name(one), view.look(one), mean(name, one)) for one in view.groups]
        for name in drawn
    }
    text = [
        "Means over runs with Student's 95 % intervals. An adoption is a decision to take over an "
        f"item ({view.task.item}) of another robot. CPU time includes the whole simulation: physics, scans "
        "and navigation.",
    ]
    zero = [name for name in known if name not in drawn]
    if zero:
        text.append(f"Zero in every run: {'; '.join(zero)}.")
    if outcome_names:
        text.append(
            "outcome.NAME: value returned by the strategy's outcome(), mean over robots, not verified."
        )
    missing = [name for name in names if name not in known and "people" not in name]
    if missing:
        text.append(f"Not recorded in these runs: {'; '.join(missing)}.")
    picture = view.picture(
        "cost",
        charts.draw_dots(dots),
        f"Means with intervals, a panel for each of: {'; '.join(dots)}. The table below has all numbers.",
        "Means over runs with 95 % intervals; each panel has its own axis from zero.",
    )
    table = view.group_table(
        "cost",
        "Means over runs, with 95 % intervals",
        lambda group: [{name: mean(name, group) for name in known}],
    )
    return PageSection("Costs of adaptation", text, picture, (table,))
