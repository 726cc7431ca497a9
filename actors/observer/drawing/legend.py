"""What marks and lines mean, beside what they are drawn in."""

from collections.abc import Mapping
from typing import Final

import rerun as rr

from actors.observer.colours import Colour
from actors.observer.drawing.canvas import Canvas
from actors.observer.glyphs import MARKS

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
