"""What a scenario, a map and a robot model mean before anything runs, in words and numbers."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from actors import toml_file
from actors.floor.grid import UNKNOWN, OccupancyGrid, largest_region, passable, reachable
from actors.floor.map_file import load_map, map_warnings
from actors.floor.regions import Regions, regions
from actors.geometry import Point
from actors.radio.radio_model import RadioModel, needed_dbm, radio_model, reach
from actors.robot_model import RobotModel, load_model
from actors.runtime.errors import AcrcError
from actors.task.task import PlaceKey
from cleaning.parameters import CleaningParameters
from deploy.scenario.resolve import ResolvedScenario
from deploy.scenario.stack_tables import presets_of
from deploy.scenario.warnings import out_of_reach, scenario_warnings

_LATTICE: Final = 0.25
"""Between the points at which radio is looked at, m."""


@dataclass(frozen=True, eq=False)
class ScenarioSurvey:
    """What there is to know."""

    resolved: ResolvedScenario
    grid: OccupancyGrid
    radius: float
    """Of the largest robot, m."""
    reached: NDArray[np.bool_]
    """(rows, columns): where the centre of such a robot gets from some start."""
    parts: Regions
    """The floor in regions, with the doors between them."""
    out_of_reach: tuple[PlaceKey, ...]
    """Places that their owner's navigation does not get near enough to."""
    warnings: tuple[str, ...]
    """Expected failures of the run, a sentence each."""
    close: tuple[tuple[PlaceKey, PlaceKey, float], ...]
    """Pairs of one robot's places so near to each other, m, that the first visit may tick both off."""
    radio_reach: float
    """In line of sight, over which half of the longest frames arrive, m."""

    @property
    def surface(self) -> float:
        """That robots get to, m²."""
        return float(self.reached.sum()) * self.grid.resolution**2


def survey(resolved: ResolvedScenario) -> ScenarioSurvey:
    """Look at everything. Raises an AcrcError where a file that the scenario names cannot be read."""
    world, grid = resolved.world, resolved.grid
    radii = {body.id: load_model(body.model, body.sensor).footprint.circumradius for body in world.robots}
    floors = {body.id: reachable(grid, Point(*body.start[:2]), radii[body.id]) for body in world.robots}
    radius = max(radii.values())
    standing = passable(grid, radius)
    return ScenarioSurvey(
        resolved=resolved,
        grid=grid,
        radius=radius,
        reached=np.logical_or.reduce(list(floors.values())),
        parts=regions(grid, standing, grid.clearance),
        out_of_reach=out_of_reach(resolved),
        warnings=scenario_warnings(resolved),
        close=tuple(_close(resolved, CleaningParameters().reach)),
        radio_reach=reach(radio_model(resolved.radio).parameters),
    )


def covered(resolved: ResolvedScenario, grid: OccupancyGrid) -> list[NDArray[np.float64]]:
    """For each robot, (rows, columns) of a lattice: how many dB a frame from its start has left.

    At 0 half of the longest frames arrive; the lattice covers the map, its points `_LATTICE` apart.
    """
    model: RadioModel = radio_model(resolved.radio)
    x, y = lattice(grid)
    points = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    budget = model.parameters.transceiver.tx_power_dbm - needed_dbm(model.parameters)
    starts = np.array([body.start[:2] for body in resolved.world.robots], np.float64)
    loss = model.propagation.loss_db(starts, points)
    return [(budget - row).reshape(len(y), len(x)) for row in loss]


def lattice(grid: OccupancyGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The x and the y of the points at which radio is looked at, m."""
    west, south, (east, north) = grid.origin.x, grid.origin.y, grid.corner
    return _every(west, east), _every(south, north)


def _every(begin: float, end: float) -> NDArray[np.float64]:
    return np.asarray(np.arange(begin + _LATTICE / 2, end, _LATTICE), np.float64)


def _close(resolved: ResolvedScenario, near: float) -> list[tuple[PlaceKey, PlaceKey, float]]:
    found = []
    for body in resolved.world.robots:
        for index, one in enumerate(body.places):
            for other in range(index + 1, len(body.places)):
                apart = math.dist(one, body.places[other])
                if apart < near:
                    found.append((PlaceKey(body.id, index), PlaceKey(body.id, other), apart))
    return found


def sentences(found: ScenarioSurvey) -> Sequence[str]:
    """What a person wants to know first."""
    world, grid = found.resolved.world, found.grid
    places = sum(len(body.places) for body in world.robots)
    doors, count = found.parts.doors, len(world.robots)
    robots = "1 robot" if count == 1 else f"{count} robots"
    width, depth = grid.corner.x - grid.origin.x, grid.corner.y - grid.origin.y
    said = [
        f"{robots}, {places} places, {world.duration_us / 1e6:g} s at most, strategy "
        f"{found.resolved.scenario.run.strategy}, seed {world.seed}",
        f"floor: {width:.1f} m by {depth:.1f} m, of which a robot's centre gets to {found.surface:.0f} m²; "
        f"{found.parts.count} regions, {_narrow_places(len(doors))}",
        "navigation {navigation}, localisation {localisation}".format(**presets_of(found.resolved.scenario)),
        f"radio: half of the longest frames arrive over {found.radio_reach:.1f} m in line of sight",
    ]
    said += [
        f"places {_name(one)} and {_name(other)} are {apart:.2f} m apart: who cleans one cleans the other"
        for one, other, apart in found.close
    ]
    return [*said, *(f"warning: {sentence}" for sentence in found.warnings)]


def as_json(found: ScenarioSurvey) -> dict[str, Any]:
    """The same for programs: m, m², s."""
    world, grid = found.resolved.world, found.grid
    return {
        "is": "scenario",
        "robots": len(world.robots),
        "places": sum(len(body.places) for body in world.robots),
        "duration_s": world.duration_us / 1e6,
        "strategy": found.resolved.scenario.run.strategy,
        "seed": world.seed,
        "floor": {**_size(grid), "reached_m2": found.surface, "narrow_places": len(found.parts.doors)},
        "regions": found.parts.count,
        "radio_reach_m": found.radio_reach,
        "warnings": found.warnings,
        **presets_of(found.resolved.scenario),
        "out_of_reach": [_name(key) for key in found.out_of_reach],
        "close": [
            {"one": _name(one), "other": _name(other), "apart_m": apart} for one, other, apart in found.close
        ],
    }


def _size(grid: OccupancyGrid) -> dict[str, float]:
    return {"width_m": grid.corner.x - grid.origin.x, "depth_m": grid.corner.y - grid.origin.y}


def _narrow_places(count: int) -> str:
    return "1 narrow place" if count == 1 else f"{count or 'no'} narrow place{'s' * (count > 1)}"


def _name(key: PlaceKey) -> str:
    return f"{key.owner}/{key.place}"


WALKER: Final = "turtlebot2"
"""The robot model for which a map is looked at."""


@dataclass(frozen=True, eq=False)
class MapSurvey:
    """What there is to know of a map."""

    name: str
    grid: OccupancyGrid
    warnings: tuple[str, ...]
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
    return MapSurvey(path.name, grid, map_warnings(path), radius, largest_region(grid, radius), parts)


def map_sentences(found: MapSurvey) -> Iterator[str]:
    """What a person wants to know first."""
    grid, cell = found.grid, found.grid.resolution**2
    width, depth = grid.corner.x - grid.origin.x, grid.corner.y - grid.origin.y
    free, unknown = grid.free.sum() * cell, (grid.cells == UNKNOWN).sum() * cell
    yield (
        f"{found.name}: {width:.1f} m by {depth:.1f} m in cells of {grid.resolution:g} m, from "
        f"({grid.origin.x:g}, {grid.origin.y:g}) on; free {free:.0f} m², unknown {unknown:.0f} m²"
    )
    yield from (f"warning: {told}" for told in found.warnings)
    reached = found.reached.sum() * cell
    if not reached:
        yield f"a robot of {2 * found.radius:g} m has room nowhere"
        return
    narrow = _narrow_places(len(found.parts.doors))
    yield f"the centre of a robot of {2 * found.radius:g} m gets to {reached:.0f} m²; {narrow}"
    apart = ((found.parts.labels > 0) & ~found.reached).sum() * cell
    if apart >= cell:
        yield f"{apart:.1f} m² more have room for it, but no way leads there from the largest piece"


def map_as_json(found: MapSurvey) -> dict[str, Any]:
    """The same for programs: m, m²."""
    grid, cell = found.grid, found.grid.resolution**2
    return {
        "is": "map",
        "name": found.name,
        "warnings": list(found.warnings),
        **_size(grid),
        "cell_m": grid.resolution,
        "free_m2": float(grid.free.sum() * cell),
        "unknown_m2": float((grid.cells == UNKNOWN).sum() * cell),
        "reached_m2": float(found.reached.sum() * cell),
        "narrow_places": len(found.parts.doors),
    }


def is_model(path: Path) -> bool:
    """True if a file is a robot model's; of one that cannot be read nobody knows."""
    try:
        content = toml_file.read(path, "robot model")
        return "footprint" in toml_file.tables(content, path)
    except AcrcError:
        return False


def model_as_json(model: RobotModel) -> dict[str, Any]:
    """The same for programs, and all else that the model says, as its file has it."""
    told: dict[str, Any] = TypeAdapter(RobotModel).dump_python(model, mode="json")
    return {"is": "robot model", **told}


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
