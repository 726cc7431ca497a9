"""Branches of one run at random instants: each is the run itself, or, without one frame, names that frame."""

import random
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.installation.repository import SHIPPED
from actors.robot.behaviour.foreign import INSTALLED
from benchmarks.branches.losses import heard, named
from benchmarks.statistics.measured import Measured, table_of
from deploy.branches.branching import branch
from deploy.branches.change import Change
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"


@dataclass(frozen=True)
class _Branch:
    """One branch."""

    change: str
    at_s: float
    took_s: float
    right: bool
    """It has the run's digest, or names the frame."""

    @property
    def row(self) -> dict[str, object]:
        found = "names it" if self.change else "is the run"
        return {
            "without": self.change or "-", "at s": f"{self.at_s:.3f}", "took s": f"{self.took_s:.1f}",
            "branch": found if self.right else "is otherwise",
        }  # fmt: skip


def check(runs: int = 20, duration: float = 60.0, seed: int = 1) -> Measured:
    """Branch so often unchanged, and so often without one frame at one robot, and compare.

    `duration`: of the run that they leave, simulated s. `seed`: of the run, and of the instants. It holds
    where each unchanged branch is the run, and each other one names its frame as the first difference.
    """
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:
        origin = Path(name) / "run"
        scenario = load_scenario(_SCENARIO, Overrides(seed=seed, duration=duration))
        plan = swarm.plan(scenario, RunOptions(origin, bus="memory"))
        digest = swarm.run_in_memory(plan, lambda progress: None).digest
        same = list(_unchanged(runs, duration, rng, origin, digest))
        lacking = list(_without_a_frame(runs, rng, origin))
    right, told = sum(one.right for one in same), sum(one.right for one in lacking)
    title = (
        f"{right} of {len(same)} unchanged have the run's digest {digest}; "
        f"{told} of {len(lacking)} without a frame name it as the first difference"
    )
    rows = [one.row for one in (*same, *lacking)]
    return Measured(rows, (table_of(rows, title),), right == len(same) and told == len(lacking))


def _unchanged(
    runs: int, duration: float, rng: random.Random, origin: Path, digest: str
) -> Iterator[_Branch]:
    for number in range(runs):
        at_s, began = rng.uniform(0.1, duration - 1), time.monotonic()
        options = RunOptions(origin.with_name(f"unchanged-{number}"), bus="memory")
        made = branch(origin, Change(at_s), options, permit=INSTALLED)
        yield _Branch("", at_s, time.monotonic() - began, made.result.digest == digest)


def _without_a_frame(runs: int, rng: random.Random, origin: Path) -> Iterator[_Branch]:
    for number, copy in enumerate(heard(origin, runs, rng)):
        began = time.monotonic()
        found = named(origin, copy, origin.with_name(f"frame-{number}"))
        change = f"a frame of {copy.sender} at {copy.receiver}"
        yield _Branch(change, copy.ended / 1e6, time.monotonic() - began, found)
