"""Draws the map, the legend, and what was put on the floor."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.observer.drawing.canvas import CIRCLE, LABEL, TRAIL, Canvas, ring
from actors.observer.glyphs import DOOR, FLOOR, GROUND, MARKS, WALL, WHITE, Colour, faded


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


_SIGNS: Final = {
    "ring": "○", "disc": "●", "diamond": "◇", "cross": "✕", "square": "□", "tint": "▒", "bar": "━",
    "dashed ring": "◌",
}  # fmt: skip
"""Marks of the floor, as letters."""
_MORE: Final = (
    ("bright line", "where a robot went in the last 20 s; dim: before"),
    ("thin line", "to where a robot heads"),
    ("blue line", "radio link, the brighter the stronger"),
    ("red or amber ring", "a frame is lost here: collision, or it was sending"),
)


def draw_marks(canvas: Canvas) -> None:
    """What is drawn on the floor, as text."""
    rows = [
        (f"{_SIGNS[mark.shape]} {name}", mark.says) for name, mark in MARKS.items() if mark.shape in _SIGNS
    ]
    rows += [(name, says) for name, says in _MORE]
    text = "\n".join(f"- **{name}**: {says}" for name, says in rows)
    canvas.still("legend/marks", rr.TextDocument(text, media_type="text/markdown"))


def draw_lines(canvas: Canvas, name: str, lines: Mapping[str, Colour]) -> None:
    """The lines of a plot: their names in their colours, below one another."""
    count = len(lines)
    dots = rr.Points2D(
        [(0.0, float(row)) for row in range(count)],
        colors=list(lines.values()),
        radii=[-4.0] * count,
        labels=list(lines),
        show_labels=True,
    )
    canvas.still(f"legend/{name}", dots)


PutThing = tuple[str, tuple[tuple[float, float], ...], float]
"""Kind, one of MARKS; m: middle or both ends; radius, 0 of what is straight."""
_DASHES: Final = 12
"""Of a dashed ring."""
_RINGS: Final = 100.0
"""Of a disc, at most: a recording may hold any radius."""


def draw_things(canvas: Canvas, second: float, things: Sequence[PutThing]) -> None:
    """Draw all that stands there from an instant on."""
    strips: list[NDArray[np.float32]] = []
    colours: list[Colour] = []
    radii: list[float] = []
    names: list[tuple[float, float, float]] = []
    for kind, points, radius in things:
        mark = MARKS[kind]
        for strip, width in _strips(mark.shape, points, radius):
            strips.append(strip)
            colours.append(mark.colour or WHITE)
            radii.append(width)
        middle = np.mean(points, axis=0)
        names.append((float(middle[0]), float(middle[1]), LABEL))
    canvas.at(second, "world/put", rr.LineStrips3D(strips, colors=colours, radii=radii))
    words: Any = [kind for kind, _, _ in things]
    colours = [MARKS[kind].colour or WHITE for kind, _, _ in things]
    label = rr.Points3D(names, labels=words, colors=colours, radii=[0.0] * len(names), show_labels=True)
    canvas.at(second, "world/put/names", label)


def _strips(
    shape: str, points: tuple[tuple[float, float], ...], radius: float
) -> list[tuple[NDArray[np.float32], float]]:
    """Lines and their widths, m, or points if below 0."""
    if not radius:
        return [(np.array([(x, y, TRAIL) for x, y in points], np.float32), -3.0)]
    (x, y), *_ = points
    if shape != "dashed ring":
        rings = round(min(max(2.0, radius / 0.06), _RINGS))
        return [(ring(x, y, radius * (one + 1) / rings, TRAIL), -2.0) for one in range(rings)]
    part = (len(CIRCLE) - 1) // _DASHES
    whole = ring(x, y, radius, TRAIL)
    return [(whole[one * part : one * part + part], -1.5) for one in range(_DASHES)]
