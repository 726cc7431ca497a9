"""What the robot hears of where the others are, as the radio would bring it: late, and about right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.geometry import Point
from benchmarks.localisation.course import STEP_US


@dataclass(frozen=True)
class ReportParameters:
    """How peers tell their positions; own choices for a beacon of an IEEE 802.15.4 swarm."""

    every: int = 10
    """Steps from one report of a peer to its next: 1 s. The peers take turns."""
    delay: int = 2
    """Steps from where a peer was to when its report is used: 0.2 s."""
    spread: float = 0.10
    """Standard deviation of a reported coordinate, m: how well a peer localises itself."""
    kept: int = 30
    """A report older than so many steps, 3 s, is forgotten."""


Known = Sequence[tuple[Point, ...] | None]
"""Per step of a course: all positions now known, or None where nothing has changed."""


def reports(
    peers: NDArray[np.float64], generator: Generator, parameters: ReportParameters = ReportParameters()
) -> Known:
    """What is known of `peers`, (steps, m, 2) m with NaN while away, at each step."""
    steps, count, _ = peers.shape
    noise = parameters.spread * generator.standard_normal((steps, count, 2))
    latest: list[tuple[int, Point] | None] = [None] * count
    known: list[tuple[Point, ...] | None] = []
    for step in range(steps):
        changed = False
        for i in range(count):
            told, sent = latest[i], step - parameters.delay
            turn = (sent - i * parameters.every // count) % parameters.every == 0
            if sent >= 0 and turn and not np.isnan(peers[sent, i, 0]):
                latest[i] = sent, Point(*(peers[sent, i] + noise[sent, i]).tolist())
            elif told is not None and step - told[0] > parameters.kept:
                latest[i] = None
            changed |= latest[i] is not told
        known.append(tuple(told[1] for told in latest if told is not None) if changed else None)
    return known


assert STEP_US == 100_000  # the steps above are counted in tenths of a second
