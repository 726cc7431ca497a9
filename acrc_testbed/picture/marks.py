"""Marks, floor objects and labels in matplotlib."""

import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any, Final, NamedTuple, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.transforms import Bbox

from acrc_testbed.picture import style
from acrc_testbed.run_model.floor import FloorInterval, FloorObject
from actors.array_types import Floats
from actors.observer.glyphs import MARKS, Mark, hexadecimal

_DIRECTIONS: Final = ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
"""Directions of a label from its point: right above, left above, and so on."""
_EXTRA_DISTANCES: Final = (0.0, 6.0, 14.0, 24.0, 38.0)
"""Additional distances of a label, points, tried in order."""
_MIN_LINE: Final = 10.0
"""Labels farther than this, points, are connected with their point by a line."""
_COVER_COST: Final = 8.0
"""Cost of covering another point; one more step of distance costs 1."""


class PointLabel(NamedTuple):
    """Label of a point."""

    words: str
    x: float
    """Position of the point, axes' units."""
    y: float
    colour: str
    gap: float = 5.0
    """Distance between the point and the label, points: size of the mark."""
    size: float = 8.5
    bold: bool = False


def fix_layout(figure: Figure) -> None:
    """Fix the layout so that labels can be placed."""
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.execute(figure)
    for axes in figure.axes:
        axes.apply_aspect()
    figure.set_layout_engine()  # "none" leaves a placeholder, for which saving draws twice


def place_labels(axes: Axes, labels: Sequence[PointLabel], taken: Iterable[tuple[float, float]] = ()) -> int:
    """Place labels in order without overlaps; return the number of labels without room.

    `taken`: points, in the axes' units, that labels should not cover. Call `fix_layout` first.
    """
    points = [(one.x, one.y) for one in labels]
    covered = axes.transData.transform(np.array([*points, *taken], np.float64).reshape(-1, 2))
    boxes: list[Bbox] = []
    for label in labels:
        box = _place_label(axes, label, boxes, covered)
        if box is not None:
            boxes.append(box)
    return len(labels) - len(boxes)


def _place_label(axes: Axes, label: PointLabel, boxes: Sequence[Bbox], covered: Floats) -> Bbox | None:
    """Write a label and return its box, pixels; None if there is no room."""
    text = axes.annotate(
        label.words, (label.x, label.y), xytext=(0, 0), textcoords="offset points", color=label.colour,
        fontsize=label.size, fontweight="bold" if label.bold else "normal", ha="center", va="center",
        zorder=9, path_effects=style.HALO, annotation_clip=False,
    )  # fmt: skip
    figure = axes.get_figure()
    assert figure is not None
    text_box = text.get_window_extent(cast(Any, figure.canvas).get_renderer())
    pixels, area = figure.dpi / 72.0, axes.get_window_extent()
    best_place = None
    for (right, up), extra in product(_DIRECTIONS, _EXTRA_DISTANCES):
        away = label.gap + extra
        dx = right * (away + text_box.width / 2 / pixels) * (0.8 if up else 1.0)
        dy = up * (away * 0.6 + text_box.height / 2 / pixels)
        box = text_box.translated(dx * pixels, dy * pixels)
        inside = area.x0 <= box.x0 and box.x1 <= area.x1 and area.y0 <= box.y0 and box.y1 <= area.y1
        if not inside or any(box.overlaps(other) for other in boxes):
            continue
        cost = extra / 6.0 + _COVER_COST * _count_inside(box, covered)
        if best_place is None or cost < best_place[0]:
            best_place = cost, dx, dy, extra, box
    if best_place is None:
        text.remove()
        return None
    _, dx, dy, extra, box = best_place
    text.set_position((dx, dy))
    if extra > _MIN_LINE:
        line = {"arrowstyle": "-", "color": label.colour, "lw": 0.6, "shrinkA": 1.0, "shrinkB": 1.0}
        axes.annotate(
            "", (label.x, label.y), xytext=(dx, dy), textcoords="offset points", arrowprops=line, zorder=8
        )
    return box


def _count_inside(box: Bbox, points: Floats) -> int:
    """Count the points in a box."""
    x, y = points.T
    return int(((box.x0 <= x) & (x <= box.x1) & (box.y0 <= y) & (y <= box.y1)).sum())


_MARKERS: Final[dict[str, Any]] = {
    "ring": "o", "disc": "o", "diamond": "D", "cross": "x", "square": "s", "soft ring": "o",
    "heavy cross": "X", "snowflake": (6, 2, 0), "tick": "|", "triangle": "v", "filled ring": "o",
}  # fmt: skip
_UNFILLED: Final = frozenset({"ring", "diamond", "square"})
_SOFT: Final = "30"
"""Opacity of the middle of a soft or filled ring, hexadecimal."""


def colour_of(mark: Mark, robot_colour: str = style.INK) -> str:
    """Return the mark's colour; `robot_colour` if it has the colour of a robot."""
    return robot_colour if mark.colour is None else hexadecimal(mark.colour)


def plot(
    axes: Axes,
    mark: Mark,
    x: float,
    y: float,
    robot_colour: str,
    *,
    size: float,
    fill: str = "",
    zorder: float = 5.0,
) -> None:
    """Draw a mark at a point; `robot_colour`: the robot's colour; `fill`: overrides the fill of the shape."""
    axes.plot(x, y, ls="", zorder=zorder, **line_style(mark, robot_colour, size, fill))


def legend_entry(mark: Mark) -> Artist:
    """Return the legend entry of a mark."""
    colour = colour_of(mark)
    match mark.shape:
        case "tint":
            return Patch(facecolor=colour, label=mark.meaning)
        case "bar":
            return Line2D([], [], color=colour, lw=3.0, label=mark.meaning)
        case "dashed ring":
            return Patch(facecolor="none", edgecolor=colour, ls="--", label=mark.meaning)
        case "dotted line":
            return Line2D([], [], color=colour, lw=1.2, ls=":", label=mark.meaning)
    size = {
        "soft ring": 11.0 if mark.colour else 6.0,
        "square": 4.0,
        "tick": 9.0,
        "heavy cross": 9.0,
        "snowflake": 9.0,
    }
    fill = "#9a9fa8" if mark.shape == "disc" and mark.colour is None else ""
    look = line_style(mark, style.INK, size.get(mark.shape, 6.0), fill)
    return Line2D([], [], ls="", label=mark.meaning, **look)


def line_style(mark: Mark, robot_colour: str, size: float, fill: str) -> dict[str, Any]:
    """Return the properties of a line that draws a mark; arguments as of `plot`."""
    colour = colour_of(mark, robot_colour)
    middle = fill or ("w" if mark.shape in _UNFILLED else colour)
    if mark.shape in ("soft ring", "filled ring"):
        middle = colour + _SOFT
    width = 0.6 if mark.shape in ("triangle", "heavy cross") else 1.0 if mark.shape == "soft ring" else 1.4
    edge = "w" if mark.shape == "heavy cross" else colour
    return {"marker": _MARKERS[mark.shape], "ms": size, "mfc": middle, "mec": edge, "mew": width}


_ZORDER: Final = 3.5
_SHORT_NAMES: Final = {"closed door": "closed"}
"""Shorter labels of kinds."""


def draw_objects(axes: Axes, intervals: Sequence[FloorInterval]) -> list[PointLabel]:
    """Draw floor objects; return their labels with kind and interval."""
    for one in intervals:
        draw_object(axes, one.object)
    return [_label(one) for one in intervals]


def draw_object(axes: Axes, item: FloorObject) -> Line2D | Patch:
    """Draw one floor object."""
    colour = colour_of(MARKS[item.kind])
    if item.is_round:
        dashed = MARKS[item.kind].shape == "dashed ring"
        look = {"fill": False, "ls": "--", "lw": 1.2} if dashed else {"alpha": 0.85}
        circle = Circle(item.points[0], item.radius, color=colour, zorder=_ZORDER, **look)
        axes.add_patch(circle)
        return circle
    (line,) = axes.plot(*zip(*item.points, strict=True), color=colour, lw=3.0, zorder=_ZORDER)
    return line


def _label(one: FloorInterval) -> PointLabel:
    item = one.object
    x, y = (math.fsum(axis) / len(item.points) for axis in zip(*item.points, strict=True))
    interval = f"{one.begin:.0f} to {one.end:.0f} s"
    colour = colour_of(MARKS[item.kind])
    return PointLabel(f"{_SHORT_NAMES.get(item.kind, item.kind)} {interval}", x, y, colour, 5.0, 7.0)
