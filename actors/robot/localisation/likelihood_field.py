"""Likelihood field of a map: distances to the nearest wall, and free cells."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from actors.array_types import Floats, Int64s, Octets
from actors.floor import raster
from actors.floor.grid import OCCUPIED, OccupancyGrid, SharedCache
from actors.geometry import Covariance
from actors.runtime.errors import AcrcError

LEVELS: Final = 256
"""Number of distance levels, one byte each, so that the whole map fits a processor's cache."""
_RING: Final = 1
"""Width of the ring of cells around the map, which represents everything beyond."""


class LevelGrid(NamedTuple):
    """A field for kernels; read-only."""

    levels: Octets
    """(rows + 2, columns + 2): as in `LikelihoodField`."""
    frame: Floats
    """(3,): as in `LikelihoodField`."""
    step: float
    """Distance per level, m."""


@dataclass(frozen=True, eq=False)
class LikelihoodField:
    """Likelihood field of a map; immutable and shared by all robots of a process."""

    levels: Octets
    """(rows + 2, columns + 2): distance from a cell's centre to that of the nearest wall cell, in steps of
    `max_distance` / 255, at most 255. Includes a ring around the map's cells."""
    frame: Floats
    """(3,): x and y of the south-west corner of `levels`, and the side of a cell, m."""
    max_distance: float
    """Highest distance, m."""
    floor: Floats
    """(k, 2): south-west corners of the free cells, m."""

    @property
    def distances(self) -> Floats:
        """(256,): distance of each level, m."""
        return np.linspace(0.0, self.max_distance, LEVELS, dtype=np.float64)

    @cached_property
    def grid(self) -> LevelGrid:
        """The field for kernels."""
        return LevelGrid(self.levels, self.frame, self.max_distance / (LEVELS - 1))

    @cached_property
    def anywhere(self) -> Covariance:
        """Covariance of the difference of two uniform random poses on free floor, with wrapped headings."""
        side = float(self.frame[2])
        cells = np.rint((self.floor - self.frame[:2]) / side).astype(np.int64)
        x, y = cells[:, 0], cells[:, 1]
        scale = 2 * side * side
        xx, xy, yy = scale * _shared(x, x), scale * _shared(x, y), scale * _shared(y, y)
        return (xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, math.pi * math.pi / 3)

    def poses(self, generator: Generator, count: int) -> Floats:
        """Return uniform random poses on free floor: (3, count), x, y, heading."""
        draws = generator.random((3, count))
        corners = self.floor[generator.integers(len(self.floor), size=count)]
        side = self.frame[2]
        return np.stack(
            (corners[:, 0] + side * draws[0], corners[:, 1] + side * draws[1], np.pi - 2 * np.pi * draws[2])
        )


def _shared(x: Int64s, y: Int64s) -> float:
    """Return the covariance of two integer columns, with exact sums."""
    count, products = len(x), x * y
    of_x, of_y, of_both = (int(column.sum(dtype=np.int64)) for column in (x, y, products))
    return (count * of_both - of_x * of_y) / (count * count)


_FIELDS: Final = SharedCache[LikelihoodField]()


def likelihood_field(plan: OccupancyGrid, max_distance: float) -> LikelihoodField:
    """Return the field of a floor plan, with distances up to `max_distance`, m.

    Only occupied cells are walls: if unknown cells were, beams that are too long would fit best on maps with
    unknown surroundings and draw the particles outward. Outside the map the distance is infinite (both as in
    amcl: ros-planning/navigation, map_cspace.cpp and amcl_laser.cpp, LikelihoodFieldModel). Raises AcrcError
    for a plan without free cells, and a distance that is not above 0.
    """
    if not max_distance > 0:
        raise AcrcError(f"max_distance of the likelihood field is {max_distance:g} m; it must be above 0 m")
    return _FIELDS.get((plan.content, max_distance), lambda: _field(plan, max_distance))


def _field(plan: OccupancyGrid, max_distance: float) -> LikelihoodField:
    rows, columns = np.nonzero(plan.free)
    if not rows.size:
        raise AcrcError(
            f"the map of {plan.rows} x {plan.columns} cells has no free cell; robots need free floor"
        )
    metres = np.sqrt(raster.squared_distance(plan.cells == OCCUPIED)) * plan.resolution
    inner = np.rint(np.minimum(metres / max_distance, 1.0) * (LEVELS - 1)).astype(np.uint8)
    levels = np.pad(inner, _RING, constant_values=LEVELS - 1)
    west, south = plan.origin.x, plan.origin.y
    offset = _RING * plan.resolution
    frame = np.array([west - offset, south - offset, plan.resolution])
    floor = np.column_stack((west + columns * plan.resolution, south + rows * plan.resolution))
    for shared in (levels, frame, floor):
        shared.setflags(write=False)
    return LikelihoodField(levels, frame, max_distance, floor)


def example_field() -> LikelihoodField:
    """Return a small field for fingerprints, read-only like the robot's, to compile the same variants."""
    row, column = np.indices((50, 50))
    levels = np.minimum(12 * np.minimum(row, abs(column - 20)), 255).astype(np.uint8)
    frame = np.array([-0.5, -0.5, 0.1])
    for shared in (levels, frame):
        shared.setflags(write=False)
    return LikelihoodField(levels, frame, 2.0, np.empty((0, 2)))
