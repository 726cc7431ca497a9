"""The drawing language on one sheet; `python -m observation.picture.glyph_sheet FILE` draws it."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from actors.observer.glyphs import MARKS, OWN_STATES, SEEN_STATES, StateGlyph
from observation.picture import lanes, look, marks, style


def draw() -> Figure:
    """All states and marks, with what they are called."""
    figure = style.new_figure(9.5, 3.1)
    columns = figure.subplots(1, 4, width_ratios=[1.1, 0.8, 1.9, 0.5])
    _column(columns[0], "by ground truth", _states(SEEN_STATES))
    _column(columns[1], "by its own account", _states(OWN_STATES))
    _column(columns[2], "on the floor and in lanes", [marks.sample(name) for name in MARKS])
    robots = [Patch(facecolor=colour, label=f"r{number}") for number, colour in enumerate(style.ROBOTS, 1)]
    _column(columns[3], "robots", robots)
    return figure


def write(path: Path) -> None:
    """The sheet as a PNG or SVG file."""
    with look.applied(style.LOOK):
        style.save(draw(), path)


def _states(states: Mapping[str, StateGlyph]) -> list[Artist]:
    return [Patch(label=word, **lanes.look_of(glyph)) for word, glyph in states.items()]


def _column(axes: Axes, title: str, handles: Sequence[Artist]) -> None:
    axes.set_axis_off()
    axes.set_title(title, loc="left", fontweight="bold", fontsize=9)
    axes.legend(
        handles=handles, loc="upper left", frameon=False, fontsize=8, handlelength=2.4, handleheight=1.1,
        borderaxespad=0.0, borderpad=0.0,
    )  # fmt: skip


if __name__ == "__main__":
    write(Path(sys.argv[1]))
