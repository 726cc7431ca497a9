"""A node: the components and ensembles of one machine, without clock, socket or thread.

`advance(until, inputs)` takes in what the link has received, does what is planned before `until` in the order
of its instants, and gives what the link is to send.
"""

import heapq
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

from deeco.component import Fact, OnChange, has_fact
from deeco.ensemble import Binding
from deeco.errors import DeploymentError, ExecutionError
from deeco.instant import START, Duration, Instant, Task, in_seconds
from deeco.knowledge import Knowledge, made, roles_of, roles_under
from deeco.link import Reception, Transmission
from deeco.local import BoundProcess, Commit, LocalComponent, Pairing, Witness
from deeco.network import Network, NetworkParameters, News, Replica, Replicas
from deeco.schema import RoleBook
from deeco.statistics import Statistics

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


class Onlooker(Protocol):
    """Who is told; what it is given are values, and it must change nothing."""

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """A component begins with this knowledge; also if its node is made anew."""

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """A component has other knowledge now. `replica`: of the peer that an ensemble used; None for a
        process, and for a peer on the same node."""

    def heard(self, component: str, replica: Replica, now: Instant) -> None:
        """From `now` on the node of this component has a newer replica of another one."""


_PRESENT: Final[ContextVar[Onlooker | None]] = ContextVar("onlooker", default=None)


def onlooker() -> Onlooker | None:
    """Who looks on at nodes that are made now; None, as in every run: nobody."""
    return _PRESENT.get()


class looking_on:  # noqa: N801  # a context manager is named as a function
    """Let nodes that are made meanwhile, in this thread, report to `who` what they do."""

    __slots__ = ("_token", "_who")

    def __init__(self, who: Onlooker) -> None:
        self._who = who

    def __enter__(self) -> None:
        self._token = _PRESENT.set(self._who)

    def __exit__(self, *_: object) -> None:
        _PRESENT.reset(self._token)


CASCADE_LIMIT: Final = 16
"""So often may processes trigger one another at one instant before the node takes it for a circle."""
_NONE: Final = Duration(0)
_ENSEMBLES: Final = 1 << 20
"""Order of ensembles within an instant: after the processes, and among them as deployed."""
_PUBLICATION: Final = 1 << 40


class Node:
    """Runs components; see the module's first lines."""

    def __init__(
        self,
        components: Sequence[Knowledge],
        ensembles: Sequence[object] = (),
        *,
        ports: Mapping[Any, object] | None = None,
        parameters: NetworkParameters | None = None,
        address: int = 0,
        epoch: int = 0,
        start: Instant = START,
        publish_phase: Duration = _NONE,
        witness: Witness | None = None,
        former: "Node | None" = None,
    ) -> None:
        """Deploy everything.

        `ports` gives, by type, what processes and ensembles may ask for. `address` is the node's on the link;
        `epoch` grows with each restart of the machine; `publish_phase` is when, after `start`, it publishes
        first; `witness` is told of every change of knowledge; `former` is the machine's node so far, where
        this one goes on counting. Raises DeploymentError if a port is missing or a component cannot be run.
        """
        parameters = parameters or NetworkParameters()
        self._statistics: Statistics = Statistics() if former is None else former._statistics
        self._counters = self._statistics.counters
        self._now = start
        self._agenda = Agenda()
        binding = Binding(ports or {})
        self._onlooker = onlooker()
        witnesses = (*([witness] if witness else ()), *([self._tell] if self._onlooker else ()))
        self._locals = tuple(LocalComponent(value, binding, witnesses) for value in components)
        self._by_id = {one.id: one for one in self._locals}
        if len(self._by_id) < len(self._locals):
            raise DeploymentError("two components of a node have the same id; each should have its own")
        self._pairings = tuple(Pairing(one, binding, self._statistics) for one in ensembles)
        self._reacting = tuple(one for one in self._pairings if one.type.on_change)
        self._network: Network = Network(
            parameters,
            RoleBook(self._roles(), parameters.link),
            own=frozenset(self._by_id),
            plan=self._agenda.once,
            passes=self._passes,
            address=address,
            epoch=epoch,
            statistics=self._statistics,
            former=None if former is None else former._network,
        )
        self._plan_components(start)
        self._plan_ensembles(start)
        first = Instant(start + publish_phase)
        self._agenda.repeat(self._publish, first, parameters.publish_every, _PUBLICATION)
        if self._onlooker is not None:
            for value in components:
                self._onlooker.deployed(value, start)

    @property
    def now(self) -> Instant:
        """Everything planned before it has been done."""
        return self._now

    @property
    def replicas(self) -> Replicas:
        """What is known of other nodes' components, in the order of their ids."""
        return self._network.replicas

    def knowledge(self, component: str) -> Knowledge:
        """The present knowledge of a component of this node."""
        return self._by_id[component].value

    def outcome(self) -> dict[str, dict[Any, int]]:
        """Return all counts (`Statistics.outcome`), with those of the network."""
        outcome = self._statistics.outcome()
        outcome["counters"] |= self._network.counters()
        return outcome

    def advance(self, until: Instant, inputs: Sequence[Reception] = ()) -> list[Transmission]:
        """Take in `inputs`, then do what is planned before `until`.

        What the link heard before `now` is known from `now` on. An exception of a user's process or ensemble
        is passed on with a note that says where.
        """
        self._network.replicas.forget(self._now)
        for reception in inputs:
            for news in self._network.take(reception):
                self._react(news)
        self._agenda.run(until)
        self._now = until
        return self._network.transmissions()

    def skip(self, to: Instant) -> None:
        """Do nothing of what is planned before `to`: the machine stood still. Rhythms are kept."""
        self._counters.skipped += self._agenda.skip(to)
        self._network.clear()
        self._now = to

    def _plan_components(self, start: Instant) -> None:
        for component in self._locals:
            for process in component.processes:
                schedule = process.schedule
                if isinstance(schedule, OnChange):
                    component.watch(schedule.facts, partial(self._trigger, process))
                    continue
                task, first = partial(self._activate, component, process), Instant(start + schedule.offset)
                self._agenda.repeat(task, first, schedule.every, schedule.order)

    def _plan_ensembles(self, start: Instant) -> None:
        for pairing in self._pairings:
            kind = pairing.type
            if kind.every is not None:
                first = Instant(start + kind.offset)
                self._agenda.repeat(partial(self._evaluate, pairing), first, kind.every, _ENSEMBLES)
            triggered = partial(self._trigger_ensemble, pairing)
            for component in self._locals:
                facts = [fact for fact in kind.on_change if has_fact(type(component.value), fact)]
                component.watch(facts, triggered)

    def _activate(self, component: LocalComponent, process: BoundProcess, now: Instant) -> None:
        self._now = now
        self._counters.activations += 1
        if process.run(now):
            self._counters.commits += 1
            if component.watched:
                self._settle()

    def _trigger(self, process: BoundProcess) -> str:
        self._counters.activations += 1
        self._counters.commits += process.run(self._now)
        return process.name

    def _evaluate(self, pairing: Pairing, now: Instant) -> None:
        self._now = now
        learnt = pairing.evaluate(self._locals, self._young(pairing), now)
        if any(component.watched for component in learnt):
            self._settle()

    def _trigger_ensemble(self, pairing: Pairing) -> str:
        pairing.evaluate(self._locals, self._young(pairing), self._now)
        return pairing.type.name

    def _young(self, pairing: Pairing) -> list[Replica]:
        oldest = pairing.type.max_age
        return [one for one in self._network.replicas if oldest is None or self._now - one.heard <= oldest]

    def _settle(self) -> None:
        """Run what changes of facts trigger, until nothing changes any more."""
        ran: list[str] = []
        rounds = 0
        while due := dict.fromkeys(then for component in self._locals for then in component.changes()):
            if rounds == CASCADE_LIMIT:
                raise ExecutionError(
                    f"at {in_seconds(self._now):g} s processes keep triggering each other: {_circle(ran)}"
                )
            ran += [then() for then in due]
            rounds += 1

    def _publish(self, now: Instant) -> None:
        self._now = now
        self._network.publish(now, [component.value for component in self._locals])

    def _tell(self, commit: Commit) -> None:
        assert self._onlooker is not None
        self._onlooker.committed(commit, self._network.replicas.get(commit.peer))

    def _react(self, news: News) -> None:
        """Evaluate the ensembles that watch a fact which differs now."""
        if self._onlooker is not None:
            for component in self._locals:
                self._onlooker.heard(component.id, news.after, self._now)
        for pairing in self._reacting:
            if any(_differs(news, fact) for fact in pairing.type.on_change):
                self._evaluate(pairing, self._now)

    def _roles(self) -> tuple[type[Knowledge], ...]:
        wanted = [kind for one in self._locals for kind in roles_of(type(one.value))]
        wanted += [kind for pairing in self._pairings for kind in pairing.type.roles]
        known = {(kind.__module__, kind.__qualname__): kind for one in wanted for kind in roles_under(one)}
        return tuple(known.values())

    def _passes(self, sender: Replica) -> bool:
        """One ensemble without a boundary, or whose boundary holds, is enough; so is to have no ensemble."""
        for pairing in self._pairings:
            if pairing.lets_pass(sender, self._locals):
                return True
        return not self._pairings


def _differs(news: News, fact: Fact) -> bool:
    return news.before is None or _value(news.before, fact) != _value(news.after, fact)


def _value(replica: Replica, fact: Fact) -> object:
    for one in replica.roles:
        if has_fact(type(one), fact):
            return getattr(one, fact.__name__)()
    return None


def _circle(ran: Sequence[str]) -> str:
    """The last stretch that begins and ends with the same name."""
    last = ran[-1]
    begin = max((index for index, name in enumerate(ran[:-1]) if name == last), default=0)
    return " → ".join(ran[begin:])
