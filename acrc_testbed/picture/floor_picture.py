"""Picture of a floor with trails, places, obstacles and blocked robots."""

import math
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle
from numpy.typing import NDArray

from acrc_testbed.explanation.time_accounting import CauseInterval
from acrc_testbed.explanation.time_spent import BY_ROBOTS, Cause
from acrc_testbed.picture import marks, style
from acrc_testbed.picture.marks import PointLabel
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.floor import floor_intervals
from actors.floor.doors import Doorways, Regions
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, hexadecimal
from actors.task.referee import PlaceOutcome, PlaceVerdict

DOOR: Final = hexadecimal(glyphs.DOOR)
SHUT: Final = "#d9c7d9"
JUMP: Final = 1.0
"""Distance in one step from which a robot counts as carried, m; no line is drawn."""
_STOOD: Final = "#7a1116"
_STOPPED: Final = (Cause.OFF, Cause.FROZEN)
_SAME_POSITION: Final = 1.6
"""Blocked positions closer than this share one mark, m."""
_MEETING_S: Final = 5.0
"""Minimum total duration of a marked position, s."""


def draw_floor(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the floor plan with a scale in m."""
    colours = np.zeros((3, 3))
    for kind, colour in ((FREE, style.FLOOR), (UNKNOWN, style.UNKNOWN), (OCCUPIED, style.WALL)):
        colours[kind] = to_rgb(colour)
    extent = (grid.origin.x, grid.corner.x, grid.origin.y, grid.corner.y)
    axes.imshow(colours[grid.cells], extent=extent, origin="lower", interpolation="nearest", zorder=0)
    axes.set_aspect("equal")
    axes.autoscale(enable=False)  # clip marks beyond the floor, such as jammers
    axes.set_xlabel("m")
    axes.set_ylabel("m")


def draw_regions(axes: Axes, grid: OccupancyGrid, parts: Regions, reached: NDArray[np.bool_]) -> bool:
    """Draw doors and unreachable free floor; return True if there is unreachable floor."""
    tint = np.zeros((grid.rows, grid.columns, 4))
    shut = (parts.labels > 0) & ~reached
    for mask, colour in ((parts.labels > parts.count, DOOR), (shut, SHUT)):
        tint[mask] = (*to_rgb(colour), 1.0)
    extent = (grid.origin.x, grid.corner.x, grid.origin.y, grid.corner.y)
    axes.imshow(tint, extent=extent, origin="lower", interpolation="nearest", zorder=1)
    return bool(shut.any())


def draw_doors(axes: Axes, run: RunData) -> bool:
    """Draw the doors of the map; return True if it has any."""
    parts = Doorways(run.grid, run.description.radius).regions
    draw_regions(axes, run.grid, parts, np.ones_like(parts.labels, np.bool_))
    return bool(parts.doors)


class DrawnRun(NamedTuple):
    """Marks drawn for a run, and labels to place."""

    kinds: frozenset[str]
    """Names of the marks."""
    labels: tuple[PointLabel, ...]
    """Labels, the most important first."""
    taken: tuple[tuple[float, float], ...]
    """Points that labels should not cover, m."""


def draw_run(axes: Axes, run: RunData, doing: Sequence[CauseInterval]) -> DrawnRun:
    """Draw trails, final positions, places, obstacles and positions of blocked robots."""
    few = glyphs.is_small_swarm(run.robots)
    put = floor_intervals(run.floor, run.end)
    labels = [_name(run, index, robot, few=few) for index, robot in enumerate(run.robots)]
    kinds = {"start"} | ({"door"} if draw_doors(axes, run) else set())
    for index, _ in enumerate(run.robots):
        kinds |= _trail(axes, run, index, few=few)
    for place in run.outcomes:
        kinds.add(_place(axes, place, run, few=few))
    labels += marks.draw(axes, put)
    kinds |= {one.object.kind for one in put}
    for interval in doing:
        if interval.cause in _STOPPED:
            kinds.add(interval.cause.value)
            _stopped(axes, interval, run)
    stood = blocked_positions(doing)
    labels += [_draw_blocked(axes, *one) for one in stood]
    kinds |= {"stood"} if stood else set()
    ends = [(x, y) for x, y in run.true[-1, :, :2].tolist()]
    taken = (*ends, *((x, y) for x, y, _ in stood), *((one.x, one.y) for one in run.outcomes))
    return DrawnRun(frozenset(kinds), tuple(labels), taken)


def legend(kinds: Collection[str]) -> list[Artist]:
    """Return legend entries for these marks."""
    return [marks.sample(name) for name in MARKS if name in kinds]


def _trail(axes: Axes, run: RunData, index: int, *, few: bool) -> set[str]:
    """Draw a robot's trail with start and end; return {"carried"} if it was carried."""
    track, colour = run.true[:, index, :2].copy(), style.colour(index)
    start, end = track[0].copy(), track[-1].copy()
    jumps = np.flatnonzero(np.hypot(*np.diff(track, axis=0).T) > JUMP) + 1
    for jump in jumps.tolist():
        axes.plot(*track[jump - 1 : jump + 1].T, color=colour, lw=0.9, ls=":", zorder=2)
    track[jumps] = np.nan
    axes.plot(*track.T, color=colour, lw=0.9 if few else 0.5, alpha=0.75 if few else 0.5, zorder=2)
    marks.plot(axes, "start", float(start[0]), float(start[1]), colour, size=4.0, zorder=4)
    axes.add_patch(Circle((float(end[0]), float(end[1])), glyphs.RADIUS, color=colour, zorder=6))
    return {"carried"} if jumps.size else set()


def _name(run: RunData, index: int, robot: str, *, few: bool) -> PointLabel:
    x, y = run.true[-1, index, :2].tolist()
    return PointLabel(robot, x, y, style.colour(index), 5.0 if few else 2.5, 8.5 if few else 5.5, bold=True)


def _stopped(axes: Axes, interval: CauseInterval, run: RunData) -> None:
    """Mark the position of a robot that was off or frozen."""
    colour = style.colour(run.robots.index(interval.robot))
    marks.plot(axes, interval.cause.value, interval.x, interval.y, colour, size=9.0, zorder=7)


def _place(axes: Axes, place: PlaceOutcome, run: RunData, *, few: bool) -> str:
    """Draw a place, and return the name of its mark."""
    robots = run.robots
    owner = style.colour(robots.index(place.owner)) if place.owner in robots else style.INK
    size = 4.6 if few else 2.6
    if place.verdict in (PlaceVerdict.GIVEN_UP, PlaceVerdict.MISTAKEN):
        marks.plot(axes, "given up", place.x, place.y, owner, size=size + 1, zorder=5)
        return "given up"
    by = place.reported_by
    fill = "w" if by is None or by not in robots else style.colour(robots.index(by))
    begun = len(run.description.own_places.get(place.owner, ()))
    shape = "given" if place.place >= begun else "open"
    marks.plot(axes, shape, place.x, place.y, owner, size=size, fill=fill, zorder=5)
    return shape if by is None or shape == "given" else "done"


def _draw_blocked(axes: Axes, x: float, y: float, lasted: float) -> PointLabel:
    """Draw a disc where robots were blocked, larger for a longer time; return its label."""
    size = 9 + 0.6 * min(lasted, 900.0) ** 0.5
    marks.plot(axes, "stood", x, y, "", size=size, zorder=7)
    return PointLabel(f"{lasted:.0f} s", x, y, _STOOD, size / 2, 7.0)


def blocked_positions(doing: Sequence[CauseInterval]) -> list[tuple[float, float, float]]:
    """Return positions where robots blocked others, x, y, m, with total durations, s, without short ones."""
    clusters: list[list[CauseInterval]] = []
    for one in sorted((one for one in doing if one.cause in BY_ROBOTS), key=lambda one: one.begin - one.end):
        near = (c for c in clusters if math.hypot(c[0].x - one.x, c[0].y - one.y) < _SAME_POSITION)
        cluster = next(near, None)
        if cluster is None:
            clusters.append([one])
        else:
            cluster.append(one)
    found = [(*_middle(cluster), _union(cluster)) for cluster in clusters]
    return [(x, y, lasted) for x, y, lasted in found if lasted >= _MEETING_S]


def _middle(cluster: Sequence[CauseInterval]) -> tuple[float, float]:
    """Return the mean position, weighted by duration."""
    lasted = [one.end - one.begin for one in cluster]
    x = sum(one.x * weight for one, weight in zip(cluster, lasted, strict=True))
    y = sum(one.y * weight for one, weight in zip(cluster, lasted, strict=True))
    return x / sum(lasted), y / sum(lasted)


def _union(cluster: Sequence[CauseInterval]) -> float:
    """Return the total duration of the union of intervals, s."""
    lasted, until = 0.0, -math.inf
    for one in sorted(cluster, key=lambda one: one.begin):
        lasted += max(0.0, one.end - max(one.begin, until))
        until = max(until, one.end)
    return lasted
