"""What was put into a run's world, and when, on its floor."""

import math
from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from actors.observer.glyphs import MARKS
from observation.evidence.things_over_time import FloorThing, ThingSpan
from observation.picture import marks
from observation.picture.labels import PointLabel

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
    colour = marks.colour_of(MARKS[thing.kind])
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
    colour = marks.colour_of(MARKS[thing.kind])
    return PointLabel(f"{_WORDS.get(thing.kind, thing.kind)} {lasted}", x, y, colour, 5.0, 7.0)
