"""Where all robots truly were, second by second, in a form that is quick to compare."""

import hashlib
import struct
from pathlib import Path
from typing import Final

from actors.messages import TRUTH
from observation.evidence.recorded import taken
from observation.replay.run_recordings import recordings

DIGITS: Final = 8
"""Hexadecimal digits of each second: two states look alike once in 4 000 million."""


def trace(out: Path) -> str:
    """DIGITS for each whole simulated second of the run in the folder `out`, from 0 on.

    Raises RecordingError for a damaged one.
    """
    seconds: list[str] = []
    for _, truth in taken(recordings(out)["radio"], TRUTH):
        if truth.halt or truth.instant < len(seconds) * 1_000_000:
            continue
        poses = [value for robot in truth.robots for value in (robot.x, robot.y, robot.heading)]
        state = struct.pack(f"<{len(poses)}d", *poses)
        seconds.append(hashlib.blake2b(state, digest_size=DIGITS // 2).hexdigest())
    return "".join(seconds)


def coincide_s(one: str, other: str) -> int:
    """How many whole seconds two traces have in common from the beginning on."""
    pairs = zip(_by_second(one), _by_second(other), strict=False)
    for number, (mine, theirs) in enumerate(pairs):
        if mine != theirs:
            return number
    return min(len(one), len(other)) // DIGITS


def _by_second(trace: str) -> list[str]:
    return [trace[at_ : at_ + DIGITS] for at_ in range(0, len(trace), DIGITS)]
