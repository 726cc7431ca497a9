"""One-page picture of a run, or of several side by side: floor, lanes of robots, radio, progress."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from acrc_testbed.explanation.time_accounting import CauseInterval, cause_intervals
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.picture import floor_picture, marks, style
from acrc_testbed.picture.floor_picture import DrawnRun
from acrc_testbed.run_model.data import RunData, ordered_changes
from actors.array_types import Floats
from actors.instant import in_seconds
from actors.items import ItemKey
from actors.messages import TaskEvent
from actors.observer import glyphs
from actors.observer.glyphs import (
    ADOPTION,
    PUT,
    WHITE,
    StateGlyph,
    cause_glyphs,
    contrast,
    event_marks,
    hexadecimal,
)
from actors.runtime.errors import printable

_HALF: Final = 0.38
"""Half the height of a lane; lanes are one unit apart."""
_PRODUCTIVE: Final = frozenset({Cause.DRIVING, Cause.IDLE})
_ORDERED: Final = "event or order"


def draw_lanes(axes: Axes, run: RunData, intervals: Sequence[CauseInterval], *, legend: bool) -> None:
    """Draw one lane per robot.

    Symbols: events of the task, in the owner's colour; triangles: adoptions; dashed lines: orders.
    """
    few = glyphs.is_small_swarm(run.robots)
    rows = {robot: row for row, robot in enumerate(lane_order(run, intervals))}
    states = cause_glyphs(run.description.task)
    for one in intervals:
        extent = [(one.begin, one.end - one.begin)], (rows[one.robot] - _HALF, 2 * _HALF)
        axes.broken_barh(*extent, **state_style(states[one.cause]))
    _draw_events(axes, run, rows, few=few)
    for change in ordered_changes(run):
        axes.axvline(change.second, color=hexadecimal(PUT), ls="--", lw=0.8, zorder=3)
    axes.set_yticks(range(len(rows)), list(rows), fontsize=8.5 if few else 6.0)
    for label, robot in zip(axes.get_yticklabels(), rows, strict=True):
        label.set_color(style.colour(run.robots.index(robot)))
        label.set_fontweight("bold")
    axes.set_ylim(len(rows) - 0.4, -0.7)
    axes.set_xlim(0.0, run.end)
    if legend:
        axes.legend(
            handles=lane_legend([run], intervals), ncols=4, handlelength=1.8,
            handleheight=1.1, columnspacing=1.0, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        )  # fmt: skip


def lane_order(run: RunData, intervals: Sequence[CauseInterval]) -> list[str]:
    """Return the robots from top to bottom: few in scenario order, many by lost time, longest first."""
    if glyphs.is_small_swarm(run.robots):
        return list(run.robots)
    lost_time: defaultdict[str, float] = defaultdict(float)
    for one in intervals:
        lost_time[one.robot] += 0.0 if one.cause in _PRODUCTIVE else one.end - one.begin
    return sorted(run.robots, key=lambda robot: -lost_time[robot])


def lane_legend(runs: Sequence[RunData], intervals: Sequence[CauseInterval]) -> list[Artist]:
    """Return legend entries for the colours and marks used."""
    seen = {one.cause for one in intervals}
    states = {word: glyph for run in runs for word, glyph in cause_glyphs(run.description.task).items()}
    kinds: list[Artist] = [
        Patch(label=printable(word), **state_style(glyph)) for word, glyph in states.items() if word in seen
    ]
    used = dict.fromkeys(
        mark
        for run in runs
        for kind, mark in event_marks(run.description.task).items()
        if (run.taken_over if kind == ADOPTION else any(event.kind == kind for event in run.task_events))
    )
    kinds += [marks.legend_entry(mark) for mark in used]
    if any(ordered_changes(run) for run in runs):
        kinds.append(Line2D([], [], color=hexadecimal(PUT), ls="--", lw=0.8, label=_ORDERED))
    return kinds


def state_style(glyph: StateGlyph) -> dict[str, Any]:
    """Return the colour, and a hatch with enough contrast to it."""
    hatch_colour = "#ffffff" if contrast(glyph.colour, WHITE) > 3.0 else style.INK
    colour = hexadecimal(glyph.colour)
    edge = hatch_colour if glyph.hatch else colour
    return {"facecolor": colour, "edgecolor": edge, "hatch": glyph.hatch, "lw": 0}


def _draw_events(axes: Axes, run: RunData, rows: Mapping[str, int], *, few: bool) -> None:
    """Draw events of the task in the middle of the lanes, and adoptions above."""
    symbols = event_marks(run.description.task)
    drawn = [
        (one.robot, in_seconds(one.instant), one.owner, symbols[one.kind], 0.0)
        for one in run.task_events
        if one.kind in symbols
    ]
    drawn += [(one.robot, one.second, one.key.owner, symbols[ADOPTION], -_HALF) for one in run.taken_over]
    for robot, second, owner, symbol, shift in drawn:
        if robot in rows:
            colour = style.robot_colour(run.robots, owner, robot)
            large, small = (9.0, 3.0) if symbol.shape == "tick" else (5.0, 2.0)
            marks.plot(axes, symbol, second, rows[robot] + shift, colour, size=large if few else small)
            if not shift:  # the robot's colour may equal the lane's
                axes.lines[-1].set_path_effects(style.HALO)


def draw(run: RunData) -> Figure:
    """Draw the page of a run."""
    intervals = cause_intervals(run)
    lanes_height = 0.24 * min(max(len(run.robots), 4), 50)
    below_radio = [1.2] * run.description.has_batteries
    figure = style.new_figure(11.0, 7.0 + lanes_height + sum(below_radio))
    heights = [5.0, lanes_height + 0.5, 1.5, *below_radio]
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=[3, 1])
    floor = figure.add_subplot(grid[0, :])
    floor_picture.draw_floor(floor, run.grid)
    drawn = floor_picture.draw_run(floor, run, intervals)
    floor.set_title(style.title(run), loc="left", fontweight="bold", fontsize=10)
    floor.legend(
        handles=floor_picture.legend(drawn.marks, [run.description.task]),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.1),
        ncols=3,
    )
    below = figure.add_subplot(grid[1, 0])
    draw_lanes(below, run, intervals, legend=True)
    below.tick_params(labelbottom=False)
    radio = figure.add_subplot(grid[2, 0], sharex=below)
    _draw_radio(radio, run)
    if below_radio:
        _draw_charges(figure.add_subplot(grid[3, 0], sharex=below), run)
    draw_progress(figure.add_subplot(grid[1:, 1] if glyphs.is_small_swarm(run.robots) else grid[2, 1]), run)
    marks.fix_layout(figure)
    marks.place_labels(floor, drawn.labels, drawn.taken)
    return figure


def done_events(run: RunData) -> list[TaskEvent]:
    """Return the first event of each item of the kind `TaskDeclaration.done`, by time."""
    first: dict[ItemKey | TaskEvent, TaskEvent] = {}
    for event in run.task_events:
        if event.kind == run.description.task.done:
            first.setdefault(event.key or event, event)
    return sorted(first.values(), key=lambda event: event.instant)


def draw_progress(axes: Axes, run: RunData) -> None:
    """Draw items done per robot; for many robots, their mean and percentiles."""
    done = done_events(run)
    by_robot = {
        robot: sorted(in_seconds(event.instant) for event in done if event.robot == robot)
        for robot in run.robots
    }
    if glyphs.is_small_swarm(run.robots):  # colours as in the lanes
        for index, seconds in enumerate(by_robot.values()):
            look: dict[str, Any] = {"where": "post", "color": style.colour(index), "lw": 1.2}
            axes.step([0.0, *seconds, run.end], [*range(len(seconds) + 1), len(seconds)], **look)
    else:
        at = np.linspace(0.0, run.end, 201)
        counts = np.array([np.searchsorted(seconds, at, side="right") for seconds in by_robot.values()])
        low, high = np.percentile(counts, [10, 90], axis=0)
        axes.fill_between(
            at, low, high, step="post", color=style.INK, alpha=0.2, lw=0, label="10 to 90 % of robots"
        )
        axes.step(at, counts.mean(axis=0), where="post", color=style.INK, lw=1.4, label="mean per robot")
        axes.legend(loc="upper left")
    axes.set_xlim(0.0, run.end)
    axes.set_ylim(0, max(3.0, axes.get_ylim()[1]))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    words = f"{printable(run.description.task.items)} {printable(run.description.task.done)}"
    axes.set_title(f"{words} by each robot: {len(done)}{style.of_total(run)}", loc="left", fontsize=8.5)
    axes.set_xlabel("simulated time, s")
    axes.grid(alpha=0.25, lw=0.5)


def _draw_radio(axes: Axes, run: RunData) -> None:
    """Draw frames sent and received per second, in bins of 5 s."""
    window = max(1, round(5.0 / max(run.end / len(run.seconds), 1e-9)))
    whole = len(run.seconds) // window * window
    if whole:
        at = np.append(run.seconds[:whole:window], run.end)
        for counts, label, colour in (
            (run.frames_heard, "received", "#6baed6"),
            (run.frames_sent, "sent", "#08306b"),
        ):
            rate = counts[:whole].sum(axis=1).reshape(-1, window).sum(axis=1) / 5.0
            rate = np.append(rate, rate[-1])
            axes.step(at, rate, where="post", color=colour, lw=1.2, label=label)
            if label == "received":
                axes.fill_between(at, rate, step="post", color=colour, alpha=0.35)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("radio frames/s")
    axes.set_xlabel("simulated time, s")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.96))


def _draw_charges(axes: Axes, run: RunData) -> None:
    """Draw the charge of each robot's battery."""
    for index, robot in enumerate(run.robots):
        axes.plot(run.seconds, run.charge[:, index], color=style.colour(index), lw=1.2, label=robot)
    axes.set_ylim(0.0, 1.05)
    axes.set_ylabel("battery charge")
    axes.set_xlabel("simulated time, s")


_MARGIN: Final = 1.5
"""Margin around trails and items, and the widest strip of floor that is not cut off beyond it, m."""
_COLUMN: Final = 4.0
"""Width of a floor, inches."""


def draw_several(runs: Sequence[RunData]) -> Figure:
    """Draw runs side by side, one column each with floor and lanes."""
    views = [_view(run) for run in runs]
    tall = _COLUMN * min(1.0, max((high[1] - low[1]) / (high[0] - low[0]) for low, high in views))
    figure = style.new_figure((_COLUMN + 0.6) * len(runs), tall + 3.1)
    grid = figure.add_gridspec(2, len(runs), height_ratios=[tall, 1.0])
    end = max(run.end for run in runs)
    intervals_by_run = [cause_intervals(run) for run in runs]
    floors: list[tuple[Axes, DrawnRun]] = []
    for column, (run, intervals, (low, high)) in enumerate(zip(runs, intervals_by_run, views, strict=True)):
        axes = figure.add_subplot(grid[0, column])
        floor_picture.draw_floor(axes, run.grid)
        floors.append((axes, floor_picture.draw_run(axes, run, intervals)))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_title(style.short_title(run), loc="left", fontweight="bold", fontsize=10)
        below = figure.add_subplot(grid[1, column])
        draw_lanes(below, run, intervals, legend=False)
        below.set_xlim(0.0, end)
        below.tick_params(labelbottom=True)
        below.set_xlabel("simulated time, s")
    figure.legend(
        handles=[
            *lane_legend(runs, [one for intervals in intervals_by_run for one in intervals]),
            *floor_picture.legend(
                {mark for _, drawn in floors for mark in drawn.marks}, [run.description.task for run in runs]
            ),
        ],
        loc="outside lower center", ncols=3,
    )  # fmt: skip
    marks.fix_layout(figure)
    for axes, drawn in floors:
        marks.place_labels(axes, drawn.labels, drawn.taken)
    return figure


def write(runs: Sequence[RunData], path: Path) -> None:
    """Write the page of a run, or several runs side by side, as a PNG or SVG file."""
    with style.context(style.LOOK):
        style.save(draw_several(runs) if runs[1:] else draw(runs[0]), path)


def _view(run: RunData) -> tuple[Floats, Floats]:
    """Return the south-west and north-east corners of the part of the floor to show, m, each (2,)."""
    items = [(one.mark.x, one.mark.y) for one in floor_picture.shown_items(run)]
    points = np.concatenate([run.true[..., :2].reshape(-1, 2), np.array(items).reshape(-1, 2)])
    grid, low, high = run.grid, points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    first, last = (np.array(corner) for corner in (grid.origin, grid.corner))
    return np.where(low - first < _MARGIN, first, low), np.where(last - high < _MARGIN, last, high)
