"""The decisions of one process of a robot, from its trace."""

from collections.abc import Iterator
from typing import NamedTuple

from actors.instant import Instant
from observation.trace.orders import GIVES_UP
from observation.trace.rows import Trace


class Made(NamedTuple):
    """A decision."""

    step: int
    instant: Instant
    words: str
    by: str
    """The process or the exchange that changed the knowledge; "behaviour" for what it told the robot."""
    change: int | None
    """Its number among the changes of knowledge ..."""
    order: int | None
    """... or among the orders."""


def decisions(trace: Trace) -> list[Made]:
    """In the order in which they were made."""
    made = [*_of_knowledge(trace), *_of_orders(trace)]
    return sorted(made, key=lambda one: (one.step, one.change is None))


def _of_knowledge(trace: Trace) -> Iterator[Made]:
    """Changes of which the component itself says that they are decisions."""
    for number, change in enumerate(trace.changes):
        if change.decision is not None:
            yield Made(change.step, change.instant, change.decision.words, change.by, number, None)


def _of_orders(trace: Trace) -> Iterator[Made]:
    """Orders but for those that say again what a change of knowledge of the same step says."""
    said = {change.step for change in trace.changes if change.adaptation}
    for number, order in enumerate(trace.orders):
        if order.verb != GIVES_UP or order.step not in said:
            yield Made(order.step, order.instant, order.words, "behaviour", None, number)
