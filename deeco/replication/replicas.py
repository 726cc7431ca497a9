"""What a node knows of the components of others: the newest version of each that it has heard."""

from collections.abc import Iterator
from typing import Any

from deeco.ensemble import Contact
from deeco.instant import START, Duration, Instant
from deeco.knowledge import Knowledge
from deeco.replication.packet import Version
from deeco.statistics import NodeCounters


class Replica:
    """One component of another node, as it last published itself."""

    def __init__(
        self, component: str, version: Version, roles: tuple[Knowledge, ...], contact: Contact
    ) -> None:
        self.id = component
        self.version = version
        self.roles = roles
        self.heard = contact.heard
        self._contact = contact
        self._by_kind: dict[type[Knowledge], Knowledge | None] = {}

    def role(self, kind: type[Knowledge]) -> Any:
        """Its knowledge in that role; None if it does not play it, as far as is known here."""
        try:
            return self._by_kind[kind]
        except KeyError:
            found = next((one for one in self.roles if isinstance(one, kind)), None)
            return self._by_kind.setdefault(kind, found)

    def contact(self, now: Instant) -> Contact:
        """How this knowledge came here."""
        return self._contact


class Replicas:
    """At most so many replicas, in the order of their ids; what grows old is dropped."""

    def __init__(self, most: int, forget_after: Duration, counters: NodeCounters) -> None:
        self._most = most
        self._forget_after = forget_after
        self._counters = counters
        self._by_id: dict[str, Replica] = {}
        self._versions: dict[str, Version] = {}
        self._oldest = START
        """No replica was heard before it, so that not every step has to ask every one."""

    def __iter__(self) -> Iterator[Replica]:
        return iter(self._by_id.values())

    def __len__(self) -> int:
        return len(self._by_id)

    def get(self, component: str) -> Replica | None:
        """The replica of a component."""
        return self._by_id.get(component)

    def is_news(self, component: str, version: Version) -> bool:
        """True if no version so new has been heard of; dropping a replica does not forget its version."""
        known = self._versions.get(component)
        return known is None or version > known

    def put(self, replica: Replica) -> None:
        """Take in a newer version than any known."""
        self._versions.pop(replica.id, None)
        self._versions[replica.id] = replica.version
        if len(self._versions) > 4 * self._most:
            del self._versions[next(iter(self._versions))]
        fresh = replica.id not in self._by_id
        if fresh and len(self._by_id) >= self._most:
            self._counters.replicas_evicted += 1
            del self._by_id[min(self._by_id.values(), key=lambda one: (one.heard, one.id)).id]
        self._by_id[replica.id] = replica
        self._oldest = min(self._oldest, replica.heard)
        if fresh:
            self._by_id = dict(sorted(self._by_id.items()))

    def forget(self, now: Instant) -> None:
        """Drop what has not been heard for too long."""
        if now - self._oldest <= self._forget_after:
            return
        old = [one.id for one in self if now - one.heard > self._forget_after]
        for component in old:
            del self._by_id[component]
        self._oldest = min((one.heard for one in self), default=now)
        self._counters.replicas_forgotten += len(old)
