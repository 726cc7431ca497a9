"""What a map means to a robot, and what a robot model is, in words: before any scenario names them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors import toml_file
from actors.floor.grid import UNKNOWN, OccupancyGrid, largest_region, passable
from actors.floor.map_file import load_map
from actors.floor.regions import Regions, regions
from actors.robot_model import RobotModel, load_model
from actors.runtime.errors import AcrcError

WALKER: Final = "turtlebot2"
"""The robot model for which a map is looked at."""


@dataclass(frozen=True, eq=False)
class MapSurvey:
    """What there is to know of a map."""

    name: str
    grid: OccupancyGrid
    radius: float
    """Of the robot for which it was looked at, m."""
    reached: NDArray[np.bool_]
    """(rows, columns): the largest piece of floor in which its centre gets everywhere."""
    parts: Regions
    """The floor with room for it in regions, with the doors between them."""


def survey_map(path: Path) -> MapSurvey:
    """Look at a map's YAML file and its image. Raises MapError."""
    grid, radius = load_map(path), load_model(WALKER).footprint.circumradius
    parts = regions(grid, passable(grid, radius), grid.clearance)
    return MapSurvey(path.name, grid, radius, largest_region(grid, radius), parts)


def map_sentences(found: MapSurvey) -> Iterator[str]:
    """What a person wants to know first."""
    grid, cell = found.grid, found.grid.resolution**2
    width, depth = grid.corner.x - grid.origin.x, grid.corner.y - grid.origin.y
    free, unknown = grid.free.sum() * cell, (grid.cells == UNKNOWN).sum() * cell
    yield (
        f"{found.name}: {width:.1f} m by {depth:.1f} m in cells of {grid.resolution:g} m, from "
        f"({grid.origin.x:g}, {grid.origin.y:g}) on; free {free:.0f} m², unknown {unknown:.0f} m²"
    )
    reached = found.reached.sum() * cell
    if not reached:
        yield f"a robot of {2 * found.radius:g} m has room nowhere"
        return
    doors = len(found.parts.doors)
    narrow = "no narrow place" if not doors else "1 narrow place" if doors == 1 else f"{doors} narrow places"
    yield f"the centre of a robot of {2 * found.radius:g} m gets to {reached:.0f} m²; {narrow}"
    apart = ((found.parts.labels > 0) & ~found.reached).sum() * cell
    if apart >= cell:
        yield f"{apart:.1f} m² more have room for it, but no way leads there from the largest piece"


def is_model(path: Path) -> bool:
    """True if a file is a robot model's; of one that cannot be read nobody knows."""
    try:
        content = toml_file.read(path, "robot model")
        return "footprint" in toml_file.tables(content, path)
    except AcrcError:
        return False


def model_sentences(model: RobotModel) -> Iterator[str]:
    """What a person wants to know first; of the sensors, the one that is mounted."""
    body, drive, sensor = model.footprint, model.drive, model.sensor
    shape = f"a disc of {2 * body.circumradius:g} m" if body.radius is not None else (
        f"a polygon within {2 * body.circumradius:.2f} m, {2 * body.inradius:.2f} m at its narrowest"
    )  # fmt: skip
    yield f"{model.name}: {shape}, {model.mass:g} kg; odometry {model.odometry}"
    stops = drive.speed**2 / (2 * drive.acceleration)
    yield (
        f"{drive.kind} drive: up to {drive.speed:g} m/s, from which it stops within {stops:.2f} m, and "
        f"{math.degrees(drive.turn_rate):.0f}° per second; brakes {drive.watchdog:g} s after its last command"
    )
    noise = "no noise"
    if sensor.noise or sensor.noise_growth:
        far = sensor.noise + sensor.noise_growth * sensor.range_max**2
        noise = f"noise of {sensor.noise * 1000:.0f} mm, {far * 1000:.0f} mm at its farthest"
    yield (
        f"sensor {model.sensor_name}: {sensor.rays} rays over {sensor.field_of_view_deg:g}°, "
        f"{sensor.range_min:g} to {sensor.range_max:g} m, {sensor.rate:g} Hz, {noise}"
    )
    if model.bumper is None:
        yield "no bumper: it does not notice that it touches something"
    else:
        bumper = model.bumper
        yield f"bumper: centre to {bumper.centre_deg:g}° either side, right and left to {bumper.reach_deg:g}°"
