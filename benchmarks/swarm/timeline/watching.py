"""One run over Zenoh in which every process notes what it does in some steps of its middle."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from actors.messages import Progress
from actors.runtime.errors import AcrcError
from actors.runtime.recording import decoded, read_notes
from actors.runtime.spans import NOTE, Span, SpansNote, Window
from benchmarks.swarm.process_figures import Load
from benchmarks.swarm.task import SwarmTask, all_cpu_s, planned
from deploy.run import swarm


class NothingSeenError(AcrcError):
    """A run that was over before the steps that were to be watched."""


@dataclass(frozen=True)
class Notice:
    """The parent hears how far the run is; it takes no part in the barrier."""

    step: int
    at_ns: int
    """CLOCK_MONOTONIC."""
    cpu_ns: int
    """Of the parent, so far."""


@dataclass(frozen=True)
class Watched:
    """What was noted."""

    robots: int
    window: Window
    spans: Mapping[str, tuple[Span, ...]]
    """By process, world and radio first; each process's own in their order."""
    notices: tuple[Notice, ...]
    cores: int
    load: float
    """Load average over the last minute, before."""
    others: float
    """Cores that were busy with something else, over the whole run."""
    digest: str


def watch(robots: int, task: SwarmTask, steps: int) -> Watched:
    """Run that many robots for the task's time, and watch so many steps in the middle of it."""
    notices = []

    def note(progress: Progress) -> None:
        notices.append(Notice(progress.step, time.monotonic_ns(), time.process_time_ns()))

    load_before = os.getloadavg()[0]
    with planned(robots, task, "zenoh") as plan:
        whole = round(task.seconds * 1e6) // plan.world.step_us
        window = Window(max(0, (whole - steps) // 2), min(steps, whole))
        load, own = Load(), all_cpu_s()
        result = swarm.run_processes(replace(plan, spans=window), "forkserver", note)
        others = load.others(all_cpu_s() - own)
        spans = dict(_spans(path) for path in plan.out.glob("*/*.mcap"))
    if not all(spans.values()):
        raise NothingSeenError(f"the run was over after {result.simulated_s:g} s, before step {window.first}")
    return Watched(
        robots=robots,
        window=window,
        spans={actor: spans[actor] for actor in sorted(spans, key=_order)},
        notices=tuple(notice for notice in notices if notice.step in window),
        cores=len(os.sched_getaffinity(0)),
        load=load_before,
        others=others,
        digest=result.digest,
    )


def _spans(recording: Path) -> tuple[str, tuple[Span, ...]]:
    note = decoded(recording, NOTE, read_notes(recording)[NOTE], SpansNote)
    return recording.stem, note.spans


def _order(actor: str) -> tuple[int, int, str]:
    """World, radio, and the robots by their numbers."""
    rank = {"world": 0, "radio": 1}.get(actor, 2)
    return rank, len(actor), actor
