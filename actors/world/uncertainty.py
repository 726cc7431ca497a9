"""Real-world errors: floor that differs from the map, rays without echo, odometry drift.

All are drawn once from the run's seed; robots receive the unchanged map.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final, NamedTuple, TypeVar

import numpy as np
from msgspec import Meta, structs
from numpy.random import Generator

from actors.array_types import Floats, Octets
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.floor.placement import PlacementError, draw_points
from actors.geometry import Point
from actors.portable.draws import normals
from actors.robot_model import KobukiErrors, RobotModel, StageErrors
from actors.settings import Settings, Share

T = TypeVar("T", StageErrors, KobukiErrors)
_LATTICE: Final = 2.0
"""Distance of points at which the map's errors are independent, m; own choice, as all values below."""
_PANE: Final = 1.0
"""Side of the squares of glass, m."""
_FURNITURE: Final = 0.25
"""Radius of a piece of furniture, m."""
_PASSAGE: Final = 0.6
"""Minimum distance of furniture from walls and other furniture, m, so that robots can pass. From starts and
places its centre is farther away by twice its radius."""


class Uncertainty(Settings, frozen=True):
    """Differences between floor and map, missing echoes and odometry drift."""

    map_error: Annotated[float, Meta(ge=0, le=0.5, extra={"unit": "metres"})] = 0.0
    """Standard deviation of walls from their position on the map, m, per axis."""
    glass: Share = 0.0
    """Share of the walls that range sensors do not detect."""
    furniture: Annotated[int, Meta(ge=0, le=1000)] = 0
    """Number of obstacles of 0.25 m radius that are not on the map."""
    drift: Annotated[float, Meta(ge=0, le=1000)] = 1.0
    """Factor on the errors of the odometry."""
    dropout: Share = 0.0
    """Share of rays without echo in every scan."""


class RealFloor(NamedTuple):
    """The floor that robots move on."""

    solid: OccupancyGrid
    """Cells that bodies collide with."""
    visible: OccupancyGrid
    """Cells that range sensors detect: without glass; rays end at the map's edge."""


def draw_floor(
    plan: OccupancyGrid, dose: Uncertainty, generator: Generator, kept_off: Sequence[Point]
) -> RealFloor:
    """Return the real floor for the map `plan`; no furniture stands near `kept_off`.

    Raises PlacementError if there is no room for the furniture.
    """
    cells = _shifted(plan, dose.map_error, generator) if dose.map_error else plan.cells
    visible = _without_glass(plan, cells, dose.glass, generator) if dose.glass else cells
    solid = replace(plan, cells=cells)
    if not dose.furniture:
        return RealFloor(solid, solid if visible is cells else replace(plan, cells=visible))
    try:
        pieces = draw_points(
            solid,
            dose.furniture,
            rng=generator,
            clearance=_FURNITURE + _PASSAGE,
            apart=2 * _FURNITURE + _PASSAGE,
            keep_off=kept_off,
        )
    except PlacementError as error:
        raise PlacementError(f"uncertainty.furniture = {dose.furniture}: {error}") from None
    x, y = plan.centres()
    occupied = np.zeros(plan.cells.shape, np.bool_)
    for piece in pieces:
        away = np.square(x - piece.x) + np.square(y[:, None] - piece.y)
        occupied |= away <= _FURNITURE * _FURNITURE
    return RealFloor(*(replace(plan, cells=np.where(occupied, OCCUPIED, part)) for part in (cells, visible)))


def with_drift(model: RobotModel, dose: Uncertainty) -> RobotModel:
    """Return the model with its odometry errors scaled by `drift`."""

    def scaled(errors: T, *names: str) -> T:
        return structs.replace(errors, **{name: dose.drift * getattr(errors, name) for name in names})

    gyro = "gyro_noise_deg", "gyro_bias_deg", "gyro_walk_deg"
    stage = scaled(model.stage_errors, "forward", "leftward", "turn")
    kobuki = scaled(model.kobuki_errors, *gyro, "wheel_scale", "wheel_bias", "slip")
    return structs.replace(model, stage_errors=stage, kobuki_errors=kobuki)


def _shifted(plan: OccupancyGrid, error: float, generator: Generator) -> Octets:
    """Return the cells displaced by a smooth random field; walls stay without gaps."""
    rows, columns = np.indices(plan.cells.shape).astype(np.float64)
    down, across = (_smooth(plan, generator) * (error / plan.resolution) for _ in range(2))
    blocked = np.zeros(plan.cells.shape, np.bool_)
    for half in ((0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5)):
        row = np.clip(np.rint(rows + down + half[0]), 0, plan.rows - 1).astype(np.intp)
        column = np.clip(np.rint(columns + across + half[1]), 0, plan.columns - 1).astype(np.intp)
        blocked |= np.equal(plan.cells[row, column], OCCUPIED)
    rest = np.where(np.equal(plan.cells, OCCUPIED), FREE, plan.cells)
    return np.where(blocked, OCCUPIED, rest).astype(np.uint8)


def _smooth(plan: OccupancyGrid, generator: Generator) -> Floats:
    """Return (rows, columns): standard normal at lattice points, bilinear in between."""
    spacing = _LATTICE / plan.resolution
    shape = (int(plan.rows / spacing) + 2, int(plan.columns / spacing) + 2)
    lattice = normals(generator, shape)
    row, column = (np.arange(count) / spacing for count in plan.cells.shape)
    r, c = row.astype(np.intp)[:, None], column.astype(np.intp)[None, :]
    y, x = row[:, None] - r, column[None, :] - c
    south = lattice[r, c] * (1 - x) + lattice[r, c + 1] * x
    north = lattice[r + 1, c] * (1 - x) + lattice[r + 1, c + 1] * x
    return south * (1 - y) + north * y


def _without_glass(plan: OccupancyGrid, cells: Octets, share: float, generator: Generator) -> Octets:
    rows, columns = np.indices(cells.shape)
    side = max(round(_PANE / plan.resolution), 1)
    panes = generator.random((plan.rows // side + 1, plan.columns // side + 1)) < share
    visible = np.equal(cells, OCCUPIED) & ~panes[rows // side, columns // side]
    return np.where(visible, OCCUPIED, FREE).astype(np.uint8)
