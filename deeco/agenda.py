"""What is to be done when: tasks in the order of their instants, periodic ones without drift."""

import heapq
from collections.abc import Callable
from typing import Final, NamedTuple

from deeco.errors import ExecutionError
from deeco.instant import Duration, Instant, in_seconds
from deeco.replacing import made

Task = Callable[[Instant], None]
"""Called with the instant for which it was planned."""
_ONCE: Final = 1 << 40
"""Serial numbers of tasks that are done once: after all periodic ones of the same instant and order."""


class _Entry(NamedTuple):
    task: Task
    every: Duration | None


class Agenda:
    """A heap of (instant, order, serial): at one instant the lower order goes first, then who came first.

    Planning raises ExecutionError once too much is planned.
    """

    def __init__(self, most: int = 100_000) -> None:
        """`most`: tasks that may be planned at once; more are a mistake that feeds itself."""
        self._most = most
        self._heap: list[tuple[Instant, int, int, _Entry]] = []
        self._added = 0

    def repeat(self, task: Task, first: Instant, every: Duration, order: int = 0) -> None:
        """Do the task at `first` and every `every` after it."""
        self._make_room()
        heapq.heappush(self._heap, (first, order, self._added, _Entry(task, every)))

    def once(self, task: Task, at: Instant, order: int = 0) -> None:
        """Do the task at one instant."""
        self._make_room()
        heapq.heappush(self._heap, (at, order, _ONCE + self._added, made(_Entry, (task, None))))

    def _make_room(self) -> None:
        if len(self._heap) >= self._most:
            raise ExecutionError(
                f"{self._most} tasks are planned already, the next at {in_seconds(self._heap[0][0]):g} s; "
                "no more can be until some are done"
            )
        self._added += 1

    def run(self, until: Instant) -> None:
        """Do what is planned before `until`, also what is planned meanwhile."""
        heap = self._heap
        while heap and heap[0][0] < until:
            at, order, serial, entry = heap[0]
            if entry.every is None:
                heapq.heappop(heap)
            else:
                heapq.heapreplace(heap, (Instant(at + entry.every), order, serial, entry))
            entry.task(at)

    def skip(self, to: Instant) -> int:
        """Leave out what is planned before `to`, and keep the rhythm; how many tasks that were."""
        left_out, kept = 0, []
        for at, order, serial, entry in self._heap:
            if at >= to:
                kept.append((at, order, serial, entry))
            elif entry.every is None:
                left_out += 1
            else:
                missed = -((at - to) // entry.every)
                left_out += missed
                kept.append((Instant(at + missed * entry.every), order, serial, entry))
        heapq.heapify(kept)
        self._heap = kept
        return left_out
