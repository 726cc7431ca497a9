"""Definitions: accepted types; `replace` copies knowledge."""

import dataclasses
from dataclasses import FrozenInstanceError, dataclass
from functools import cached_property
from typing import Any

import pytest

from deeco import ExecutionError, Knowledge, component, replace, role
from deeco.knowledge import has_generated_init, immutability_fault
from tests.deeco.refusals import refused
from tests.deeco.test_mistakes import define, lorry
from tests.deeco.test_schema import unpacked


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
    with refused("replace: Robot has no field 'speed'; use one of held, id, x", ExecutionError):
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
