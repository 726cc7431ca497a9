"""Properties of maps and robot models."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from actors.array_types import Flags
from actors.floor.doors import Regions, regions
from actors.floor.grid import UNKNOWN, OccupancyGrid, largest_region, passable
from actors.floor.map_file import load_map, map_warnings
from actors.robot_model import RobotModel, load_model

REFERENCE_MODEL: Final = "turtlebot2"
"""Robot model for which a map is surveyed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MapSurvey:
    """Properties of a map."""

    name: str
    grid: OccupancyGrid
    radius: float
    """Radius of the robot for which it was surveyed, m; in a scenario that of the largest robot."""
    reached: Flags
    """(rows, columns): cells that its centre can reach from the starts, or in the largest part."""
    parts: Regions
    """Regions of the floor wide enough for it, and the doors between them."""
    warnings: tuple[str, ...]

    @property
    def surface(self) -> float:
        """Reachable floor, m²."""
        return float(self.reached.sum()) * self.grid.resolution**2

    @property
    def unreachable(self) -> Flags:
        """(rows, columns): cells that are wide enough for its centre, but have no path."""
        return (self.parts.labels > 0) & ~self.reached

    def sentences(self) -> Iterator[str]:
        """Yield the properties as sentences."""
        facts, origin, cell = self.json_content(), self.grid.origin, self.grid.resolution**2
        yield (
            f"{self.name}: {facts['width_m']:.1f} m by {facts['depth_m']:.1f} m in cells "
            f"of {facts['cell_m']:g} m, from ({origin.x:g}, {origin.y:g}) on; "
            f"free {facts['free_m2']:.0f} m², unknown {facts['unknown_m2']:.0f} m²"
        )
        yield from (f"warning: {warning}" for warning in self.warnings)
        if not facts["reached_m2"]:
            yield f"a robot of {2 * self.radius:g} m fits nowhere"
            return
        narrow, diameter = narrow_places(facts["narrow_places"]), 2 * self.radius
        yield f"the centre of a robot of {diameter:g} m can reach {facts['reached_m2']:.0f} m²; {narrow}"
        apart = self.unreachable.sum() * cell
        if apart >= cell:
            yield f"{apart:.1f} m² more are wide enough, but no path leads there from the largest part"

    def json_content(self) -> dict[str, Any]:
        """Return the properties as JSON content, in m, m²."""
        grid, cell = self.grid, self.grid.resolution**2
        return {
            "is": "map",
            "name": self.name,
            "warnings": list(self.warnings),
            **grid_size(grid),
            "cell_m": grid.resolution,
            "free_m2": float(grid.free.sum() * cell),
            "unknown_m2": float((grid.cells == UNKNOWN).sum() * cell),
            "reached_m2": self.surface,
            "narrow_places": len(self.parts.doors),
        }


def sentences(found: MapSurvey | RobotModel) -> Iterable[str]:
    """Return the survey as sentences."""
    if isinstance(found, RobotModel):
        return _model_sentences(found)
    return found.sentences()


def json_content(found: MapSurvey | RobotModel) -> dict[str, Any]:
    """Return the survey as JSON content, in m, m², s; for a robot model that of its file."""
    if isinstance(found, RobotModel):
        content: dict[str, Any] = msgspec.to_builtins(found)
        sensor, name = content.pop("sensors")[found.default_sensor], content.pop("default_sensor")
        return {"is": "robot model", **content, "sensor": sensor, "sensor_name": name}
    return found.json_content()


def grid_size(grid: OccupancyGrid) -> dict[str, float]:
    """Return the sides of a map, m."""
    return {"width_m": grid.corner.x - grid.origin.x, "depth_m": grid.corner.y - grid.origin.y}


def narrow_places(count: int) -> str:
    """Return a number of narrow places as text."""
    return f"{count or 'no'} narrow place{'s' * (count > 1)}"


def survey_map(path: Path) -> MapSurvey:
    """Survey a map's YAML file and its image. Raises MapError."""
    grid, radius = load_map(path), load_model(REFERENCE_MODEL).footprint.circumradius
    parts = regions(grid, passable(grid, radius), grid.clearance)
    return MapSurvey(
        name=path.name, grid=grid, radius=radius, reached=largest_region(grid, radius), parts=parts,
        warnings=map_warnings(path),
    )  # fmt: skip


def _model_sentences(model: RobotModel) -> Iterator[str]:
    body, drive, sensor = model.footprint, model.drive, model.sensor
    shape = f"a disc of {2 * body.circumradius:g} m" if body.radius is not None else (
        f"a polygon within {2 * body.circumradius:.2f} m, {2 * body.inradius:.2f} m at its narrowest"
    )  # fmt: skip
    yield f"{model.name}: {shape}, {model.mass:g} kg; odometry {model.odometry}"
    stops = drive.speed**2 / (2 * drive.acceleration)
    yield (
        f"{drive.kind} drive: up to {drive.speed:g} m/s, stopping distance {stops:.2f} m, "
        f"{math.degrees(drive.turn_rate):.0f}° per second; brakes {drive.watchdog:g} s after its last command"
    )
    noise = "no noise"
    if sensor.noise or sensor.noise_growth:
        far = sensor.noise + sensor.noise_growth * sensor.range_max**2
        noise = f"noise of {sensor.noise * 1000:.0f} mm, {far * 1000:.0f} mm at its farthest"
    yield (
        f"sensor {model.default_sensor}: {sensor.rays} rays over {sensor.field_of_view_deg:g}°, "
        f"{sensor.range_min:g} to {sensor.range_max:g} m, {sensor.rate:g} Hz, {noise}"
    )
    if model.battery is not None:
        battery, cruise = model.battery, model.battery.motor_power(drive.speed, 0.0)
        idle = battery.electronics + sensor.power + battery.receiving
        yield (
            f"battery of {battery.capacity_wh:g} Wh: {idle:.1f} W standing, {idle + cruise:.1f} W at "
            f"{drive.speed:g} m/s"
        )
    if model.bumper is None:
        yield "no bumper: contacts are not detected"
    else:
        bumper = model.bumper
        yield f"bumper: centre to {bumper.centre_deg:g}° either side, right and left to {bumper.reach_deg:g}°"
