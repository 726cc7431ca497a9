"""Static analysis of reads and writes, including unresolved accesses."""

import copy
import dataclasses
from collections.abc import Callable
from dataclasses import asdict, replace
from dataclasses import replace as changed
from typing import Any, Protocol, Self

import pytest

from deeco import Knowledge, component, ensemble, periodic, role, seconds
from deeco.explain.dataflow import Flow, analyse_flow


class Motor(Protocol):
    def drive(self, speed: float) -> None: ...
    def tell(self, about: Knowledge) -> float: ...


@role
class Vehicle(Knowledge):
    position: float
    speed: float = 0.0

    def is_moving(self) -> bool:
        return self.speed > 0

    def is_ahead_of(self, other: "Vehicle") -> bool:
        return self.position > other.position

    @property
    def place(self) -> float:
        return self.position

    def limited(self) -> Self:
        return replace(self, speed=min(self.speed, 1.0))


@component
class Truck(Vehicle):
    fuel: float = 1.0
    load: tuple[str, ...] = ()
    LIMIT = 3.0

    @staticmethod
    def price(truck: "Truck") -> float:
        return truck.fuel * Truck.LIMIT

    def again(self) -> Self:
        return self.again() if self.fuel else self


@component
class Lorry(Truck):
    def is_moving(self) -> bool:
        return super().is_moving() and bool(self.load)


def emptied(truck: Truck, *, by: float = 1.0) -> Truck:
    return changed(truck, fuel=truck.fuel - by)


def weight(truck: Truck) -> float:
    return heavier(truck) if truck.load else 0.0


def heavier(truck: Truck) -> float:
    return weight(truck) + truck.speed


def nothing(self: Truck) -> Truck:
    return self


def plain(self: Truck, motor: Motor) -> Truck:
    motor.drive(self.speed)
    return replace(self, fuel=0.5, position=self.position + Truck.LIMIT)


def by_method(self: Truck) -> Truck:
    return replace(self, fuel=0.0) if self.is_moving() else self


def by_property(self: Truck) -> Truck:
    return dataclasses.replace(self, speed=self.place)


def by_static(self: Truck) -> Truck:
    return changed(self, load=(str(self.price(self)),))


def by_function(self: Truck) -> Truck:
    return emptied(truck=self, by=self.position)


def by_recursion(self: Truck) -> Truck:
    return replace(self, fuel=weight(self))


def in_turn(self: Truck) -> Truck:
    slower = self.limited()
    empty: Truck = emptied(slower)
    if (last := replace(empty, load=())).is_moving():
        return last
    return replace(last, position=0.0).limited()


def in_pairs(self: Truck) -> Truck:
    slower, load = self.limited(), self.load
    slower, (first, *_) = emptied(slower), load
    return slower if first else replace(slower, load=load)


def in_a_loop(self: Truck) -> Truck:
    state = self
    later: Truck | None = None
    for _ in range(3):
        if later is not None:
            state = replace(later, fuel=later.speed)
        later = replace(state, load=())
    return state


def in_a_nested_function(self: Truck) -> Truck:
    def far(item: Truck) -> bool:
        return item.speed > self.position

    smallest = min(self.load, key=lambda self: self.fuel)  # type: ignore[attr-defined]  # another self
    return replace(self, load=(smallest, str(far)))


def as_a_whole(self: Truck) -> Truck:
    assert asdict(self)
    return self


def by_comparison(self: Truck) -> Truck:
    assert self == replace(self)
    return self


def by_name(self: Truck) -> Truck:
    assert getattr(self, "fuel")  # noqa: B009
    return self


ALL = ("id", "position", "speed", "fuel", "load")
ACCESSES: list[tuple[Callable[..., Any], tuple[str, ...], tuple[str, ...]]] = [
    (nothing, (), ()),
    (plain, ("speed", "position"), ("fuel", "position")),
    (by_method, ("speed",), ("fuel",)),
    (by_property, ("position",), ("speed",)),
    (by_static, ("fuel",), ("load",)),
    (by_function, ("position", "fuel"), ("fuel",)),
    (by_recursion, ("load", "speed"), ("fuel",)),
    (in_turn, ("speed", "fuel"), ("speed", "fuel", "load", "position")),
    (in_pairs, ("speed", "load", "fuel"), ("speed", "fuel", "load")),
    (in_a_loop, ("speed",), ("load", "fuel")),
    (in_a_nested_function, ("position", "load"), ("load",)),
    (as_a_whole, ALL, ()),
    (by_comparison, ALL, ()),
    (by_name, ("fuel",), ()),
]


def analysed(function: Callable[..., Any]) -> Flow:
    return analyse_flow(function, {"self": Truck}, returns_knowledge=True)


@pytest.mark.parametrize(
    ("function", "reads", "writes"), ACCESSES, ids=lambda one: getattr(one, "__name__", "")
)
def test_reads_and_writes(
    function: Callable[..., Any], reads: tuple[str, ...], writes: tuple[str, ...]
) -> None:
    found = analysed(function)
    assert sorted(found.read("self")) == sorted(reads)
    assert sorted(found.written("self")) == sorted(writes)
    assert list(found.unknowns) == []


def test_overridden_methods_are_analysed() -> None:
    assert analyse_flow(by_method, {"self": Lorry}).read("self") == ("speed", "load")


def any_fields(self: Truck, changes: dict[str, Any]) -> Truck:
    return replace(self, fuel=1.0, **changes)


def built(self: Truck) -> Truck:
    return Truck(id=self.id, position=self.position)


def told_to_a_port(self: Truck, motor: Motor) -> Truck:
    return replace(self, speed=motor.tell(self))


def in_a_list(self: Truck) -> Truck:
    return [self][0]


def by_any_name(self: Truck, name: str) -> Truck:
    assert getattr(self, name)
    return self


def by_dict(self: Truck) -> Truck:
    assert self.__dict__
    return self


def by_the_standard_library(self: Truck) -> Truck:
    return copy.copy(self)


def forever(self: Truck) -> Truck:
    return self.again()


UNRESOLVED: list[tuple[Callable[..., Any], tuple[str, ...]]] = [
    (any_fields, ("writes of `replace(self, fuel=1.0, **changes)`",)),
    (built, ("writes of `return Truck(id=self.id, position=self.position)`",)),
    (told_to_a_port, ("reads of self in `motor.tell(self)`",)),
    (in_a_list, ("reads of self in `[self]`", "writes of `return [self][0]`")),
    (by_any_name, ("reads of self in `getattr(self, name)`",)),
    (by_dict, ("reads of self.__dict__",)),
    (
        by_the_standard_library,
        ("reads of self in `copy.copy(self)`", "writes of `return copy.copy(self)`"),
    ),
    (
        forever,
        (
            "reads of self through `self.again() if self.fuel else self`",
            "writes of `return self.again()`",
        ),
    ),
]


@pytest.mark.parametrize(("function", "unknowns"), UNRESOLVED, ids=lambda one: getattr(one, "__name__", ""))
def test_unresolved_accesses_are_listed(function: Callable[..., Any], unknowns: tuple[str, ...]) -> None:
    assert tuple(analysed(function).unknowns) == unknowns


def test_a_function_without_source() -> None:
    names: dict[str, Any] = {}
    exec("def hidden(self): return self", names)
    assert list(analysed(names["hidden"]).unknowns) == [
        "reads and writes of hidden(), whose source is not available"
    ]


@ensemble(every=seconds(1))
class Convoy:
    gap: float = 20.0

    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        return coordinator.is_ahead_of(member) and self.near(member, coordinator)

    def near(self, one: Vehicle, other: Vehicle) -> bool:
        return abs(one.position - other.place) < self.gap and other.is_moving()

    def at_member(self, coordinator: Vehicle, member: Truck) -> Truck:
        return replace(member, speed=coordinator.speed)


def test_both_sides_of_an_ensemble_are_separate() -> None:
    subjects: dict[str, type] = {"self": Convoy, "coordinator": Vehicle, "member": Truck}
    membership = analyse_flow(Convoy.membership, subjects)
    assert membership.read("coordinator") == ("position", "speed")
    assert membership.read("member") == ("position",)
    assert membership.read("self") == ("gap",)
    exchange = analyse_flow(Convoy.at_member, subjects, returns_knowledge=True)
    assert (exchange.read("coordinator"), exchange.written("coordinator")) == (("speed",), ())
    assert (exchange.read("member"), exchange.written("member")) == ((), ("speed",))
    assert not membership.unknowns | exchange.unknowns


def test_a_tagged_process_is_a_plain_function() -> None:
    @component
    class Van(Vehicle):
        @periodic(every=seconds(1))
        def stop(self) -> Self:
            return changed(self, speed=0.0)

    assert analyse_flow(Van.stop, {"self": Van}, returns_knowledge=True).written("self") == ("speed",)
