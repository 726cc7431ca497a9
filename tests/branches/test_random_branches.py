"""Branches at random instants: one without a change is the run, one without a frame differs by that frame."""

import random
from pathlib import Path
from typing import NamedTuple

import pytest

from actors.installation.repository import SHIPPED
from actors.instant import in_seconds, milliseconds
from actors.messages import RECEIVED
from actors.orders import Lose
from actors.robot.behaviour.foreign import INSTALLED
from deploy.branches.branching import branch
from deploy.branches.change import BranchEvent, Change
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.trace.frame_fates import frame_fates


class ReceivedFrame(NamedTuple):
    step: int
    """In which the frame ended."""
    sender: str
    receiver: str
    ended: int
    """µs."""


def received(origin: Path, count: int, rng: random.Random, step_us: int) -> list[ReceivedFrame]:
    """Random frames of the run, each the first of its sender that its receiver received in that step."""
    found: dict[tuple[int, str, str], ReceivedFrame] = {}
    for frame in frame_fates(origin):
        for copy in frame.copies:
            if copy.fate == "heard":
                key = (frame.ended // step_us, frame.robot, copy.robot)
                found.setdefault(key, ReceivedFrame(*key, frame.ended))
    last = max(found)[0]
    usable = [frame for key, frame in sorted(found.items()) if 0 < key[0] < last]
    return rng.sample(usable, min(count, len(usable)))


@pytest.mark.claim("branches")
@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_random_branches(full: bool, tmp_path: Path) -> None:
    count, duration = (20, 60.0) if full else (2, 10.0)
    rng, origin = random.Random(1), tmp_path / "origin"
    scenario = load_scenario(SHIPPED / "scenarios" / "chapter.toml", Overrides(seed=1, duration=duration))
    plan = swarm.plan(scenario, RunOptions(origin, bus="memory"))
    digest = swarm.run_in_memory(plan, lambda progress: None).digest
    for number in range(count):
        options = RunOptions(tmp_path / f"unchanged-{number}", bus="memory")
        made = branch(origin, Change(rng.uniform(0.1, duration - 1)), options, permit=INSTALLED)
        assert made.result.digest == digest
    step_us = milliseconds(scenario.run.step_ms)
    for number, frame in enumerate(received(origin, count, rng, step_us)):
        at_s = in_seconds(frame.step * step_us)
        order = BranchEvent(Lose(frame.receiver, frame.sender), at_s, f"lose {frame.receiver} {frame.sender}")
        options = RunOptions(tmp_path / f"frame-{number}", bus="memory")
        parted = branch(origin, Change(at_s, events=(order,)), options, permit=INSTALLED).divergence
        assert parted is not None
        assert (parted.step, parted.key) == (frame.step + 1, RECEIVED.key(frame.receiver))
        assert f"instant={frame.ended}" in parted.words
