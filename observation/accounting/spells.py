"""What each robot did from when to when: the causes of the accounting, one after the other, for pictures."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from observation.accounting.account import judge
from observation.accounting.classify import CAUSES
from observation.accounting.time_spent import Cause
from observation.evidence.run_evidence import RunEvidence


class Spell(NamedTuple):
    """A while that went into one thing for one robot."""

    robot: str
    cause: Cause
    begin: float
    """Simulated s."""
    end: float
    x: float
    """Where it was in the middle of it, m."""
    y: float


def spells(run: RunEvidence) -> list[Spell]:
    """Everything that every robot's time went into, robot by robot in the order of time, without gaps.

    Raises RecordingError or OutcomeError if the run is damaged.
    """
    causes = judge(run).causes.causes
    found: list[Spell] = []
    for index, robot in enumerate(run.robots):
        own = causes[:, index]
        edges = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(own)]
        for begin, end in pairwise(edges):
            x, y = run.true[(begin + end) // 2, index, :2].tolist()
            until = run.end if end == len(own) else float(run.seconds[end])
            found.append(Spell(robot, CAUSES[own[begin]], float(run.seconds[begin]), until, x, y))
    return found
