"""The floor, from above, north up."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.observer.colours import FLOOR, GROUND, WALL, faded
from actors.observer.drawing.canvas import Canvas
from actors.observer.glyphs import DOOR


def draw_floor(canvas: Canvas, grid: OccupancyGrid, doors: NDArray[np.bool_] | None = None) -> None:
    """Draw the floor plan below /world/map; `doors`: (rows, columns), cells that get a tint."""
    image = _image(grid, np.zeros(grid.cells.shape, np.bool_) if doors is None else doors)
    rows, columns, _ = image.shape
    canvas.still(
        "world/map",
        rr.GridMap(
            data=image.tobytes(),
            format=rr.components.ImageFormat(
                width=columns, height=rows, color_model="RGB", channel_datatype="U8"
            ),
            cell_size=grid.resolution,
            translation=(grid.origin.x, grid.origin.y, 0.0),
            draw_order=-10.0,
        ),
    )


def _image(grid: OccupancyGrid, doors: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The cells in grey, (rows, columns, 3); the viewer wants the north edge first."""
    values = np.full((*grid.cells.shape, 3), GROUND, dtype=np.uint8)
    values[grid.cells == FREE] = FLOOR
    values[grid.cells == OCCUPIED] = WALL
    values[doors] = faded(DOOR, 0.3)
    return np.ascontiguousarray(np.flipud(values))
