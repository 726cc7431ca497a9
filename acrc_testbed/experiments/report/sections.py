"""Report sections on places, times, robots, radio and costs."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import binomtest

from acrc_testbed.experiments.metrics import values
from acrc_testbed.experiments.paired_tests import CONFIDENCE, Interval, mean_interval
from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Box, Curve, Dot
from acrc_testbed.experiments.report.report_view import (
    Group,
    ReportView,
    Row,
    completion_time,
    event_time,
    places_done_or_reported,
)
from acrc_testbed.experiments.statistical_models import Completion, kaplan_meier, restricted_mean
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.picture.html_page import PagePicture, PageSection, PageTable
from acrc_testbed.results.outcome import outcome_means
from acrc_testbed.results.result import RunResult, optional_value
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
    near: bool = False,
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


def places_done(view: ReportView) -> PageSection:
    """Return the section on places done: second box plot of Fig. 7.10."""
    runs = [run for group in view.groups for run in group.results]
    totals = {run.places_total for run in runs}
    text = ["Places done at the end of the run: the chapter's number of cleaning tasks that were completed."]
    if any(run.places_done is None for run in runs):
        text.append("Places of real robots are as reported, without ground truth.")

    def total(group: Group) -> Row:
        group_totals = sorted({run.places_total for run in group.results})
        return {
            "total": group_totals[0] if len(group_totals) == 1 else f"{group_totals[0]} to {group_totals[-1]}"
        }

    picture, table = _box_plot(
        view, "places", lambda run: Completion(places_done_or_reported(run), True), what="places done",
        unit="", axis="places done", table="Places done; total: all places of a run", more=total, near=True,
        limit=(float(max(totals)), f"all {max(totals)} places") if len(totals) == 1 else None,
        caption="Places done in each run (as in the chapter's Fig. 7.10).",
    )  # fmt: skip
    return PageSection("Places done", (*text, _BOX), picture, (table,))


def running_time(view: ReportView) -> PageSection:
    """Return the section on running time: first box plot of Fig. 7.10."""
    picture, table = _box_plot(
        view, "running_time", lambda run: event_time(run.settled_s, run), what="running time", unit=" s",
        axis="simulated s", table="Running time until done or given up, s", limit=_run_end(view),
        more=lambda group: {"settled": sum(run.settled_s is not None for run in group.results)},
        caption="Running time until all places were done or given up (as in Fig. 7.10).",
    )  # fmt: skip
    text = (
        "Time at which the last place was done or given up: the chapter's total running time till system "
        "completes or gives up. Other runs count with their full length.",
        _AT_LEAST,
    )
    return PageSection("Running time until done or given up", text, picture, (table,))


def _run_end(view: ReportView) -> tuple[float, str] | None:
    """Return the length of the runs with a label, if equal for all."""
    lengths = {run.length_s for group in view.groups for run in group.results}
    return (max(lengths), "end of run") if len(lengths) == 1 else None


def completion(view: ReportView) -> PageSection:
    """Return the section on completion: Kaplan-Meier curves and their summary."""
    lengths = view.panels(lambda group: max(run.length_s for run in group.results))
    horizons = {condition: max(values) for condition, values in lengths.items()}
    runs = {group: tuple(map(completion_time, group.results)) for group in view.groups}
    done = {group: sum(run.done for run in group_runs) for group, group_runs in runs.items()}

    def curve(group: Group) -> Curve:
        return Curve(group.label, view.look(group), kaplan_meier(runs[group]), runs[group])

    def summary(group: Group) -> Iterator[Row]:
        horizon, count = horizons[group.condition], len(runs[group])
        bounds = binomtest(done[group], count).proportion_ci(CONFIDENCE, method="wilson")
        yield {
            "runs": count,
            "complete": done[group],
            "share complete": Interval(done[group] / count, float(bounds.low), float(bounds.high)),
            "restricted mean, s": restricted_mean(runs[group], horizon),
            "up to, s": horizon,
        }

    def steps(group: Group) -> Iterator[Row]:
        found = curve(group).survival
        for at, *shares in zip(found.times, found.shares, found.high, found.low, strict=True):
            complete, low, high = (1.0 - float(one) for one in shares)
            yield {"time, s": float(at), "complete": complete, "low": low, "high": high}

    counts = "; ".join(f"{view.row_name(one)} {done[one]} of {len(one.results)}" for one in view.groups)
    picture = view.picture(
        "completion",
        charts.draw_completion(view.panels(curve), max(horizons.values())),
        f"Share of completed runs over simulated time. Complete at the end: {counts}. The tables below have "
        "all numbers.",
        "Share of runs with all places done, with 95 % bands; ticks are censored runs.",
    )
    caption = "Completion, with 95 % intervals (Wilson for shares, Student for means)"
    return PageSection(
        "Time to complete",
        (
            "Kaplan-Meier estimate of the share of runs with all places done, with 95 % bands. Runs that "
            "ended before completion are censored (ticks).",
            "The restricted mean is the mean of the completion time or the run's length, whichever comes "
            "first; it includes incomplete runs.",
        ),
        picture,
        (
            view.group_table("completion", caption, summary),
            view.group_table("completion_curves", "Steps of the curves", steps, folded=True),
        ),
    )


def robots(view: ReportView) -> PageSection:
    """Return the section on each robot's own places."""

    def runs_of(group: Group, robot: str) -> list[Completion]:
        runs = (run for run in group.results if robot in run.per_robot)
        return [event_time(run.per_robot[robot].completion_s, run) for run in runs]

    def rows(group: Group) -> Iterator[Row]:
        horizon = max(run.length_s for run in group.results)
        for robot in _robots(group):
            parts = [run.per_robot[robot] for run in group.results if robot in run.per_robot]
            runs = runs_of(group, robot)
            yield {
                "robot": robot,
                "runs": len(parts),
                "total": max(part.places_total for part in parts),
                "done, mean": sum(map(places_done_or_reported, parts)) / len(parts),
                "all done in": sum(run.done for run in runs),
                "restricted mean, s": restricted_mean(runs, horizon),
            }

    caption = "Each robot's own places: mean number done, and time of the last"
    table = view.group_table("robots", caption, rows)
    text = "Time at which the last of a robot's own places was done, by whichever robot."
    if len(view.groups) > _MAX_PANELS:
        return PageSection("Results by robot", (text,), None, (table,))
    boxed = {
        view.row_name(group): [_box_of(robot, view, group, runs_of(group, robot)) for robot in _robots(group)]
        for group in view.groups
    }
    picture = view.picture(
        "robots",
        charts.draw_boxes(boxed, "simulated s", limit=_run_end(view)),
        "Box plots of the time at which each robot's own places were done, a panel for each strategy. "
        "The table below has all numbers.",
        "Time until a robot's own places were done.",
    )
    return PageSection("Results by robot", (text, _AT_LEAST), picture, (table,))


def _robots(group: Group) -> list[str]:
    names = {name for run in group.results for name in run.per_robot}
    return sorted(names, key=lambda name: (len(name), name))


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


class Cost(NamedTuple):
    """A measure of cost of a run."""

    description: str
    """With unit."""
    measure: Callable[[RunResult, TrialRecord], float | None]
    """None: unknown."""


COSTS: Final = (
    Cost("octets on the air per robot and s", lambda run, _: run.radio_bytes_per_robot_s),
    Cost("air time of a robot, % of the time", lambda run, _: airtime_percent(run)),
    Cost("adoptions in a run", _adoption_count),
    Cost("decisions of the adaptation in a run", _decision_count),
    Cost("time from blocked to driving on, s", _mean_time_to_drive_on),
    Cost("CPU, ms per robot and simulated s", lambda run, _: cpu_ms(run)),
    Cost("metres driven by all robots", lambda run, _: run.driven_m),
    Cost("energy used by all robots, J", lambda run, _: optional_value(run.energy_j)),
    Cost("contacts in a run", lambda run, _: run.contacts),
    Cost("contacts with people in a run", lambda run, _: optional_value(run.people_contacts)),
    Cost("time in contact with people, s", lambda run, _: optional_value(run.people_contact_s)),
    Cost("age of replicas, s", lambda run, _: run.deeco.replica_age_mean_s),
)


def _metric_cost(metric: Metric) -> Cost:
    """Return the cost of a study's own metric; an event that did not happen counts as the end of the run."""

    def measure(run: RunResult, _: TrialRecord) -> float | None:
        (value,) = values(metric, (run,), run.length_s)
        return None if math.isnan(value) else value

    unit = f", {metric.unit}" if metric.unit else ""
    return Cost(f"{metric.description}{unit} ({metric.better} is better)", measure)


def _outcome_cost(name: str) -> Cost:
    """Return the cost of a value returned by outcome()."""
    return Cost(f"outcome.{name}", lambda run, _: outcome_means(run.outcome).get(name))


def costs(view: ReportView) -> PageSection:
    """Return the section on all known costs."""
    outcome_names = dict.fromkeys(
        name for group in view.groups for run in group.results for name in outcome_means(run.outcome)
    )
    own = map(_metric_cost, view.metrics.values())
    found = {
        (cost.description, group): [
            float(value)
            for record in group.records
            if record.result is not None and (value := cost.measure(record.result, record)) is not None
        ]
        for cost in (*own, *COSTS, *map(_outcome_cost, outcome_names))
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
        "Means over runs with Student's 95 % intervals. An adoption is a decision to take over another "
        "robot's place. CPU time includes the whole simulation: physics, scans and navigation.",
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
