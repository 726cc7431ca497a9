"""A scenario on its floor: starts, places, doors, what nobody reaches, how far radio gets."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from actors.geometry import Point
from actors.task.words import PlaceKey
from deploy.scenario.survey import ScenarioSurvey, covered, lattice
from observation.picture import floor_picture, look, style


def draw(found: ScenarioSurvey) -> Figure:
    """The picture."""
    figure = style.new_figure(11.0, 6.6)
    axes = figure.add_subplot()
    floor_picture.draw_floor(axes, found.grid)
    floor_picture.draw_regions(axes, found.grid, found.parts, found.reached)
    world = found.resolved.world
    few = style.few([body.id for body in world.robots])
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
        for number, (px, py) in enumerate(body.places):
            shut = PlaceKey(body.id, number) in found.out_of_reach
            mark = {"marker": "X", "ms": 8.0} if shut else {"marker": "o", "ms": 4.6 if few else 2.6}
            axes.plot(px, py, mfc="w", mec=colour, mew=1.3, zorder=5, **mark)  # type: ignore[arg-type]
    scenario = found.resolved.scenario
    axes.set_title(
        f"{Path(scenario.map).stem}: {len(world.robots)} robots, {sum(len(b.places) for b in world.robots)} "
        f"places, seed {world.seed}",
        loc="left", fontweight="bold", fontsize=10,
    )  # fmt: skip
    figure.legend(
        handles=_legend(found, few=few), loc="outside lower center", ncols=3, fontsize=7, frameon=False
    )
    return figure


def write(found: ScenarioSurvey, path: Path) -> None:
    """The picture as a PNG or SVG file."""
    with look.applied(style.LOOK):
        style.save(draw(found), path)


def _draw_radio(axes: Axes, found: ScenarioSurvey) -> None:
    """From each start, to where on the floor half of the longest frames arrive."""
    x, y = lattice(found.grid)
    free = np.array([[found.grid.is_free(Point(east, north)) for east in x.tolist()] for north in y.tolist()])
    look: dict[str, Any] = {"levels": [0.0], "linewidths": 1.0, "linestyles": "dotted", "zorder": 3}
    for index, left in enumerate(covered(found.resolved, found.grid)):
        if left[free].min() < 0.0 < left[free].max():
            axes.contour(x, y, np.where(free, left, np.nan), colors=[style.colour(index)], **look)


def _legend(found: ScenarioSurvey, *, few: bool) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], marker="o", ls="", ms=8, color=style.INK, label="start of a robot"),
        Line2D([], [], marker="o", ls="", mfc="w", mec=style.INK, label="place to be cleaned"),
        Patch(color=floor_picture.DOOR, label="narrow place: who meets there, stops"),
    ]
    if few:
        says = "to here half of the longest frames from the start arrive"
        handles.append(Line2D([], [], ls="dotted", lw=0.8, color=style.INK, label=says))
    if found.out_of_reach:
        handles.append(Line2D([], [], marker="X", ls="", ms=8, mfc="w", mec=style.INK, label="out of reach"))
    if ((found.parts.labels > 0) & ~found.reached).any():
        handles.append(Patch(color=floor_picture.SHUT, label="room for a robot, but no way there"))
    return handles
