"""Kinds of values in the tables of scenario and fleet files, each with the words for what would be right."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    StringConstraints,
)

from actors.robot.behaviour.adaptation import LONGEST_S, SHORTEST_S
from actors.robot.behaviour.ports import Setting
from actors.robot_model import OdometryKind

MOST_PLACES: Final = 1000
ROBOT_ID: Final = re.compile(r"r[1-9][0-9]{0,3}")


@dataclass(frozen=True)
class Right:
    """What would have been right, in words that go on after "must be"; `item`: the same for one of a list."""

    words: str
    item: str = ""


def as_tuples(value: object) -> object:
    """TOML's arrays as tuples, so that the tables can be frozen all through."""
    return tuple(as_tuples(item) for item in value) if isinstance(value, list) else value


def _growing(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError
    return span


def _setting(value: object) -> object:
    """What TOML can hold and what has one value: no date, no array, no table, no infinity."""
    match value:
        case bool() | str():
            return value
        case int() if -(2**63) <= value < 2**63:
            return value
        case float() if math.isfinite(value):
            return value
    raise ValueError


def _without_zero(value: str) -> str:
    """A zero character ends a path for the operating system."""
    if "\0" in value:
        raise ValueError
    return value


Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
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
Id = Annotated[str, StringConstraints(pattern=rf"^{ROBOT_ID.pattern}$")]
RobotId = Annotated[Id, Right('the id of a robot, such as "r2"')]
Text = Annotated[str, StringConstraints(min_length=1), AfterValidator(_without_zero)]
Names = Annotated[
    tuple[Text, ...],
    BeforeValidator(as_tuples),
    Field(min_length=1),
    Right('a list of names of areas, such as ["hall"]', item='the name of an area, such as "hall"'),
]
Model = Annotated[Text, Right('the name of a robot model such as "turtlebot2", or the path of a .toml file')]
Sensor = Annotated[Text, Right('the name of one of the robot model\'s sensors, such as "chapter"')]
OdometryName = Annotated[OdometryKind, Right('"exact", "stage" or "kobuki"')]
Radius = Annotated[float, Field(gt=0, le=1000), Right("a number of metres above 0, at most 1000")]
Seconds = Annotated[float, Field(gt=0, le=1e6), Right("a number of seconds above 0, at most 1000000")]
Interval = Annotated[
    float,
    Field(ge=SHORTEST_S, le=LONGEST_S),
    Right(f"a number of seconds from {SHORTEST_S} to {LONGEST_S}"),
]
Settings = Annotated[
    Mapping[str, Annotated[Setting, PlainValidator(_setting)]],
    Right(
        "a table [strategy] with the strategy's settings; its name stands in run.strategy",
        item="true, false, a whole number of 64 bits, a finite number or a text",
    ),
]

Parameters = Annotated[
    Mapping[str, Annotated[Setting, PlainValidator(_setting)]],
    Right(
        "a table of a preset and of parameters",
        item="true, false, a whole number of 64 bits, a finite number or a text",
    ),
]


class Table(BaseModel):
    """A table of the file: every key known, nothing converted, every number finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
