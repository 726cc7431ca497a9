"""Pairs put head-on and too near: how many come apart, with robots that back off and without."""

import math
from dataclasses import asdict, dataclass
from itertools import product
from typing import Final

import numpy as np
from rich.table import Table

from actors.randomness import generator
from benchmarks.causes.situations import NECKS, Robot, Situation
from benchmarks.statistics.measured import Measured
from benchmarks.statistics.runs import in_memory, in_order
from observation.accounting.account import account
from observation.accounting.time_spent import Cause
from observation.evidence.run_reader import read_run

_APART: Final = 1.0
"""Who has been so far apart, m, came free."""
_DURATION_S: Final = 60.0
_GAPS: Final = ((0.36, 0.40), (0.40, 0.45))


@dataclass(frozen=True)
class WedgeTask:
    """One pair."""

    passage: bool
    """In a passage; else on open floor."""
    gap: tuple[float, float]
    """Between their centres, from and to, m."""
    strategy: str
    back_off: bool
    seed: int


@dataclass(frozen=True)
class Parted:
    """What became of a pair."""

    free: bool
    places: int
    """Done, of two."""
    deadlock_s: float
    """Of a robot, on average."""


def check(runs: int = 5) -> Measured:
    """Run so many pairs of each kind; it holds where each pair that backs off comes free."""
    table = Table("where", "apart, m", "strategy", "back_off", "came free", "places", "deadlock, s per robot")
    kinds = list(product((True, False), _GAPS, ("none", "chapter"), (False, True)))
    tasks = [WedgeTask(*kind, seed) for kind in kinds for seed in range(1, runs + 1)]
    parted = list(in_order(part, tasks))
    for number, (passage, gap, strategy, back_off) in enumerate(kinds):
        group = parted[number * runs : (number + 1) * runs]
        where = "passage" if passage else "open floor"
        free, places = sum(one.free for one in group), sum(one.places for one in group)
        stood = sum(one.deadlock_s for one in group) / runs
        row = (where, f"{gap[0]:.2f} to {gap[1]:.2f}", strategy, str(back_off).lower(), f"{free} of {runs}")
        table.add_row(*row, f"{places} of {2 * runs}", f"{stood:.1f}")
    figures = [asdict(task) | asdict(one) for task, one in zip(tasks, parted, strict=True)]
    holds = all(one.free for task, one in zip(tasks, parted, strict=True) if task.back_off)
    return Measured(figures, (table,), holds)


def part(task: WedgeTask) -> Parted:
    """Run one pair for a minute."""
    situation = Situation("wedge", task.seed, _pair(task), _DURATION_S, task.strategy)
    with in_memory(situation.scenario({"back_off": task.back_off})) as (plan, result):
        spent = account(plan.out)
        true = read_run(plan.out).true
    apart = np.hypot(*(true[:, 0, :2] - true[:, 1, :2]).T)
    stood = [each[Cause.DEADLOCK.value] for each in spent.robots.values()]
    return Parted(bool((apart > _APART).any()), result.places_done, sum(stood) / len(stood))


def _pair(task: WedgeTask) -> tuple[Robot, Robot]:
    """Head-on, each with its place behind the other one."""
    draw = generator(task.seed, "causes", "w1" if task.passage else "w2")
    if task.passage:
        x, y = NECKS[int(draw.integers(2))], draw.uniform(8.6, 10.0)
        gap = draw.uniform(*task.gap)
        return Robot((x, y, math.pi / 2), [(x, 12.3)]), Robot((x, y + gap, -math.pi / 2), [(x, 4.0)])
    x, y = draw.uniform(8, 11), draw.uniform(12, 13)
    gap = draw.uniform(*task.gap)
    west, east = (max(x - 3, 6.8), 12.4), (x + 8, 12.4)
    return Robot((x, y, 0.0), [east]), Robot((x + gap, y, math.pi), [west])
