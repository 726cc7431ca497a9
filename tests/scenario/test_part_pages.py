"""Fields, defaults and ranges in docs/own-map.md and docs/own-robot.md."""

import re
from dataclasses import fields
from typing import Any, get_args

import pytest
from msgspec import NODEFAULT, Meta

from actors import robot_model
from actors.floor.map_file import KEYS, MapLimits
from actors.floor.offices import PARAMETERS, RESOLUTION
from actors.installation.repository import REPOSITORY
from actors.instant import Duration, in_seconds
from actors.settings import Settings, fields_of

ROBOT = (REPOSITORY / "docs" / "own-robot.md").read_text()
MAP = (REPOSITORY / "docs" / "own-map.md").read_text()
TABLES: dict[str, type] = {
    "The robot": robot_model.RobotModel,
    "`[footprint]`": robot_model.Footprint,
    "`[drive]`": robot_model.DriveParameters,
    "`[bumper]`": robot_model.Bumper,
    "`[battery]`": robot_model.BatteryParameters,
    "`[stage_errors]`": robot_model.StageErrors,
    "`[kobuki_errors]`": robot_model.KobukiErrors,
    "`[sensors.NAME]`": robot_model.RangeSensor,
}


def rows(text: str) -> dict[str, list[str]]:
    """Return the cells of each row that begins with a name in backticks, by name."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return {row[0].strip("`"): row[1:] for row in cells if re.fullmatch(r"`\w+`", row[0])}


def is_duration(field: Any) -> bool:
    return Duration in (field.hint, *get_args(field.hint)) or getattr(field.hint, "__origin__", 0) is Duration


def default(field: Any) -> str:
    if field.default is NODEFAULT:
        return ""
    if isinstance(field.default, Settings):
        return "below"
    if is_duration(field):
        return str(in_seconds(field.default))
    return "none" if field.default is None else str(field.default)


def span(field: Any) -> str:
    """Return the range as on the page; empty without bounds."""
    bounds = {
        name: getattr(one, name)
        for part in (field.hint, *get_args(field.hint))
        for one in getattr(part, "__metadata__", ())
        if isinstance(one, Meta)
        for name in ("gt", "ge", "le")
        if getattr(one, name) is not None
    }
    if not bounds:
        return ""
    if is_duration(field):
        bounds = {name: in_seconds(bound) for name, bound in bounds.items()}
    low = f"above {bounds['gt']}" if "gt" in bounds else str(bounds["ge"])
    return f"{low} to {bounds['le']}"


@pytest.mark.parametrize("heading", TABLES)
def test_every_field_of_a_robot_model_is_documented_with_default_and_range(heading: str) -> None:
    part = ROBOT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    kind = TABLES[heading]
    told = {name: (cells[1], cells[2]) for name, cells in rows(part).items()}
    assert told == {name: (default(field), span(field)) for name, field in fields_of(kind).items()}


def test_every_key_and_limit_of_a_map_is_documented() -> None:
    yaml, _, image = MAP.partition("## Drawn office floors")[0].partition("## The image")
    assert set(rows(yaml)) == {*KEYS}
    limits = {one.name: str(one.default) for one in fields(MapLimits)}
    assert {name: cells[0] for name, cells in rows(image).items()} == limits


def test_every_parameter_of_an_office_floor_is_documented() -> None:
    told = rows(MAP.partition("## Drawn office floors")[2].partition("## People")[0])
    assert list(told) == list(PARAMETERS)
    for key, allowed in PARAMETERS.items():
        low, high = (
            f"{end * RESOLUTION:.2f}" if allowed.is_length else str(end)
            for end in (allowed.low, allowed.high)
        )
        assert told[key][0].startswith(f"{low} to {high} ")
