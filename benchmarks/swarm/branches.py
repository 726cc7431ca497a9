"""Branches of one run without a change, at random instants: whether each is the run itself."""

import random
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.statistics.rows import print_rows
from deploy.branches.branching import branch
from deploy.branches.change import Change
from deploy.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

_SCENARIO: Final = REPOSITORY / "scenarios" / "chapter.toml"


@dataclass(frozen=True)
class BranchesTask:
    """What is tried."""

    forks: int = 20
    duration: float = 60.0
    """Of the run that they leave, simulated s."""
    seed: int = 1
    """Of the run, and of the instants."""


def run(task: BranchesTask, json_output: bool = False) -> bool:
    """Branch and compare, print, and say whether every digest is that of the run."""
    rng, rows, same = random.Random(task.seed), [], 0
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:
        origin = Path(name) / "run"
        scenario = load_scenario(_SCENARIO, Overrides(seed=task.seed, duration=task.duration))
        whole = swarm.run_in_memory(
            swarm.plan(scenario, RunOptions(origin, bus="memory")), lambda progress: None
        )
        for number in range(1, task.forks + 1):
            at_s, began = rng.uniform(0.1, task.duration - 1), time.monotonic()
            options = RunOptions(Path(name) / str(number), bus="memory")
            made = branch(origin, Change(at_s), options, trust=False)
            equal = made.result.digest == whole.digest
            same += equal
            took = time.monotonic() - began
            rows.append({"fork": number, "at s": f"{at_s:.3f}", "took s": f"{took:.1f}", "same": equal})
    print_rows(rows, f"{same} of {task.forks} have the run's digest {whole.digest}", json_output=json_output)
    return same == task.forks
