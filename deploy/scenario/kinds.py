"""Kinds of values in the tables of scenario and fleet files, each with the words for what would be right."""

import re
from collections.abc import Mapping
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field, StringConstraints

from actors.robot_model import OdometryKind
from actors.table import Right, Text, as_tuples

MOST_PLACES: Final = 1000
ROBOT_ID: Final = re.compile(r"r[1-9][0-9]{0,3}")
Id = Annotated[str, StringConstraints(pattern=rf"^{ROBOT_ID.pattern}$")]
RobotId = Annotated[Id, Right('the id of a robot, such as "r2"')]
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
Parameters = Annotated[Mapping[str, Any], Right("a table of a preset and of parameters")]
"""As it stands in the file; what may stand there, `deploy.scenario.stack_tables` says."""
