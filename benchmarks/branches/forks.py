"""Branches of one run at random instants: each is the run itself, or, without one frame, names that frame."""

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import SHIPPED
from actors.instant import in_seconds, milliseconds
from actors.messages import RECEIVED
from actors.orders import Lose
from actors.robot.behaviour.foreign import INSTALLED
from benchmarks.statistics.measured import Measured, table_of
from benchmarks.statistics.runs import in_memory
from deploy.branches.branching import branch
from deploy.branches.change import BranchEvent, Change
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.trace.frame_fates import frame_fates


class Copy(NamedTuple):
    """A frame as one robot heard it."""

    step: int
    """In which it ended."""
    sender: str
    receiver: str
    ended: int
    """µs; the receiver's process is told so."""


def heard(origin: Path, number: int, rng: random.Random) -> list[Copy]:
    """Frames of the run at random, each the first of its sender that its receiver heard in that step."""
    step_us = milliseconds(load_scenario(origin / "scenario.toml").run.step_ms)
    copies: dict[tuple[int, str, str], Copy] = {}
    for frame in frame_fates(origin):
        for one in frame.copies:
            if one.fate == "heard":
                key = (frame.ended // step_us, frame.robot, one.robot)
                copies.setdefault(key, Copy(*key, frame.ended))
    last = max(copies)[0]
    usable = [copy for key, copy in sorted(copies.items()) if 0 < key[0] < last]
    return rng.sample(usable, min(number, len(usable)))


def named(origin: Path, copy: Copy, out: Path) -> bool:
    """Whether a branch without that copy says that, first of all, its receiver is not told of it."""
    at_s = in_seconds(copy.step * milliseconds(load_scenario(origin / "scenario.toml").run.step_ms))
    order = BranchEvent(Lose(copy.receiver, copy.sender), at_s, f"lose {copy.receiver} {copy.sender}")
    change, options = Change(at_s, events=(order,)), RunOptions(out, bus="memory")
    parted = branch(origin, change, options, permit=INSTALLED).divergence
    if parted is None:
        return False
    there = (parted.step, parted.key) == (copy.step + 1, RECEIVED.key(copy.receiver))
    return there and f"instant={copy.ended}" in parted.words


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
    with in_memory(load_scenario(_SCENARIO, Overrides(seed=seed, duration=duration))) as (plan, result):
        same = list(_unchanged(runs, duration, rng, plan.out, result.digest))
        lacking = list(_without_a_frame(runs, rng, plan.out))
    right, told = sum(one.right for one in same), sum(one.right for one in lacking)
    title = (
        f"{right} of {len(same)} unchanged have the run's digest {result.digest}; "
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
