"""Pictures of a scenario, a map or a robot model."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Wedge

from acrc_testbed.picture import floor_picture, marks, style
from actors.array_types import Floats
from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.observer import glyphs
from actors.radio.radio_model import radio_model, required_dbm
from actors.robot_model import RobotModel
from actors.world.program import initial_marks
from deploy.scenario.map_survey import MapSurvey
from deploy.scenario.resolve import ResolvedScenario
from deploy.scenario.survey import ScenarioSurvey

_LATTICE: Final = 0.25
"""Spacing of the points at which radio range is computed, m."""


def draw_scenario(found: ScenarioSurvey) -> Figure:
    """Return the picture of a scenario."""
    figure, axes = _floor_figure(found)
    world = found.resolved.world
    few = glyphs.is_small_swarm(world.ids)
    if few:
        _draw_radio(axes, found)
    for index, body in enumerate(world.robots):
        colour, (x, y, heading) = style.colour(index), body.start
        axes.add_patch(Circle((x, y), found.radius, color=colour, zorder=6))
        axes.plot(
            [x, x + 0.35 * np.cos(heading)], [y, y + 0.35 * np.sin(heading)], color=colour, lw=2, zorder=6
        )
        if few:
            axes.annotate(
                body.id, (x, y), xytext=(6, 6), textcoords="offset points", color=colour, zorder=9,
                fontweight="bold",
            )  # fmt: skip
    symbols = glyphs.item_marks(world.task.declaration)
    items = initial_marks(world)
    for mark in items:
        colour = style.robot_colour(world.ids, mark.owner, mark.by)
        if mark.key in found.out_of_reach:
            axes.plot(mark.x, mark.y, marker="X", ms=8.0, mfc="w", mec=colour, mew=1.3, zorder=5)
        elif mark.state in symbols:
            marks.plot(axes, symbols[mark.state], mark.x, mark.y, colour, size=4.6 if few else 2.6)
    count, words = world.initial_work, world.task.declaration
    work = f"{count} {words.items}" if count else f"task {words.name}"
    _set_title(axes, f"{found.name}: {len(world.robots)} robots, {work}, seed {world.seed}")
    states = {mark.state for mark in items}
    shown = [mark for state, mark in symbols.items() if state in states]
    _add_legend(figure, _legend(found, shown, few=few), 3)
    return figure


def write(found: MapSurvey | RobotModel, path: Path) -> None:
    """Write the picture of a scenario, a map or a robot model to a PNG or SVG file."""
    with style.context(style.LOOK):
        if isinstance(found, RobotModel):
            figure = draw_model(found)
        else:
            figure = draw_scenario(found) if isinstance(found, ScenarioSurvey) else draw_map(found)
        style.save(figure, path)


def _floor_figure(found: MapSurvey) -> tuple[Figure, Axes]:
    figure = style.new_figure(11.0, 6.6)
    axes = figure.add_subplot()
    floor_picture.draw_floor(axes, found.grid)
    floor_picture.draw_regions(axes, found.grid, found.parts, found.reached)
    return figure, axes


def _floor_legend(found: MapSurvey) -> list[Artist]:
    handles: list[Artist] = [
        Patch(color=floor_picture.DOOR, label="narrow place: robots cannot pass each other")
    ]
    if found.unreachable.any():
        handles.append(Patch(color=floor_picture.SHUT, label="wide enough for a robot, but no path"))
    return handles


def _set_title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontweight="bold", fontsize=10)


def _add_legend(figure: Figure, handles: list[Artist], columns: int) -> None:
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=7, frameon=False)


def _draw_radio(axes: Axes, found: ScenarioSurvey) -> None:
    """Draw the contour around each start at which half of the longest frames arrive."""
    x, y = _lattice(found.grid)
    free = np.array([[found.grid.is_free(Point(east, north)) for east in x.tolist()] for north in y.tolist()])
    contour_style: dict[str, Any] = {"levels": [0.0], "linewidths": 1.0, "linestyles": "dotted", "zorder": 3}
    for index, margin in enumerate(_link_margins(found.resolved, found.grid)):
        if margin[free].min() < 0.0 < margin[free].max():
            axes.contour(x, y, np.where(free, margin, np.nan), colors=[style.colour(index)], **contour_style)


def _link_margins(resolved: ResolvedScenario, grid: OccupancyGrid) -> list[Floats]:
    """Return the link margin from each robot's start, dB, (rows, columns) of a lattice over the map.

    At 0 dB half of the longest frames arrive. Lattice points are `_LATTICE` apart.
    """
    model = radio_model(resolved.radio)
    x, y = _lattice(grid)
    points = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    budget = model.parameters.transceiver.tx_power_dbm - required_dbm(model.parameters)
    starts = np.array([body.start[:2] for body in resolved.world.robots], np.float64)
    loss = model.propagation.loss_db(starts, points)
    return [(budget - row).reshape(len(y), len(x)) for row in loss]


def _lattice(grid: OccupancyGrid) -> tuple[Floats, Floats]:
    """Return the coordinates x and y of the lattice, m."""
    spans = ((grid.origin.x, grid.corner.x), (grid.origin.y, grid.corner.y))
    x, y = (np.arange(begin + _LATTICE / 2, end, _LATTICE, np.float64) for begin, end in spans)
    return x, y


def _legend(found: ScenarioSurvey, shown: Sequence[glyphs.Mark], *, few: bool) -> list[Artist]:
    handles: list[Artist] = [
        Line2D([], [], marker="o", ls="", ms=8, color=style.INK, label="start of a robot"),
    ]
    handles += [marks.legend_entry(mark) for mark in shown]
    if few:
        label = "half of the longest frames from the start arrive up to here"
        handles.append(Line2D([], [], ls="dotted", lw=0.8, color=style.INK, label=label))
    if found.out_of_reach:
        handles.append(Line2D([], [], marker="X", ls="", ms=8, mfc="w", mec=style.INK, label="out of reach"))
    return [*handles, *_floor_legend(found)]


_BODY, _VIEW, _CONTACT = style.ROBOTS[0], "#cfe3f3", style.ROBOTS[1]


def draw_map(found: MapSurvey) -> Figure:
    """Return the picture of a map: floor, doors and unreachable parts."""
    figure, axes = _floor_figure(found)
    _set_title(axes, found.name)
    _add_legend(figure, _floor_legend(found), 2)
    return figure


def draw_model(model: RobotModel) -> Figure:
    """Return the picture of a robot model: body with bumper, and field of view."""
    figure = style.new_figure(9.0, 4.8)
    near, far = figure.subplots(1, 2)
    size = 1.6 * model.footprint.circumradius
    for axes, half in ((near, size), (far, model.sensor.range_max + 2 * size)):
        _draw_view(axes, model)
        _draw_body(axes, model)
        axes.set_xlim(-half, half)
        axes.set_ylim(-half, half)
        axes.set_aspect("equal")
        axes.set_xlabel("forward, m")
        axes.set_ylabel("to the left, m")
        axes.grid(alpha=0.25, lw=0.5)
    _set_title(near, model.name)
    _set_title(far, f"sensor {model.default_sensor}")
    handles = [
        Patch(color=_BODY, alpha=0.35, label="body; line: forward"),
        Line2D([], [], marker="^", ls="", color=style.INK, label="range sensor"),
        Patch(color=_VIEW, label="field of view"),
    ]
    if model.bumper is not None:
        handles.append(Line2D([], [], lw=3, color=_CONTACT, label="bumper: right, centre, left"))
    _add_legend(figure, handles, 4)
    return figure


def _draw_body(axes: Axes, model: RobotModel) -> None:
    body, ahead = model.footprint, model.footprint.circumradius
    patch_style = {"facecolor": to_rgba(_BODY, 0.35), "edgecolor": _BODY, "lw": 1.4, "zorder": 4}
    if body.vertices is None:
        axes.add_patch(Circle((0.0, 0.0), ahead, **patch_style))
    else:
        axes.add_patch(Polygon(np.array(body.vertices), closed=True, **patch_style))
    axes.plot([0.0, ahead], [0.0, 0.0], color=_BODY, lw=1.4, zorder=5)
    if model.bumper is not None:
        centre, side = model.bumper.centre_deg, model.bumper.reach_deg
        for begin, end in ((-side, -centre), (-centre, centre), (centre, side)):
            angles = np.radians(np.linspace(begin + 1.0, end - 1.0, 30))
            ring = 1.05 * ahead * np.array([np.cos(angles), np.sin(angles)])
            axes.plot(*ring, color=_CONTACT, lw=3, zorder=5)


def _draw_view(axes: Axes, model: RobotModel) -> None:
    sensor, mount = model.sensor, model.sensor.mount
    half, ahead = sensor.field_of_view_deg / 2, math.degrees(mount.heading)
    width = sensor.range_max - sensor.range_min
    view = Wedge((mount.x, mount.y), sensor.range_max, ahead - half, ahead + half, width=width, color=_VIEW)
    axes.add_patch(view)
    axes.plot(mount.x, mount.y, marker="^", ms=5, color=style.INK, zorder=6)
