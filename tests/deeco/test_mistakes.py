"""Mistakes of definition, deployment and run; each error names component, field and fix."""

import linecache
import textwrap
from collections.abc import Callable
from typing import Any

import pytest

from deeco import (
    DefinitionError,
    DeploymentError,
    ExecutionError,
    Instant,
    Knowledge,
    component,
    ensemble,
    periodic,
    replace,
    role,
    seconds,
)
from deeco.node import Node

PRELUDE = """
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple, NewType, Self

from deeco import (
    Duration, History, Knowledge, adaptation, component, ensemble, milliseconds, on_change,
    periodic, role, seconds
)
from deeco.network import NetworkParameters
from deeco.udp import UdpLink
from deeco.virtual_network import LossyMedium, VirtualNetwork

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
    """Run a program whose source is known, as that of a module is."""
    program = PRELUDE + textwrap.dedent(text)
    linecache.cache["<program>"] = (len(program), None, program.splitlines(keepends=True), "<program>")
    exec(compile(program, "<program>", "exec"), {})


def refusal(text: str) -> str:
    with pytest.raises(DefinitionError) as caught:
        define(text)
    return str(caught.value)


METHOD = "must be a method with self, without async, yield, *, @property and @classmethod"
NO_UNIT = "has no unit; use seconds(...) or milliseconds(...)"
PERIODIC = "write @periodic(every=seconds(1))"
ONCE = ", once and without parentheses"


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
    f"Trailer.drive {METHOD}": (
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
    f"@ensemble: every=3 {NO_UNIT}": "ensemble(every=3)",
    f"@ensemble: max_age=10 {NO_UNIT}": "ensemble(every=seconds(3), max_age=10)",
    f"@ensemble: max_age=10000 {NO_UNIT}": "ensemble(every=seconds(3), max_age=10_000)",
    f"@periodic: every=1 {NO_UNIT}": "periodic(every=1)",
    f"@periodic: every=1000 {NO_UNIT}": "periodic(every=1000)",
    f"@periodic: offset=5000 {NO_UNIT}": "periodic(every=seconds(1), offset = 5000)",
    f"History('x'): max_age=60000 {NO_UNIT}": "History('x', 3, max_age=60_000)",
    f"NetworkParameters: publish_every=1000 {NO_UNIT}": "NetworkParameters(publish_every=1000)",
    f"UdpLink: step=50000 {NO_UNIT}": "UdpLink(7000, [], step=50_000)",
    f"VirtualNetwork: step=20000 {NO_UNIT}": "VirtualNetwork({}, step=20_000)",
    "@periodic: every=2 is 2 µs; use at least 1000 µs. seconds(1) is one second": "n = 2\nperiodic(every=n)",
    f"@periodic: periodic() takes 0 positional arguments but 1 was given; {PERIODIC}": (
        "@component\nclass Lorry(Vehicle):\n @periodic\n def drive(self) -> Self: ..."
    ),
    f"@periodic: periodic() missing 1 required keyword-only argument: 'every'; {PERIODIC}": "periodic()",
    f"@periodic: periodic() got an unexpected keyword argument 'phase'; {PERIODIC}": (
        "periodic(every=seconds(1), phase=seconds(1))"
    ),
    "@ensemble: ensemble() takes 0 positional arguments but 1 was given; write @ensemble(every=seconds(1))": (
        "@ensemble\nclass Convoy: ..."
    ),
    f"@role: role() missing 1 required positional argument: 'cls'; write @role{ONCE}": "role()",
    f"@component: component() missing 1 required positional argument: 'cls'; write @component{ONCE}": (
        "@component()\nclass Lorry(Vehicle): ..."
    ),
    f"@adaptation: adaptation() missing 1 required positional argument: 'process'; write @adaptation{ONCE}": (
        "adaptation()"
    ),
    f"@role: issubclass() arg 1 must be a class; write @role{ONCE}": "@role\ndef lorry(): ...",
    f"@component: Cannot overwrite attribute __setattr__ in class Lorry; write @component{ONCE}": (
        "@component\n@role\nclass Lorry(Knowledge): ..."
    ),
    "Lorry.drive runs on a change of Lorry.drive, which is not a method of Lorry or its roles": (
        lorry(" @on_change\n def drive(self) -> Self: ...", periodic=False)
    ),
    "Lorry.drive runs on a change of Lorry.<lambda>, which is not a method of Lorry or its roles": (
        lorry(" @on_change(lambda self: self.position)\n def drive(self) -> Self: ...", periodic=False)
    ),
    "Lorry.drive runs on a change of 'is_empty', which is not a method of Lorry or its roles": (
        lorry(" @on_change('is_empty')\n def drive(self) -> Self: ...", periodic=False)
    ),
    "<class 'Lorry'>: write one of @periodic and @on_change, directly above a method": (
        "@periodic(every=seconds(1))\nclass Lorry(Vehicle): __module__ = 'builtins'"
    ),
    f"Lorry.alone {METHOD}": lorry(" def alone() -> Self: ..."),
    f"Lorry.wait {METHOD}": lorry(" async def wait(self) -> Self: ..."),
    f"Lorry.next {METHOD}": lorry(" def next(self) -> Self: yield self"),
    f"Lorry.all {METHOD}": lorry(" def all(self, *motors: float) -> Self: ..."),
    f"Lorry.named {METHOD}": lorry(" def named(self, *, motor: float) -> Self: ..."),
    f"Lorry.shared {METHOD}": (
        lorry(" @classmethod\n @periodic(every=seconds(1))\n def shared(cls) -> Self: ...", periodic=False)
    ),
    f"Lorry.value {METHOD}": (
        lorry(" @property\n @periodic(every=seconds(1))\n def value(self) -> Self: ...", periodic=False)
    ),
    f"Convoy.membership {METHOD}": convoy(" async" + MEMBERSHIP),
    f"Convoy.boundary {METHOD}": (
        convoy(MEMBERSHIP + " def boundary(sender: Vehicle, here: Vehicle) -> bool: ...")
    ),
    "Convoy.at_member: its member, which it returns, is Vehicle; "
    "use a component that is a Vehicle, as in membership": (
        convoy(MEMBERSHIP + " def at_member(self, coordinator: Vehicle, member: Vehicle) -> Vehicle: ...")
    ),
    "Convoy.at_coordinator: its coordinator, which it returns, is Boat; "
    "use a component that is a Vehicle, as in membership": (
        "@role\nclass Ship(Knowledge): ...\n@component\nclass Boat(Ship): ...\n"
        + convoy(MEMBERSHIP + " def at_coordinator(self, coordinator: Boat, member: Vehicle) -> Boat: ...")
    ),
    "ensemble Convoy has no membership(self, coordinator, member)": convoy(" gap: float = 20.0"),
    "Convoy.membership: its first parameters must be self, coordinator and member": (
        convoy(" def membership(self, member: Vehicle, coordinator: Vehicle) -> bool: ...")
    ),
    "Convoy.at_meber is never called; use at_coordinator, at_member, at_coordinator_end, at_member_end": (
        convoy(MEMBERSHIP + " def at_meber(self, coordinator: Vehicle, member: Truck) -> Truck: ...")
    ),
    "Convoy.drive is a process; define it in a component": (
        convoy(MEMBERSHIP + " @periodic(every=seconds(1))\n def drive(self) -> Self: ...")
    ),
    "Lorry.drive has @adaptation but no schedule; write @periodic below it": (
        lorry(" @adaptation\n def drive(self) -> Self: ...", periodic=False)
    ),
    "modes=3 is not a tuple of modes; write modes=(Mode.SEARCH,)": "periodic(every=seconds(1), modes=3)",
    "LossyMedium: loss=30 must be a share from 0 to 1": "LossyMedium(loss=30)",
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


def test_a_duration_with_a_unit_is_accepted_beside_other_numbers() -> None:
    define("""
        @ensemble(every=seconds(1000), max_age=milliseconds(5000))  # 1000 ms
        class Convoy:
            gap: int = 1000

            def membership(self, coordinator: Vehicle, member: Vehicle) -> bool: ...

        NetworkParameters(max_replicas=1000, publish_every=milliseconds(1000))
        History("x", 1000, max_age=milliseconds(1))
        every = Duration(500_000)
        periodic(every=every, offset=0)
        periodic(every=Duration(500_000))
        """)


class Motor:
    """A port."""


def run(*components: Any, ensembles: Any = (), ports: Any = None) -> None:
    Node(components, ensembles, ports=ports).advance(Instant(seconds(2)))


@role
class Lane(Knowledge):
    x: float = 0.0


@component
class Car(Lane):
    goods: tuple[str, ...] = ()


def car(process: Any) -> Any:
    """Return a component with one process."""
    process.__name__ = "drive"
    made = type("Car", (Lane,), {"drive": periodic(every=seconds(1))(process), "__module__": __name__})
    deployed: Any = component(made)
    return deployed(id="a")


def group(membership: Any, **methods: Any) -> Any:
    made: Any = type("Group", (), {"membership": membership, **methods})
    return ensemble(every=seconds(1))(made)()


def always(self: Any, coordinator: Lane, member: Lane) -> bool:
    return True


def result(value: Any) -> Any:
    """Return a process with a wrong result."""

    def drive(self: Any) -> Any:
        return value(self)

    return drive


def answer(value: Any) -> Any:
    def membership(self: Any, coordinator: Lane, member: Lane) -> Any:
        return value

    return membership


def with_motor() -> Any:
    def drive(self: Any, motor: Motor) -> Any: ...

    return drive


def changed(value: Any) -> Any:
    def at_member(self: Any, coordinator: Lane, member: Car) -> Any:
        return value(coordinator, member)

    return at_member


PAIR = (Car(id="a"), Car(id="b"))
BOOL = "return True or False, such as bool(...)"
ENSEMBLE = "is not an ensemble; use an instance of a class with @ensemble(...)"
RUNS: dict[str, tuple[type[Exception], Callable[[], object]]] = {
    f"3 {ENSEMBLE}": (DefinitionError, lambda: run(Car(id="a"), ensembles=[3])),
    f"{type(group(always))} {ENSEMBLE}": (
        DefinitionError,
        lambda: run(Car(id="a"), ensembles=[type(group(always))]),
    ),
    f"Derived() {ENSEMBLE}": (
        DefinitionError,
        lambda: run(ensembles=[type("Derived", (type(group(always)),), {})()]),
    ),
    "components is Car(id='a', x=0.0, goods=()); must be a list, also of one": (
        DeploymentError,
        lambda: Node(Car(id="a")),  # type: ignore[arg-type]
    ),
    "Car is a class; use an instance, Car(id=...)": (DeploymentError, lambda: run(Car)),
    "Lane cannot be deployed: decorate its class with @component": (
        DeploymentError,
        lambda: run(Lane(id="a")),
    ),
    "Van cannot be deployed: decorate its class with @component": (
        DeploymentError,
        lambda: run(type("Van", (Car,), {})(id="a")),
    ),
    "Car.id is 1; must be a str that is not empty": (DeploymentError, lambda: run(Car(id=1))),  # type: ignore[arg-type]
    "Car.id is ''; must be a str that is not empty": (DeploymentError, lambda: run(Car(id=""))),
    "the components of a node are a, a; ids must be unique": (DeploymentError, lambda: run(PAIR[0], PAIR[0])),
    "this node has no component 'c'; use one of a, b": (DeploymentError, lambda: Node(PAIR).knowledge("c")),
    "Car.drive needs a Motor ('motor'); this node provides nothing": (
        DeploymentError,
        lambda: run(car(with_motor())),
    ),
    "Car.drive needs a Motor ('motor'); this node provides motor": (
        DeploymentError,
        lambda: run(car(with_motor()), ports={"motor": Motor()}),
    ),
    "Car.drive of 'a' at 0 s returned a NoneType; return the next Car": (
        ExecutionError,
        lambda: run(car(result(lambda self: None))),
    ),
    "Car.drive of 'a' at 0 s returned a dict; return the next Car": (
        ExecutionError,
        lambda: run(car(result(lambda self: {"x": 1.0}))),
    ),
    "Car.drive of 'a' at 0 s returned a Lane; return the next Car": (
        ExecutionError,
        lambda: run(car(result(lambda self: Lane(id="a")))),
    ),
    "Car.drive of 'a' at 0 s changed the id to 'b'; keep the id": (
        ExecutionError,
        lambda: run(car(result(lambda self: replace(self, id="b")))),
    ),
    "replace: Car has no field 'speed'; use one of id, x": (
        ExecutionError,
        lambda: run(car(result(lambda self: replace(self, speed=1.0)))),
    ),
    "Lane.x of 'a' cannot be published: 'fast' must be a float": (
        ExecutionError,
        lambda: run(car(result(lambda self: replace(self, x="fast")))),
    ),
    f"Group.membership of 'a' and 'b' at 0 s returned None; {BOOL}": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(answer(None))]),
    ),
    f"Group.membership of 'a' and 'b' at 0 s returned 1; {BOOL}": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(answer(1))]),
    ),
    f"Group.membership of 'a' and 'b' at 0 s returned 0.0; {BOOL}": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(answer(0.0))]),
    ),
    "Group.at_member of 'a' at 0 s returned a NoneType; return the next Car": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(always, at_member=changed(lambda _, one: None))]),
    ),
    "Group.at_member of 'a' at 0 s returned a tuple; return the next Car": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(always, at_member=changed(lambda *both: both))]),
    ),
    "Group.at_member of 'a' at 0 s returned a Lane; return the next Car": (
        ExecutionError,
        lambda: run(*PAIR, ensembles=[group(always, at_member=changed(lambda peer, _: peer))]),
    ),
}


@pytest.mark.parametrize("sentence", RUNS)
def test_mistakes_of_deployment_and_run_are_one_sentence(sentence: str) -> None:
    kind, program = RUNS[sentence]
    with pytest.raises(kind) as caught:
        program()
    assert str(caught.value) == sentence
