"""Marks of the drawing language, and obstacles, walls, doors and jammers, as matplotlib draws them."""

import math
from collections.abc import Sequence
from typing import Any, Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from actors.observer.glyphs import MARKS, Mark, hexadecimal
from observation.evidence.things_over_time import FloorThing, ThingSpan
from observation.picture import style
from observation.picture.labels import PointLabel

_MARKERS: Final[dict[str, Any]] = {
    "ring": "o", "disc": "o", "diamond": "D", "cross": "x", "square": "s", "soft ring": "o",
    "heavy cross": "X", "snowflake": (6, 2, 0), "tick": "|", "triangle": "v",
}  # fmt: skip
_UNFILLED: Final = frozenset({"ring", "diamond", "square"})
_SOFT: Final = "30"
"""How opaque the middle of a soft ring is, in hexadecimal digits."""


def colour_of(mark: Mark, own: str = style.INK) -> str:
    """The mark's colour; `own` if it has that of a robot."""
    return own if mark.colour is None else hexadecimal(mark.colour)


def plot(
    axes: Axes, name: str, x: float, y: float, own: str, *, size: float, fill: str = "", zorder: float = 5.0
) -> None:
    """A mark at a point; `own`: the robot's colour; `fill`: instead of what the mark's shape has."""
    axes.plot(x, y, ls="", zorder=zorder, **_look(MARKS[name], own, size, fill))


def sample(name: str) -> Artist:
    """The mark with what it says, for a legend."""
    mark = MARKS[name]
    colour = colour_of(mark)
    match mark.shape:
        case "tint":
            return Patch(facecolor=colour, label=mark.says)
        case "bar":
            return Line2D([], [], color=colour, lw=3.0, label=mark.says)
        case "dashed ring":
            return Patch(facecolor="none", edgecolor=colour, ls="--", label=mark.says)
        case "dotted line":
            return Line2D([], [], color=colour, lw=1.2, ls=":", label=mark.says)
    size = {"soft ring": 11.0, "square": 4.0, "tick": 9.0, "heavy cross": 9.0, "snowflake": 9.0}
    fill = "#9a9fa8" if name == "done" else ""
    look = _look(mark, style.INK, size.get(mark.shape, 6.0), fill)
    return Line2D([], [], ls="", label=mark.says, **look)


def _look(mark: Mark, own: str, size: float, fill: str) -> dict[str, Any]:
    colour = colour_of(mark, own)
    middle = fill or ("w" if mark.shape in _UNFILLED else colour)
    if mark.shape == "soft ring":
        middle = colour + _SOFT
    width = 0.6 if mark.shape in ("triangle", "heavy cross") else 1.0 if mark.shape == "soft ring" else 1.4
    edge = "w" if mark.shape == "heavy cross" else colour
    return {"marker": _MARKERS[mark.shape], "ms": size, "mfc": middle, "mec": edge, "mew": width}


_ZORDER: Final = 3.5
_WORDS: Final = {"closed door": "closed"}
"""Where the mark's name says too much."""


def draw(axes: Axes, put: Sequence[ThingSpan]) -> list[PointLabel]:
    """All of them, with what each is and from when to when it was there, to be written beside it."""
    for one in put:
        artist(axes, one.thing)
    return [_label(one) for one in put]


def artist(axes: Axes, thing: FloorThing) -> Line2D | Patch:
    """One thing, drawn on the floor."""
    colour = colour_of(MARKS[thing.kind])
    if thing.radius:
        dashed = MARKS[thing.kind].shape == "dashed ring"
        look = {"fill": False, "ls": "--", "lw": 1.2} if dashed else {"alpha": 0.85}
        circle = Circle(thing.points[0], thing.radius, color=colour, zorder=_ZORDER, **look)
        axes.add_patch(circle)
        return circle
    (line,) = axes.plot(*zip(*thing.points, strict=True), color=colour, lw=3.0, zorder=_ZORDER)
    return line


def _label(one: ThingSpan) -> PointLabel:
    thing = one.thing
    x, y = (math.fsum(axis) / len(thing.points) for axis in zip(*thing.points, strict=True))
    lasted = f"{one.begin:.0f} to {one.end:.0f} s"
    colour = colour_of(MARKS[thing.kind])
    return PointLabel(f"{_WORDS.get(thing.kind, thing.kind)} {lasted}", x, y, colour, 5.0, 7.0)
