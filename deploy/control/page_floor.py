"""Floor, colours and recent orders as the map page receives them."""

import base64
import io
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from PIL import Image

from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, OWN_STATES, WHITE, Colour, Mark, contrast, hexadecimal
from actors.robot_model import load_model
from actors.world.world_setup import WorldSetup
from deploy.control.wire import Floor, LegendEntry, Line, Place

STATES: Final = ("driving", "standing", "blocked", "idle", "frozen", "off")
"""What a robot may be, seen from outside. "standing": it means to visit places, and stays where it is;
"blocked": the same with another robot near it; "idle": it stays, and means to visit none."""
_BLACK: Final[Colour] = (0, 0, 0)
_MARKS: Final[Mapping[str, Mark]] = MappingProxyType({
    **{name: MARKS[name] for name in ("open", "given")},
    "done": MARKS["done"]._replace(shape="dim disc", says="place reported as done"),
    "given up": MARKS["given up"]._replace(says="place given up"),
    "off": MARKS["off"]._replace(says="robot off"),
    "frozen": MARKS["frozen"]._replace(says="robot frozen"),
    "blocked": Mark("blocked", OWN_STATES["blocked"].colour, "robot blocked: it stays, and by whom"),
    "destination": Mark("dashes", None, "the place that a robot says it visits next"),
    "trail": Mark("trail", None, "where a robot was in the last 20 s"),
    "link": Mark("link", None, "one robot heard the other in the last 3 s"),
    **{name: MARKS[name] for name in ("door", "closed door", "wall", "obstacle", "jammer")},
})  # fmt: skip


def state_colours() -> dict[str, tuple[str, str]]:
    """The colour of each state, and that of letters on it: white or black, whichever is read better."""
    grounds = {state: OWN_STATES[state].colour for state in STATES}
    return {
        state: (hexadecimal(ground), hexadecimal(max(WHITE, _BLACK, key=lambda ink: contrast(ink, ground))))
        for state, ground in grounds.items()
    }


def legend() -> tuple[LegendEntry, ...]:
    """Every mark that the page draws."""
    return tuple(
        LegendEntry(name, mark.shape, hexadecimal(mark.colour) if mark.colour else "", mark.says)
        for name, mark in _MARKS.items()
    )


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
                robot: glyphs.hexadecimal(glyphs.robot(index)) for index, robot in enumerate(self.radii)
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
