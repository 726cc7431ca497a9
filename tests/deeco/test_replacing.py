"""`replace` gives what that of dataclasses gives, also of classes that it cannot copy field by field."""

import dataclasses
from dataclasses import FrozenInstanceError, dataclass, replace
from functools import cached_property
from typing import Any

import pytest

from deeco import Knowledge, component, role
from deeco.knowledge import is_plain
from tests.deeco.test_schema import unpacked


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
class Remembering:
    side: int

    @cached_property
    def area(self) -> int:
        return self.side**2


@dataclass(frozen=True, slots=True)
class Slotted:
    x: int
    y: int


def test_a_changed_field_and_all_others() -> None:
    robot = Robot(id="r1", x=1.0, held=("a",))
    moved = replace(robot, x=2.0)
    assert moved == dataclasses.replace(robot, x=2.0) == Robot(id="r1", x=2.0, held=("a",))
    assert list(vars(moved)) == list(vars(robot)) and hash(moved) != hash(robot) and robot.x == 1.0
    assert replace(robot) == robot and replace(robot) is not robot
    with pytest.raises(dataclasses.FrozenInstanceError):
        moved.x = 3.0  # type: ignore[misc]


def test_a_component_is_copied_at_once() -> None:
    """Else it would only be slow."""
    assert is_plain(Robot) and not is_plain(Checked) and not is_plain(Slotted)


def test_what_a_class_checks_is_checked() -> None:
    assert replace(Checked(1, 5), low=3).width == 2
    with pytest.raises(ValueError, match="low lies above high"):
        replace(Checked(1, 5), low=7)
    assert replace(Slotted(1, 2), y=5) == Slotted(1, 5)
    with pytest.raises(TypeError, match="speed"):
        replace(Robot(id="r1"), speed=1.0)  # type: ignore[call-arg]


def test_what_was_worked_out_of_old_fields_does_not_stay() -> None:
    square = Remembering(2)
    assert square.area == 4
    assert replace(square, side=3).area == 9


@dataclass(frozen=True)
class Plain:
    low: int
    high: int


@dataclass(frozen=True)
class InOrder:
    low: int
    high: int

    def __init__(self, low: int, high: int) -> None:
        object.__setattr__(self, "low", min(low, high))
        object.__setattr__(self, "high", max(low, high))


@dataclass(frozen=True, slots=True)
class MakingSlotted:
    low: int
    high: int


@pytest.mark.parametrize("kind", [Plain, MakingSlotted, InOrder])
def test_what_comes_in_is_made_as_its_class_makes_it(kind: Any) -> None:
    """Where a class only sets its fields they are set at once; an `__init__` of the user's own is called."""
    made = unpacked(kind, (5, 3))
    assert made == kind(5, 3) and hash(made) == hash(kind(5, 3))
    assert (made.low, made.high) == ((3, 5) if kind is InOrder else (5, 3))
    assert replace(made, low=1) == kind(1, made.high)
    with pytest.raises(FrozenInstanceError):
        made.low = 2
