"""A floor with what was on it: trails, places, and where robots were in each other's way."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.floor.regions import Regions
from actors.task.referee import PlaceOutcome, Verdict
from observation.accounting.spells import Spell
from observation.accounting.time_spent import BY_ROBOTS
from observation.evidence.run_evidence import RunEvidence
from observation.picture import style

DOOR: Final = "#ffd27f"
SHUT: Final = "#d9c7d9"
RADIUS: Final = 0.177
"""Of a drawn robot, m: a TurtleBot 2."""
JUMP: Final = 1.0
"""m in one step: it was carried, and no line is drawn."""
_TOGETHER: Final = 1.6
"""Meetings nearer to one another than this are marked once, m."""
_MEETING_S: Final = 5.0
"""Meetings that took less long in all are not marked, s."""


def draw_floor(axes: Axes, grid: OccupancyGrid) -> None:
    """The floor plan, with a scale in m."""
    colours = np.zeros((3, 3))
    for kind, colour in ((FREE, style.FLOOR), (UNKNOWN, style.UNKNOWN), (OCCUPIED, style.WALL)):
        colours[kind] = to_rgb(colour)
    extent = (grid.origin.x, grid.corner.x, grid.origin.y, grid.corner.y)
    axes.imshow(colours[grid.cells], extent=extent, origin="lower", interpolation="nearest", zorder=0)
    axes.set_aspect("equal")
    axes.set_xlabel("m")
    axes.set_ylabel("m")


def draw_regions(axes: Axes, grid: OccupancyGrid, parts: Regions, reached: NDArray[np.bool_]) -> bool:
    """Doors, and free floor with room for a robot that none gets to; True if there is such."""
    tint = np.zeros((grid.rows, grid.columns, 4))
    shut = (parts.labels > 0) & ~reached
    for mask, colour in ((parts.labels > parts.count, DOOR), (shut, SHUT)):
        tint[mask] = (*to_rgb(colour), 1.0)
    extent = (grid.origin.x, grid.corner.x, grid.origin.y, grid.corner.y)
    axes.imshow(tint, extent=extent, origin="lower", interpolation="nearest", zorder=1)
    return bool(shut.any())


def draw_run(axes: Axes, run: RunEvidence, doing: Sequence[Spell]) -> None:
    """Trails, where robots are at the end, places, where robots stood before others."""
    few = style.few(run.robots)
    for index, robot in enumerate(run.robots):
        _trail(axes, run, index, robot, few=few)
    for place in run.places:
        _place(axes, place, run.robots, few=few)
    _meetings(axes, doing)


def legend() -> list[Line2D]:
    """What the marks mean."""
    red = "#c1272d"
    return [
        _mark("o", "place cleaned: filled as its cleaner, ringed as its owner", mfc="#9a9fa8"),
        _mark("o", "place still open"),
        _mark("x", "place given up, or reported and not cleaned"),
        _mark("s", "start of a robot; its disc: where it ended", ms=4),
        _mark("o", "stood before another robot here, for so many s", mfc=f"{red}40", mec=red, ms=11),
    ]


def _mark(marker: str, says: str, mfc: str = "w", mec: str = style.INK, ms: float = 6.0) -> Line2D:
    return Line2D([], [], marker=marker, ls="", mfc=mfc, mec=mec, ms=ms, label=says)


def _trail(axes: Axes, run: RunEvidence, index: int, robot: str, *, few: bool) -> None:
    track, colour = run.true[:, index, :2].copy(), style.colour(index)
    start, end = track[0].copy(), track[-1].copy()
    jumps = np.flatnonzero(np.hypot(*np.diff(track, axis=0).T) > JUMP) + 1
    track[jumps] = np.nan
    axes.plot(*track.T, color=colour, lw=0.9 if few else 0.5, alpha=0.75 if few else 0.5, zorder=2)
    axes.plot(*start, marker="s", ms=4, mfc="w", mec=colour, zorder=4)
    axes.add_patch(Circle((float(end[0]), float(end[1])), RADIUS, color=colour, zorder=6))
    if few:
        at = axes.annotate(
            robot, tuple(end), xytext=(6, 6), textcoords="offset points", color=colour, zorder=9
        )
        at.set_fontweight("bold")
        at.set_path_effects(style.HALO)


def _place(axes: Axes, place: PlaceOutcome, robots: Sequence[str], *, few: bool) -> None:
    owner = style.colour(robots.index(place.owner)) if place.owner in robots else style.INK
    size = 4.6 if few else 2.6
    if place.verdict in (Verdict.GIVEN_UP, Verdict.MISTAKEN):
        axes.plot(place.x, place.y, marker="x", ms=size + 1, mec=owner, mew=1.4, zorder=5)
        return
    by = place.reported_by
    fill = "w" if by is None or by not in robots else style.colour(robots.index(by))
    axes.plot(place.x, place.y, marker="o", ms=size, mfc=fill, mec=owner, mew=1.3, zorder=5)


def _meetings(axes: Axes, doing: Sequence[Spell]) -> None:
    """A disc where robots stood before others, larger the longer somebody did."""
    for x, y, lasted in meetings(doing):
        size = 9 + 0.6 * min(lasted, 900.0) ** 0.5
        axes.plot(x, y, marker="o", ms=size, mfc="#c1272d30", mec="#c1272d", zorder=7)
        beside: dict[str, Any] = {"xytext": (-size / 2 - 3, -3), "textcoords": "offset points", "ha": "right"}
        said = axes.annotate(f"{lasted:.0f} s", (x, y), fontsize=7, color="#7a1116", zorder=8, **beside)
        said.set_path_effects(style.HALO)


def meetings(doing: Sequence[Spell]) -> list[tuple[float, float, float]]:
    """Where robots stood before others, x and y, m, and for how long in all, s; short ones left out."""
    clusters: list[list[Spell]] = []
    for one in sorted((one for one in doing if one.cause in BY_ROBOTS), key=lambda one: one.begin - one.end):
        near = (c for c in clusters if math.hypot(c[0].x - one.x, c[0].y - one.y) < _TOGETHER)
        cluster = next(near, None)
        if cluster is None:
            clusters.append([one])
        else:
            cluster.append(one)
    found = [(*_middle(cluster), _union(cluster)) for cluster in clusters]
    return [(x, y, lasted) for x, y, lasted in found if lasted >= _MEETING_S]


def _middle(cluster: Sequence[Spell]) -> tuple[float, float]:
    """Weighted by how long they lasted."""
    lasted = [one.end - one.begin for one in cluster]
    x = sum(one.x * weight for one, weight in zip(cluster, lasted, strict=True))
    y = sum(one.y * weight for one, weight in zip(cluster, lasted, strict=True))
    return x / sum(lasted), y / sum(lasted)


def _union(cluster: Sequence[Spell]) -> float:
    """How long at least one of them lasted, s."""
    lasted, until = 0.0, -math.inf
    for one in sorted(cluster, key=lambda one: one.begin):
        lasted += max(0.0, one.end - max(one.begin, until))
        until = max(until, one.end)
    return lasted
