"""Protocol of groups: roles of coordinators and members, and the decisions of both.

A coordinator publishes a `GroupOffer` for each member that it has chosen; a member publishes the offers that
it confirms. Both sides decide on received knowledge only. These functions have no state, so lost, late and
repeated messages change nothing but their arguments.
"""

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from deeco.component import role
from deeco.instant import Instant
from deeco.knowledge import Knowledge

MAX_CONFIRMATIONS: Final = 8
"""Confirmations of a member in one group; the offers of all received coordinators may exceed its packet."""


class GroupOffer(NamedTuple):
    """Offer of a coordinator to one member of a group."""

    group: str
    role: str
    coordinator: str
    member: str
    since: Instant
    """Instant of the coordinator's node since which it has made this offer in every evaluation."""
    priority: float
    utility: float
    confirmed: bool = False
    """True if the coordinator has received the member's confirmation of this offer."""
    holds: bool = False
    """True if a member is confirmed, and each role has its minimum of confirmed members."""

    @property
    def key(self) -> tuple[object, ...]:
        """Identity of the offer, in its confirmation also."""
        return self[:5]


@role
class GroupCoordinator(Knowledge):
    """Base of the roles of coordinators."""

    group_offers: tuple[GroupOffer, ...] = ()
    """Written by the node."""

    def held_offers(self, group: str) -> tuple[GroupOffer, ...]:
        """Return the offers to the confirmed members of a group, by role and id; () if it does not hold."""
        return tuple(
            one
            for one in self.group_offers
            if one.holds and one.confirmed and (one.group, one.coordinator) == (group, self.id)
        )


@role
class GroupMember(Knowledge):
    """Base of the roles of members."""

    group_confirmations: tuple[GroupOffer, ...] = ()
    """Written by the node: confirmed offers, at most one in the exclusive roles of each group."""


@dataclass(frozen=True)
class MemberRole:
    """Member role of a group, with its cardinality."""

    role: type[GroupMember]
    least: int
    most: int
    exclusive: bool = True
    """True: a component confirms at most one coordinator in all exclusive roles of the group."""


def choose(roles: Mapping[str, MemberRole], candidates: Iterable[GroupOffer]) -> tuple[GroupOffer, ...]:
    """Return the offers to the best candidates, role by role; () if a role lacks its minimum.

    The higher utility is better, then the earlier offer, then the smaller id. A component gets one role.
    """
    ranked = sorted(candidates, key=lambda one: (-one.utility, one.since, one.member))
    chosen: dict[str, GroupOffer] = {}
    for name, declared in roles.items():
        free = [one for one in ranked if one.role == name and one.member not in chosen]
        if len(free) < declared.least:
            return ()
        chosen |= {one.member: one for one in free[: declared.most]}
    confirmed = Counter(one.role for one in chosen.values() if one.confirmed)
    holds = bool(confirmed) and all(confirmed[name] >= one.least for name, one in roles.items())
    return tuple(one._replace(holds=holds) for one in chosen.values())


def can_win(offer: GroupOffer, confirmed: Iterable[GroupOffer], exclusive: Container[str]) -> bool:
    """Return whether a member that has confirmed other offers of the group may confirm this one.

    It may if the offer is better. It may later if the other group does not hold, has no higher priority and
    the greater id of a coordinator: of two groups that wait for each other's members, that one gives way.
    """
    return offer.role not in exclusive or all(
        (offer.priority, offer.utility) > (one.priority, one.utility)
        or (not one.holds and offer.priority >= one.priority and offer.coordinator < one.coordinator)
        for one in confirmed
        if one.role in exclusive and one.coordinator != offer.coordinator
    )


def confirm(
    current: Iterable[GroupOffer], offers: Iterable[GroupOffer], exclusive: Container[str]
) -> tuple[GroupOffer, ...]:
    """Return the offers that a member confirms in one group: the best of its `exclusive` roles, all others.

    The higher priority is better, then the higher utility, then the coordinator that is confirmed at present,
    then the smaller id of a coordinator. At most MAX_CONFIRMATIONS are returned.
    """
    present = {one.coordinator for one in current if one.role in exclusive}
    best: dict[object, GroupOffer] = {}
    for one in sorted(
        offers, key=lambda one: (-one.priority, -one.utility, one.coordinator not in present, one.coordinator)
    ):
        best.setdefault(one.role in exclusive or (one.role, one.coordinator), one)
    return tuple(best.values())[:MAX_CONFIRMATIONS]


def with_offers(
    offers: Iterable[GroupOffer], new: Iterable[GroupOffer], group: str
) -> tuple[GroupOffer, ...]:
    """Return offers with those of one group replaced."""
    return tuple(sorted([*new, *(one for one in offers if one.group != group)]))
