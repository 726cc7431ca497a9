"""One swarm in memory, recorded as any run: CPU and bytes of recording it, and one robot replayed."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from unittest.mock import patch

from actors.runtime.bus.memory_bus import run_shells
from actors.runtime.recording import Recorder
from actors.runtime.shell import Shell
from benchmarks.statistics.measured import Measured, table_of
from benchmarks.swarm import part_clock
from benchmarks.swarm.part_clock import PartClock
from benchmarks.swarm.task import SwarmTask, planned
from deploy.run import memory_swarm, swarm
from observation.replay.record_replay import replay_actor

GOAL_SHARE: Final = 0.15
"""Of the run's CPU, at most."""
GOAL_MB: Final = 20.0
"""Per simulated minute, all processes together, at most."""
GOAL_SPEED: Final = 200.0
"""Times real time, at least: one robot replayed."""


@dataclass(frozen=True)
class RecordingFigures:
    """What one swarm's recordings came to."""

    robots: int
    simulated_s: float
    run_cpu_s: float
    share: float
    """Of the run's CPU that went into recording."""
    mb_per_minute: float
    """Of 10⁶ bytes; all recordings of the run, per simulated minute."""
    lost: int
    """Messages that were sent and arrived nowhere."""
    replayed: str
    """The robot that was replayed."""
    outputs: int
    """Its messages, all equal to the recorded ones; ReplayError otherwise."""
    replay_speed: float
    """Simulated time by CPU time of executing it again, from opening the file to the last comparison."""

    @property
    def reached(self) -> bool:
        """All goals are."""
        cheap = self.share <= GOAL_SHARE and self.mb_per_minute <= GOAL_MB
        return cheap and self.lost == 0 and self.replay_speed >= GOAL_SPEED


def measure(robots: Sequence[int] = (20,), duration: float = 600.0) -> Measured:
    """Each number of robots for so many simulated s; AcrcError if the run, or the replay, fails."""
    found = [figures(count, duration, "r1") for count in robots]
    rows = [row(one) for one in found]
    return Measured(
        rows, (table_of(rows, "in memory, each with its goal"),), all(one.reached for one in found)
    )


def row(found: RecordingFigures) -> dict[str, object]:
    """What is printed: each figure with its goal."""
    return {
        "robots": found.robots,
        "simulated s": f"{found.simulated_s:g}",
        "CPU s": f"{found.run_cpu_s:.0f}",
        f"CPU for recording (≤ {GOAL_SHARE:.0%})": f"{found.share:.1%}",
        f"MB per simulated minute (≤ {GOAL_MB:g})": f"{found.mb_per_minute:.1f}",
        "lost (0)": found.lost,
        "replayed": f"{found.replayed}: identical, {found.outputs} outputs",
        f"times real time (≥ {GOAL_SPEED:g})": f"{found.replay_speed:.0f}",
    }


def figures(robots: int, seconds: float, robot: str) -> RecordingFigures:
    """One run of the chapter's scenario, with the recorder clocked and nothing else."""
    cost = part_clock.overhead()
    clock = PartClock()

    def clocked(shells: Sequence[Shell], hold: Callable[[Shell], None]) -> None:
        with part_clock.clocked(clock, part_clock.calls_of(Recorder, "recorder")):
            clock.start()
            run_shells(shells, hold)
            clock.stop()

    task = SwarmTask((robots,), seconds=seconds, robot_seconds=None)
    with planned(robots, task, "memory") as plan:
        with patch.object(memory_swarm, "run_shells", clocked):
            result = swarm.run_in_memory(plan, lambda progress: None)
        size = sum(path.stat().st_size for path in plan.out.glob("*/*.mcap"))
        outputs, replay_s = _replayed(plan.out, robot)
    account = clock.accounts["", "recorder"]
    clocking_ns = account.calls * (cost.inside_ns + cost.outside_ns)
    run_ns = clock.total_ns - clocking_ns
    spent_ns = account.spent_ns - account.calls * cost.inside_ns
    minutes = result.simulated_s / 60
    return RecordingFigures(
        robots=robots,
        simulated_s=result.simulated_s,
        run_cpu_s=run_ns / 1e9,
        share=spent_ns / run_ns,
        mb_per_minute=size / 1e6 / minutes,
        lost=result.undelivered,
        replayed=robot,
        outputs=outputs,
        replay_speed=result.simulated_s / replay_s,
    )


def _replayed(out: Path, robot: str) -> tuple[int, float]:
    """How many messages were compared, and CPU s; the second time, for the first one compiles and loads."""
    replay_actor(out, robot)
    begun = time.process_time()
    report = replay_actor(out, robot)
    return report.outputs, time.process_time() - begun
