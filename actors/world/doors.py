"""Doors that are closed and opened while a run goes on: walls for bodies and for range sensors.

Radio does not know of them. What a robot's map shows of a door it shows as ever.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid, outline
from actors.geometry import Point
from actors.world.physics import Arena
from actors.world.sensing import RangeSensors


class _Leaf(NamedTuple):
    """What fills a door."""

    cells: NDArray[np.bool_]
    segments: NDArray[np.float64]


class Doors:
    """All doors of a floor; as long as none is ordered to close, nothing is computed."""

    def __init__(self, solid: OccupancyGrid, visible: OccupancyGrid, radius: float) -> None:
        """`solid` and `visible`: the floor to bodies and to sensors; `radius`: of the largest robot, m."""
        self._solid = solid
        self._visible = visible
        self._doorways = Doorways(solid, radius)
        self._closed: dict[int, _Leaf] = {}
        self._closing: dict[int, _Leaf] = {}
        """Doors that wait until nobody stands in the way."""

    def close(self, point: Point) -> None:
        """Let the door at a point close with the next `settle` at which it can.

        Raises DoorError where there is none, or it is closed or closing.
        """
        door = self._doorways.at(point)
        if door.index in self._closed or door.index in self._closing:
            raise DoorError(f"the door at ({point.x:g}, {point.y:g}) is closed already")
        cells = self._doorways.closed(door)
        alone = replace(self._solid, cells=np.where(cells, OCCUPIED, FREE).astype(np.uint8))
        self._closing[door.index] = _Leaf(cells, outline(alone, beyond=False))

    def open(self, point: Point, arena: Arena, sensors: RangeSensors) -> None:
        """Open the door at a point, or let it be if it was yet to close. Raises DoorError if it is open."""
        door = self._doorways.at(point).index
        if self._closing.pop(door, None) is not None:
            return
        if self._closed.pop(door, None) is None:
            raise DoorError(f"the door at ({point.x:g}, {point.y:g}) is open already")
        arena.open_door(door)
        sensors.look_at(self._seen)

    def settle(self, arena: Arena, sensors: RangeSensors) -> None:
        """Close every door that is to be closed and in which no robot stands."""
        free = [door for door, leaf in self._closing.items() if not arena.in_the_way(leaf.segments)]
        for door in free:
            self._closed[door] = self._closing.pop(door)
            arena.close_door(door, self._closed[door].segments)
        if free:
            sensors.look_at(self._seen)

    @property
    def _seen(self) -> OccupancyGrid:
        """What range sensors see of floor and doors."""
        cells = self._visible.cells
        for leaf in self._closed.values():
            cells = np.where(leaf.cells, np.uint8(OCCUPIED), cells)
        return replace(self._visible, cells=cells)
