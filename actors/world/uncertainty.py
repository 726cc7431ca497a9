"""What makes robots lose their way: floor and map that differ, rays without echo, odometry that drifts.

All of it is drawn once, from the run's seed; robots have the map as it is in its file.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final, NamedTuple, TypeVar

import numpy as np
from msgspec import Meta
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.floor.placement import PlacementError, draw_points
from actors.geometry import Point
from actors.portable.draws import normals
from actors.settings import Settings, Share
from actors.world.odometry import KobukiErrors, StageErrors

T = TypeVar("T", StageErrors, KobukiErrors)
_LATTICE: Final = 2.0
"""The map's errors at points so far apart, m, are independent of each other; own choice, as all below."""
_PANE: Final = 1.0
"""Glass comes in squares of this side, m."""
_FURNITURE: Final = 0.25
"""Radius of a thing on the floor, m,"""
_PASSAGE: Final = 0.6
"""and how far it is from walls and other things at least, m: a robot gets past it. From robots' starts and
places its middle is twice its radius farther."""


class Uncertainty(Settings, frozen=True):
    """How the floor differs from the robots' map, what sensors miss, how odometry drifts."""

    map_error: Annotated[float, Meta(ge=0, le=0.5, extra={"unit": "metres"})] = 0.0
    """Standard deviation of how far a wall is from where the map has it, m, by direction."""
    glass: Share = 0.0
    """Share of the walls that range sensors look through."""
    furniture: Annotated[int, Meta(ge=0, le=1000)] = 0
    """So many things on the floor, of 0.25 m radius, that the map does not have."""
    drift: Annotated[float, Meta(ge=0, le=1000)] = 1.0
    """The odometry's errors are so many times as large as those of its kind."""
    dropout: Share = 0.0
    """Share of the rays of every scan that give no echo, whatever they hit."""


class RealFloor(NamedTuple):
    """What is really there."""

    solid: OccupancyGrid
    """What bodies run into."""
    visible: OccupancyGrid
    """What range sensors see: where there is glass nothing is, nor outside it; rays end at the map's edge."""


def floor(
    plan: OccupancyGrid, dose: Uncertainty, generator: Generator, kept_off: Sequence[Point]
) -> RealFloor:
    """The floor behind a robots' map `plan`; no furniture stands at `kept_off`.

    Raises PlacementError if there is no room for the furniture.
    """
    cells = _shifted(plan, dose.map_error, generator) if dose.map_error else plan.cells
    seen = _without_glass(plan, cells, dose.glass, generator) if dose.glass else cells
    solid = replace(plan, cells=cells)
    if not dose.furniture:
        return RealFloor(solid, solid if seen is cells else replace(plan, cells=seen))
    try:
        things = draw_points(
            solid,
            dose.furniture,
            rng=generator,
            clearance=_FURNITURE + _PASSAGE,
            apart=2 * _FURNITURE + _PASSAGE,
            keep_off=kept_off,
        )
    except PlacementError as error:
        raise PlacementError(f"uncertainty.furniture is {dose.furniture}, but {error}") from None
    x, y = plan.centres()
    taken = np.zeros(plan.cells.shape, np.bool_)
    for thing in things:
        away = np.square(x - thing.x) + np.square(y[:, None] - thing.y)
        taken |= away <= _FURNITURE * _FURNITURE
    return RealFloor(*(replace(plan, cells=np.where(taken, OCCUPIED, part)) for part in (cells, seen)))


def drifting(dose: Uncertainty) -> tuple[StageErrors, KobukiErrors]:
    """Return the errors of both kinds of odometry, scaled by `drift`."""

    def scaled(errors: T, *names: str) -> T:
        return replace(errors, **{name: dose.drift * getattr(errors, name) for name in names})

    gyro = "gyro_noise_deg", "gyro_bias_deg", "gyro_walk_deg"
    stage = scaled(StageErrors(), "forward", "leftward", "turn")
    return stage, scaled(KobukiErrors(), *gyro, "wheel_scale", "slip")


def _shifted(plan: OccupancyGrid, error: float, generator: Generator) -> NDArray[np.uint8]:
    """Each cell is what the map has where a smooth field of errors leads; walls stay without gaps."""
    rows, columns = np.indices(plan.cells.shape).astype(np.float64)
    down, across = (_smooth(plan, generator) * (error / plan.resolution) for _ in range(2))
    blocked = np.zeros(plan.cells.shape, np.bool_)
    for half in ((0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5)):
        row = np.clip(np.rint(rows + down + half[0]), 0, plan.rows - 1).astype(np.intp)
        column = np.clip(np.rint(columns + across + half[1]), 0, plan.columns - 1).astype(np.intp)
        blocked |= np.equal(plan.cells[row, column], OCCUPIED)
    rest = np.where(np.equal(plan.cells, OCCUPIED), FREE, plan.cells)
    return np.where(blocked, OCCUPIED, rest).astype(np.uint8)


def _smooth(plan: OccupancyGrid, generator: Generator) -> NDArray[np.float64]:
    """(rows, columns): standard normal at the points of a lattice, and linear between them."""
    spacing = _LATTICE / plan.resolution
    shape = (int(plan.rows / spacing) + 2, int(plan.columns / spacing) + 2)
    lattice = normals(generator, shape)
    row, column = (np.arange(count) / spacing for count in plan.cells.shape)
    r, c = row.astype(np.intp)[:, None], column.astype(np.intp)[None, :]
    y, x = row[:, None] - r, column[None, :] - c
    south = lattice[r, c] * (1 - x) + lattice[r, c + 1] * x
    north = lattice[r + 1, c] * (1 - x) + lattice[r + 1, c + 1] * x
    smooth: NDArray[np.float64] = south * (1 - y) + north * y
    return smooth


def _without_glass(
    plan: OccupancyGrid, cells: NDArray[np.uint8], share: float, generator: Generator
) -> NDArray[np.uint8]:
    rows, columns = np.indices(cells.shape)
    side = max(round(_PANE / plan.resolution), 1)
    panes = generator.random((plan.rows // side + 1, plan.columns // side + 1)) < share
    seen = np.equal(cells, OCCUPIED) & ~panes[rows // side, columns // side]
    return np.where(seen, OCCUPIED, FREE).astype(np.uint8)
