"""Objects that come in from the air are what their classes would have made themselves."""

from dataclasses import FrozenInstanceError, dataclass, replace
from typing import Any

import pytest

from tests.deeco.test_schema import unpacked


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
class Slotted:
    low: int
    high: int


@pytest.mark.parametrize("kind", [Plain, Slotted, InOrder])
def test_what_comes_in_is_made_as_its_class_makes_it(kind: Any) -> None:
    """Where a class only sets its fields they are set at once; an `__init__` of the user's own is called."""
    made = unpacked(kind, (5, 3))
    assert made == kind(5, 3) and hash(made) == hash(kind(5, 3))
    assert (made.low, made.high) == ((3, 5) if kind is InOrder else (5, 3))
    assert replace(made, low=1) == kind(1, made.high)
    with pytest.raises(FrozenInstanceError):
        made.low = 2
