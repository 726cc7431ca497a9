"""Several runs beside each other: the floor of each, and what its robots did below."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acrc_testbed.accounting.account import Spell, spells
from acrc_testbed.picture import floor_picture, lanes, marks, style
from acrc_testbed.picture.floor_picture import DrawnRun
from acrc_testbed.run_model.data import RunData

_MARGIN: Final = 1.5
"""Around what happened, m."""


def draw(runs: Sequence[RunData]) -> Figure:
    """A column for each run."""
    figure = style.new_figure(4.6 * len(runs), 6.6)
    grid = figure.add_gridspec(2, len(runs), height_ratios=[4.2, 1.0])
    end = max(run.end for run in runs)
    done = [spells(run) for run in runs]
    floors: list[tuple[Axes, DrawnRun]] = []
    for column, (run, doing) in enumerate(zip(runs, done, strict=True)):
        axes = figure.add_subplot(grid[0, column])
        floors.append((axes, _draw_floor(axes, run, doing)))
        axes.set_title(style.short_title(run), loc="left", fontweight="bold", fontsize=10)
        below = figure.add_subplot(grid[1, column])
        lanes.draw(below, run, doing, legend=False)
        below.set_xlim(0.0, end)
        below.tick_params(labelbottom=True)
        below.set_xlabel("simulated time, s")
    figure.legend(
        handles=[
            *lanes.key(runs, [one for doing in done for one in doing]),
            *floor_picture.legend({kind for _, drawn in floors for kind in drawn.kinds}),
        ],
        loc="outside lower center", ncols=3, fontsize=7, frameon=False,
    )  # fmt: skip
    marks.settle(figure)
    for axes, drawn in floors:
        marks.place(axes, drawn.labels, drawn.taken)
    return figure


def write(runs: Sequence[RunData], path: Path) -> None:
    """The picture as a PNG or SVG file."""
    with style.applied(style.LOOK):
        style.save(draw(runs), path)


def _draw_floor(axes: Axes, run: RunData, doing: Sequence[Spell]) -> DrawnRun:
    """The part of the floor where something happened."""
    floor_picture.draw_floor(axes, run.grid)
    drawn = floor_picture.draw_run(axes, run, doing)
    points = np.concatenate(
        [run.true[..., :2].reshape(-1, 2), [(place.x, place.y) for place in run.outcomes]]
    )
    (west, south), (east, north) = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    axes.set_xlim(max(west, run.grid.origin.x), min(east, run.grid.corner.x))
    axes.set_ylim(max(south, run.grid.origin.y), min(north, run.grid.corner.y))
    return drawn
