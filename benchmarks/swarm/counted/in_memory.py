"""One robot's step in memory: Python calls, messages, bytes sent and recorded, allocated blocks."""

import cProfile
import gc
from collections import defaultdict
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

from actors.runtime.bus.memory_bus import MemoryBus
from benchmarks.swarm.counted import calls
from benchmarks.swarm.counted.blocks import counted_blocks
from benchmarks.swarm.counted.steps import ROBOTS, WARM_UP, CountedSteps
from benchmarks.swarm.process_figures import kind
from benchmarks.swarm.task import SwarmTask, planned
from deploy.run import swarm

_OWN: Final = "benchmarks/"
"""Calls in these rooms are the counting itself."""


@dataclass(frozen=True)
class StepCounts:
    """Of one robot in one step, the world's and the radio's work for it included."""

    calls: dict[str, float]
    """Python's calls, of built-in functions as well, by room."""
    messages: dict[str, float]
    """By topic."""
    sent: dict[str, float]
    """Bytes of these messages, by topic."""
    recorded: dict[str, float]
    """Bytes of recordings, by kind of actor."""
    functions: dict[str, float]
    """Calls by function."""


_NAMES: Final = [field.name for field in fields(StepCounts)]


def counted(window: CountedSteps) -> StepCounts:
    """What a longer run has more than a shorter one of the same start.

    What a process does once, such as imports and the first use of kernels, has been done before.
    """
    with planned(ROBOTS, WARM_UP, "memory") as plan:
        swarm.run_in_memory(plan, lambda progress: None)
    short, long = map(_profiled, window.tasks)
    return StepCounts(*(window.per_step(getattr(short, name), getattr(long, name)) for name in _NAMES))


def blocks(window: CountedSteps) -> float:
    """Blocks of memory allocated per robot and step, freed ones included; for a process that is warm."""
    short, long = map(_blocks, window.tasks)
    return window.per_step({"": short}, {"": long})[""]


def _profiled(task: SwarmTask) -> StepCounts:
    """Whole numbers of one run, from laying it out to its result."""
    bus, profile = _CountingBus(), cProfile.Profile()
    with planned(ROBOTS, task, "memory") as plan:
        gc.collect()  # what the run before has left is freed before this one is counted
        profile.runcall(swarm.run_in_memory, plan, lambda progress: None, bus)
        recorded = recorded_bytes(plan.out)
    called = calls.entries(profile)
    functions: defaultdict[str, float] = defaultdict(float)
    for function, (times, _) in called.items():
        functions[calls.name_of(function)] += times
    rooms = {room: times for room, times in calls.by_room(called).items() if not room.startswith(_OWN)}
    return StepCounts(rooms, bus.messages, bus.sent, recorded, functions)


def _blocks(task: SwarmTask) -> int:
    with planned(ROBOTS, task, "memory") as plan, counted_blocks() as count:
        swarm.run_in_memory(plan, lambda progress: None)
    return count.blocks


def recorded_bytes(out: Path) -> dict[str, float]:
    """The size of a run's recordings by kind of actor."""
    sizes: defaultdict[str, float] = defaultdict(float)
    for file in out.glob("*/*.mcap"):
        sizes[kind(file.stem)] += file.stat().st_size
    return sizes


class _CountingBus(MemoryBus):
    """Counts by topic."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: defaultdict[str, float] = defaultdict(float)
        self.sent: defaultdict[str, float] = defaultdict(float)

    def publish(self, key: str, payload: bytes) -> None:
        """Count, and hand it on."""
        topic = _topic(key)
        self.messages[topic] += 1
        self.sent[topic] += len(payload)
        super().publish(key, payload)


def _topic(key: str) -> str:
    """The pattern of a key: without whose it is."""
    parts = key.split("/")
    if parts[1] in {"up", "down"}:
        parts[2] = "{id}"
    return "/".join(parts)
