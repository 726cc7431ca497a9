"""Doors and regions of a floor: where only one robot has room, and what lies between such places.

A region is wide floor, with `room` to the walls, and its rim up to them, niches included. The rim is as
wide as the body's centre can go beyond the wide floor and no wider, so that regions do not meet through a
door in a thin wall. What is left and touches two regions or more is a door, however long.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor import flood
from actors.floor.distance import squared_distance
from actors.floor.door import Door
from actors.floor.grid import Cell, OccupancyGrid

ROOM: Final = 0.8
"""Wide is where the walls are so far from the middle, m. Own choice: in the corridor map's necks, 1.5 m wide,
robots of 0.35 m that meet head-on stop for good, for the chapter's local planner keeps to the middle."""


@dataclass(frozen=True, eq=False)
class Regions:
    """A floor taken apart."""

    labels: NDArray[np.int32]
    """(rows, columns): 0 where the robot's centre cannot be, 1 to `count` in that region, `count` + 1 + index
    in that door."""
    count: int
    """How many regions there are."""
    doors: tuple[Door, ...]
    """In the order of their southernmost, then westernmost cells."""


def regions(
    grid: OccupancyGrid, passable: NDArray[np.bool_], clearance: NDArray[np.float64], room: float = ROOM
) -> Regions:
    """The regions of the `passable` cells, (rows, columns), with their `clearance`, m, and the doors between.

    Passable floor without any wide place, if it is on its own, is a region, too.
    """
    wide = passable & (clearance >= room)
    rim = room - float(clearance[passable].min(initial=room)) + grid.resolution
    opened = passable & (squared_distance(wide) <= (rim / grid.resolution) * (rim / grid.resolution))
    labels = flood.regions(opened)
    count = int(labels.max())
    narrow = flood.regions(passable & ~opened)
    doors: list[Door] = []
    named = labels.copy()
    for number in range(1, int(narrow.max()) + 1):
        cells = narrow == number
        touched = touching(labels, cells)
        if len(touched) > 1:
            doors.append(_door(len(doors), grid, cells, clearance, touched))
            named[cells] = -len(doors)
            continue
        if not touched:
            count += 1
        named[cells] = touched[0] if touched else count
    named = np.where(named < 0, count - named, named).astype(np.int32)
    named.setflags(write=False)
    return Regions(named, count, tuple(doors))


def touching(labels: NDArray[np.int32], cells: NDArray[np.bool_]) -> tuple[int, ...]:
    """The labels of regions and doors beside these cells, ascending."""
    beside = np.zeros_like(cells)
    beside[1:] |= cells[:-1]
    beside[:-1] |= cells[1:]
    beside[:, 1:] |= cells[:, :-1]
    beside[:, :-1] |= cells[:, 1:]
    return tuple(int(label) for label in np.unique(labels[beside]) if label > 0)


def _door(
    index: int,
    grid: OccupancyGrid,
    cells: NDArray[np.bool_],
    clearance: NDArray[np.float64],
    touched: tuple[int, ...],
) -> Door:
    within = np.where(cells, clearance, 0.0)
    row, column = divmod(int(np.argmax(within)), grid.columns)
    return Door(index, grid.centre(Cell(row, column)), touched)
