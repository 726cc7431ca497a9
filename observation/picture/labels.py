"""Words beside points of a picture, none of which lies on another one."""

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any, Final, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from observation.picture import style

_AROUND: Final = ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
"""Where words may stand beside a point: right and above, left and above, and so on."""
_FARTHER: Final = (0.0, 6.0, 14.0, 24.0, 38.0)
"""By so many more points away, if nearer there is no room."""
_LINE: Final = 10.0
"""Words that are farther away, points, are joined with their point by a line."""
_COVERS: Final = 8.0
"""Covering a point of somebody else's costs so much; a point farther away costs 1."""


class PointLabel(NamedTuple):
    """Words that belong to a point."""

    words: str
    x: float
    """Of the point, in the axes' units."""
    y: float
    colour: str
    gap: float = 5.0
    """Points between the point and its words: the size of what is drawn there."""
    size: float = 8.5
    bold: bool = False


def settle(figure: Figure) -> None:
    """Fix the layout, so that what is where does not change any more; then labels can be placed."""
    cast(Any, figure).draw_without_rendering()
    figure.set_layout_engine("none")


def place(axes: Axes, labels: Sequence[PointLabel], taken: Iterable[tuple[float, float]] = ()) -> int:
    """Write labels, the first ones first, where none lies on another; gives how many found no room.

    `taken`: points, in the axes' units, on which words should not lie if they can stand elsewhere. The figure
    has to be settled.
    """
    points = [(one.x, one.y) for one in labels]
    covered = axes.transData.transform(np.array([*points, *taken], np.float64).reshape(-1, 2))
    boxes: list[Bbox] = []
    for label in labels:
        found = _room(axes, label, boxes, covered)
        if found is not None:
            boxes.append(found)
    return len(labels) - len(boxes)


def _room(axes: Axes, label: PointLabel, boxes: Sequence[Bbox], covered: NDArray[np.float64]) -> Bbox | None:
    """Write a label; the box that it takes, pixels; None, and nothing is written, without room."""
    said = axes.annotate(
        label.words, (label.x, label.y), xytext=(0, 0), textcoords="offset points", color=label.colour,
        fontsize=label.size, fontweight="bold" if label.bold else "normal", ha="center", va="center",
        zorder=9, path_effects=style.HALO, annotation_clip=False,
    )  # fmt: skip
    figure = axes.get_figure()
    assert figure is not None
    own = said.get_window_extent(cast(Any, figure.canvas).get_renderer())
    pixels, whole = figure.dpi / 72.0, axes.get_window_extent()
    best: tuple[float, float, float, float] | None = None
    for (right, up), more in product(_AROUND, _FARTHER):
        away = label.gap + more
        dx = right * (away + own.width / 2 / pixels) * (0.8 if up else 1.0)
        dy = up * (away * 0.6 + own.height / 2 / pixels)
        box = own.translated(dx * pixels, dy * pixels)
        inside = whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
        if not inside or any(box.overlaps(other) for other in boxes):
            continue
        cost = more / 6.0 + _COVERS * _count(box, covered)
        if best is None or cost < best[0]:
            best = cost, dx, dy, more
    if best is None:
        said.remove()
        return None
    _, dx, dy, more = best
    said.set_position((dx, dy))
    if more > _LINE:
        line = {"arrowstyle": "-", "color": label.colour, "lw": 0.6, "shrinkA": 1.0, "shrinkB": 1.0}
        axes.annotate(
            "", (label.x, label.y), xytext=(dx, dy), textcoords="offset points", arrowprops=line, zorder=8
        )
    return own.translated(dx * pixels, dy * pixels)


def _count(box: Bbox, points: NDArray[np.float64]) -> int:
    """How many points lie in a box."""
    x, y = points.T
    return int(((box.x0 <= x) & (x <= box.x1) & (box.y0 <= y) & (y <= box.y1)).sum())
