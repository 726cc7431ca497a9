"""A floor with what was on it: trails, places, and where robots were in each other's way."""

import math
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle
from numpy.typing import NDArray

from acrc_testbed.explanation.account import Spell
from acrc_testbed.explanation.time_spent import BY_ROBOTS, Cause
from acrc_testbed.picture import marks, style
from acrc_testbed.picture.marks import PointLabel
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.floor import floor_intervals
from actors.floor.doors import Doorways, Regions
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, hexadecimal
from actors.task.referee import PlaceOutcome, Verdict

DOOR: Final = hexadecimal(glyphs.DOOR)
SHUT: Final = "#d9c7d9"
JUMP: Final = 1.0
"""m in one step: it was carried, and no line is drawn."""
_STOOD: Final = "#7a1116"
_STOPPED: Final = (Cause.OFF, Cause.FROZEN)
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
    axes.autoscale(enable=False)  # what reaches beyond the floor, such as a jammer, is cut off
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


def draw_doors(axes: Axes, run: RunData) -> bool:
    """The doors of the map; True if it has any."""
    parts = Doorways(run.grid, run.description.radius).regions
    draw_regions(axes, run.grid, parts, np.ones_like(parts.labels, np.bool_))
    return bool(parts.doors)


class DrawnRun(NamedTuple):
    """What was drawn of a run, and what is to be written beside it."""

    kinds: frozenset[str]
    """Names of the marks."""
    labels: tuple[PointLabel, ...]
    """The most important first."""
    taken: tuple[tuple[float, float], ...]
    """Points on which no words should lie, m."""


def draw_run(axes: Axes, run: RunData, doing: Sequence[Spell]) -> DrawnRun:
    """Trails, where robots are at the end, places, what was put there, where robots stood before others."""
    few = glyphs.has_few(run.robots)
    put = floor_intervals(run.floor, run.end)
    labels = [_name(run, index, robot, few=few) for index, robot in enumerate(run.robots)]
    kinds = {"start"} | ({"door"} if draw_doors(axes, run) else set())
    for index, _ in enumerate(run.robots):
        kinds |= _trail(axes, run, index, few=few)
    for place in run.outcomes:
        kinds.add(_place(axes, place, run, few=few))
    labels += marks.draw(axes, put)
    kinds |= {one.object.kind for one in put}
    for spell in doing:
        if spell.cause in _STOPPED:
            kinds.add(spell.cause.value)
            _stopped(axes, spell, run)
    stood = meetings(doing)
    labels += [_meeting(axes, *one) for one in stood]
    kinds |= {"stood"} if stood else set()
    ends = [(x, y) for x, y in run.true[-1, :, :2].tolist()]
    taken = (*ends, *((x, y) for x, y, _ in stood), *((one.x, one.y) for one in run.outcomes))
    return DrawnRun(frozenset(kinds), tuple(labels), taken)


def legend(kinds: Collection[str]) -> list[Artist]:
    """What the marks mean that there are."""
    return [marks.sample(name) for name in MARKS if name in kinds]


def _trail(axes: Axes, run: RunData, index: int, *, few: bool) -> set[str]:
    """The way, its begin, and its end; whether somebody carried it."""
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


def _stopped(axes: Axes, spell: Spell, run: RunData) -> None:
    """Where a robot was while it was off or frozen."""
    colour = style.colour(run.robots.index(spell.robot))
    marks.plot(axes, spell.cause.value, spell.x, spell.y, colour, size=9.0, zorder=7)


def _place(axes: Axes, place: PlaceOutcome, run: RunData, *, few: bool) -> str:
    """Which mark it got."""
    robots = run.robots
    owner = style.colour(robots.index(place.owner)) if place.owner in robots else style.INK
    size = 4.6 if few else 2.6
    if place.verdict in (Verdict.GIVEN_UP, Verdict.MISTAKEN):
        marks.plot(axes, "given up", place.x, place.y, owner, size=size + 1, zorder=5)
        return "given up"
    by = place.reported_by
    fill = "w" if by is None or by not in robots else style.colour(robots.index(by))
    begun = len(run.description.own_places.get(place.owner, ()))
    shape = "given" if place.place >= begun else "open"
    marks.plot(axes, shape, place.x, place.y, owner, size=size, fill=fill, zorder=5)
    return shape if by is None or shape == "given" else "done"


def _meeting(axes: Axes, x: float, y: float, lasted: float) -> PointLabel:
    """A disc where robots stood before others, larger the longer somebody did."""
    size = 9 + 0.6 * min(lasted, 900.0) ** 0.5
    marks.plot(axes, "stood", x, y, "", size=size, zorder=7)
    return PointLabel(f"{lasted:.0f} s", x, y, _STOOD, size / 2, 7.0)


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
