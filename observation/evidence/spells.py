"""What each robot did for how long, by ground truth and by what it said of its places alone."""

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import in_seconds
from observation.evidence.run_evidence import RunEvidence

Flags = NDArray[np.bool_]


class Doing(Enum):
    """What a robot does."""

    DRIVING = "driving"
    STANDING = "standing, nobody near"
    MEETING = "standing near another robot"
    DONE = "no places left"
    GONE = "not running"


@dataclass(frozen=True)
class SpellParameters:
    """When a robot counts as standing; own choices."""

    window_s: float = 4.0
    """It is looked at over so long: as long as one of the chapter stands before it is blocked ..."""
    still: float = 0.1
    """... and comes less far than this, m; it may turn on the spot meanwhile."""
    near: float = 1.5
    """Another robot is near within this distance, centre to centre, m: as far as the chapter's driver looks
    (sim_time * speed) and as its robots adopt."""
    shortest_s: float = 1.0
    """What lasts less long goes with what was before."""


class Spell(NamedTuple):
    """A while in which one robot did one thing."""

    robot: str
    doing: Doing
    begin: float
    """Simulated s."""
    end: float
    x: float
    """Where it was in the middle of it, m."""
    y: float


def spells(run: RunEvidence, parameters: SpellParameters = SpellParameters()) -> list[Spell]:
    """Everything that every robot did, robot by robot in the order of time, without gaps."""
    found: list[Spell] = []
    for index, robot in enumerate(run.robots):
        doing = _settled(_doing(run, index, parameters), _samples(run, parameters.shortest_s))
        edges = [0, *(np.flatnonzero(np.diff(doing)) + 1).tolist(), len(doing)]
        for begin, end in pairwise(edges):
            x, y = run.true[(begin + end) // 2, index, :2].tolist()
            until = run.end if end == len(doing) else float(run.seconds[end])
            found.append(Spell(robot, list(Doing)[doing[begin]], float(run.seconds[begin]), until, x, y))
    return found


def _samples(run: RunEvidence, duration: float) -> int:
    return max(1, round(duration / in_seconds(run.setup.step_us)))


def _doing(run: RunEvidence, robot: int, p: SpellParameters) -> NDArray[np.int64]:
    """(steps,): the index in Doing."""
    here, order = run.true[:, robot], list(Doing)
    doing = np.full(len(here), order.index(Doing.DRIVING))
    stands = _stands(here[:, :2], _samples(run, p.window_s), p.still)
    apart = np.hypot(*np.moveaxis(run.true[..., :2] - here[:, None, :2], -1, 0))
    apart[:, robot] = np.inf
    near = apart.min(axis=1, initial=np.inf) < p.near
    doing[stands] = order.index(Doing.STANDING)
    doing[stands & near] = order.index(Doing.MEETING)
    doing[run.left[:, robot] == 0] = order.index(Doing.DONE)
    doing[~run.powered[:, robot]] = order.index(Doing.GONE)
    return doing


def _stands(track: NDArray[np.float64], window: int, still: float) -> Flags:
    """(steps,): whether it came nowhere in some window around."""
    stands: Flags = np.zeros(len(track), np.bool_)
    if len(track) <= window:
        return stands
    nowhere = np.hypot(*(track[window:] - track[:-window]).T) < still
    for offset in range(window + 1):
        stands[offset : len(nowhere) + offset] |= nowhere
    return stands


def _settled(doing: NDArray[np.int64], shortest: int) -> NDArray[np.int64]:
    """The same with what lasts less than `shortest` samples taken for what was before."""
    settled = doing.copy()
    edges = [0, *(np.flatnonzero(np.diff(doing)) + 1).tolist(), len(doing)]
    for begin, end in pairwise(edges[1:]):
        if end - begin < shortest:
            settled[begin:end] = settled[begin - 1]
    return settled
