"""`acrc causes`: where a run's time went; apart from commands of campaigns, since it needs no scipy."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
from rich.table import Table

from acrc_testbed.accounting.account import account
from acrc_testbed.accounting.time_spent import Cause, TimeSpent
from actors.console import print_table, screen

_MOST: Final = 20
"""Blockings and decisions that are shown one by one; --json has all."""


def causes(folder: Path, *, json_output: bool) -> None:
    """Account for the time of the run in the folder, and print it."""
    spent = account(folder)
    if json_output:
        sys.stdout.write(msgspec.json.encode(spent).decode() + "\n")
        return
    console = screen()
    print_table(console, _times(spent))
    for table in (_blockings(spent), _decisions(spent)):
        if table.row_count:
            print_table(console, table)
    for sentence in _sentences(spent):
        console.print(sentence)


def _times(spent: TimeSpent) -> Table:
    """A row for each cause that there was; s."""
    table = Table("s", *spent.robots, "all", title="Where the time went")
    for cause in Cause:
        lasted = [each[cause.value] for each in spent.robots.values()]
        if any(lasted):
            table.add_row(cause.value, *(f"{s:.1f}" for s in (*lasted, sum(lasted))))
    whole = [sum(each.values()) for each in spent.robots.values()]
    table.add_row("together", *(f"{s:.1f}" for s in (*whole, sum(whole))))
    return table


def _blockings(spent: TimeSpent) -> Table:
    table = Table("from", "to", "robots", "at", "place", "cause", title="The longest blockings")
    longest = sorted(spent.blockings, key=lambda one: one.begin_s - one.end_s)[:_MOST]
    for one in sorted(longest, key=lambda one: one.begin_s):
        end = f"{one.end_s:.1f}" + (" (the run's)" if one.at_end else "")
        where = f"{one.x:.1f}, {one.y:.1f}"
        table.add_row(f"{one.begin_s:.1f}", end, ", ".join(one.robots), where, one.place, one.cause)
    return table


def _decisions(spent: TimeSpent) -> Table:
    table = Table("at", "robot", "decided", "by", "knowing from", "outcome", "free after", title="Decisions")
    for one in spent.decisions[:_MOST]:
        known = ", ".join(f"{each.source} ({each.age_s:.1f} s old)" for each in one.knowledge)
        free = "" if one.free_after_s is None else f"{one.free_after_s:.1f} s"
        by = one.trigger.partition(".")[0 if one.trigger.endswith(".at_member") else 2]
        table.add_row(f"{one.instant_s:.1f}", one.robot, one.words, by, known, one.outcome, free)
    return table


def _sentences(spent: TimeSpent) -> Iterator[str]:
    hidden = [max(len(each) - _MOST, 0) for each in (spent.blockings, spent.decisions)]
    if any(hidden):
        yield f"not shown: {hidden[0]} blockings, {hidden[1]} decisions; --json has them"
    if spent.decisions_left_out:
        yield f"{spent.decisions_left_out} more decisions were not kept by the robots"
    for blame in spent.blames:
        yield f"at the end of the chain, {blame.robot}: {blame.seconds:.1f} s of others, {blame.cause}"
    if spent.deadlocks is not None and spent.deadlocks.pairs:
        yield f"pairs in a deadlock: {spent.deadlocks.pairs}, of which {spent.deadlocks.came_free} came free"
    if (score := spent.diagnosis) is not None:
        precision, recall = (
            "none" if share is None else f"{share:.0%}" for share in (score.precision, score.recall)
        )
        delay = "" if score.delay_s is None else f", {score.delay_s:.1f} s after it began (median)"
        yield (
            f"the robots' own word that they are blocked: right for {precision} of the time they say so, "
            f"said for {recall} of the time that they are; {score.noticed} of {score.spells} spells "
            f"noticed{delay}; {score.false_alarms} false alarms"
        )
    for finding in spent.findings:
        yield f"{finding.name}: {finding.says}"
