"""Branches of one run in which a robot does not receive one frame: whether that frame differs first."""

import random
from pathlib import Path
from typing import NamedTuple

from actors.instant import in_seconds, milliseconds
from actors.messages import RECEIVED
from actors.orders import Lose
from actors.robot.behaviour.foreign import INSTALLED
from deploy.branches.branching import branch
from deploy.branches.change import Change, Event
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
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
    order = Event(Lose(copy.receiver, copy.sender), at_s, f"lose {copy.receiver} {copy.sender}")
    change, options = Change(at_s, events=(order,)), RunOptions(out, bus="memory")
    parted = branch(origin, change, options, permit=INSTALLED).divergence
    if parted is None:
        return False
    there = (parted.step, parted.key) == (copy.step + 1, RECEIVED.key(copy.receiver))
    return there and f"instant={copy.ended}" in parted.words
