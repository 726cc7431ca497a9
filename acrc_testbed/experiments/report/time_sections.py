"""Sections on where the robots' time went, who blocked whom, and decisions of the adaptation."""

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import Bar
from acrc_testbed.experiments.report.runs import Cell, Group, ReportView, Row
from acrc_testbed.explanation.time_spent import Cause, DeadlockCount, DecisionEvent
from acrc_testbed.picture.html_page import PageSection
from actors.observer.glyphs import CAUSE_GLYPHS, hexadecimal

LOOKS: Final = {word: (hexadecimal(glyph.colour), glyph.hatch) for word, glyph in CAUSE_GLYPHS.items()}
"""Colour and hatch of each cause: driving first, then what keeps a robot from it."""
_MOST_LISTED: Final = 500


def causes(view: ReportView) -> PageSection | None:
    """Return where robot-seconds went; None if no run says so."""
    shares = {group: _shares(group) for group in view.groups if group.times}
    if not shares:
        return None
    bars = view.panels(lambda group: Bar(group.label, shares[group]) if group in shares else None)
    seen = {name for parts in shares.values() for name, part in parts.items() if part}
    told = "; ".join(
        f"{view.row_name(group)}: "
        + ", ".join(f"{name} {part:.0%}" for name, part in parts.items() if part >= 0.01)
        for group, parts in shares.items()
    )

    def percents(group: Group) -> Iterator[Row]:
        if group in shares:
            yield {"runs": len(group.times)} | {name: 100.0 * part for name, part in shares[group].items()}

    def robots(group: Group) -> Iterator[Row]:
        names = {name for run in group.times for name in run.robots}
        for robot in sorted(names, key=lambda name: (len(name), name)):
            runs = [run.robots[robot] for run in group.times if robot in run.robots]
            means = {cause: float(np.mean([run.get(cause, 0.0) for run in runs])) for cause in LOOKS}
            yield {"robot": robot, **means}

    return PageSection(
        "Where the time went",
        (
            "Every robot-second of every run by what it went into, by ground truth; a robot's seconds add up "
            "to the run's. Where several causes hold at once, the first in this order does: "
            f"{', '.join(cause.value for cause in Cause)}.",
        ),
        view.picture(
            "time",
            charts.bars(
                bars, {name: how for name, how in LOOKS.items() if name in seen}, "share of robot time"
            ),
            f"Stacked bars of the share of robot time by cause. {told}. All numbers are in the tables below.",
            "Share of robot time by cause, over all robots and runs; numbers in the bars are percent.",
        ),
        (
            view.group_table("time", "Share of robot time, %", percents),
            view.group_table("time_robots", "Mean time in a run, robot by robot, s", robots, folded=True),
        ),
    )


def _shares(group: Group) -> dict[str, float]:
    total = Counter[str]()
    for run in group.times:
        for parts in run.robots.values():
            total.update(parts)
    whole = sum(total.values()) or 1.0
    return {name: total[name] / whole for name in LOOKS}


def blockings(view: ReportView) -> PageSection | None:
    """Return how often robots blocked one another, and whether they noticed; None if no run says so."""
    if not any(group.times for group in view.groups):
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
            view.group_table("blockings", "Blockings, all runs together", _blockings),
            view.group_table("deadlocks", "Pairs of robots in a deadlock", _deadlocks),
            view.group_table("diagnosis", "The strategy's own diagnosis", _diagnosis),
            view.group_table("findings", "What else was found of whole runs", _findings),
        ),
    )


def _blockings(group: Group) -> Iterator[Row]:
    events = [event for run in group.times for event in run.blockings]
    for place, cause in sorted({(event.place, event.cause) for event in events}):
        of_kind = [event for event in events if (event.place, event.cause) == (place, cause)]
        yield {
            "runs": len(group.times),
            "place": place,
            "cause": cause,
            "blockings": len(of_kind),
            "median length, s": float(np.median([event.end_s - event.begin_s for event in of_kind])),
            "lasted to the end": sum(event.at_end for event in of_kind),
        }


def deadlocks(group: Group) -> tuple[DeadlockCount, ...]:
    """Return those of the group's runs in which they were counted."""
    return tuple(run.deadlocks for run in group.times if run.deadlocks is not None)


def _deadlocks(group: Group) -> Iterator[Row]:
    if runs := deadlocks(group):
        pairs, free = sum(run.pairs for run in runs), sum(run.came_free for run in runs)
        yield {"runs": len(runs), "pairs": pairs, "came free": free, "pairs in a run": pairs / len(runs)}


def _diagnosis(group: Group) -> Iterator[Row]:
    scores = [run.diagnosis for run in group.times if run.diagnosis is not None]
    if scores:
        yield {
            "runs": len(scores),
            "precision": _known([score.precision for score in scores]),
            "recall": _known([score.recall for score in scores]),
            "delay, s": _known([score.delay_s for score in scores]),
            "spells": sum(score.spells for score in scores),
            "noticed": sum(score.noticed for score in scores),
            "false alarms": sum(score.false_alarms for score in scores),
        }


def _findings(group: Group) -> Iterator[Row]:
    for name, runs in Counter(one.name for run in group.times for one in run.findings).items():
        yield {"finding": name, "runs": runs}


def _known(said: list[float | None]) -> Cell:
    """Return the mean over runs that have it."""
    values = [value for value in said if value is not None]
    return float(np.mean(values)) if values else None


def decisions(view: ReportView) -> PageSection | None:
    """Return decisions of the adaptation and their outcomes; None if nothing was decided."""
    if not any(run.decisions for group in view.groups for run in group.times):
        return None
    left_out = sum(run.decisions_left_out for group in view.groups for run in group.times)
    more = (f"{left_out} further decisions were made and are not listed.",) if left_out else ()
    all_runs = "Decisions, all runs together; times are medians over robots that got on"
    themselves = f"The decisions themselves, {_MOST_LISTED} of each strategy at most"
    return PageSection(
        "What the adaptation decided",
        ("Each decision by what set it off and what came of it.", *more),
        None,
        (
            view.group_table("decisions", all_runs, _by_outcome),
            view.group_table(
                "decision_events", themselves, lambda group: list(_events(group))[:_MOST_LISTED], folded=True
            ),
        ),
    )


def _by_outcome(group: Group) -> Iterator[Row]:
    events = [event for run in group.times for event in run.decisions]
    for trigger, outcome in sorted({(event.trigger, event.outcome) for event in events}):
        of_kind = [event for event in events if (event.trigger, event.outcome) == (trigger, outcome)]
        freed = [
            (event.blocked_s + event.free_after_s, event.free_after_s)
            for event in of_kind
            if event.free_after_s is not None
        ]
        whole, after = np.median(freed, axis=0).tolist() if freed else (None, None)
        yield {
            "decided by": trigger,
            "outcome": outcome,
            "decisions": len(of_kind),
            "got on": len(freed),
            "from blocked to free, s": whole,
            "from decision to free, s": after,
        }


def _events(group: Group) -> Iterator[Row]:
    for record in group.records:
        for event in () if record.time is None else record.time.decisions:
            yield {
                "seed": str(record.seed),
                "s": event.instant_s,
                "robot": event.robot,
                "decided by": event.trigger,
                "decision": event.words,
                "knowledge of": _knowledge(event),
                "old goal": _goal(event.old_goal),
                "new goal": _goal(event.new_goal),
                "outcome": event.outcome,
                "stood for, s": event.blocked_s,
                "free after, s": event.free_after_s,
            }


def _knowledge(event: DecisionEvent) -> str:
    return "; ".join(f"{one.source}, {one.age_s:.1f} s old" for one in event.knowledge)


def _goal(goal: tuple[float, float] | None) -> str:
    return "none" if goal is None else f"({goal[0]:.2f}, {goal[1]:.2f})"
