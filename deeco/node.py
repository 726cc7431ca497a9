"""A node: components and ensembles of one machine, without clock, socket or thread.

`advance(until, inputs)` processes received frames, runs everything scheduled before `until` in order of time,
and returns the frames to send.
"""

import heapq
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

from deeco.component import ChangeTrigger
from deeco.ensemble import Binding, ensemble_type_of
from deeco.errors import DeploymentError, ExecutionError
from deeco.group_evaluation import BoundGroup
from deeco.history import histories, with_history
from deeco.instant import START, ZERO, Duration, Instant, Task, in_seconds
from deeco.knowledge import Fact, Knowledge, has_fact, new_tuple, role_subclasses, roles_of
from deeco.link import ReceivedFrame, Transmission
from deeco.local import NEVER, BoundEnsemble, BoundProcess, Commit, CommitListener, LocalComponent
from deeco.network import Network, NetworkParameters, Replica, Replicas
from deeco.schema import shared_registry
from deeco.statistics import Statistics

_ONCE: Final = 1 << 40
"""Serial numbers of one-time tasks start here: they follow periodic ones of equal instant and order."""


class _Entry(NamedTuple):
    task: Task
    every: Duration | None


class TaskQueue:
    """Scheduled tasks by (instant, order, serial number).

    Scheduling raises ExecutionError beyond the limit.
    """

    def __init__(self, most: int = 100_000) -> None:
        """Create an agenda for at most `most` tasks; more indicate unbounded scheduling."""
        self._most = most
        self._heap: list[tuple[Instant, int, int, _Entry]] = []
        self._added = 0

    def repeat(self, task: Task, first: Instant, every: Duration, order: int = 0) -> None:
        """Run the task at `first` and then every `every`."""
        self._make_room()
        heapq.heappush(self._heap, (first, order, self._added, _Entry(task, every)))

    def once(self, task: Task, at: Instant, order: int = 0) -> None:
        """Run the task once."""
        self._make_room()
        heapq.heappush(self._heap, (at, order, _ONCE + self._added, new_tuple(_Entry, (task, None))))

    def _make_room(self) -> None:
        if len(self._heap) >= self._most:
            raise ExecutionError(
                f"{self._most} tasks are scheduled, the next at {in_seconds(self._heap[0][0]):g} s; "
                "which is the limit; check for repeated scheduling"
            )
        self._added += 1

    def run(self, until: Instant) -> None:
        """Run tasks scheduled before `until`, including those scheduled meanwhile."""
        heap = self._heap
        while heap and heap[0][0] < until:
            at, order, serial, entry = heap[0]
            if entry.every is None:
                heapq.heappop(heap)
            else:
                heapq.heapreplace(heap, (Instant(at + entry.every), order, serial, entry))
            entry.task(at)

    def skip(self, to: Instant) -> int:
        """Drop tasks scheduled before `to` and return their number; periodic ones keep their phase."""
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


class NodeObserver(Protocol):
    """Receives events of nodes; arguments are values, and nothing may be changed."""

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """Receive a component's first knowledge, also when its node is rebuilt."""

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """Receive a change of knowledge.

        `replica`: the peer that an ensemble used; None for a process, and for a peer that is on the same node
        or no longer a replica.
        """

    def replica_received(self, component: str, replica: Replica, now: Instant) -> None:
        """Receive the news that a component's node has a newer replica since `now`."""


_CURRENT_OBSERVER: Final[ContextVar[NodeObserver | None]] = ContextVar("node_observer", default=None)


def node_observer() -> NodeObserver | None:
    """Return the observer of nodes created now; None (the default) for none."""
    return _CURRENT_OBSERVER.get()


class observing_nodes:  # noqa: N801  # a context manager, named like a function
    """Report the events of nodes created in this context, in this thread, to `observer`."""

    __slots__ = ("_observer", "_token")

    def __init__(self, observer: NodeObserver) -> None:
        self._observer = observer

    def __enter__(self) -> None:
        self._token = _CURRENT_OBSERVER.set(self._observer)

    def __exit__(self, *_: object) -> None:
        _CURRENT_OBSERVER.reset(self._token)


CASCADE_LIMIT: Final = 16
"""Maximum rounds of processes that trigger one another at one instant; more are reported as a cycle."""
_ENSEMBLES: Final = 1 << 20
"""Order of ensembles within an instant: after processes, in order of deployment."""
_PUBLICATION: Final = 1 << 40
_MODES: Final = -_PUBLICATION
"""Transitions due at an instant fire before its processes."""


class Node:
    """Runs components and ensembles; see the module."""

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
        publish_phase: Duration = ZERO,
        on_commit: CommitListener | None = None,
        previous: "Node | None" = None,
    ) -> None:
        """Deploy components and ensembles.

        `ports`: objects that processes and ensembles may use, by type. `address`: of the node on the link.
        `epoch`: number of restarts of the machine. `publish_phase`: delay of the first publication after
        `start`. `on_commit`: called for every change of knowledge. `previous`: node of this machine until
        now, whose counters and numbering continue. Raises DeploymentError if a port is missing or a component
        is invalid.
        """
        for name, several in (("components", components), ("ensembles", ensembles)):
            if not isinstance(several, Sequence):
                raise DeploymentError(f"{name} is {several!r}; must be a list, also of one")
        parameters = parameters or NetworkParameters()
        if type(epoch) is not int or epoch < 0:
            raise DeploymentError(f"epoch is {epoch!r}; must be an integer of at least 0")
        self._statistics: Statistics = Statistics() if previous is None else previous._statistics
        self._counters = self._statistics.counters
        self._now = start
        self._tasks = TaskQueue()
        binding = Binding(ports or {})
        self._observer = node_observer()
        listeners = (*([on_commit] if on_commit else ()), *([self._notify] if self._observer else ()))
        self._locals = tuple(LocalComponent(value, binding, listeners) for value in components)
        self._by_id = {one.id: one for one in self._locals}
        self._with_histories = tuple(one for one in self._locals if histories(type(one.value)))
        if len(self._by_id) < len(self._locals):
            ids = ", ".join(one.id for one in self._locals)
            raise DeploymentError(f"the components of a node are {ids}; ids must be unique")
        self._ensembles = tuple(
            (BoundGroup if ensemble_type_of(one).members else BoundEnsemble)(one, binding, self._statistics)
            for one in ensembles
        )
        self._change_ensembles = tuple(one for one in self._ensembles if one.type.on_change)
        self._network: Network = Network(
            parameters,
            shared_registry(self._roles(), parameters.link),
            own=frozenset(self._by_id),
            may_relay=self._may_relay,
            address=address,
            epoch=epoch,
            statistics=self._statistics,
            previous=None if previous is None else previous._network,
        )
        self._plan_components(start)
        self._plan_ensembles(start)
        self._with_modes = [one for one in self._locals if one.chart.transitions]
        self._timers = [NEVER]
        for component in self._with_modes:
            component.watch([component.chart.enabled], self._change_modes)
            self._tasks.once(self._evaluate_modes, start, _MODES)
        first = Instant(start + publish_phase)
        self._tasks.repeat(self._publish, first, parameters.publish_every, _PUBLICATION)
        if self._observer is not None:
            for value in components:
                self._observer.deployed(value, start)

    @property
    def now(self) -> Instant:
        """Current instant: everything scheduled before it has run."""
        return self._now

    @property
    def replicas(self) -> Replicas:
        """Replicas of other nodes' components, in order of id."""
        return self._network.replicas

    def knowledge(self, component: str) -> Knowledge:
        """Return the current knowledge of a component of this node. Raises DeploymentError for another id."""
        if component not in self._by_id:
            known = ", ".join(self._by_id)
            raise DeploymentError(f"this node has no component {component!r}; use one of {known}")
        return self._by_id[component].value

    def outcome(self) -> dict[str, dict[Any, int]]:
        """Return all counts (`Statistics.outcome`), including those of the reassembly."""
        outcome = self._statistics.outcome()
        outcome["counters"] |= self._network.counters()
        return outcome

    def advance(self, until: Instant, inputs: Sequence[ReceivedFrame] = ()) -> list[Transmission]:
        """Process `inputs`, then run everything scheduled before `until`; return the frames to send.

        Inputs received before `now` take effect at `now`. An exception of a user's process or ensemble
        propagates with a note of its origin.
        """
        self._network.replicas.drop_old(self._now)
        if inputs:
            self._network.take(inputs, self._process_update)
        self._tasks.run(until)
        self._now = until
        return self._network.transmissions(until)

    def skip(self, to: Instant) -> None:
        """Skip everything scheduled before `to`, as after a pause; schedules keep their phase."""
        self._counters.skipped += self._tasks.skip(to) + self._network.clear(to)
        if self._with_modes:
            self._tasks.once(self._evaluate_modes, to, _MODES)
        self._now = to

    def _plan_components(self, start: Instant) -> None:
        for component in self._locals:
            for process in component.processes:
                schedule = process.schedule
                if isinstance(schedule, ChangeTrigger):
                    component.watch(schedule.facts, partial(self._trigger, process))
                    continue
                task, first = partial(self._activate, component, process), Instant(start + schedule.offset)
                self._tasks.repeat(task, first, schedule.every, schedule.order)

    def _plan_ensembles(self, start: Instant) -> None:
        for ensemble in self._ensembles:
            kind = ensemble.type
            if kind.every is not None:
                first = Instant(start + kind.offset)
                self._tasks.repeat(partial(self._evaluate, ensemble), first, kind.every, _ENSEMBLES)
            callback = partial(self._trigger_ensemble, ensemble)
            for component in self._locals:
                facts = [fact for fact in kind.on_change if has_fact(type(component.value), fact)]
                component.watch(facts, callback)

    def _evaluate_modes(self, now: Instant) -> None:
        self._now = now
        self._change_modes()
        self._run_triggered()

    def _change_modes(self) -> str:
        """Fire due transitions, and plan the next evaluation unless an earlier one is planned."""
        at = min([one.change_mode(self._now) for one in self._with_modes])
        self._timers = [one for one in self._timers if one > self._now]
        if at < min(self._timers):
            self._timers.append(at)
            self._tasks.once(self._evaluate_modes, at, _MODES)
        return "mode transitions"

    def _activate(self, component: LocalComponent, process: BoundProcess, now: Instant) -> None:
        self._now = now
        self._counters.activations += 1
        if process.run(now):
            self._counters.commits += 1
            if component.watched:
                self._run_triggered()

    def _trigger(self, process: BoundProcess) -> str:
        self._counters.activations += 1
        self._counters.commits += process.run(self._now)
        return process.name

    def _evaluate(self, ensemble: BoundEnsemble, now: Instant) -> None:
        self._now = now
        changed = ensemble.evaluate(self._locals, self._fresh_replicas(ensemble), now)
        if any(component.watched for component in changed):
            self._run_triggered()

    def _trigger_ensemble(self, ensemble: BoundEnsemble) -> str:
        ensemble.evaluate(self._locals, self._fresh_replicas(ensemble), self._now)
        return ensemble.type.name

    def _fresh_replicas(self, ensemble: BoundEnsemble) -> list[Replica]:
        oldest = ensemble.type.max_age
        return [one for one in self._network.replicas if oldest is None or self._now - one.heard <= oldest]

    def _run_triggered(self) -> None:
        """Run processes and ensembles triggered by changed facts until no fact changes."""
        names: list[str] = []
        rounds = 0
        while callbacks := dict.fromkeys(
            callback for component in self._locals for callback in component.changes()
        ):
            if rounds == CASCADE_LIMIT:
                raise ExecutionError(
                    f"at {in_seconds(self._now):g} s processes keep triggering each other: {_cycle_of(names)}"
                )
            names += [callback() for callback in callbacks]
            rounds += 1

    def _publish(self, now: Instant) -> None:
        self._now = now
        if self._with_histories:
            self._add_to_histories(now)
        self._network.publish(now, [component.value for component in self._locals])

    def _add_to_histories(self, now: Instant) -> None:
        for component in self._with_histories:
            value = component.value
            component.commit(with_history(value, value, now), f"{type(value).__name__}.history", now)
        self._run_triggered()

    def _notify(self, commit: Commit) -> None:
        assert self._observer is not None
        self._observer.committed(commit, self._network.replicas.get(commit.peer))

    def _process_update(self, before: Replica | None, after: Replica) -> None:
        """Evaluate the ensembles whose watched facts changed."""
        if self._observer is not None:
            for component in self._locals:
                self._observer.replica_received(component.id, after, self._now)
        for ensemble in self._change_ensembles:
            if any(_differs(before, after, fact) for fact in ensemble.type.on_change):
                self._evaluate(ensemble, self._now)

    def _roles(self) -> tuple[type[Knowledge], ...]:
        kinds = [kind for one in self._locals for kind in roles_of(type(one.value))]
        kinds += [kind for ensemble in self._ensembles for kind in ensemble.type.roles]
        known = {(kind.__module__, kind.__qualname__): kind for one in kinds for kind in role_subclasses(one)}
        return tuple(known.values())

    def _may_relay(self, sender: Replica) -> bool:
        """Return whether any ensemble allows relaying, or there is no ensemble."""
        for ensemble in self._ensembles:
            if ensemble.allows_relay(sender, self._locals):
                return True
        return not self._ensembles


def _differs(before: Replica | None, after: Replica, fact: Fact) -> bool:
    return before is None or _value(before, fact) != _value(after, fact)


def _value(replica: Replica, fact: Fact) -> object:
    for one in replica.roles:
        if has_fact(type(one), fact):
            return getattr(one, fact.__name__)()
    return None


def _cycle_of(names: Sequence[str]) -> str:
    """Return the part since the previous occurrence of the last name, joined by arrows."""
    last = names[-1]
    begin = max((index for index, name in enumerate(names[:-1]) if name == last), default=0)
    return " → ".join(names[begin:])
