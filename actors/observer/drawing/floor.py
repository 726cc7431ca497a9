"""The floor, from above, north up."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.observer.colours import FLOOR, GROUND, WALL
from actors.observer.drawing.canvas import Canvas


def draw_floor(canvas: Canvas, grid: OccupancyGrid) -> None:
    """Draw the floor plan below /world/map."""
    image = _image(grid)
    rows, columns = image.shape
    canvas.still(
        "world/map",
        rr.GridMap(
            data=image.tobytes(),
            format=rr.components.ImageFormat(
                width=columns, height=rows, color_model="L", channel_datatype="U8"
            ),
            cell_size=grid.resolution,
            translation=(grid.origin.x, grid.origin.y, 0.0),
            colormap=rr.components.Colormap.Grayscale,
            draw_order=-10.0,
        ),
    )


def _image(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """The cells in grey; the viewer wants the north edge first."""
    values = np.full(grid.cells.shape, GROUND, dtype=np.uint8)
    values[grid.cells == FREE] = FLOOR
    values[grid.cells == OCCUPIED] = WALL
    return np.flipud(values)
