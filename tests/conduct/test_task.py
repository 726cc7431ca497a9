"""The seam of the task: another one can be brought to the world, and nothing else need know of it."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.instant import Instant
from actors.orders import Give, Restart
from actors.runtime.errors import AcrcError
from actors.task.task import TaskProgress
from actors.task.words import TaskWords
from tests.conduct.theatre import Theatre


class Parting:
    """Robots are to get so far from one another."""

    def __init__(self, distance: float, refused: str | None = None) -> None:
        self._distance, self._refused = distance, refused
        self._parted: int | None = None
        self.words: list[str] = []
        self.restarted: list[str] = []
        self.given: list[tuple[object, ...]] = []

    @property
    def settled(self) -> bool:
        return self._parted is not None

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        (ax, ay), (bx, by) = positions.tolist()
        if self._parted is None and (ax - bx) ** 2 + (ay - by) ** 2 >= self._distance**2:
            self._parted = instant

    def take(self, robot: str, words: TaskWords) -> str | None:
        self.words.append(robot)
        return self._refused if robot == "r2" else None

    def restart(self, robot: str) -> None:
        self.restarted.append(robot)

    def give(self, instant: Instant, robot: str, places: Sequence[tuple[float, float]]) -> None:
        self.given.append((robot, *places))

    def progress(self, present: Collection[str]) -> TaskProgress:
        return TaskProgress(0, 1) if self.settled else TaskProgress(len(present), 0)

    def outcome(self, present: Collection[str]) -> Mapping[str, object]:
        return {"parted_at": self._parted}


def test_a_run_ends_once_another_task_is_settled_and_tells_its_outcome() -> None:
    task = Parting(distance=0.5)
    play = Theatre(20.0, task=task).run()
    assert play.core.finished and play.core.step == 0, "who is far enough apart has nothing to do"
    assert play.core.task_outcome == {"parted_at": 0}
    assert (play.progress[-1].places_left, play.progress[-1].reports) == (0, 1)
    assert task.words == []


def test_without_an_end_of_its_task_a_run_goes_on_to_its_limit_and_every_robot_is_heard_every_step() -> None:
    task = Parting(distance=1000.0)
    play = Theatre(1.0, task=task).run()
    assert int(play.core.instant) == 1_000_000 and play.core.task_outcome == {"parted_at": None}
    assert task.words == ["r1", "r2"] * play.core.step


def test_what_a_task_cannot_believe_ends_the_run_with_its_words() -> None:
    with pytest.raises(AcrcError) as caught:
        Theatre(1.0, task=Parting(1000.0, "says that it is a fish")).run()
    assert str(caught.value) == "step 0 (0 s): r2 says that it is a fish"


def test_a_task_is_told_of_restarts_and_of_what_robots_are_given() -> None:
    task = Parting(distance=1000.0)
    Theatre(1.0, [(0.5, Restart("r2")), (0.6, Give("r1", ((15.5, 12.5),)))], task=task).run()
    assert (task.restarted, task.given) == (["r2"], [("r1", (15.5, 12.5))])
