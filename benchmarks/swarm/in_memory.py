"""A full swarm in one process: CPU time by part."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final
from unittest.mock import patch

from actors.runtime.bus.memory_bus import run_shells
from actors.runtime.shell import Shell
from benchmarks.swarm import part_clock, parts
from benchmarks.swarm.part_clock import BudgetLine, PartClock, budget
from benchmarks.swarm.task import SwarmTask, planned
from deploy.run import memory_swarm, swarm
from observation.results.result import RunResult

_MEMORY_REPEATS: Final = 2


@dataclass(frozen=True)
class MemoryFigures:
    """The same swarm in one process."""

    real_time_factor: float
    ms: float
    """CPU per robot and simulated second, ms, with nothing measured inside."""
    lines: list[BudgetLine]
    """The same by part, from another run, without what the clock cost."""
    clock_ms: float
    """What the clock is held to have cost in that run."""
    clocked_ms: float
    """That run as a whole."""
    simulated_s: float
    frames: dict[str, int]
    """What became of the radio's frames, as in `RunResult.frames`."""
    node: dict[str, int]
    """What the robots' nodes counted, all together."""


Turn = Callable[[Sequence[Shell], Callable[[Shell], None]], None]


def _memory_run(count: int, task: SwarmTask, turn: Turn) -> RunResult:
    """With `turn` in the place of `run_shells`."""
    with planned(count, task, "memory") as plan, patch.object(memory_swarm, "run_shells", turn):
        return swarm.run_in_memory(plan, lambda progress: None)


def in_memory(count: int, task: SwarmTask, clock_cost: part_clock.Overhead) -> MemoryFigures:
    """Of several runs of each kind the one that took least counts: all do the same."""
    clocked, plain = [], []
    for _ in range(min(task.repeat, _MEMORY_REPEATS)):
        clocked.append(_clocked_run(count, task))
        plain.append(_plain_run(count, task))
    clock = min(clocked, key=lambda clock: clock.total_ns)
    spent_ns, result = min(plain, key=lambda run: run[0])
    robot_s = count * result.simulated_s
    lines, clock_ms = budget(clock.accounts, clock.total_ns, clock_cost, robot_s)
    return MemoryFigures(
        real_time_factor=result.real_time_factor,
        ms=spent_ns / robot_s / 1e6,
        lines=lines,
        clock_ms=clock_ms,
        clocked_ms=clock.total_ns / robot_s / 1e6,
        simulated_s=result.simulated_s,
        frames=result.frames,
        node=result.deeco.counters,
    )


def plain_ms(count: int, task: SwarmTask) -> float:
    """CPU per robot and simulated second of one run, ms, with nothing measured inside."""
    spent_ns, result = _plain_run(count, task)
    return spent_ns / count / result.simulated_s / 1e6


def _plain_run(count: int, task: SwarmTask) -> tuple[int, RunResult]:
    spent: list[int] = []

    def timed(shells: Sequence[Shell], hold: Callable[[Shell], None]) -> None:
        begun = time.thread_time_ns()
        run_shells(shells, hold)
        spent.append(time.thread_time_ns() - begun)

    result = _memory_run(count, task, timed)
    return spent[0], result


def _clocked_run(count: int, task: SwarmTask) -> PartClock:
    clock = PartClock()

    def clocked(shells: Sequence[Shell], hold: Callable[[Shell], None]) -> None:
        targets = parts.targets(shell.core for shell in shells)
        with part_clock.clocked(clock, targets), parts.pumps_clocked(clock):
            clock.start()
            run_shells(shells, hold)
            clock.stop()

    _memory_run(count, task, clocked)
    return clock
