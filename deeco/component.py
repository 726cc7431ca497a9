"""Roles and components: classes of knowledge; peers see roles, processes use all fields.

    @role
    class Vehicle(Knowledge):           # published
        position: float

    @component
    class Truck(Vehicle):               # adds local fields
        fuel: float = 1.0

Both decorators make a frozen dataclass with keyword-only fields; `dataclasses.replace` makes the next value.

Processes are methods of a component that take its knowledge and return its next knowledge.
The decorators only tag: a process stays a plain method that a test can call.
"""

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any, Final, ParamSpec, TypeVar, dataclass_transform, get_type_hints

from deeco.errors import DefinitionError
from deeco.history import add_histories
from deeco.instant import ZERO, Duration, check_duration
from deeco.knowledge import KIND, Fact, Knowledge, check_fact, immutability_fault, is_component, roles_of
from deeco.modes import Modes, check_modes

F = TypeVar("F", bound=Callable[..., Knowledge])
P = ParamSpec("P")
R = TypeVar("R")
_TAG: Final = "_deeco_schedule"
_ADAPTATION: Final = "_deeco_adaptation"
_NOT_BINDABLE: Final = (
    inspect.CO_VARARGS
    | inspect.CO_VARKEYWORDS
    | inspect.CO_COROUTINE
    | inspect.CO_GENERATOR
    | inspect.CO_ASYNC_GENERATOR
)


@dataclass(frozen=True)
class PeriodicTrigger:
    """Schedule at `offset` + multiples of `every`; at equal instants the lower `order` runs first."""

    every: Duration
    offset: Duration = ZERO
    order: int = 0
    modes: Modes = ()
    """Modes in which the process is active; empty: all."""


@dataclass(frozen=True)
class ChangeTrigger:
    """Schedule after each commit that changes the value of one of the facts."""

    facts: tuple[Fact, ...]
    modes: Modes = ()


Schedule = PeriodicTrigger | ChangeTrigger


@dataclass(frozen=True)
class Process:
    """One process of a component class."""

    owner: str
    """Name of the component class."""
    name: str
    schedule: Schedule
    ports: tuple[tuple[str, Any], ...]
    """Name and annotated type of each parameter after the knowledge; a node binds it by type."""
    adaptation: bool
    """True in the adaptation layer, False in the adapted layer."""

    def __str__(self) -> str:
        return f"{self.owner}.{self.name}"


def checked_arguments(decorator: Callable[P, R]) -> Callable[P, R]:
    """Make a decorator raise DefinitionError where Python raises TypeError, as for a missing argument."""

    @functools.wraps(decorator)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return decorator(*args, **kwargs)
        except TypeError as error:
            usage = "(every=seconds(1))" if decorator.__kwdefaults__ else ", once and without parentheses"
            name = decorator.__name__
            raise DefinitionError(f"@{name}: {error}; write @{name}{usage}") from error

    return checked


@checked_arguments
def periodic(
    *, every: Duration, offset: Duration = ZERO, order: int = 0, modes: Modes = ()
) -> Callable[[F], F]:
    """Run the method every `every`, without drift, starting `offset` after the node; only in `modes`, if any.

    Raises DefinitionError unless both are durations of at least 1 ms (`offset` also 0).
    """
    check_duration("@periodic: every", every)
    check_duration("@periodic: offset", offset, zero=True)
    return _tag(PeriodicTrigger(every, offset, order, modes))


def on_change(*facts: Fact, modes: Modes = ()) -> Callable[[F], F]:
    """Run the method immediately after a commit that changes a fact, such as `Cleaner.is_blocked`.

    With `modes`, only in these modes; a change in another mode is not made up for.
    """
    if not facts:
        raise DefinitionError("@on_change() has no fact; name one, such as Cleaner.is_blocked")
    return _tag(ChangeTrigger(facts, modes))


@checked_arguments
def adaptation(process: F) -> F:
    """Assign a process to the adaptation layer; affects diagrams and explanations only."""
    setattr(process, _ADAPTATION, True)
    return process


def _tag(schedule: Schedule) -> Callable[[F], F]:
    modes: object = schedule.modes
    if not isinstance(modes, tuple) or not all(isinstance(one, Enum) for one in modes):
        raise DefinitionError(f"modes={modes} is not a tuple of modes; write modes=(Mode.SEARCH,)")

    def decorate(function: F) -> F:
        if not inspect.isfunction(function) or tag_of(function):
            raise DefinitionError(
                f"{function!r}: write one of @periodic and @on_change, directly above a method"
            )
        setattr(function, _TAG, schedule)
        return function

    setattr(decorate, _TAG, schedule)  # so that `@on_change` without a fact is found in the class
    return decorate


def tag_of(function: object) -> Schedule | None:
    """Return the schedule that a method was tagged with; None without a tag."""
    return getattr(function, _TAG, None)


def processes_of(cls: type) -> tuple[Process, ...]:
    """Return all processes of a component class, those of its bases first.

    A method that overrides a process takes its place, and keeps its schedule unless tagged again. Raises
    DefinitionError for a parameter without a type and for a fact of another class.
    """
    schedules: dict[str, Schedule] = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            if schedule := tag_of(getattr(value, "fget", getattr(value, "__func__", value))):
                schedules[name] = schedule
            elif getattr(value, _ADAPTATION, False) and name not in schedules:
                raise DefinitionError(
                    f"{cls.__name__}.{name} has @adaptation but no schedule; write @periodic below it"
                )
    return tuple(_process(cls, name, schedule) for name, schedule in schedules.items())


def _process(cls: type, name: str, schedule: Schedule) -> Process:
    function = getattr(cls, name)
    for fact in schedule.facts if isinstance(schedule, ChangeTrigger) else ():
        check_fact(cls, fact, f"{cls.__name__}.{name} runs on a change of")
    layer = any(getattr(vars(base).get(name), _ADAPTATION, False) for base in cls.__mro__)
    needed = ports(cls, function, f"{cls.__name__}.{name}")
    return Process(cls.__name__, name, schedule, needed, layer)


def ports(owner: type, function: Callable[..., Any], name: str) -> tuple[tuple[str, Any], ...]:
    """Return name and type of each parameter of a method after `self`; `name` is for errors.

    `owner` is the class being defined: its module has no such name yet, but annotations may use it.
    """
    code = getattr(inspect.unwrap(function), "__code__", None)
    if (
        code is None
        or code.co_flags & _NOT_BINDABLE
        or code.co_kwonlyargcount
        or code.co_varnames[:1] != ("self",)
    ):
        raise DefinitionError(
            f"{name} must be a method with self, without async, yield, *, @property and @classmethod"
        )
    try:
        hints = get_type_hints(function, localns={owner.__name__: owner})
    except NameError as error:
        raise DefinitionError(
            f"{name}: {error}; import the type at run time, not only under TYPE_CHECKING"
        ) from None
    _, *parameters = inspect.signature(function).parameters
    for parameter in parameters:
        if parameter not in hints:
            raise DefinitionError(f"{name}: annotate its parameter {parameter!r}; it is bound by type")
    return tuple((parameter, hints[parameter]) for parameter in parameters)


K = TypeVar("K", bound=Knowledge)


@checked_arguments
@dataclass_transform(frozen_default=True, kw_only_default=True)
def role(cls: type[K]) -> type[K]:
    """Make a subclass of Knowledge a role: peers see all its fields.

    Raises DefinitionError if a field's type is mutable, or if the class has processes.
    """
    made = _define(cls, "role")
    if parent := next((base for base in made.__mro__[1:] if is_component(base)), None):
        raise DefinitionError(
            f"role {made.__name__} is derived from the component {parent.__name__}; "
            "published knowledge must not contain local fields"
        )
    if process := next((name for name, value in vars(made).items() if tag_of(value)), None):
        raise DefinitionError(f"role {made.__name__} has the process {process}; define it in a component")
    return made


@checked_arguments
@dataclass_transform(frozen_default=True, kw_only_default=True)
def component(cls: type[K]) -> type[K]:
    """Make a subclass of Knowledge a component: fields that its roles do not have stay local.

    Raises DefinitionError if a field's type is mutable, or if a process or the mode chart is invalid.
    """
    made = _define(cls, "component")
    if not roles_of(made):
        raise DefinitionError(f"component {made.__name__} plays no role; derive it from a class with @role")
    check_modes(made, {one.name: one.schedule.modes for one in processes_of(made)})
    return made


def _define(cls: type[K], kind: str) -> type[K]:
    if not issubclass(cls, Knowledge):
        raise DefinitionError(
            f"{kind} {cls.__name__} is not derived from Knowledge; derive it directly or through its roles"
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
    add_histories(made, hints)
    setattr(made, KIND, kind)
    return made
