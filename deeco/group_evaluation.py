"""Evaluation of groups on a node: offers of local coordinators and confirmations of local members."""

import sys
from collections.abc import Iterable, Sequence
from typing import Any

from deeco.ensemble import EXCHANGES, Binding, Contact
from deeco.errors import ExecutionError
from deeco.group_protocol import GroupMember, GroupOffer, can_win, choose, confirm, with_offers
from deeco.groups import AT_GROUP, PRIORITY
from deeco.instant import Instant, in_seconds
from deeco.knowledge import replace
from deeco.local import BoundEnsemble, LocalComponent, Peer
from deeco.statistics import Statistics


class BoundGroup(BoundEnsemble):
    """A group with its bound ports: an ensemble of the pairs that its nodes have agreed on."""

    def __init__(self, instance: object, binding: Binding, statistics: Statistics) -> None:
        super().__init__(instance, binding, statistics)
        kind = self.type
        self._exclusive = {role for role, one in kind.members.items() if one.exclusive}
        called = (one.own for name, one in kind.exchanges.items() if name not in EXCHANGES)
        self._coordinators = (kind.coordinator, *called)
        """Classes of a component that can coordinate: it is an instance of all."""

    def evaluate(
        self, locals_: tuple[LocalComponent, ...], replicas: Sequence[Peer], now: Instant
    ) -> list[LocalComponent]:
        """Update offers and confirmations of the local components, then run the exchanges.

        Return the components whose knowledge may have changed.
        """
        for local in locals_:
            peers = {one.id: one for one in (*locals_, *replicas) if one is not local}
            try:
                if all(isinstance(local.value, one) for one in self._coordinators):
                    self._coordinate(local, peers, now)
                if isinstance(local.value, GroupMember):
                    self._confirm(local, peers, now)
            except Exception as error:
                error.add_note(f"in group {self.type.name} of {local.id!r} at {in_seconds(now):g} s")
                raise
        super().evaluate(locals_, replicas, now)
        return list(locals_)

    def _coordinate(self, local: LocalComponent, peers: dict[str, Peer], now: Instant) -> None:
        value: Any = local.value
        group, roles, here = self.type.name, self.type.members, local.contact(now)
        since = {one[:4]: one.since for one in value.group_offers}
        priority = self._number(PRIORITY, here, now, value)
        candidates = []
        for role, declared in roles.items():
            for peer in peers.values():
                view, contact = peer.role(declared.role), peer.contact(now)
                if view is None or not self._call(f"select_{role}", True, contact, now, value, view):
                    continue
                utility = self._number(f"utility_{role}", contact, now, value, view)
                key = (group, role, local.id, peer.id)
                offer = GroupOffer(*key, since.get(key, now), priority, utility)
                confirmed = [one for one in view.group_confirmations if one.group == group]
                if can_win(offer, confirmed, self._exclusive):
                    is_confirmed = any(one.key == offer.key for one in confirmed)
                    candidates.append(offer._replace(confirmed=is_confirmed))
        offers = choose(roles, candidates)
        result = replace(value, group_offers=with_offers(value.group_offers, offers, group))
        self._commit(local, result, "offer", [peers[one.member] for one in offers], now)
        value = local.value
        if held := value.held_offers(group):
            views = [
                tuple(peers[one.member].role(declared.role) for one in held if one.role == role)
                for role, declared in roles.items()
            ]
            result = self._call(AT_GROUP, value, here, now, value, *views)
            self._commit(local, result, AT_GROUP, [peers[one.member] for one in held], now)

    def _confirm(self, local: LocalComponent, peers: dict[str, Peer], now: Instant) -> None:
        value: Any = local.value
        group, roles = self.type.name, self.type.members
        own = {role for role, one in roles.items() if isinstance(value, one.role)}
        offers = [
            one
            for peer in peers.values()
            for one in getattr(peer.role(self.type.coordinator), "group_offers", ())
            if (one.group, one.coordinator, one.member) == (group, peer.id, local.id) and one.role in own
        ]
        before = [one for one in value.group_confirmations if one.group == group]
        confirmed = confirm(before, offers, self._exclusive)
        result = replace(value, group_confirmations=with_offers(value.group_confirmations, confirmed, group))
        self._commit(local, result, "confirm", [peers[one.coordinator] for one in confirmed], now)

    def _commit(
        self, local: LocalComponent, result: Any, method: str, peers: Iterable[Peer], now: Instant
    ) -> None:
        """Commit new knowledge; its source is the most recently received one of `peers`, if any."""
        source = max(peers, key=lambda one: one.contact(now).heard, default=local)
        name, heard = self.type.name, source.contact(now).heard
        changed = local.commit(result, f"{name}.{method}", now, adaptation=True, peer=source.id, heard=heard)
        self._statistics.exchanges[name] += changed

    def _call(self, method: str, default: Any, contact: Contact, now: Instant, *values: Any) -> Any:
        """Call a method with the given knowledge; return the default if the group does not have it."""
        exchange = self._exchanges.get(method)
        return default if exchange is None else exchange.call.call(now, contact, *values)

    def _number(self, method: str, contact: Contact, now: Instant, *values: Any) -> float:
        """Return the result of `priority` or `utility`. Raises ExecutionError unless it is finite."""
        value = self._call(method, 0, contact, now, *values)
        if isinstance(value, float | int) and abs(value) <= sys.float_info.max:
            return float(value)
        raise ExecutionError(f"{self.type.name}.{method} returned {value!r}; return a finite number")
