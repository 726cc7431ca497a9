"""Tables of TOML files as pydantic models, and the kinds of values that all files have in common."""

from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    model_validator,
)

from actors.geometry import GREATEST_COORDINATE


@dataclass(frozen=True)
class Right:
    """What would have been right, in words that go on after "must be"; `item`: the same for one of a list."""

    words: str
    item: str = ""


class FileTable(BaseModel):
    """A table of the file: every key known, nothing converted, every number finite.

    A ValueError of its model validators goes on after "must", such as "hold either radius or vertices".
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _first_unknown(cls, content: object) -> object:
        """Of a million keys that are unknown the first is enough: pydantic keeps a kilobyte for each."""
        if not isinstance(content, dict) or len(content) <= len(cls.model_fields):
            return content
        first = next(name for name in content if name not in cls.model_fields)
        return {name: value for name, value in content.items() if name in cls.model_fields or name == first}


def as_tuples(value: object) -> object:
    """TOML's arrays as tuples, so that the tables can be frozen all through."""
    return tuple(as_tuples(item) for item in value) if isinstance(value, list) else value


def _growing(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError
    return span


def _without_zero(value: str) -> str:
    """A zero character ends a path for the operating system."""
    if "\0" in value:
        raise ValueError
    return value


Coordinate = Annotated[float, Field(ge=-GREATEST_COORDINATE, le=GREATEST_COORDINATE)]
Pose = Annotated[tuple[Coordinate, Coordinate, Coordinate], BeforeValidator(as_tuples)]
Point = Annotated[tuple[Coordinate, Coordinate], BeforeValidator(as_tuples)]
Span = Annotated[
    tuple[Coordinate, Coordinate],
    BeforeValidator(as_tuples),
    AfterValidator(_growing),
    Right("two numbers [from, to] in m, the first below the second"),
]
A_POSE: Final = "a pose [x, y, heading] in m, m and rad"
A_POINT: Final = "a point [x, y] in m"
Text = Annotated[str, StringConstraints(min_length=1), AfterValidator(_without_zero)]
