"""One process of a robot executed again, with all that an explanation is made of."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

from actors.instant import Instant
from actors.robot.behaviour.decision_log import Deciding
from actors.robot.core import RobotCore
from actors.runtime.core import Core
from actors.runtime.prints import nowhere
from deeco.knowledge import Knowledge
from deeco.onlooking import looking_on
from observation.evidence.knowledge_trace import KnowledgeTrace, Tracer
from observation.explanation.orders import GIVES_UP, Order, OrderWatch
from observation.replay.record_replay import Onlook, replay_actor


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


@dataclass(frozen=True)
class Retold:
    """What one process of a robot knew and did."""

    actor: str
    trace: KnowledgeTrace
    orders: tuple[Order, ...]
    followed: bool
    """False: what the behaviour told the robot could not be taken down."""
    ensembles: tuple[object, ...]
    decisions: tuple[Made, ...]
    """In the order in which they were made."""

    def before(self, number: int) -> Knowledge:
        """The knowledge that a change has changed."""
        return _before(self.trace, number)


def retell(out: Path, actor: str) -> Retold:
    """Execute a robot's process again, its strategy in this process; see `knowledge_trace`.

    Raises ReplayError if it does not do again what it did, RecordingError for a damaged recording.
    """
    tracer, watch = Tracer(), OrderWatch()

    def prepare(core: Core, step_us: int) -> None:
        tracer.prepare(core, step_us)
        watch.attach(cast(RobotCore, core))

    with looking_on(tracer):
        tracer.trace.report = replay_actor(out, actor, Onlook(prepare, prints=lambda step_us: nowhere()))
    orders, trace = tuple(watch.orders), tracer.trace
    made = sorted(
        [*_of_knowledge(trace), *_of_orders(orders, trace)], key=lambda one: (one.step, one.change is None)
    )
    return Retold(actor, trace, orders, watch.followed, watch.ensembles, tuple(made))


def _before(trace: KnowledgeTrace, number: int) -> Knowledge:
    one = trace.changes[number]
    for earlier in reversed(trace.changes[:number]):
        if earlier.component == one.component:
            return earlier.after
    begun = [own for own in trace.beginnings if own.knowledge.id == one.component and own.step <= one.step]
    return begun[-1].knowledge


def _of_knowledge(trace: KnowledgeTrace) -> Iterator[Made]:
    """Changes of which the component itself says that they are decisions."""
    for number, change in enumerate(trace.changes):
        if change.adaptation and isinstance(change.after, Deciding):
            before: Any = _before(trace, number)
            if words := change.after.decided_since(before):
                yield Made(change.step, change.instant, words, change.by, number, None)


def _of_orders(orders: tuple[Order, ...], trace: KnowledgeTrace) -> Iterator[Made]:
    """Orders but for those that say again what a change of knowledge of the same step says."""
    said = {change.step for change in trace.changes if change.adaptation}
    for number, order in enumerate(orders):
        if order.verb == GIVES_UP and order.step in said:
            continue
        yield Made(order.step, order.instant, order.words, "behaviour", None, number)
