"""Components of a node with their knowledge, processes and watched facts; evaluation of ensembles."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

from deeco.component import Process, processes_of
from deeco.ensemble import (
    COORDINATOR,
    MEMBER,
    Binding,
    BoundFunction,
    Contact,
    EndReason,
    EnsembleType,
    Exchange,
    ensemble_type_of,
)
from deeco.errors import DeploymentError, ExecutionError
from deeco.instant import Instant, in_seconds
from deeco.knowledge import Fact, Knowledge, has_fact, is_component, is_role, new_tuple, replace, role_view
from deeco.modes import MODE, Transition, chart_of
from deeco.pair_search import PairSearch
from deeco.statistics import Statistics

NEVER: Final = Instant(1 << 62)


class Commit(NamedTuple):
    """One change of a component's knowledge."""

    by: str
    """Process or exchange, such as `Cleaner.sense`, `Adoption.at_member` or `Adoption.at_member_end`; a
    publication, `Cleaner.history`; or a transition, by its guard `Cleaner.is_low` or `Cleaner.transition`."""
    instant: Instant
    before: Knowledge
    after: Knowledge
    adaptation: bool
    """True for an ensemble, a transition and a process of the adaptation layer."""
    peer: str = ""
    """Component whose knowledge an ensemble used; empty for a process."""
    heard: Instant | None = None
    """Instant at which that knowledge was received; None for a process."""


CommitListener = Callable[[Commit], None]


class BoundProcess:
    """A process of one component with its bound ports."""

    def __init__(self, process: Process, component: "LocalComponent", binding: Binding) -> None:
        self.name = str(process)
        self.schedule = process.schedule
        self._adaptation = process.adaptation
        self._component = component
        function = getattr(type(component.value), process.name)
        self._bound = binding.process(function, process.ports, self.name)

    def run(self, now: Instant) -> bool:
        """Run the process if it is active and commit its result; return whether the knowledge changed."""
        component, bound = self._component, self._bound
        modes = self.schedule.modes
        if modes and getattr(component.value, MODE) not in modes:
            return False
        for place in bound.now:
            bound.arguments[place] = now
        try:
            result = bound.function(component.value, *bound.arguments)
        except Exception as error:
            error.add_note(f"in process {self.name} of {component.id!r} at {in_seconds(now):g} s")
            raise
        if result is component.value:
            return False
        return component.commit(result, self.name, now, adaptation=self._adaptation)


class LocalComponent:
    """Knowledge of one component; `commit` applies every change and notifies the listeners."""

    def __init__(
        self, value: Knowledge, binding: Binding, listeners: tuple[CommitListener, ...] = ()
    ) -> None:
        kind = type(value)
        if isinstance(value, type):
            raise DeploymentError(f"{value.__name__} is a class; use an instance, {value.__name__}(id=...)")
        if not is_component(kind):
            raise DeploymentError(f"{kind.__name__} cannot be deployed: decorate its class with @component")
        if not isinstance(value.id, str) or not value.id:
            raise DeploymentError(f"{kind.__name__}.id is {value.id!r}; must be a str that is not empty")
        self.id = value.id
        self.value = value
        self.processes = tuple(BoundProcess(process, self, binding) for process in processes_of(kind))
        self._listeners = listeners
        self.chart = chart_of(kind)
        self._mode = getattr(value, MODE, None)
        self._deadlines: dict[Transition, Instant] = {}
        """Instants at which the enabled transitions fire, in order of priority."""
        self.watched: list[tuple[Fact, Callable[[], str]]] = []
        """Watched facts, each with its callback."""
        self._facts: list[object] = []
        self._role_views: dict[type[Knowledge], tuple[Knowledge, Knowledge]] = {}

    def watch(self, facts: Sequence[Fact], callback: Callable[[], str]) -> None:
        """Register `callback` for `changes` if the value of one of the facts changes.

        A fact may be any function of the knowledge; for a method, its override counts.
        """
        for fact in facts:
            kind = type(self.value)
            function = getattr(kind, fact.__name__) if has_fact(kind, fact) else fact
            self.watched.append((function, callback))
            self._facts.append(function(self.value))

    def changes(self) -> list[Callable[[], str]]:
        """Return the callbacks of facts that changed since the last call, each once, in order."""
        callbacks: dict[Callable[[], str], None] = {}
        for index, (function, callback) in enumerate(self.watched):
            fact = function(self.value)
            if fact != self._facts[index]:
                self._facts[index] = fact
                callbacks[callback] = None
        return list(callbacks)

    def change_mode(self, now: Instant) -> Instant:
        """Change the mode if a transition is due; otherwise return when the next one will be."""
        value = self.value
        self._deadlines = {
            one: self._deadlines.get(one) or one.deadline(value, now) for one in self.chart.enabled(value)
        }
        for one, deadline in self._deadlines.items():
            if deadline <= now:
                self._mode = one.target
                by = f"{type(value).__name__}.{one.when.__name__ if one.when else 'transition'}"
                result = replace(value, **{MODE: one.target})  # type: ignore[arg-type]  # not the id
                self.commit(result, by, now, adaptation=True)
                return NEVER
        return min(self._deadlines.values(), default=NEVER)

    def commit(
        self,
        result: Any,
        by: str,
        now: Instant,
        *,
        adaptation: bool = False,
        peer: str = "",
        heard: Instant | None = None,
    ) -> bool:
        """Commit new knowledge; return whether it differs. Raises ExecutionError for an invalid value."""
        value = self.value
        if type(result) is not type(value):
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s returned a {type(result).__name__}; "
                f"return the next {type(value).__name__}"
            )
        if result == value:
            return False
        if result.id != self.id:
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s changed the id to {result.id!r}; keep the id"
            )
        if self.chart.transitions and getattr(result, MODE) is not self._mode:
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s changed the mode; only transitions may do so"
            )
        self.value = result
        if self._listeners:
            commit = new_tuple(Commit, (by, now, value, result, adaptation, peer, heard))
            for on_commit in self._listeners:
                on_commit(commit)
        return True

    def role(self, kind: type[Knowledge]) -> Any:
        """Return the role visible to peers on the same node; None if the component does not play it."""
        if not is_role(kind) or not isinstance(self.value, kind):
            return None
        view = self._role_views.get(kind)
        if view is None or view[0] is not self.value:
            view = self._role_views[kind] = (self.value, role_view(self.value, kind))
        return view[1]

    def contact(self, now: Instant) -> Contact:
        """Return the contact between components of one node: now, without hops."""
        return Contact(now, None, 0)


class Peer(Protocol):
    """Another component, local or a replica."""

    @property
    def id(self) -> str:
        """The component's id."""

    def role(self, kind: type[Knowledge]) -> Any:
        """Return its knowledge in a role; None if it does not play it."""

    def contact(self, now: Instant) -> Contact:
        """Return how that knowledge was received."""


class _BoundExchange:
    """An exchange or an end of a membership, with its bound ports."""

    def __init__(self, exchange: Exchange, call: BoundFunction, name: str) -> None:
        self.own, self.peer = exchange.own, exchange.peer
        self.local_is_coordinator = exchange.side == COORDINATOR
        self.call = call
        self.name = name


class _EnsembleSide:
    """One side of an ensemble, played by the local component."""

    def __init__(self, kind: EnsembleType, exchanges: Mapping[str, _BoundExchange], side: str) -> None:
        self.local_is_coordinator = side == COORDINATOR
        roles = kind.coordinator, kind.member
        self.own, self.peer = roles if self.local_is_coordinator else reversed(roles)
        self.exchange = exchanges.get(f"at_{side}")
        self.end = exchanges.get(f"at_{side}_end")
        self.members: dict[tuple[str, str], tuple[LocalComponent, Peer]] = {}
        """Local component and last peer with which the membership held, by id; empty without `end`."""


MIN_SEARCHED_PAIRS: Final = 1000
"""Number of pairs up to which evaluating all is faster than a search."""


class BoundEnsemble:
    """An ensemble with its parameters and bound ports."""

    def __init__(self, instance: object, binding: Binding, statistics: Statistics) -> None:
        self.type = kind = ensemble_type_of(instance)
        self._statistics = statistics

        def bound(method: str, ports: tuple[tuple[str, Any], ...]) -> BoundFunction:
            return binding.pair(getattr(instance, method), ports, f"{kind.name}.{method}")

        self._membership = bound("membership", kind.ports)
        self._exchanges = exchanges = {
            method: _BoundExchange(exchange, bound(method, exchange.ports), f"{kind.name}.{method}")
            for method, exchange in kind.exchanges.items()
        }
        self._sides = [
            _EnsembleSide(kind, exchanges, side)
            for side, peer in ((COORDINATOR, kind.member), (MEMBER, kind.coordinator))
            if not is_component(peer)
        ]
        self._search = PairSearch(kind, instance) if kind.equal or kind.near else None
        self._ends = [side for side in self._sides if side.end is not None]
        self._boundary: Callable[[Any, Any], bool] | None = getattr(instance, "boundary", None)

    def evaluate(
        self, locals_: tuple[LocalComponent, ...], replicas: Sequence[Peer], now: Instant
    ) -> list[LocalComponent]:
        """Pair every local component with every other one and every replica, on both sides.

        With conditions and many pairs, omit those that do not fulfil them and were not members.
        Return the components whose knowledge changed.
        """
        changed: dict[str, LocalComponent] = {}
        if self._ends:
            self._end_with_absent(locals_, replicas, now, changed)
        everyone = (*locals_, *replicas)
        search = self._search if len(locals_) * len(everyone) > MIN_SEARCHED_PAIRS else None
        if search:
            search.index(everyone, [ids for side in self._ends for ids in side.members])
        for place, local in enumerate(locals_):
            peers = (
                search.peers_of(place)
                if search
                else (*(other for other in locals_ if other is not local), *replicas)
            )
            for peer in peers:
                for side in self._sides:
                    if self._meet(side, local, peer, now):
                        changed[local.id] = local
        return list(changed.values())

    def allows_relay(self, sender: Peer, components: Iterable[LocalComponent]) -> bool:
        """Return whether the boundary, if any, allows this node to relay the sender's knowledge."""
        if self._boundary is None or self.type.boundary is None:
            return True
        sender_role, here_role = self.type.boundary
        role = sender.role(sender_role)
        return role is not None and any(
            self._boundary(role, one.value) for one in components if isinstance(one.value, here_role)
        )

    def _end_with_absent(
        self,
        locals_: tuple[LocalComponent, ...],
        replicas: Sequence[Peer],
        now: Instant,
        changed: dict[str, LocalComponent],
    ) -> None:
        """End memberships with peers that are too old or dropped, in order of components, peers and sides."""
        present = {one.id for one in (*locals_, *replicas)}
        oldest = self.type.max_age
        members = sorted((ids, number) for number, side in enumerate(self._ends) for ids in side.members)
        for ids, number in members:
            if ids[1] not in present:
                side = self._ends[number]
                local, peer = side.members[ids]
                is_old = oldest is not None and now - peer.contact(now).heard > oldest
                if self._end(side, local, peer, now, EndReason.AGE if is_old else EndReason.FORGOTTEN):
                    changed[local.id] = local

    def _meet(self, side: _EnsembleSide, local: LocalComponent, peer: Peer, now: Instant) -> bool:
        """Evaluate membership and exchange of a pair; return whether the knowledge changed."""
        value, role = local.value, peer.role(side.peer)
        if role is None or not isinstance(value, side.own):
            return side.end is not None and self._end(side, local, peer, now, EndReason.CONDITION)
        contact = peer.contact(now)
        self._statistics.counters.memberships += 1
        try:
            coordinator, member = (value, role) if side.local_is_coordinator else (role, value)
            holds = self._membership.pair(coordinator, member, now, contact)
        except Exception as error:
            self._add_note(error, side.local_is_coordinator, local, peer, now)
            raise
        if holds is not True:
            if holds is not False:
                raise ExecutionError(
                    f"{self.type.name}.membership of {coordinator.id!r} and {member.id!r} at "
                    f"{in_seconds(now):g} s returned {holds!r}; return True or False, such as bool(...)"
                )
            return side.end is not None and self._end(side, local, peer, now, EndReason.CONDITION)
        if side.end is not None:
            side.members[local.id, peer.id] = (local, peer)
        return side.exchange is not None and self._exchange(side.exchange, local, peer, now, contact)

    def _end(
        self, side: _EnsembleSide, local: LocalComponent, peer: Peer, now: Instant, reason: EndReason
    ) -> bool:
        """End a membership if it held until now; return whether the knowledge changed."""
        last = side.members.pop((local.id, peer.id), None)
        if last is None or side.end is None:
            return False
        known = last[1] if peer.role(side.end.peer) is None else peer
        side.end.call.set_reason(reason)
        return self._exchange(side.end, local, known, now, known.contact(now))

    def _exchange(
        self, exchange: _BoundExchange, local: LocalComponent, peer: Peer, now: Instant, contact: Contact
    ) -> bool:
        value, role = local.value, peer.role(exchange.peer)
        if role is None or not isinstance(value, exchange.own):
            return False
        try:
            coordinator, member = (value, role) if exchange.local_is_coordinator else (role, value)
            result = exchange.call.pair(coordinator, member, now, contact)
            if result is value:
                return False
            if not local.commit(
                result, exchange.name, now, adaptation=True, peer=peer.id, heard=contact.heard
            ):
                return False
        except Exception as error:
            self._add_note(error, exchange.local_is_coordinator, local, peer, now)
            raise
        self._statistics.exchanges[self.type.name] += 1
        return True

    def _add_note(
        self, error: Exception, is_coordinator: bool, local: LocalComponent, peer: Peer, now: Instant
    ) -> None:
        first, second = (local.id, peer.id) if is_coordinator else (peer.id, local.id)
        hint = "; a peer has the fields of its role only" if isinstance(error, AttributeError) else ""
        error.add_note(
            f"in ensemble {self.type.name} of {first!r} and {second!r} at {in_seconds(now):g} s{hint}"
        )
