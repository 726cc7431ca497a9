"""Definitions: errors name the remedy; `replace` copies knowledge."""

import dataclasses
import textwrap
from dataclasses import FrozenInstanceError, dataclass, replace
from functools import cached_property
from typing import Any

import pytest

from deeco import DefinitionError, Knowledge, component, role
from deeco.ensemble import ensemble_type_of
from deeco.knowledge import has_generated_init, immutability_fault
from tests.deeco.refusals import refused
from tests.deeco.test_schema import unpacked

PRELUDE = """
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple, NewType, Self

from deeco import Knowledge, component, ensemble, milliseconds, on_change, periodic, role, seconds

@dataclass
class Open:
    speed: float

@dataclass(frozen=True)
class Manifest:
    goods: list[str]

class Waypoint(NamedTuple):
    tags: set[str]

@role
class Vehicle(Knowledge):
    position: float

@component
class Truck(Vehicle):
    def is_empty(self) -> bool:
        return True
"""
UNORDERED = "differs between processes; write a sorted tuple"
FIELDS = {
    "list[float]": "list[float] is mutable; write tuple[float, ...]",
    "bytearray": "bytearray is mutable; write bytes",
    "set[int]": f"set[int] is mutable, and its order {UNORDERED}",
    "frozenset[int]": f"the order of frozenset[int] {UNORDERED}",
    "tuple": "tuple has no item type; write for example tuple[float, ...]",
    "Any": "Any does not restrict the value; use a specific type",
    "Open": "Open is a mutable dataclass; write @dataclass(frozen=True)",
    "datetime": "datetime is not known to be immutable; "
    "use a number, a str, an Enum, a tuple or a frozen dataclass without type parameters",
    # A mutable type is found at any depth.
    "float | list[int] | None": "list[int] is mutable; write tuple[int, ...]",
    "Manifest": "list[str] is mutable; write tuple[str, ...]",
    "tuple[Waypoint, ...]": f"set[str] is mutable, and its order {UNORDERED}",
}


def define(text: str) -> None:
    exec(PRELUDE + textwrap.dedent(text), {})


def refusal(text: str) -> str:
    with pytest.raises(DefinitionError) as caught:
        define(text)
    return str(caught.value)


@pytest.mark.parametrize("annotation", FIELDS)
def test_mutable_field_types_are_refused(annotation: str) -> None:
    kind, base = ("role", "Knowledge") if "tuple" in annotation else ("component", "Vehicle")
    text = f"@{kind}\nclass Lorry({base}):\n load: {annotation}"
    assert refusal(text) == f"Lorry.load: {FIELDS[annotation]}"


def lorry(body: str, *, periodic: bool = True) -> str:
    return "@component\nclass Lorry(Vehicle):\n" + " @periodic(every=seconds(1))\n" * periodic + body


def convoy(body: str) -> str:
    return f"@ensemble(every=seconds(1))\nclass Convoy:\n{body}"


MEMBERSHIP = " def membership(self, coordinator: Vehicle, member: Vehicle) -> bool: ...\n"
MISTAKES = {
    "role Lorry is not derived from Knowledge; "
    "derive it directly or through its roles": "@role\nclass Lorry: ...",
    "role Lorry: name 'Goods' is not defined; "
    "import or define the type before the class": "@role\nclass Lorry(Knowledge):\n load: 'Goods'",
    "role Lorry is derived from the component Truck; "
    "published knowledge must not contain local fields": "@role\nclass Lorry(Truck): ...",
    "role Lorry has the process drive; define it in a component": (
        "@role\nclass Lorry(Knowledge):\n @periodic(every=seconds(1))\n def drive(self) -> Self: ..."
    ),
    "component Lorry plays no role; derive it from a class with @role": (
        "@component\nclass Lorry(Knowledge): ..."
    ),
    "@periodic: every=0 is 0 µs; use at least 1000 µs. "
    "seconds(1) is one second": "periodic(every=seconds(0))",
    "@periodic: offset=-1000 is -1000 µs; use 0 or at least 1000 µs. "
    "seconds(1) is one second": "periodic(every=seconds(1), offset=milliseconds(-1))",
    "@periodic: every=0.5 is not a duration; use one, such as seconds(1)": "periodic(every=0.5)",
    "@on_change() has no fact; name one, such as Cleaner.is_blocked": "on_change()",
    "Lorry.stop runs on a change of Truck.is_empty, which is not a method of Lorry or its roles": (
        lorry(" @on_change(Truck.is_empty)\n def stop(self) -> Self: ...", periodic=False)
    ),
    "Trailer.drive is None and overrides a process; define a method": (
        lorry(" def drive(self) -> Self: ...\n@component\nclass Trailer(Lorry):\n drive = None")
    ),
    "Lorry.drive: annotate its parameter 'motor'; it is bound by type": (
        lorry(" def drive(self, motor) -> Self: ...")
    ),
    "Lorry.drive: name 'Motor' is not defined; import the type at run time, "
    "not only under TYPE_CHECKING": lorry(" def drive(self, motor: 'Motor') -> Self: ..."),
    "@ensemble() has no schedule; set every=seconds(3), on_change=a fact, or both": "ensemble()",
    "@ensemble: offset=-1000 is -1000 µs; use 0 or at least 1000 µs. "
    "seconds(1) is one second": "ensemble(every=seconds(1), offset=milliseconds(-1))",
    "@ensemble: every=3 is 3 µs; use at least 1000 µs. seconds(1) is one second": "ensemble(every=3)",
    "@ensemble: max_age=10 is 10 µs; use at least 1000 µs. "
    "seconds(1) is one second": "ensemble(every=seconds(3), max_age=10)",
    "ensemble Convoy has no membership(self, coordinator, member)": convoy(" gap: float = 20.0"),
    "Convoy.membership: its first parameters must be self, coordinator and member": (
        convoy(" def membership(self, member: Vehicle, coordinator: Vehicle) -> bool: ...")
    ),
    "Convoy.at_meber is never called; use at_coordinator, at_member, at_coordinator_end, at_member_end": (
        convoy(MEMBERSHIP + " def at_meber(self, coordinator: Vehicle, member: Truck) -> Truck: ...")
    ),
    "Convoy.boundary: its first parameters must be self, sender and here": (
        convoy(MEMBERSHIP + " def boundary(self, coordinator: Vehicle, member: Vehicle) -> bool: ...")
    ),
    "Convoy.membership: member is a float; use a class with @role or @component": (
        convoy(" def membership(self, coordinator: Vehicle, member: float) -> bool: ...")
    ),
    "Convoy.membership: Truck and Truck are components; use a role for one side, "
    "as peers are known by role only": convoy(MEMBERSHIP.replace("Vehicle", "Truck")),
    "Convoy.at_member: Truck is a component, but the peer is known by role only; use a role": (
        convoy(MEMBERSHIP + " def at_member(self, coordinator: Truck, member: Truck) -> Truck: ...")
    ),
    "ensemble Meeting has at_member_end but no period; set every=, "
    "as a replica becomes too old without any change": (
        "@ensemble(on_change=Truck.is_empty)\nclass Meeting:\n"
        " def membership(self, coordinator: Vehicle, member: Truck) -> bool: ...\n"
        " def at_member_end(self, coordinator: Vehicle, member: Truck) -> Truck: ..."
    ),
    "Convoy.at_member_end: Truck is a component, but the peer is known by role only; use a role": (
        convoy(MEMBERSHIP + " def at_member_end(self, coordinator: Truck, member: Truck) -> Truck: ...")
    ),
    "ensemble Meeting runs on a change of Truck.is_empty, which is not a method of Vehicle or Vehicle": (
        f"@ensemble(on_change=Truck.is_empty)\nclass Meeting:\n{MEMBERSHIP}"
    ),
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_invalid_definitions_are_refused(sentence: str) -> None:
    assert refusal(MISTAKES[sentence]) == sentence


def test_an_object_that_is_not_an_ensemble_is_refused() -> None:
    with refused("3 is not an ensemble; use an instance of a class with @ensemble(...)", DefinitionError):
        ensemble_type_of(3)


@dataclass(frozen=True)
class Tree:
    branches: tuple["Tree", ...]


def test_immutable_types_are_accepted() -> None:
    assert immutability_fault(Tree) is None
    define(lorry(" def drive(self) -> 'Lorry': ..."))
    define("""
        Id = NewType("Id", int)

        class Gear(Enum):
            ONE = 1

        class Point(NamedTuple):
            x: float

        @role
        class Lorry(Knowledge):
            a: bool | int | float | str | bytes | None
            b: tuple[Point, ...]
            c: tuple[int, str]
            d: Annotated[float, ["m"]]
            e: Literal["up", "down"]
            f: Id
            g: Gear = Gear.ONE
        """)


@role
class Body(Knowledge):
    x: float = 0.0


@component
class Robot(Body):
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class Checked:
    low: int
    high: int

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ValueError("low lies above high")

    @cached_property
    def width(self) -> int:
        return self.high - self.low


@dataclass(frozen=True)
class Plain:
    low: int
    high: int

    @cached_property
    def width(self) -> int:
        return self.high - self.low


@dataclass(frozen=True, slots=True)
class Slotted:
    low: int
    high: int


@dataclass(frozen=True)
class InOrder:
    low: int
    high: int

    def __init__(self, low: int, high: int) -> None:
        object.__setattr__(self, "low", min(low, high))
        object.__setattr__(self, "high", max(low, high))


def test_replace_changes_one_field_and_keeps_all_others() -> None:
    robot = Robot(id="r1", x=1.0, held=("a",))
    moved = replace(robot, x=2.0)
    assert moved == dataclasses.replace(robot, x=2.0) == Robot(id="r1", x=2.0, held=("a",))
    assert list(vars(moved)) == list(vars(robot)) and hash(moved) != hash(robot) and robot.x == 1.0
    assert replace(robot) == robot and replace(robot) is not robot
    assert has_generated_init(Robot) and not has_generated_init(Checked) and not has_generated_init(Slotted)
    with pytest.raises(FrozenInstanceError):
        moved.x = 3.0  # type: ignore[misc]
    with pytest.raises(TypeError, match="speed"):
        replace(robot, speed=1.0)  # type: ignore[call-arg]


def test_replace_runs_the_checks_of_a_class_and_drops_cached_properties() -> None:
    assert replace(Checked(1, 5), low=3).width == 2
    with pytest.raises(ValueError, match="low lies above high"):
        replace(Checked(1, 5), low=7)
    plain = Plain(1, 5)
    assert plain.width == 4 and replace(plain, low=3).width == 2


@pytest.mark.parametrize("kind", [Plain, Slotted, InOrder])
def test_a_received_value_is_made_as_its_class_makes_it(kind: Any) -> None:
    made = unpacked(kind, (5, 3))
    assert made == kind(5, 3) and hash(made) == hash(kind(5, 3))
    assert (made.low, made.high) == ((3, 5) if kind is InOrder else (5, 3))
    assert replace(made, low=1) == kind(1, made.high)
    with pytest.raises(FrozenInstanceError):
        made.low = 2
