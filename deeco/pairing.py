"""One ensemble on one node: asks its membership of every pair, and lets the local side learn."""

from collections.abc import Callable, Iterable
from typing import Any, Protocol

from deeco.binding import Binding
from deeco.ensemble import COORDINATOR, MEMBER, Contact, EnsembleType, Exchange, type_of
from deeco.instant import Instant, in_seconds
from deeco.knowledge import Knowledge, is_component
from deeco.local import LocalComponent
from deeco.statistics import Statistics

_Call = Callable[[Any, Any, Instant, Contact], Any]


class Peer(Protocol):
    """Somebody else's component, on this node or as a replica."""

    @property
    def id(self) -> str:
        """The component's id."""

    def role(self, kind: type[Knowledge]) -> Any:
        """Its knowledge in a role, None if it does not play it."""

    def contact(self, now: Instant) -> Contact:
        """How that knowledge came here."""


class _Side:
    """The ensemble with the local component on one side."""

    def __init__(self, kind: EnsembleType, side: str, exchange: Exchange | None, call: _Call | None) -> None:
        self.local_is_coordinator = side == COORDINATOR
        own, peer = kind.coordinator, kind.member
        self.own, self.peer = (own, peer) if self.local_is_coordinator else (peer, own)
        self.exchange = exchange
        self.call = call
        self.name = f"{kind.name}.at_{side}"


class Pairing:
    """An ensemble and its parameters, with what the node provides for it."""

    def __init__(self, instance: object, binding: Binding, statistics: Statistics) -> None:
        self.type = type_of(instance)
        self._statistics = statistics
        self._membership = self._bound(instance, "membership", self.type.ports, binding)
        self._sides = tuple(
            _Side(self.type, side, exchange, self._exchange_of(instance, exchange, binding))
            for side, exchange in ((COORDINATOR, self.type.at_coordinator), (MEMBER, self.type.at_member))
            if not is_component(self._peer_of(side))
        )
        self._boundary: Callable[[Any, Any], bool] | None = getattr(instance, "boundary", None)

    def evaluate(
        self, locals_: tuple[LocalComponent, ...], replicas: Iterable[Peer], now: Instant
    ) -> list[LocalComponent]:
        """Every local component with every other and every replica, in both roles; gives who has learnt."""
        learnt: dict[str, LocalComponent] = {}
        heard = list(replicas)
        for local in locals_:
            others: list[Peer] = [other for other in locals_ if other is not local]
            for peer in others + heard:
                for side in self._sides:
                    if self._meet(side, local, peer, now):
                        learnt[local.id] = local
        return list(learnt.values())

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
        value, role = local.value, peer.role(side.peer)
        if role is None or not isinstance(value, side.own):
            return False
        contact = peer.contact(now)
        coordinator, member = (value, role) if side.local_is_coordinator else (role, value)
        self._statistics.counters.memberships += 1
        try:
            if not self._membership(coordinator, member, now, contact):
                return False
            return side.call is not None and self._exchange(side, side.call, local, peer, now, contact)
        except Exception as error:
            ids = (local.id, peer.id) if side.local_is_coordinator else (peer.id, local.id)
            error.add_note(
                f"in ensemble {self.type.name} of {ids[0]!r} and {ids[1]!r} at {in_seconds(now):g} s"
            )
            raise

    def _exchange(
        self, side: _Side, call: _Call, local: LocalComponent, peer: Peer, now: Instant, contact: Contact
    ) -> bool:
        exchange, value = side.exchange, local.value
        assert exchange is not None
        role = peer.role(exchange.peer)
        if role is None or not isinstance(value, exchange.own):
            return False
        coordinator, member = (value, role) if side.local_is_coordinator else (role, value)
        made = call(coordinator, member, now, contact)
        if made is value:
            return False
        if not local.commit(made, side.name, now, adaptation=True, peer=peer.id, heard=contact.heard):
            return False
        self._statistics.exchanges[self.type.name] += 1
        return True

    def _peer_of(self, side: str) -> type[Knowledge]:
        return self.type.member if side == COORDINATOR else self.type.coordinator

    def _exchange_of(self, instance: object, exchange: Exchange | None, binding: Binding) -> _Call | None:
        if exchange is None:
            return None
        return self._bound(instance, f"at_{exchange.side}", exchange.ports, binding)

    def _bound(
        self, instance: object, method: str, ports: tuple[tuple[str, Any], ...], binding: Binding
    ) -> _Call:
        return binding.pair(getattr(instance, method), ports, f"{self.type.name}.{method}")
