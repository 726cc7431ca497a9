"""A run on one page: floor, what everybody did, radio, progress."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from observation.accounting.spells import spells
from observation.evidence.run_evidence import RunEvidence
from observation.picture import floor_picture, lanes, look, style


def draw(run: RunEvidence) -> Figure:
    """The page."""
    doing = spells(run)
    tall = 0.24 * min(max(len(run.robots), 4), 50)
    figure = style.new_figure(11.0, 7.0 + tall)
    grid = figure.add_gridspec(3, 2, height_ratios=[5.0, tall + 0.5, 1.5], width_ratios=[3, 1])
    floor = figure.add_subplot(grid[0, :])
    floor_picture.draw_floor(floor, run.grid)
    floor_picture.draw_run(floor, run, doing)
    floor.set_title(style.title(run), loc="left", fontweight="bold", fontsize=10)
    floor.legend(
        handles=floor_picture.legend(),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.09),
        ncols=2,
        fontsize=7,
        frameon=False,
    )
    below = figure.add_subplot(grid[1, 0])
    lanes.draw(below, run, doing, legend=True)
    below.tick_params(labelbottom=False)
    radio = figure.add_subplot(grid[2, 0], sharex=below)
    _draw_radio(radio, run)
    draw_progress(figure.add_subplot(grid[1:, 1]), run)
    return figure


def write(run: RunEvidence, path: Path) -> None:
    """The page as a PNG or SVG file."""
    with look.applied(style.LOOK):
        style.save(draw(run), path)


def draw_progress(axes: Axes, run: RunEvidence) -> None:
    """Places cleaned, robot by robot."""
    few = style.few(run.robots)
    first = {deed.place: deed for deed in reversed(run.reported)}
    for index, robot in enumerate(run.robots):
        done = sorted(deed.second for deed in first.values() if deed.robot == robot)
        axes.step(
            [0.0, *done, run.end],
            [*range(len(done) + 1), len(done)],
            where="post",
            color=style.colour(index),
            lw=1.2,
            label=robot,
        )
    if few:
        axes.legend(fontsize=7, frameon=False, loc="upper left")
    axes.set_xlim(0.0, run.end)
    axes.set_ylim(0, max(3.0, axes.get_ylim()[1]))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_title("places cleaned", loc="left", fontsize=8.5)
    axes.set_xlabel("simulated time, s")
    axes.grid(alpha=0.25, lw=0.5)


def _draw_radio(axes: Axes, run: RunEvidence) -> None:
    """Frames sent and heard per second, over 5 s each."""
    window = max(1, round(5.0 / max(run.end / len(run.seconds), 1e-9)))
    whole = len(run.seconds) // window * window
    if whole:
        at = np.append(run.seconds[:whole:window], run.end)
        for counts, label, colour in ((run.heard, "heard", "#6baed6"), (run.sent, "sent", "#08306b")):
            rate = counts[:whole].sum(axis=1).reshape(-1, window).sum(axis=1) / 5.0
            rate = np.append(rate, rate[-1])
            axes.step(at, rate, where="post", color=colour, lw=1.2, label=label)
            if label == "heard":
                axes.fill_between(at, rate, step="post", color=colour, alpha=0.35)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("radio frames/s")
    axes.set_xlabel("simulated time, s")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7, frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.96))
