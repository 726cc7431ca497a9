"""Groups: ensembles of one coordinator and several members, chosen by utility within a cardinality.

    @group(coordinator=Field, every=seconds(1), max_age=seconds(5))
    class Protection:
        reach: float = 50.0                                             # a parameter of the experiment
        drones = some_of(Drone, 1, 3)

        def priority(self, coordinator: Field) -> float: ...
        def select_drones(self, coordinator: Field, member: Drone) -> bool: ...
        def utility_drones(self, coordinator: Field, member: Drone) -> float: ...
        def at_group(self, coordinator: Station, drones: tuple[Drone, ...]) -> Station: ...
        def at_member(self, coordinator: Field, member: Quadcopter) -> Quadcopter: ...
        def at_member_end(self, coordinator: Field, member: Quadcopter) -> Quadcopter: ...

All methods are optional, also `at_coordinator` and `at_coordinator_end` as in ensembles; further parameters
are bound by type. `Field` is derived from GroupCoordinator, `Drone` from GroupMember. Each coordinator's node
chooses members, each member's node confirms at most one coordinator (`group_protocol`); a confirmed pair is a
membership of an ensemble.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar, dataclass_transform

from deeco.component import checked_arguments, ports
from deeco.ensemble import (
    COORDINATOR,
    ENSEMBLE,
    EXCHANGES,
    EnsembleType,
    Exchange,
    check_methods,
    exchange_of,
)
from deeco.errors import DefinitionError
from deeco.group_protocol import GroupCoordinator, GroupMember, MemberRole
from deeco.instant import ZERO, Duration, check_duration
from deeco.knowledge import Knowledge, describe, is_role

T = TypeVar("T")
PRIORITY: Final = "priority"
AT_GROUP: Final = "at_group"


some_of: Final = MemberRole
"""Declare a member role of `least` to `most` components: `some_of(Drone, 1, 3)`."""


def one_of(role: type[GroupMember], *, exclusive: bool = True) -> MemberRole:
    """Declare a member role of exactly one component."""
    return some_of(role, 1, 1, exclusive)


def all_of(role: type[GroupMember], most: int = 12, *, exclusive: bool = True) -> MemberRole:
    """Declare a member role of all components for which `select` holds.

    `most`: limit, so that offers fit a packet. Default: with ids of 32 bytes 12 members fit 1024 bytes.
    """
    return some_of(role, 0, most, exclusive)


@checked_arguments
@dataclass_transform(frozen_default=True)
def group(
    *, coordinator: type[GroupCoordinator], every: Duration, max_age: Duration, offset: Duration = ZERO
) -> Callable[[type[T]], type[T]]:
    """Make a class a group and a frozen dataclass; evaluate it periodically, with replicas of at most
    `max_age`.

    Raises DefinitionError if the class is invalid.
    """
    check_duration("@group: every", every)
    check_duration("@group: max_age", max_age)
    check_duration("@group: offset", offset, zero=True)

    def decorate(cls: type[T]) -> type[T]:
        _check_role(f"group {cls.__name__}: coordinator", coordinator, GroupCoordinator)
        made: Any = dataclass(frozen=True)(cls)
        members = _members(made)
        kind = EnsembleType(
            name=cls.__name__,
            every=every,
            offset=offset,
            on_change=(),
            max_age=max_age,
            coordinator=coordinator,
            member=GroupMember,
            ports=(),
            exchanges=_exchanges(made, members),
            boundary=None,
            members=members,
        )
        setattr(made, ENSEMBLE, kind)
        made.membership = _membership
        return made  # type: ignore[no-any-return]

    return decorate


def _membership(self: object, coordinator: GroupCoordinator, member: GroupMember) -> bool:
    """Return whether the group holds, and both components confirm the same offer."""
    confirmed = {one.key for one in member.group_confirmations}
    held = coordinator.held_offers(getattr(type(self), ENSEMBLE).name)
    return any(one.member == member.id and one.key in confirmed for one in held)


def _members(cls: type) -> dict[str, MemberRole]:
    """Return the member roles of a group. Raises DefinitionError if one is invalid."""
    attributes = [item for base in reversed(cls.__mro__) for item in vars(base).items()]
    found = {name: value for name, value in attributes if isinstance(value, MemberRole)}
    if not found:
        raise DefinitionError(f"group {cls.__name__} has no member role; add one, such as one_of(Drone)")
    for name, member in found.items():
        where = f"{cls.__name__}.{name}"
        _check_role(where, member.role, GroupMember)
        least, most = member.least, member.most
        if {type(least), type(most)} != {int} or not 0 <= least <= most or most == 0:
            raise DefinitionError(
                f"{where} has {least!r} to {most!r} members; "
                "use integers: the first from 0, the second from 1 and not below the first"
            )
    return found


def _check_role(where: str, role: Any, base: type[Knowledge]) -> None:
    if not isinstance(role, type) or not is_role(role):
        raise DefinitionError(
            f"{where}: {describe(role)} is not a role; use a class with @role, as peers are known by it only"
        )
    if not issubclass(role, base):
        raise DefinitionError(f"{where}: derive {role.__name__} from {base.__name__}")


def _exchanges(cls: type, members: Mapping[str, MemberRole]) -> dict[str, Exchange]:
    """Return the methods of a group. Raises DefinitionError if one is invalid."""
    pairs = EXCHANGES | {f"{one}_{role}": COORDINATOR for role in members for one in ("select", "utility")}
    others = {PRIORITY: (), AT_GROUP: tuple(members)}
    check_methods(cls, ("select_", "utility_", "at_"), (*others, *pairs))
    found = {name: exchange_of(cls, name, side) for name, side in pairs.items() if hasattr(cls, name)}
    for name, roles in others.items():
        if hasattr(cls, name):
            found[name] = _exchange(cls, name, (COORDINATOR, *roles))
    return found


def _exchange(cls: type, name: str, first: tuple[str, ...]) -> Exchange:
    """Return a method of the coordinator, and of the members of all roles if it is `at_group`."""
    where = f"{cls.__name__}.{name}"
    found = ports(cls, getattr(cls, name), where)
    if tuple(parameter for parameter, _ in found[: len(first)]) != first:
        raise DefinitionError(f"{where}: its first parameters must be self, {', '.join(first)}")
    return Exchange(COORDINATOR, found[0][1], Knowledge, found[len(first) :])
