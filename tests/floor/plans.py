"""Small floor plans written as text, north at the top: `.` free, `#` occupied, `?` unknown."""

import numpy as np

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point

SOUTH_WEST = Point(0.0, 0.0)
STATES = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}


def plan(*lines: str, resolution: float = 1.0, origin: Point = SOUTH_WEST) -> OccupancyGrid:
    cells = np.array([[STATES[sign] for sign in line] for line in reversed(lines)], dtype=np.uint8)
    return OccupancyGrid(cells, resolution, origin)


def random_plan(seed: int, rows: int, columns: int, share_blocking: float) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    cells = np.where(
        rng.random((rows, columns)) < share_blocking, rng.integers(1, 3, (rows, columns)), FREE
    ).astype(np.uint8)
    return OccupancyGrid(cells, 0.25, Point(-3.0, 7.5))


def room(side: float, resolution: float = 0.1) -> OccupancyGrid:
    """An empty square room, its walls one cell thick around the floor from (0, 0) to (side, side)."""
    cells = np.full((round(side / resolution) + 2,) * 2, OCCUPIED, dtype=np.uint8)
    cells[1:-1, 1:-1] = FREE
    return OccupancyGrid(cells, resolution, Point(-resolution, -resolution))
