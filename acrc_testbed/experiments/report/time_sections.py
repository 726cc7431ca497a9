"""Where the robots' time went, what stood in whose way, and what the adaptation decided about it."""

from collections import Counter
from typing import Final

import numpy as np

from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Bar
from acrc_testbed.experiments.report.runs import Cell, Group, ReportView
from acrc_testbed.explanation.time_spent import Cause, DeadlockCount, DecisionEvent
from acrc_testbed.picture.html_page import PageSection
from actors.observer.glyphs import SEEN_STATES, hexadecimal

LOOKS: Final = {word: (hexadecimal(glyph.colour), glyph.hatch) for word, glyph in SEEN_STATES.items()}
"""Colour and hatch of each cause: driving first, then what keeps a robot from it."""
_MOST_LISTED: Final = 500


def causes(view: ReportView) -> PageSection | None:
    """Where robot-seconds went; None if no run says so."""
    bars = view.panels(lambda group: Bar(group.label, _shares(group)) if group.times else None)
    if not bars:
        return None
    seen = {name for rows in bars.values() for row in rows for name, part in row.parts.items() if part}
    looks = {name: how for name, how in LOOKS.items() if name in seen}
    told = "; ".join(
        f"{view.row_name(group)}: "
        + ", ".join(f"{name} {part:.0%}" for name, part in _shares(group).items() if part >= 0.01)
        for group in view.groups
        if group.times
    )
    return PageSection(
        "Where the time went",
        (
            "Every robot-second of every run by what it went into, by ground truth; a robot's seconds add up "
            "to the run's. Where several causes hold at once, the first in this order does: "
            f"{', '.join(cause.value for cause in Cause)}.",
        ),
        view.picture(
            "time",
            charts.bars(bars, looks, "share of robot time"),
            f"Stacked bars of the share of robot time by cause. {told}. All numbers are in the tables below.",
            "Share of robot time by cause, over all robots and runs; numbers in the bars are percent.",
        ),
        (
            view.table(
                "time", "Share of robot time, %", ("runs", *LOOKS),
                lambda group: [_percents(group)] if group.times else [],
            ),
            view.table(
                "time_robots", "Mean time in a run, robot by robot, s", ("robot", *LOOKS), _robots,
                folded=True,
            ),
        ),
    )  # fmt: skip


def _shares(group: Group) -> dict[str, float]:
    total = Counter[str]()
    for run in group.times:
        for parts in run.robots.values():
            total.update(parts)
    whole = sum(total.values()) or 1.0
    return {name: total[name] / whole for name in LOOKS}


def _percents(group: Group) -> tuple[Cell, ...]:
    return len(group.times), *(100.0 * part for part in _shares(group).values())


def _robots(group: Group) -> list[tuple[Cell, ...]]:
    runs = group.times
    names = sorted({name for run in runs for name in run.robots}, key=lambda name: (len(name), name))
    return [
        (
            name,
            *(float(np.mean([run.robots[name].get(cause, 0.0) for run in runs if name in run.robots]))
              for cause in LOOKS),
        )
        for name in names
    ]  # fmt: skip


def blockings(view: ReportView) -> PageSection | None:
    """How often robots stood in each other's way, and whether they noticed; None if no run says so."""
    known = [group for group in view.groups if group.times]
    if not known:
        return None
    return PageSection(
        "Robots in each other's way",
        (
            "A blocking begins when robots stand in each other's way and ends when one of them gets on. "
            "Its diagnosis is the strategy's own word that it is blocked, set against the truth: precision "
            "is the share of the time said to be blocked that was, recall the share of blocked time that was "
            "said to be.",
        ),
        None,
        (
            view.table(
                "blockings", "Blockings, all runs together",
                ("runs", "place", "cause", "blockings", "median length, s", "lasted to the end"), _blockings,
            ),
            view.table(
                "deadlocks", "Pairs of robots in a deadlock",
                ("runs", "pairs", "came free", "pairs in a run"),
                lambda group: [_deadlocks(group)] if deadlocks(group) else [],
            ),
            view.table(
                "diagnosis", "The strategy's own diagnosis",
                ("runs", "precision", "recall", "delay, s", "spells", "noticed", "false alarms"), _diagnosis,
            ),
            view.table(
                "findings", "What else was found of whole runs", ("finding", "runs"),
                lambda group: list(Counter(one.name for run in group.times for one in run.findings).items()),
            ),
        ),
    )  # fmt: skip


def _blockings(group: Group) -> list[tuple[Cell, ...]]:
    events = [event for run in group.times for event in run.blockings]
    kinds = sorted({(event.place, event.cause) for event in events})
    rows: list[tuple[Cell, ...]] = []
    for place, cause in kinds:
        of_kind = [event for event in events if (event.place, event.cause) == (place, cause)]
        median = float(np.median([event.end_s - event.begin_s for event in of_kind]))
        to_end = sum(event.at_end for event in of_kind)
        rows.append((len(group.times), place, cause, len(of_kind), median, to_end))
    return rows


def deadlocks(group: Group) -> tuple[DeadlockCount, ...]:
    """Of the group's runs in which they were counted."""
    return tuple(run.deadlocks for run in group.times if run.deadlocks is not None)


def _deadlocks(group: Group) -> tuple[Cell, ...]:
    runs = deadlocks(group)
    pairs = sum(run.pairs for run in runs)
    return len(runs), pairs, sum(run.came_free for run in runs), pairs / len(runs)


def _diagnosis(group: Group) -> list[tuple[Cell, ...]]:
    scores = [run.diagnosis for run in group.times if run.diagnosis is not None]
    if not scores:
        return []
    return [
        (
            len(scores), _known([score.precision for score in scores]),
            _known([score.recall for score in scores]), _known([score.delay_s for score in scores]),
            sum(score.spells for score in scores), sum(score.noticed for score in scores),
            sum(score.false_alarms for score in scores),
        )
    ]  # fmt: skip


def _known(said: list[float | None]) -> Cell:
    """The mean over runs that have it."""
    values = [value for value in said if value is not None]
    return float(np.mean(values)) if values else None


def decisions(view: ReportView) -> PageSection | None:
    """What the adaptation decided, and what came of it; None if nothing was decided."""
    if not any(run.decisions for group in view.groups for run in group.times):
        return None
    left_out = sum(run.decisions_left_out for group in view.groups for run in group.times)
    more = (f"{left_out} further decisions were made and are not listed.",) if left_out else ()
    return PageSection(
        "What the adaptation decided",
        ("Each decision by what set it off and what came of it.", *more),
        None,
        (
            view.table(
                "decisions", "Decisions, all runs together; times are medians over robots that got on",
                ("decided by", "outcome", "decisions", "got on", "from blocked to free, s",
                 "from decision to free, s"),
                _by_outcome,
            ),
            view.table(
                "decision_events", f"The decisions themselves, {_MOST_LISTED} of each strategy at most",
                ("seed", "s", "robot", "decided by", "decision", "knowledge of", "old goal", "new goal",
                 "outcome", "stood for, s", "free after, s"),
                _events, folded=True,
            ),
        ),
    )  # fmt: skip


def _by_outcome(group: Group) -> list[tuple[Cell, ...]]:
    events = [event for run in group.times for event in run.decisions]
    rows: list[tuple[Cell, ...]] = []
    for kind in sorted(set(map(_kind, events))):
        of_kind = [event for event in events if _kind(event) == kind]
        freed = [
            (event.blocked_s + event.free_after_s, event.free_after_s)
            for event in of_kind
            if event.free_after_s is not None
        ]
        whole, after = np.median(freed, axis=0).tolist() if freed else (None, None)
        rows.append((*kind, len(of_kind), len(freed), whole, after))
    return rows


def _kind(event: DecisionEvent) -> tuple[str, str]:
    """Without its words, which name the place that it is about."""
    return event.trigger, event.outcome


def _events(group: Group) -> list[tuple[Cell, ...]]:
    events: list[tuple[Cell, ...]] = [
        (
            str(case.seed), event.instant_s, event.robot, event.trigger, event.words, _knowledge(event),
            _goal(event.old_goal), _goal(event.new_goal), event.outcome, event.blocked_s,
            event.free_after_s,
        )
        for case in group.records
        if case.time is not None
        for event in case.time.decisions
    ]  # fmt: skip
    return events[:_MOST_LISTED]


def _knowledge(event: DecisionEvent) -> str:
    return "; ".join(f"{one.source}, {one.age_s:.1f} s old" for one in event.knowledge)


def _goal(goal: tuple[float, float] | None) -> str:
    return "none" if goal is None else f"({goal[0]:.2f}, {goal[1]:.2f})"
