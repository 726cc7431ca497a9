"""Report sections on time by cause, blockages, and decisions of the adaptation."""

from collections import Counter
from collections.abc import Iterator
from itertools import groupby
from operator import attrgetter
from typing import Final

import numpy as np

from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Bar
from acrc_testbed.experiments.report.report_view import Cell, Group, ReportView, Row, in_order
from acrc_testbed.explanation.time_spent import Cause, DeadlockCount, DecisionEvent
from acrc_testbed.picture.html_page import PageSection
from actors.observer.glyphs import CAUSE_GLYPHS, hexadecimal

CAUSE_STYLES: Final = {word: (hexadecimal(glyph.colour), glyph.hatch) for word, glyph in CAUSE_GLYPHS.items()}
"""Colour and hatch of each cause, driving first."""
_MAX_LISTED: Final = 500


def causes(view: ReportView) -> PageSection | None:
    """Return the section on robots' time by cause; None if unknown."""
    shares = {group: _cause_shares(group) for group in view.groups if group.times}
    if not shares:
        return None
    bars = view.panels(lambda group: Bar(group.label, shares[group]) if group in shares else None)
    seen = {name for parts in shares.values() for name, part in parts.items() if part}
    text = "; ".join(
        f"{view.row_name(group)}: "
        + ", ".join(f"{name} {part:.0%}" for name, part in parts.items() if part >= 0.01)
        for group, parts in shares.items()
    )

    def percents(group: Group) -> Iterator[Row]:
        if group in shares:
            yield {"runs": len(group.times)} | {name: 100.0 * part for name, part in shares[group].items()}

    def robots(group: Group) -> Iterator[Row]:
        for robot in in_order(run.robots for run in group.times):
            runs = [run.robots[robot] for run in group.times if robot in run.robots]
            means = {cause: float(np.mean([run.get(cause, 0.0) for run in runs])) for cause in CAUSE_STYLES}
            yield {"robot": robot, **means}

    return PageSection(
        "Time by cause",
        (
            "Time of all robots by cause, from ground truth. If several causes apply, the first in this "
            f"order counts: {', '.join(cause.value for cause in Cause)}.",
        ),
        view.picture(
            "time",
            charts.draw_bars(
                bars, {name: how for name, how in CAUSE_STYLES.items() if name in seen}, "share of robot time"
            ),
            f"Stacked bars of the share of robot time by cause. {text}. The tables below have all numbers.",
            "Share of robot time by cause, over all robots and runs, in percent.",
        ),
        (
            view.group_table("time", "Share of robot time, %", percents),
            view.group_table("time_robots", "Mean time per run by robot, s", robots, folded=True),
        ),
    )


def _cause_shares(group: Group) -> dict[str, float]:
    total = Counter[str]()
    for run in group.times:
        for parts in run.robots.values():
            total.update(parts)
    whole = sum(total.values()) or 1.0
    return {name: total[name] / whole for name in CAUSE_STYLES}


def blockings(view: ReportView) -> PageSection | None:
    """Return the section on blockages and their diagnosis; None if unknown."""
    if not view.times:
        return None
    return PageSection(
        "Blockages",
        (
            "A blockage begins when a robot stands and waits for another one, and ends when one of them "
            "drives on; its cause is the most frequent one. Robots count as a deadlocked pair only if they "
            "wait for each other for 10 s or longer. The diagnosis compares blocked times reported by the "
            "strategy with ground truth: precision is the share of reported time that was blocked, recall "
            "the share of blocked time that was reported.",
        ),
        None,
        (
            view.group_table("blockings", "Blockages, all runs together", _blocking_rows),
            view.group_table("deadlocks", "Deadlocked pairs of robots", _deadlock_rows),
            view.group_table("diagnosis", "Diagnosis by the strategy", _diagnosis_rows),
            view.group_table("findings", "Other findings", _finding_rows),
        ),
    )


def _blocking_rows(group: Group) -> Iterator[Row]:
    kind = attrgetter("place", "cause")
    events = sorted((event for run in group.times for event in run.blockings), key=kind)
    for (place, cause), found in groupby(events, kind):
        of_kind = list(found)
        yield {
            "runs": len(group.times),
            "place": place,
            "cause": cause,
            "blockages": len(of_kind),
            "median length, s": float(np.median([event.end_s - event.begin_s for event in of_kind])),
            "lasted to the end": sum(event.at_end for event in of_kind),
        }


def deadlock_counts(group: Group) -> tuple[DeadlockCount, ...]:
    """Return the deadlock counts of a group's runs, where known."""
    return tuple(run.deadlocks for run in group.times if run.deadlocks is not None)


def _deadlock_rows(group: Group) -> Iterator[Row]:
    if runs := deadlock_counts(group):
        pairs, free = sum(run.pairs for run in runs), sum(run.came_free for run in runs)
        yield {"runs": len(runs), "pairs": pairs, "resolved": free, "pairs per run": pairs / len(runs)}


def _diagnosis_rows(group: Group) -> Iterator[Row]:
    scores = [run.diagnosis for run in group.times if run.diagnosis is not None]
    if scores:
        yield {
            "runs": len(scores),
            "precision": _known_mean([score.precision for score in scores]),
            "recall": _known_mean([score.recall for score in scores]),
            "delay, s": _known_mean([score.delay_s for score in scores]),
            "blockages": sum(score.spells for score in scores),
            "detected": sum(score.noticed for score in scores),
            "false alarms": sum(score.false_alarms for score in scores),
        }


def _finding_rows(group: Group) -> Iterator[Row]:
    for name, runs in Counter(one.name for run in group.times for one in run.findings).items():
        yield {"finding": name, "runs": runs}


def _known_mean(results: list[float | None]) -> Cell:
    """Return the mean of known values; None without any."""
    values = [value for value in results if value is not None]
    return float(np.mean(values)) if values else None


def decisions(view: ReportView) -> PageSection | None:
    """Return the section on decisions of the adaptation and their outcomes; None without decisions."""
    if not any(run.decisions for run in view.times):
        return None
    left_out = sum(run.decisions_left_out for run in view.times)
    more = (f"{left_out} further decisions are not listed.",) if left_out else ()
    all_runs = "Decisions, all runs together; times are medians over robots that drove on"
    listed = f"All decisions, at most {_MAX_LISTED} of each strategy"
    return PageSection(
        "Decisions of the adaptation",
        ("Decisions by trigger and outcome.", *more),
        None,
        (
            view.group_table("decisions", all_runs, _outcome_rows),
            view.group_table(
                "decision_events",
                listed,
                lambda one: list(_decision_rows(one))[:_MAX_LISTED],
                folded=True,
            ),
        ),
    )


def _outcome_rows(group: Group) -> Iterator[Row]:
    kind = attrgetter("trigger", "outcome")
    events = sorted((event for run in group.times for event in run.decisions), key=kind)
    for (trigger, outcome), found in groupby(events, kind):
        of_kind = list(found)
        freed = [
            (event.blocked_s + event.free_after_s, event.free_after_s)
            for event in of_kind
            if event.free_after_s is not None
        ]
        whole, after = np.median(freed, axis=0).tolist() if freed else (None, None)
        yield {
            "trigger": trigger,
            "outcome": outcome,
            "decisions": len(of_kind),
            "drove on": len(freed),
            "from blocked to driving on, s": whole,
            "from decision to driving on, s": after,
        }


def _decision_rows(group: Group) -> Iterator[Row]:
    for record in group.records:
        for event in () if record.time is None else record.time.decisions:
            yield {
                "seed": str(record.seed),
                "time, s": event.instant_s,
                "robot": event.robot,
                "trigger": event.trigger,
                "decision": event.words,
                "knowledge of": _knowledge_text(event),
                "old goal": _goal_text(event.old_goal),
                "new goal": _goal_text(event.new_goal),
                "outcome": event.outcome,
                "blocked for, s": event.blocked_s,
                "free after, s": event.free_after_s,
            }


def _knowledge_text(event: DecisionEvent) -> str:
    return "; ".join(f"{one.source}, {one.age_s:.1f} s old" for one in event.knowledge)


def _goal_text(goal: tuple[float, float] | None) -> str:
    return "none" if goal is None else f"({goal[0]:.2f}, {goal[1]:.2f})"
