"""The seam between a world and what its robots are to do: another model problem brings another of these."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.task.words import TaskWords


class TaskProgress(NamedTuple):
    """How far a task is, for people who watch the run."""

    left: int
    """What robots that take part still mean to do."""
    done: int
    """What robots have said to have done."""


class Task(Protocol):
    """What the robots of a run are to do, followed and judged from ground truth and from their own words.

    The world shows it every step's true positions and every word, in one order for all processors; it must be
    a function of these: no clock, no randomness. What it raises ends the run.
    """

    @property
    def settled(self) -> bool:
        """True once nothing is left to be done, which ends the run; never where nothing was asked."""

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Take in the robots' true positions, (n, 2) m, in the order of the set-up."""

    def take(self, robot: str, words: TaskWords) -> str | None:
        """Take in what a robot says in a step, whose form has been checked (`word_limits`).

        What cannot be true, such as a place that there is not, is told in words that follow the robot's name;
        None if nothing is.
        """

    def restart(self, robot: str) -> None:
        """Take in that a robot's process has begun anew, and knows of nothing but what it was given."""

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        """Take in that a robot is given further places, m, while the run goes on."""

    def progress(self, present: Collection[str]) -> TaskProgress:
        """How far it is; `present`: the robots that take part."""

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        """What it comes to, by subject, for the last record; `present`: the robots that take part."""
