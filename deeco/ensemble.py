"""Ensembles: the membership condition of component pairs, and the knowledge exchanged within them.

    @ensemble(every=seconds(3), max_age=seconds(10))
    class Convoy:
        gap: float = 20.0                                               # a parameter of the experiment

        def membership(self, coordinator: Vehicle, member: Vehicle) -> bool: ...
        def at_member(self, coordinator: Vehicle, member: Truck) -> Truck: ...
        def at_coordinator(self, coordinator: Truck, member: Vehicle) -> Truck: ...
        def at_member_end(self, coordinator: Vehicle, member: Truck) -> Truck: ...
        def at_coordinator_end(self, coordinator: Truck, member: Vehicle) -> Truck: ...
        def boundary(self, sender: Vehicle, here: Vehicle) -> bool: ...

All except `membership` are optional. `membership` takes roles; if one side is a component, it is evaluated
only where that side is local. An exchange takes its peer's role and its own side's component, and returns
the next knowledge of that component. The methods with `_end` run once when a membership ends. `boundary`
decides whether this node relays the sender's knowledge. Further parameters are bound by type as those of
processes are, also `Contact` and, at an end, `EndReason`.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, NamedTuple, Protocol, TypeVar, dataclass_transform

from deeco.component import checked_arguments, ports, tag_of
from deeco.errors import DefinitionError, DeploymentError
from deeco.group_protocol import GroupMember, MemberRole
from deeco.instant import ZERO, Duration, Instant, check_duration
from deeco.knowledge import Fact, Knowledge, describe, has_fact, is_component, is_role
from deeco.pair_search import Equal, Near, check_conditions


class Membership(Protocol):
    """Protocol of ensemble classes, for type checkers."""

    @property
    def membership(self) -> Callable[..., bool]:
        """Take coordinator, member and further parameters bound by type."""


T = TypeVar("T", bound=Membership)
ENSEMBLE: Final = "_deeco_ensemble"
"""Attribute by which the decorators mark classes."""
COORDINATOR: Final = "coordinator"
MEMBER: Final = "member"
EXCHANGES: Final = {f"at_{side}{end}": side for end in ("", "_end") for side in (COORDINATOR, MEMBER)}
"""Side of each exchange."""


class Contact(NamedTuple):
    """Reception of a peer's knowledge."""

    heard: Instant
    """Instant at which its packet was complete; the current instant for a component on the same node."""
    rssi_dbm: float | None
    """Signal strength of its last frame, dBm; None on the same node or if the link does not measure it."""
    hops: int
    """Number of relays."""


class EndReason(Enum):
    """Reason why a membership ended."""

    CONDITION = "condition"
    """`membership` is false, or the peer no longer plays the role."""
    AGE = "age"
    """The replica is older than `max_age`."""
    FORGOTTEN = "forgotten"
    """The node has dropped the replica."""


@dataclass(frozen=True)
class Exchange:
    """Classes and ports of `at_member`, `at_coordinator` or one of their `_end` methods."""

    side: str
    """COORDINATOR or MEMBER: the local side, whose knowledge it returns."""
    own: type[Knowledge]
    peer: type[Knowledge]
    ports: tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class EnsembleType:
    """Definition of an ensemble: schedule, classes and exchanges."""

    name: str
    every: Duration | None
    offset: Duration
    on_change: tuple[Fact, ...]
    max_age: Duration | None
    """Maximum age of a replica that takes part; None: no limit."""
    coordinator: type[Knowledge]
    member: type[Knowledge]
    ports: tuple[tuple[str, Any], ...]
    """Further parameters of `membership`."""
    exchanges: Mapping[str, Exchange]
    """By method: `at_coordinator`, `at_member`, `at_coordinator_end`, `at_member_end`; those that it has."""
    boundary: tuple[type[Knowledge], type[Knowledge]] | None
    """Roles of the sender and of the local component in `boundary`; None without a boundary."""
    members: Mapping[str, MemberRole] = field(default_factory=dict)
    """Member roles of a group by name, in order of definition; none for an ensemble of pairs."""
    equal: Equal = None
    near: Near = None

    @property
    def roles(self) -> tuple[type[Knowledge], ...]:
        """Roles of peers that the ensemble uses."""
        named = [self.coordinator, self.member]
        named += [exchange.peer for exchange in self.exchanges.values()]
        named += self.boundary or ()
        named += [member.role for member in self.members.values()]
        return tuple(dict.fromkeys(one for one in named if is_role(one) and one is not GroupMember))


@checked_arguments
@dataclass_transform(frozen_default=True)
def ensemble(
    *,
    every: Duration | None = None,
    offset: Duration = ZERO,
    on_change: Fact | tuple[Fact, ...] = (),
    max_age: Duration | None = None,
    equal: Equal = None,
    near: Near = None,
) -> Callable[[type[T]], type[T]]:
    """Make a class an ensemble and a frozen dataclass; evaluate it periodically, on changes of facts, or
    both.

    Facts are watched in local components and in replicas. `equal` and `near`: necessary conditions of
    membership, which is evaluated only for pairs that fulfil them. Raises DefinitionError if the class is
    invalid.
    """
    facts = on_change if isinstance(on_change, tuple) else (on_change,)
    if every is None and not facts:
        raise DefinitionError("@ensemble() has no schedule; set every=seconds(3), on_change=a fact, or both")
    if every is not None:
        check_duration("@ensemble: every", every)
    check_duration("@ensemble: offset", offset, zero=True)
    if max_age is not None:
        check_duration("@ensemble: max_age", max_age)

    def decorate(cls: type[T]) -> type[T]:
        made = dataclass(frozen=True)(cls)
        setattr(made, ENSEMBLE, definition_of(made))
        return made

    def definition_of(cls: type) -> EnsembleType:
        coordinator, member, more = _sides(cls, "membership", COORDINATOR, MEMBER)
        if is_component(coordinator) and is_component(member):
            raise DefinitionError(
                f"{cls.__name__}.membership: {coordinator.__name__} and {member.__name__} are components; "
                "use a role for one side, as peers are known by role only"
            )
        for fact in facts:
            if not (has_fact(coordinator, fact) or has_fact(member, fact)):
                raise DefinitionError(
                    f"ensemble {cls.__name__} runs on a change of {getattr(fact, '__qualname__', fact)}, "
                    f"which is not a method of {coordinator.__name__} or {member.__name__}"
                )
        check_conditions(f"ensemble {cls.__name__}", (coordinator, member), equal, near)
        exchanges = _exchanges(cls, {COORDINATOR: coordinator, MEMBER: member})
        end = next((one for one in exchanges if one.endswith("_end")), None)
        if end and every is None:
            raise DefinitionError(
                f"ensemble {cls.__name__} has {end} but no period; set every=, "
                "as a replica becomes too old without any change"
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
            exchanges=exchanges,
            boundary=_sides(cls, "boundary", "sender", "here")[:2] if hasattr(cls, "boundary") else None,
            equal=equal,
            near=near,
        )

    return decorate


def ensemble_type(cls: type) -> EnsembleType | None:
    """Return the definition of an ensemble class; None for any other class."""
    found: EnsembleType | None = vars(cls).get(ENSEMBLE)
    return found


def ensemble_type_of(instance: object) -> EnsembleType:
    """Return the definition of an ensemble's class. Raises DefinitionError for any other object."""
    found = ensemble_type(type(instance))
    if found is None:
        raise DefinitionError(
            f"{instance!r} is not an ensemble; use an instance of a class with @ensemble(...)"
        )
    return found


def check_methods(cls: type, prefixes: tuple[str, ...], known: Collection[str]) -> None:
    """Raise DefinitionError for a process, and for a method with one of the prefixes that is not known."""
    for name, value in vars(cls).items():
        if tag_of(value):
            raise DefinitionError(f"{cls.__name__}.{name} is a process; define it in a component")
        if name.startswith(prefixes) and name not in known:
            raise DefinitionError(f"{cls.__name__}.{name} is never called; use {', '.join(known)}")


def _exchanges(cls: type, sides: Mapping[str, type[Knowledge]]) -> dict[str, Exchange]:
    check_methods(cls, ("at_",), EXCHANGES)
    found = {name: exchange_of(cls, name, side) for name, side in EXCHANGES.items() if hasattr(cls, name)}
    for name, one in found.items():
        expected = sides[one.side]
        if not (is_component(one.own) and (issubclass(one.own, expected) or issubclass(expected, one.own))):
            raise DefinitionError(
                f"{cls.__name__}.{name}: its {one.side}, which it returns, is {one.own.__name__}; "
                f"use a component that is a {expected.__name__}, as in membership"
            )
    return found


def exchange_of(cls: type, name: str, side: str) -> Exchange:
    """Return a method of coordinator and member. Raises DefinitionError if a parameter is wrong."""
    coordinator, member, more = _sides(cls, name, COORDINATOR, MEMBER)
    own, peer = (coordinator, member) if side == COORDINATOR else (member, coordinator)
    if is_component(peer):
        raise DefinitionError(
            f"{cls.__name__}.{name}: {peer.__name__} is a component, "
            "but the peer is known by role only; use a role"
        )
    return Exchange(side, own, peer, more)


def _sides(
    cls: type, name: str, first: str, second: str
) -> tuple[type[Knowledge], type[Knowledge], tuple[tuple[str, Any], ...]]:
    function = getattr(cls, name, None)
    if function is None:
        raise DefinitionError(f"ensemble {cls.__name__} has no {name}(self, {first}, {second})")
    where = f"{cls.__name__}.{name}"
    parameters = ports(cls, function, where)
    if tuple(parameter for parameter, _ in parameters[:2]) != (first, second):
        raise DefinitionError(f"{where}: its first parameters must be self, {first} and {second}")
    for parameter, kind in parameters[:2]:
        if not (isinstance(kind, type) and (is_role(kind) or is_component(kind))):
            raise DefinitionError(
                f"{where}: {parameter} is a {describe(kind)}; use a class with @role or @component"
            )
    return parameters[0][1], parameters[1][1], parameters[2:]


_NOW: Final = object()
_CONTACT: Final = object()
_REASON: Final = object()


class BoundFunction:
    """A function with its bound ports; instant and contact are set for each call."""

    def __init__(self, function: Callable[..., Any], arguments: list[Any]) -> None:
        self.function = function
        self.arguments = arguments
        self.now = tuple(place for place, value in enumerate(arguments) if value is _NOW)
        """Indices of the current instant in `arguments`."""
        self._contact = tuple(place for place, value in enumerate(arguments) if value is _CONTACT)
        self._reason = tuple(place for place, value in enumerate(arguments) if value is _REASON)

    def pair(self, coordinator: Any, member: Any, now: Instant, contact: Contact) -> Any:
        """Call the method of an ensemble."""
        for place in self.now:
            self.arguments[place] = now
        for place in self._contact:
            self.arguments[place] = contact
        return self.function(coordinator, member, *self.arguments)

    def call(self, now: Instant, contact: Contact, *values: Any) -> Any:
        """Call a function of other values."""
        for places, value in ((self.now, now), (self._contact, contact)):
            for place in places:
                self.arguments[place] = value
        return self.function(*values, *self.arguments)

    def set_reason(self, reason: EndReason) -> None:
        """Set the reason for the next call of an `_end` method."""
        for place in self._reason:
            self.arguments[place] = reason


class Binding:
    """Ports of a node by type; also Instant (now), in ensembles Contact, at ends EndReason."""

    def __init__(self, provided: Mapping[Any, object]) -> None:
        self._process = {Instant: _NOW, **provided}
        self._pair = {Contact: _CONTACT, **self._process}
        self._end = {EndReason: _REASON, **self._pair}
        self._provided = ", ".join(describe(one) for one in provided) or "nothing"

    def process(
        self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str
    ) -> BoundFunction:
        """Bind a process. Raises DeploymentError for a missing port; `name` is for errors."""
        return self._bind(function, ports, name, self._process)

    def pair(
        self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str
    ) -> BoundFunction:
        """Bind a method of an ensemble, as `process`."""
        return self._bind(function, ports, name, self._end if name.endswith("_end") else self._pair)

    def _bind(
        self,
        function: Callable[..., Any],
        ports: tuple[tuple[str, Any], ...],
        name: str,
        provided: Mapping[Any, object],
    ) -> BoundFunction:
        for parameter, kind in ports:
            if kind not in provided:
                raise DeploymentError(
                    f"{name} needs a {describe(kind)} ({parameter!r}); this node provides {self._provided}"
                )
        return BoundFunction(function, [provided[kind] for _, kind in ports])
