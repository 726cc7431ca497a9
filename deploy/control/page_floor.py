"""What the page is sent of the floor, once."""

import base64
import io
from typing import Final

import numpy as np
from PIL import Image

from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.observer import colours
from actors.robot_model import load_model
from actors.world.world_setup import WorldSetup
from deploy.control.appearance import legend, state_colours
from deploy.control.wire import Floor, Line, Place

_HALF: Final = 40
"""How opaque is what nobody knows, of 255."""


class PageFloor:
    """The floor of a run with its doors, as the page shows it."""

    def __init__(self, setup: WorldSetup, grid: OccupancyGrid) -> None:
        self.radii = {
            robot.id: load_model(robot.model, robot.sensor).footprint.circumradius for robot in setup.robots
        }
        self.doorways = Doorways(grid, max(self.radii.values()))
        self._leaves: dict[int, Line] = {}
        for door in self.doorways.regions.doors:
            try:
                begin, end = self.doorways.leaf(self.doorways.closed(door))
            except DoorError:  # an order to close it would be refused, too
                continue
            self._leaves[door.index] = (begin.x, begin.y, end.x, end.y)
        self.numbers = {index: number for number, index in enumerate(self._leaves)}
        """By a door's index on the map: its place among those that can be closed."""
        self.told = self._told(setup, grid)

    def _told(self, setup: WorldSetup, grid: OccupancyGrid) -> Floor:
        return Floor(
            png=_png(grid),
            west=grid.origin.x,
            south=grid.origin.y,
            width=grid.columns * grid.resolution,
            height=grid.rows * grid.resolution,
            radii=self.radii,
            colours={
                robot: colours.hexadecimal(colours.robot(index)) for index, robot in enumerate(self.radii)
            },
            places=tuple(Place(robot.id, *place) for robot in setup.robots for place in robot.places),
            doors=tuple(self._leaves.values()),
            states=state_colours(),
            legend=legend(),
        )


def _png(grid: OccupancyGrid) -> str:
    cells = grid.cells[::-1]
    alpha = np.where(cells == FREE, 0, np.where(cells == UNKNOWN, _HALF, 255)).astype(np.uint8)
    file = io.BytesIO()
    Image.merge("LA", (Image.new("L", (grid.columns, grid.rows)), Image.fromarray(alpha))).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()
