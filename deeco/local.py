"""A component on its node: its knowledge, processes and watched facts; and its pairs within one ensemble."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Protocol

from deeco.component import Fact, Process, processes_of
from deeco.ensemble import COORDINATOR, MEMBER, Binding, Bound, Contact, EnsembleType, Exchange, type_of
from deeco.errors import DeploymentError, ExecutionError
from deeco.instant import Instant, in_seconds
from deeco.knowledge import Knowledge, is_component, is_role, seen_as
from deeco.knowledge import made as named
from deeco.statistics import Statistics


class Commit(NamedTuple):
    """A change of a component's knowledge."""

    by: str
    """The process or the ensemble's exchange, as in `Cleaner.sense` or `Adoption.at_member`."""
    instant: Instant
    before: Knowledge
    after: Knowledge
    adaptation: bool
    """True of an ensemble, and of a process of the adaptation layer."""
    peer: str = ""
    """The component whose knowledge an ensemble used; empty for a process."""
    heard: Instant | None = None
    """When that knowledge had come here."""


Witness = Callable[[Commit], None]


class BoundProcess:
    """One process of one component, with its ports."""

    def __init__(self, process: Process, component: "LocalComponent", binding: Binding) -> None:
        self.name = str(process)
        self.schedule = process.schedule
        self._adaptation = process.adaptation
        self._component = component
        function = getattr(type(component.value), process.name)
        self._bound = binding.process(function, process.ports, self.name)

    def run(self, now: Instant) -> bool:
        """Call the process and commit what it gives; True if that is new knowledge."""
        component, bound = self._component, self._bound
        for place in bound.now:
            bound.arguments[place] = now
        try:
            made = bound.function(component.value, *bound.arguments)
        except Exception as error:
            error.add_note(f"in process {self.name} of {component.id!r} at {in_seconds(now):g} s")
            raise
        if made is component.value:
            return False
        return component.commit(made, self.name, now, adaptation=self._adaptation)


class LocalComponent:
    """Holds the knowledge of one component; `commit` makes every change and tells the witnesses."""

    def __init__(self, value: Knowledge, binding: Binding, witnesses: tuple[Witness, ...] = ()) -> None:
        kind = type(value)
        if not is_component(kind):
            raise DeploymentError(f"{kind.__name__} cannot be deployed; its class should have @component")
        self.id = value.id
        self.value = value
        self.processes = tuple(BoundProcess(process, self, binding) for process in processes_of(kind))
        self._witnesses = witnesses
        self.watched: list[tuple[str, Callable[[], str]]] = []
        """Names of the facts that are watched, and whom to call."""
        self._facts: list[object] = []
        self._seen: dict[type[Knowledge], tuple[Knowledge, Knowledge]] = {}

    def watch(self, facts: Sequence[Fact], then: Callable[[], str]) -> None:
        """Call `then` from `changes` whenever one of the facts has another value than at the call before."""
        for fact in facts:
            self.watched.append((fact.__name__, then))
            self._facts.append(getattr(self.value, fact.__name__)())

    def changes(self) -> list[Callable[[], str]]:
        """Whom to call because a fact has changed since the last call of this, each once, in order."""
        called: dict[Callable[[], str], None] = {}
        for index, (name, then) in enumerate(self.watched):
            fact = getattr(self.value, name)()
            if fact != self._facts[index]:
                self._facts[index] = fact
                called[then] = None
        return list(called)

    def commit(
        self,
        made: Any,
        by: str,
        now: Instant,
        *,
        adaptation: bool = False,
        peer: str = "",
        heard: Instant | None = None,
    ) -> bool:
        """Take over new knowledge; True if it differs. Raises ExecutionError for anything else."""
        value = self.value
        if type(made) is not type(value):
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s gives a {type(made).__name__}; "
                f"it should give the next {type(value).__name__}"
            )
        if made == value:
            return False
        if made.id != self.id:
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s changes the id to {made.id!r}; it should stay"
            )
        self.value = made
        if self._witnesses:
            commit = named(Commit, (by, now, value, made, adaptation, peer, heard))
            for witness in self._witnesses:
                witness(commit)
        return True

    def role(self, kind: type[Knowledge]) -> Any:
        """What a peer on the same node sees: the role only; None if it is not played."""
        if not is_role(kind) or not isinstance(self.value, kind):
            return None
        seen = self._seen.get(kind)
        if seen is None or seen[0] is not self.value:
            seen = self._seen[kind] = (self.value, seen_as(self.value, kind))
        return seen[1]

    def contact(self, now: Instant) -> Contact:
        """As close as can be."""
        return Contact(now, None, 0)


class Peer(Protocol):
    """Another component, on this node or as a replica."""

    @property
    def id(self) -> str:
        """The component's id."""

    def role(self, kind: type[Knowledge]) -> Any:
        """Its knowledge in a role, None if it does not play it."""

    def contact(self, now: Instant) -> Contact:
        """How that knowledge came here."""


class _Side:
    """An ensemble with the local component on one side."""

    def __init__(self, kind: EnsembleType, exchange: Exchange | None, call: Bound | None, side: str) -> None:
        self.local_is_coordinator = side == COORDINATOR
        both = kind.coordinator, kind.member
        self.own, self.peer = both if self.local_is_coordinator else reversed(both)
        self.exchange = exchange
        self.call = call
        self.name = f"{kind.name}.at_{side}"


class Pairing:
    """An ensemble and its parameters, with what the node provides for it."""

    def __init__(self, instance: object, binding: Binding, statistics: Statistics) -> None:
        self.type = kind = type_of(instance)
        self._statistics = statistics

        def bound(method: str, ports: tuple[tuple[str, Any], ...]) -> Bound:
            return binding.pair(getattr(instance, method), ports, f"{kind.name}.{method}")

        self._membership = bound("membership", kind.ports)
        self._sides = [
            _Side(kind, exchange, bound(f"at_{side}", exchange.ports) if exchange else None, side)
            for side, exchange, peer in (
                (COORDINATOR, kind.at_coordinator, kind.member),
                (MEMBER, kind.at_member, kind.coordinator),
            )
            if not is_component(peer)
        ]
        self._boundary: Callable[[Any, Any], bool] | None = getattr(instance, "boundary", None)

    def evaluate(
        self, locals_: tuple[LocalComponent, ...], replicas: Sequence[Peer], now: Instant
    ) -> list[LocalComponent]:
        """Pair every local component with every other and every replica, in both roles.

        Returns the components whose knowledge has changed.
        """
        changed: dict[str, LocalComponent] = {}
        for local in locals_:
            for peer in (*(other for other in locals_ if other is not local), *replicas):
                for side in self._sides:
                    if self._meet(side, local, peer, now):
                        changed[local.id] = local
        return list(changed.values())

    def lets_pass(self, sender: Peer, components: Iterable[LocalComponent]) -> bool:
        """True if the ensemble's boundary, if it has one, lets knowledge of the sender be relayed here."""
        if self._boundary is None or self.type.boundary is None:
            return True
        sender_role, here_role = self.type.boundary
        role = sender.role(sender_role)
        return role is not None and any(
            self._boundary(role, one.value) for one in components if isinstance(one.value, here_role)
        )

    def _meet(self, side: _Side, local: LocalComponent, peer: Peer, now: Instant) -> bool:
        """Evaluate the membership and, if it holds, the exchange; True if that changed the knowledge."""
        value, role = local.value, peer.role(side.peer)
        if role is None or not isinstance(value, side.own):
            return False
        contact = peer.contact(now)
        self._statistics.counters.memberships += 1
        try:
            coordinator, member = (value, role) if side.local_is_coordinator else (role, value)
            if not self._membership.pair(coordinator, member, now, contact):
                return False
            return side.call is not None and self._exchange(side, side.call, local, peer, now, contact)
        except Exception as error:
            ids = (local.id, peer.id) if side.local_is_coordinator else (peer.id, local.id)
            error.add_note(
                f"in ensemble {self.type.name} of {ids[0]!r} and {ids[1]!r} at {in_seconds(now):g} s"
            )
            raise

    def _exchange(
        self, side: _Side, call: Bound, local: LocalComponent, peer: Peer, now: Instant, contact: Contact
    ) -> bool:
        exchange, value = side.exchange, local.value
        assert exchange is not None
        role = peer.role(exchange.peer)
        if role is None or not isinstance(value, exchange.own):
            return False
        coordinator, member = (value, role) if side.local_is_coordinator else (role, value)
        made = call.pair(coordinator, member, now, contact)
        if made is value:
            return False
        if not local.commit(made, side.name, now, adaptation=True, peer=peer.id, heard=contact.heard):
            return False
        self._statistics.exchanges[self.type.name] += 1
        return True
