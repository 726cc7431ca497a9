"""A run on one page: floor, what everybody did, radio, progress."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from acrc_testbed.accounting.account import spells
from acrc_testbed.picture import floor_picture, lanes, marks, style
from acrc_testbed.run_model.data import RunData


def draw(run: RunData) -> Figure:
    """The page."""
    doing = spells(run)
    tall = 0.24 * min(max(len(run.robots), 4), 50)
    figure = style.new_figure(11.0, 7.0 + tall)
    grid = figure.add_gridspec(3, 2, height_ratios=[5.0, tall + 0.5, 1.5], width_ratios=[3, 1])
    floor = figure.add_subplot(grid[0, :])
    floor_picture.draw_floor(floor, run.grid)
    drawn = floor_picture.draw_run(floor, run, doing)
    floor.set_title(style.title(run), loc="left", fontweight="bold", fontsize=10)
    floor.legend(
        handles=floor_picture.legend(drawn.kinds),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.09),
        ncols=3,
        fontsize=7,
        frameon=False,
    )
    below = figure.add_subplot(grid[1, 0])
    lanes.draw(below, run, doing, legend=True)
    below.tick_params(labelbottom=False)
    radio = figure.add_subplot(grid[2, 0], sharex=below)
    _draw_radio(radio, run)
    draw_progress(figure.add_subplot(grid[1:, 1] if style.few(run.robots) else grid[2, 1]), run)
    marks.settle(figure)
    marks.place(floor, drawn.labels, drawn.taken)
    return figure


def write(run: RunData, path: Path) -> None:
    """The page as a PNG or SVG file."""
    with style.applied(style.LOOK):
        style.save(draw(run), path)


def draw_progress(axes: Axes, run: RunData) -> None:
    """Places cleaned: robot by robot; of many robots their mean, and how far they differ."""
    first = {deed.place: deed for deed in reversed(run.reported)}
    by_robot = {
        robot: sorted(deed.second for deed in first.values() if deed.robot == robot) for robot in run.robots
    }
    if style.few(run.robots):
        for index, (robot, done) in enumerate(by_robot.items()):
            ends = [*range(len(done) + 1), len(done)]
            look: dict[str, Any] = {"where": "post", "color": style.colour(index), "lw": 1.2, "label": robot}
            axes.step([0.0, *done, run.end], ends, **look)
    else:
        at = np.linspace(0.0, run.end, 201)
        counts = np.array([np.searchsorted(done, at, side="right") for done in by_robot.values()])
        low, high = np.percentile(counts, [10, 90], axis=0)
        axes.fill_between(
            at, low, high, step="post", color=style.INK, alpha=0.2, lw=0, label="of 8 robots in 10"
        )
        axes.step(at, counts.mean(axis=0), where="post", color=style.INK, lw=1.4, label="mean of a robot")
    axes.legend(fontsize=7, frameon=False, loc="upper left")
    axes.set_xlim(0.0, run.end)
    axes.set_ylim(0, max(3.0, axes.get_ylim()[1]))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_title(f"places cleaned: {len(first)} of {len(run.outcomes)}", loc="left", fontsize=8.5)
    axes.set_xlabel("simulated time, s")
    axes.grid(alpha=0.25, lw=0.5)


def _draw_radio(axes: Axes, run: RunData) -> None:
    """Frames sent and heard per second, over 5 s each."""
    window = max(1, round(5.0 / max(run.end / len(run.seconds), 1e-9)))
    whole = len(run.seconds) // window * window
    if whole:
        at = np.append(run.seconds[:whole:window], run.end)
        for counts, label, colour in (
            (run.frames_heard, "heard", "#6baed6"),
            (run.frames_sent, "sent", "#08306b"),
        ):
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
