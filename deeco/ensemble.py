"""Ensembles: who belongs together, and what the local side of each pair learns from the other.

    @ensemble(every=seconds(3), max_age=seconds(10))
    class Convoy:
        gap: float = 20.0                                               # the experiment's parameters

        def membership(self, coordinator: Vehicle, member: Vehicle) -> bool: ...
        def at_member(self, coordinator: Vehicle, member: Truck) -> Truck: ...
        def at_coordinator(self, coordinator: Truck, member: Vehicle) -> Truck: ...
        def boundary(self, sender: Vehicle, here: Vehicle) -> bool: ...

All but `membership` are optional. `membership` names roles; where it names a component on one side, it is
asked only where that side is local. An exchange names the role of its peer and the component of its own side,
and gives that side's next knowledge. `boundary` says whether this node relays what the sender published.
Parameters beyond these are bound by type as those of processes are, `Contact` too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol, TypeVar, dataclass_transform

from deeco.component import Fact, has_fact, ports
from deeco.errors import DefinitionError, DeploymentError
from deeco.instant import Duration, Instant, check_duration
from deeco.knowledge import Knowledge, describe, is_component, is_role


class Membership(Protocol):
    """What the class of an ensemble must have, as far as a type checker can say it."""

    @property
    def membership(self) -> Callable[..., bool]:
        """Of coordinator, member and whatever else is bound by type."""


T = TypeVar("T", bound=Membership)
_TAG: Final = "_deeco_ensemble"
_NONE: Final = Duration(0)
COORDINATOR: Final = "coordinator"
MEMBER: Final = "member"


class Contact(NamedTuple):
    """How a peer's knowledge came here."""

    heard: Instant
    """When the packet that brought it was complete; now, for a component on the same node."""
    rssi_dbm: float | None
    """Strength of the last frame that brought it; None if the link does not say, and on the same node."""
    hops: int
    """How often it has been relayed."""


@dataclass(frozen=True)
class Exchange:
    """`at_member` or `at_coordinator`: which knowledge it takes, and what else."""

    side: str
    """COORDINATOR or MEMBER: the side that is local and that it gives."""
    own: type[Knowledge]
    peer: type[Knowledge]
    ports: tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class EnsembleType:
    """What an ensemble's class says."""

    name: str
    every: Duration | None
    offset: Duration
    on_change: tuple[Fact, ...]
    max_age: Duration | None
    """Older replicas take no part; None: as long as the node keeps them."""
    coordinator: type[Knowledge]
    member: type[Knowledge]
    ports: tuple[tuple[str, Any], ...]
    """Of `membership`."""
    at_coordinator: Exchange | None
    at_member: Exchange | None
    boundary: tuple[type[Knowledge], type[Knowledge]] | None
    """Roles of the sender and of the own component that `boundary` asks about; None: it has none."""

    @property
    def roles(self) -> tuple[type[Knowledge], ...]:
        """Every role that it may have to know of a peer."""
        named = [self.coordinator, self.member]
        named += [exchange.peer for exchange in (self.at_coordinator, self.at_member) if exchange]
        named += self.boundary or ()
        return tuple(dict.fromkeys(one for one in named if is_role(one)))


@dataclass_transform(frozen_default=True)
def ensemble(
    *,
    every: Duration | None = None,
    offset: Duration = _NONE,
    on_change: Fact | tuple[Fact, ...] = (),
    max_age: Duration | None = None,
) -> Callable[[type[T]], type[T]]:
    """Make a class an ensemble and a frozen dataclass; evaluated periodically, on a change of facts, or both.

    Facts are watched in the local components and in replicas. Raises DefinitionError if the class is not
    sound.
    """
    facts = on_change if isinstance(on_change, tuple) else (on_change,)
    if every is None and not facts:
        raise DefinitionError("@ensemble() should say when: every=seconds(3), on_change=a fact, or both")
    if every is not None:
        check_duration("@ensemble: every", every)
    check_duration("@ensemble: offset", offset, zero=True)
    if max_age is not None:
        check_duration("@ensemble: max_age", max_age)

    def tagged(cls: type[T]) -> type[T]:
        made = dataclass(frozen=True)(cls)
        setattr(made, _TAG, described(made))
        return made

    def described(cls: type) -> EnsembleType:
        coordinator, member, more = _sides(cls, "membership", COORDINATOR, MEMBER)
        if is_component(coordinator) and is_component(member):
            raise DefinitionError(
                f"{cls.__name__}.membership: {coordinator.__name__} and {member.__name__} are components; "
                "one side is always a peer, of which only a role is known"
            )
        for fact in facts:
            if not (has_fact(coordinator, fact) or has_fact(member, fact)):
                raise DefinitionError(
                    f"ensemble {cls.__name__} runs on a change of {getattr(fact, '__qualname__', fact)}, "
                    f"which is no method of {coordinator.__name__} or {member.__name__}"
                )
        return EnsembleType(
            name=cls.__name__,
            every=every,
            offset=offset,
            on_change=facts,
            max_age=max_age,
            coordinator=coordinator,
            member=member,
            ports=more,
            at_coordinator=_exchange(cls, COORDINATOR),
            at_member=_exchange(cls, MEMBER),
            boundary=_sides(cls, "boundary", "sender", "here")[:2] if hasattr(cls, "boundary") else None,
        )

    return tagged


def ensemble_type(cls: type) -> EnsembleType | None:
    """Return what the class of an ensemble says; None for any other class."""
    found: EnsembleType | None = getattr(cls, _TAG, None)
    return found


def type_of(instance: object) -> EnsembleType:
    """Return what the class of an ensemble says. Raises DefinitionError for an object that is none."""
    found = ensemble_type(type(instance))
    if found is None:
        raise DefinitionError(
            f"{instance!r} is no ensemble; it should be an instance of a class with @ensemble(...)"
        )
    return found


def _exchange(cls: type, side: str) -> Exchange | None:
    name = f"at_{side}"
    if not hasattr(cls, name):
        return None
    coordinator, member, more = _sides(cls, name, COORDINATOR, MEMBER)
    own, peer = (coordinator, member) if side == COORDINATOR else (member, coordinator)
    if is_component(peer):
        raise DefinitionError(
            f"{cls.__name__}.{name}: {peer.__name__} is a component, "
            "but the peer's side is known by a role only"
        )
    return Exchange(side, own, peer, more)


def _sides(
    cls: type, name: str, first: str, second: str
) -> tuple[type[Knowledge], type[Knowledge], tuple[tuple[str, Any], ...]]:
    function = getattr(cls, name, None)
    if function is None:
        raise DefinitionError(f"ensemble {cls.__name__} has no {name}(self, {first}, {second})")
    where = f"{cls.__name__}.{name}"
    given = ports(cls, function, where, skip=1)
    if tuple(parameter for parameter, _ in given[:2]) != (first, second):
        raise DefinitionError(f"{where}: its first parameters should be self, {first} and {second}")
    for parameter, kind in given[:2]:
        if not (isinstance(kind, type) and (is_role(kind) or is_component(kind))):
            raise DefinitionError(
                f"{where}: {parameter} is a {describe(kind)}; its class should have @role or @component"
            )
    return given[0][1], given[1][1], given[2:]


_NOW: Final = object()
_CONTACT: Final = object()


class Bound:
    """A function of knowledge with its ports; those of instant and contact are set for each call."""

    def __init__(self, function: Callable[..., Any], arguments: list[Any]) -> None:
        self.function = function
        self.arguments = arguments
        self.now = tuple(place for place, value in enumerate(arguments) if value is _NOW)
        """Places in `arguments` of the instant."""
        self._contact = tuple(place for place, value in enumerate(arguments) if value is _CONTACT)

    def pair(self, coordinator: Any, member: Any, now: Instant, contact: Contact) -> Any:
        """Call the method of an ensemble."""
        for place in self.now:
            self.arguments[place] = now
        for place in self._contact:
            self.arguments[place] = contact
        return self.function(coordinator, member, *self.arguments)


class Binding:
    """What a node provides, by type; beside it Instant, which is now, and in ensembles Contact."""

    def __init__(self, provided: Mapping[Any, object]) -> None:
        self._process = {Instant: _NOW, **provided}
        self._pair = {Contact: _CONTACT, **self._process}
        self._there = ", ".join(describe(one) for one in provided) or "nothing"

    def process(self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str) -> Bound:
        """Bind a process. Raises DeploymentError if a port is missing; `name` is for errors."""
        return self._bound(function, ports, name, self._process)

    def pair(self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str) -> Bound:
        """Bind a method of an ensemble, as `process`."""
        return self._bound(function, ports, name, self._pair)

    def _bound(
        self,
        function: Callable[..., Any],
        ports: tuple[tuple[str, Any], ...],
        name: str,
        provided: Mapping[Any, object],
    ) -> Bound:
        for parameter, kind in ports:
            if kind not in provided:
                raise DeploymentError(
                    f"{name} needs a {describe(kind)} ({parameter!r}); this node provides {self._there}"
                )
        return Bound(function, [provided[kind] for _, kind in ports])
