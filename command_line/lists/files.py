"""Which robot models, scenarios and maps are shipped."""

import os
import tomllib
from pathlib import Path
from typing import Any

import msgspec

from actors.installation.repository import REPOSITORY, SHIPPED
from command_line.lists.rows import head_comment, print_rows


class ListedSensor(msgspec.Struct, frozen=True):
    """A range sensor that a robot model can carry."""

    name: str
    default: bool
    """What the model carries if nothing is said."""
    field_of_view_deg: float
    rays: int
    range_max: float
    """m."""
    rate: float
    """Hz."""


class ListedModel(msgspec.Struct, frozen=True):
    """A robot model that a scenario can name."""

    name: str
    drive: str
    sensors: tuple[ListedSensor, ...]
    summary: str


class ListedScenario(msgspec.Struct, frozen=True):
    """A scenario that is shipped."""

    name: str
    path: str
    """As seen from the working directory."""
    summary: str


class ListedMap(msgspec.Struct, frozen=True):
    """A floor plan that is shipped."""

    name: str
    path: str
    """As seen from the working directory."""
    width: float
    """West to east, m."""
    depth: float
    """South to north, m."""
    resolution: float
    """Side of a cell, m."""


def models() -> tuple[ListedModel, ...]:
    """All robot models, by name."""
    return tuple(_model(path) for path in sorted((REPOSITORY / "actors" / "models").glob("*.toml")))


def scenarios() -> tuple[ListedScenario, ...]:
    """All scenarios, by name."""
    found = sorted((SHIPPED / "scenarios").glob("*.toml"))
    return tuple(
        ListedScenario(path.stem, os.path.relpath(path), head_comment(_text(path))) for path in found
    )


def maps() -> tuple[ListedMap, ...]:
    """All maps, by name."""
    from actors.floor.map_file import load_map

    found = sorted((SHIPPED / "maps").glob("*.yaml"))
    grids = [(path, load_map(path)) for path in found]
    return tuple(
        ListedMap(
            path.stem,
            os.path.relpath(path),
            grid.columns * grid.resolution,
            grid.rows * grid.resolution,
            grid.resolution,
        )
        for path, grid in grids
    )


def print_models(*, json: bool) -> None:
    """Print the robot models on standard output."""
    rows = models()
    columns = {
        "model": [row.name for row in rows],
        "drive": [row.drive for row in rows],
        "sensors": ["\n".join(map(_sensor_words, row.sensors)) for row in rows],
        "what it is": [row.summary for row in rows],
    }
    print_rows(rows, columns, json=json)


def print_scenarios(*, json: bool) -> None:
    """Print the scenarios on standard output."""
    rows = scenarios()
    columns = {
        "scenario": [row.path for row in rows],
        "what it is": [row.summary for row in rows],
    }
    print_rows(rows, columns, json=json)


def print_maps(*, json: bool) -> None:
    """Print the maps on standard output."""
    rows = maps()
    columns = {
        "map": [row.path for row in rows],
        "west to east": [f"{row.width:.2f} m" for row in rows],
        "south to north": [f"{row.depth:.2f} m" for row in rows],
        "cell": [f"{row.resolution:g} m" for row in rows],
    }
    print_rows(rows, columns, json=json)


def _model(path: Path) -> ListedModel:
    text = _text(path)
    file: dict[str, Any] = tomllib.loads(text)
    sensors = tuple(
        ListedSensor(
            name,
            name == file["default_sensor"],
            sensor["field_of_view_deg"],
            sensor["rays"],
            sensor["range_max"],
            sensor["rate"],
        )
        for name, sensor in file["sensors"].items()
    )
    return ListedModel(path.stem, file["drive"]["kind"], sensors, head_comment(text))


def _sensor_words(sensor: ListedSensor) -> str:
    rays = f"{sensor.rays} rays over {sensor.field_of_view_deg:g}°"
    default = " (default)" if sensor.default else ""
    return f"{sensor.name}{default}: {rays}, to {sensor.range_max:g} m, {sensor.rate:g} Hz"


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
