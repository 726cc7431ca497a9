"""What was put on the floor, and what stands there no more."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.colours import WHITE, Colour
from actors.observer.drawing.canvas import CIRCLE, LABEL, TRAIL, Canvas, ring
from actors.observer.glyphs import MARKS

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
