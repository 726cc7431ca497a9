"""What makes no sense is refused where it is defined, in one sentence that says what would be right."""

import textwrap
from dataclasses import dataclass

import pytest

from deeco import DefinitionError
from deeco.ensemble import type_of
from deeco.knowledge import immutability_fault

PRELUDE = """
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from enum import Enum
from typing import Any, Generic, NamedTuple, Self, TypeVar

from deeco import Contact, Instant, Knowledge
from deeco import adaptation, component, ensemble, milliseconds, on_change, periodic, role, seconds

T = TypeVar("T")


@dataclass
class Open:
    speed: float


@dataclass(frozen=True)
class Box(Generic[T]):
    content: T


@dataclass(frozen=True)
class Manifest:
    goods: list[str]


class Waypoint(NamedTuple):
    tags: set[str]


@role
class Vehicle(Knowledge):
    position: float

    def is_moving(self) -> bool:
        return True


@component
class Truck(Vehicle):
    fuel: float = 1.0

    def is_empty(self) -> bool:
        return self.fuel <= 0
"""


def define(text: str) -> dict[str, object]:
    names: dict[str, object] = {}
    exec(PRELUDE + textwrap.dedent(text), names)
    return names


def refusal(text: str) -> str:
    with pytest.raises(DefinitionError) as caught:
        define(text)
    return str(caught.value)


FIELDS = {
    "list[float]": "list[float] can change behind everybody's back; write tuple[float, ...]",
    "bytearray": "bytearray can change behind everybody's back; write bytes",
    "set[int]": (
        "set[int] can change, and its order differs from one process to the next; write a sorted tuple"
    ),
    "frozenset[int]": (
        "the order of frozenset[int] differs from one process to the next; write a sorted tuple"
    ),
    "tuple": "tuple does not say what is in it; write for example tuple[float, ...]",
    "Any": "Any says nothing about what is in it; name the type",
    "Open": "Open is a dataclass that can change; write @dataclass(frozen=True)",
    "datetime": (
        "datetime is not among the types whose values are known never to change; "
        "use a number, a str, an Enum, a tuple or a frozen dataclass without type parameters"
    ),
    # One that is deep inside is found too.
    "float | list[int] | None": "list[int] can change behind everybody's back; write tuple[int, ...]",
    "Manifest": "list[str] can change behind everybody's back; write tuple[str, ...]",
    "tuple[Waypoint, ...]": (
        "set[str] can change, and its order differs from one process to the next; write a sorted tuple"
    ),
}


@pytest.mark.parametrize("annotation", FIELDS)
def test_a_field_that_can_change(annotation: str) -> None:
    kind, base = ("role", "Knowledge") if "tuple" in annotation else ("component", "Vehicle")
    text = f"""
        @{kind}
        class Lorry({base}):
            load: {annotation}
        """
    assert refusal(text) == f"Lorry.load: {FIELDS[annotation]}"


CLASSES = {
    "role Lorry does not build on Knowledge; it should, directly or by way of the roles that it plays": """
        @role
        class Lorry:
            load: float
        """,
    "role Lorry: name 'Goods' is not defined; import or define the type before the class": """
        @role
        class Lorry(Knowledge):
            load: "Goods"
        """,
    "role Lorry builds on Truck, which is a component; "
    "what peers may know must not contain what is local": """
        @role
        class Lorry(Truck):
            load: float
        """,
    "role Lorry has the process drive; processes belong to a component": """
        @role
        class Lorry(Knowledge):
            load: float

            @periodic(every=seconds(1))
            def drive(self) -> Self:
                return self
        """,
    "component Lorry plays no role; it should build on a class with @role": """
        @component
        class Lorry(Knowledge):
            load: float
        """,
}

PROCESSES = {
    "@periodic: every=0 is 0 µs, and should be at least 1000 µs; seconds(1) is a second": """
        periodic(every=seconds(0))
        """,
    "@periodic: offset=-1000 is -1000 µs, and should be 0 or at least 1000 µs; seconds(1) is a second": """
        periodic(every=seconds(1), offset=milliseconds(-1))
        """,
    "@periodic: every=0.5 is no duration, and should be one, such as seconds(1)": """
        periodic(every=0.5)
        """,
    "@on_change() should name a fact, such as Cleaner.is_blocked": """
        on_change()
        """,
    "Lorry.stop runs on a change of Truck.is_empty, which is no method of Lorry or its roles": """
        @component
        class Lorry(Vehicle):
            @on_change(Truck.is_empty)
            def stop(self) -> Self:
                return self
        """,
    "Lorry.drive is None, but overrides a process; it should be a method": """
        @component
        class Base(Vehicle):
            @periodic(every=seconds(1))
            def drive(self) -> Self:
                return self

        @component
        class Lorry(Base):
            drive = None
        """,
    "Lorry.drive: its parameter 'motor' should have a type, by which it is bound": """
        @component
        class Lorry(Vehicle):
            @periodic(every=seconds(1))
            def drive(self, motor) -> Self:
                return self
        """,
    "Lorry.drive: name 'Motor' is not defined; "
    "import the type where the program runs, not under TYPE_CHECKING only": """
        @component
        class Lorry(Vehicle):
            @periodic(every=seconds(1))
            def drive(self, motor: "Motor") -> Self:
                return self
        """,
}

ENSEMBLES = {
    "@ensemble() should say when: every=seconds(3), on_change=a fact, or both": """
        ensemble()
        """,
    "@ensemble: offset=-1000 is -1000 µs, and should be 0 or at least 1000 µs; seconds(1) is a second": """
        ensemble(every=seconds(1), offset=milliseconds(-1))
        """,
    "@ensemble: every=3 is 3 µs, and should be at least 1000 µs; seconds(1) is a second": """
        ensemble(every=3)
        """,
    "@ensemble: max_age=10 is 10 µs, and should be at least 1000 µs; seconds(1) is a second": """
        ensemble(every=seconds(3), max_age=10)
        """,
    "ensemble Convoy has no membership(self, coordinator, member)": """
        @ensemble(every=seconds(1))
        class Convoy:
            gap: float = 20.0
        """,
    "Convoy.membership: its first parameters should be self, coordinator and member": """
        @ensemble(every=seconds(1))
        class Convoy:
            def membership(self, member: Vehicle, coordinator: Vehicle) -> bool:
                return True
        """,
    "Convoy.boundary: its first parameters should be self, sender and here": """
        @ensemble(every=seconds(1))
        class Convoy:
            def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
                return True

            def boundary(self, coordinator: Vehicle, member: Vehicle) -> bool:
                return True
        """,
    "Convoy.membership: member is a float; its class should have @role or @component": """
        @ensemble(every=seconds(1))
        class Convoy:
            def membership(self, coordinator: Vehicle, member: float) -> bool:
                return True
        """,
    "Convoy.membership: Truck and Truck are components; "
    "one side is always a peer, of which only a role is known": """
        @ensemble(every=seconds(1))
        class Convoy:
            def membership(self, coordinator: Truck, member: Truck) -> bool:
                return True
        """,
    "Convoy.at_member: Truck is a component, but the peer's side is known by a role only": """
        @ensemble(every=seconds(1))
        class Convoy:
            def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
                return True

            def at_member(self, coordinator: Truck, member: Truck) -> Truck:
                return member
        """,
    "ensemble Meeting runs on a change of Truck.is_empty, which is no method of Vehicle or Vehicle": """
        @ensemble(on_change=Truck.is_empty)
        class Meeting:
            def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
                return True
        """,
}


@pytest.mark.parametrize("sentence", [*CLASSES, *PROCESSES, *ENSEMBLES])
def test_a_definition_that_makes_no_sense(sentence: str) -> None:
    assert refusal((CLASSES | PROCESSES | ENSEMBLES)[sentence]) == sentence


def test_no_ensemble_at_all() -> None:
    with pytest.raises(DefinitionError) as caught:
        type_of(3)
    assert str(caught.value) == "3 is no ensemble; it should be an instance of a class with @ensemble(...)"


def test_a_process_may_name_the_class_that_it_belongs_to() -> None:
    """The class does not stand in its module yet while the decorator looks at it."""
    define("""
        @component
        class Lorry(Vehicle):
            @periodic(every=seconds(1))
            def drive(self) -> "Lorry":
                return self
        """)


@dataclass(frozen=True)
class Tree:
    branches: tuple["Tree", ...]


def test_a_type_may_contain_itself() -> None:
    assert immutability_fault(Tree) is None


def test_everything_that_never_changes_may_stand_in_knowledge() -> None:
    define("""
        from typing import Annotated, Literal, NewType

        Id = NewType("Id", int)

        class Gear(Enum):
            ONE = 1

        class Point(NamedTuple):
            x: float
            y: float

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
