"""Roles and components: classes of knowledge, of which peers see the roles, and processes use it all.

    @role
    class Vehicle(Knowledge):           # published
        position: float

    @component
    class Truck(Vehicle):               # what it adds is local
        fuel: float = 1.0

Both decorators make a frozen dataclass with keyword-only fields; `dataclasses.replace` makes the next value.

Processes are methods of a component that take its knowledge and return its next knowledge.
The decorators only tag: a process stays a plain method that a test can call.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final, TypeVar, dataclass_transform, get_type_hints

from deeco.errors import DefinitionError
from deeco.instant import Duration, check_duration
from deeco.knowledge import KIND, Knowledge, immutability_fault, is_component, roles_of

F = TypeVar("F", bound=Callable[..., Knowledge])
Fact = Callable[[Any], object]
"""A method of a role or component, of nothing but the knowledge; a process can run when its value changes."""
_TAG: Final = "_deeco_schedule"
_ADAPTATION: Final = "_deeco_adaptation"
_NONE: Final = Duration(0)


@dataclass(frozen=True)
class Periodic:
    """At `offset` + whole multiples of `every`; of several at one instant the lower `order` runs first."""

    every: Duration
    offset: Duration = _NONE
    order: int = 0


@dataclass(frozen=True)
class OnChange:
    """Whenever the value of one of the facts differs after a commit."""

    facts: tuple[Fact, ...]


Schedule = Periodic | OnChange


@dataclass(frozen=True)
class Process:
    """One process of a component class."""

    owner: str
    """Name of the component class."""
    name: str
    schedule: Schedule
    ports: tuple[tuple[str, Any], ...]
    """Parameters beside the knowledge: name and annotated type, by which a node binds it."""
    adaptation: bool
    """True in the adaptation layer, false in the layer that is adapted."""

    def __str__(self) -> str:
        return f"{self.owner}.{self.name}"


def periodic(*, every: Duration, offset: Duration = _NONE, order: int = 0) -> Callable[[F], F]:
    """Run the method every so often, without drift, from the node's start + `offset` on.

    Raises DefinitionError for what is no duration, or one below a millisecond.
    """
    check_duration("@periodic: every", every)
    check_duration("@periodic: offset", offset, zero=True)
    return _tag(Periodic(every, offset, order))


def on_change(*facts: Fact) -> Callable[[F], F]:
    """Run the method at once when a fact, such as `Cleaner.is_blocked`, has another value after a commit."""
    if not facts:
        raise DefinitionError("@on_change() should name a fact, such as Cleaner.is_blocked")
    return _tag(OnChange(facts))


def adaptation(process: F) -> F:
    """Say that a process belongs to the adaptation layer: for pictures and explanations, without effect."""
    setattr(process, _ADAPTATION, True)
    return process


def _tag(schedule: Schedule) -> Callable[[F], F]:
    def tagged(function: F) -> F:
        setattr(function, _TAG, schedule)
        return function

    return tagged


def tag_of(function: object) -> Schedule | None:
    """The schedule that a method was tagged with."""
    return getattr(function, _TAG, None)


def processes_of(cls: type) -> tuple[Process, ...]:
    """All processes of a component class, those of its bases first.

    A method that overrides a process takes its place; it keeps the schedule unless it has one of its own.
    Raises DefinitionError for a parameter without a type and for a fact of another class.
    """
    schedules: dict[str, Schedule] = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            if schedule := tag_of(value):
                schedules[name] = schedule
    return tuple(_process(cls, name, schedule) for name, schedule in schedules.items())


def _process(cls: type, name: str, schedule: Schedule) -> Process:
    function = getattr(cls, name)
    if not callable(function):
        raise DefinitionError(
            f"{cls.__name__}.{name} is {function!r}, but overrides a process; it should be a method"
        )
    for fact in schedule.facts if isinstance(schedule, OnChange) else ():
        if not has_fact(cls, fact):
            of = getattr(fact, "__qualname__", repr(fact))
            raise DefinitionError(
                f"{cls.__name__}.{name} runs on a change of {of}, "
                f"which is no method of {cls.__name__} or its roles"
            )
    layer = any(getattr(vars(base).get(name), _ADAPTATION, False) for base in cls.__mro__)
    needed = ports(cls, function, f"{cls.__name__}.{name}", skip=1)
    return Process(cls.__name__, name, schedule, needed, layer)


def has_fact(cls: type, fact: Fact) -> bool:
    """True if the fact is a method of the class or of one that it builds on, overridden or not."""
    name = getattr(fact, "__name__", "")
    return any(vars(base).get(name) is fact for base in cls.__mro__)


def ports(owner: type, function: Callable[..., Any], name: str, skip: int) -> tuple[tuple[str, Any], ...]:
    """The parameters of a function after the first `skip`, with their types; `name` is for errors.

    `owner` is the class that is being made, which its module does not know yet but annotations may name.
    """
    try:
        hints = get_type_hints(function, localns={owner.__name__: owner})
    except NameError as error:
        raise DefinitionError(
            f"{name}: {error}; import the type where the program runs, not under TYPE_CHECKING only"
        ) from None
    parameters = list(inspect.signature(function).parameters)[skip:]
    for parameter in parameters:
        if parameter not in hints:
            raise DefinitionError(
                f"{name}: its parameter {parameter!r} should have a type, by which it is bound"
            )
    return tuple((parameter, hints[parameter]) for parameter in parameters)


K = TypeVar("K", bound=Knowledge)


@dataclass_transform(frozen_default=True, kw_only_default=True)
def role(cls: type[K]) -> type[K]:
    """Make a class of Knowledge a role: all its fields are published, and peers see nothing else.

    Raises DefinitionError if a field's type can change, or if the class has processes.
    """
    made = _made(cls, "role")
    if parent := next((base for base in made.__mro__[1:] if is_component(base)), None):
        raise DefinitionError(
            f"role {made.__name__} builds on {parent.__name__}, which is a component; "
            "what peers may know must not contain what is local"
        )
    if process := next((name for name, value in vars(made).items() if tag_of(value)), None):
        raise DefinitionError(
            f"role {made.__name__} has the process {process}; processes belong to a component"
        )
    return made


@dataclass_transform(frozen_default=True, kw_only_default=True)
def component(cls: type[K]) -> type[K]:
    """Make a class of Knowledge a component: the fields it adds to its roles stay on its node.

    Raises DefinitionError if a field's type can change or if a process is not sound.
    """
    made = _made(cls, "component")
    if not roles_of(made):
        raise DefinitionError(
            f"component {made.__name__} plays no role; it should build on a class with @role"
        )
    processes_of(made)
    return made


def _made(cls: type[K], kind: str) -> type[K]:
    if not issubclass(cls, Knowledge):
        raise DefinitionError(
            f"{kind} {cls.__name__} does not build on Knowledge; "
            "it should, directly or by way of the roles that it plays"
        )
    made = dataclass(frozen=True, kw_only=True)(cls)
    try:
        hints = get_type_hints(made, localns={made.__name__: made}, include_extras=True)
    except NameError as error:
        raise DefinitionError(
            f"{kind} {made.__name__}: {error}; import or define the type before the class"
        ) from None
    for field in fields(made):
        if wrong := immutability_fault(hints[field.name]):
            raise DefinitionError(f"{made.__name__}.{field.name}: {wrong}")
    setattr(made, KIND, kind)
    return made
