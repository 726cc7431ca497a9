"""Picture of a floor with trails, items of the task, obstacles and blocked robots."""

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle

from acrc_testbed.explanation.time_accounting import CauseInterval
from acrc_testbed.explanation.time_spent import BY_ROBOTS, Cause
from acrc_testbed.picture import marks, style
from acrc_testbed.picture.marks import PointLabel
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.floor import floor_intervals
from actors.array_types import Flags, Floats
from actors.floor.doors import Doorways, Regions
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.items import ItemKey
from actors.messages import ItemMark
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, Mark, hexadecimal
from actors.task.task import TaskDeclaration

DOOR: Final = hexadecimal(glyphs.DOOR)
SHUT: Final = "#d9c7d9"
JUMP: Final = 1.0
"""Distance in one step from which a robot counts as carried, m; no line is drawn."""
_BLOCKED_COLOUR: Final = "#7a1116"
_STOPPED: Final = (Cause.OFF, Cause.FROZEN)
_SAME_POSITION: Final = 1.6
"""Blocked positions closer than this share one mark, m."""
_MIN_BLOCKED_S: Final = 5.0
"""Minimum total duration of a marked position, s."""


def draw_floor(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the floor plan with a scale in m."""
    colours = np.zeros((3, 3))
    for kind, colour in ((FREE, style.FLOOR), (UNKNOWN, style.UNKNOWN), (OCCUPIED, style.WALL)):
        colours[kind] = to_rgb(colour)
    _draw_cells(axes, grid, colours[grid.cells], zorder=0)
    axes.set_aspect("equal")
    axes.autoscale(enable=False)  # clip marks beyond the floor, such as jammers
    axes.set(xlabel="m", ylabel="m")


def _draw_cells(axes: Axes, grid: OccupancyGrid, image: Floats, zorder: float) -> None:
    extent = (grid.origin.x, grid.corner.x, grid.origin.y, grid.corner.y)
    axes.imshow(image, extent=extent, origin="lower", interpolation="nearest", zorder=zorder)


def draw_regions(axes: Axes, grid: OccupancyGrid, regions: Regions, reachable: Flags) -> bool:
    """Draw doors and unreachable free floor; return True if there is unreachable floor."""
    tint = np.zeros((grid.rows, grid.columns, 4))
    unreachable = (regions.labels > 0) & ~reachable
    for mask, colour in ((regions.labels > regions.count, DOOR), (unreachable, SHUT)):
        tint[mask] = (*to_rgb(colour), 1.0)
    _draw_cells(axes, grid, tint, zorder=1)
    return bool(unreachable.any())


def draw_doors(axes: Axes, run: RunData) -> bool:
    """Draw the doors of the map; return True if it has any."""
    regions = Doorways(run.grid, run.description.radius).regions
    draw_regions(axes, run.grid, regions, np.ones_like(regions.labels, np.bool_))
    return bool(regions.doors)


class DrawnRun(NamedTuple):
    """Marks drawn for a run, and labels to place."""

    marks: frozenset[Mark]
    labels: tuple[PointLabel, ...]
    """Labels, the most important first."""
    taken: tuple[tuple[float, float], ...]
    """Points that labels should not cover, m."""


def draw_run(axes: Axes, run: RunData, intervals: Sequence[CauseInterval]) -> DrawnRun:
    """Draw trails, final positions, items, obstacles and positions of blocked robots."""
    few = glyphs.is_small_swarm(run.robots)
    objects = floor_intervals(run.floor, run.end)
    labels = [_robot_label(run, index, robot, few=few) for index, robot in enumerate(run.robots)]
    kinds = {"start"} | ({"door"} if draw_doors(axes, run) else set())
    items = shown_items(run)
    for index, _ in enumerate(run.robots):
        kinds |= _draw_trail(axes, run, index, few=few)
    for item in items:
        axes.plot(item.mark.x, item.mark.y, ls="", zorder=5, **item_style(run, item, few=few))
    for path in run.people[..., :2].transpose(1, 0, 2):
        _draw_person(axes, path)
        kinds.add("person")
    labels += marks.draw_objects(axes, objects)
    kinds |= {one.object.kind for one in objects}
    for interval in intervals:
        if interval.cause in _STOPPED:
            kinds.add(interval.cause)
            _draw_stopped(axes, interval, run)
    blocked = blocked_positions(intervals)
    labels += [_draw_blocked(axes, *one) for one in blocked]
    kinds |= {"stood"} if blocked else set()
    ends = [(x, y) for x, y in run.true[-1, :, :2].tolist()]
    taken = (*ends, *((x, y) for x, y, _ in blocked), *((one.mark.x, one.mark.y) for one in items))
    shown = {*(MARKS[kind] for kind in kinds), *(one.symbol for one in items)}
    return DrawnRun(frozenset(shown), tuple(labels), taken)


def legend(shown: Collection[Mark], tasks: Iterable[TaskDeclaration]) -> list[Artist]:
    """Return legend entries for these marks: those of the tasks' items, then others."""
    items = dict.fromkeys(mark for task in tasks for mark in glyphs.item_marks(task).values())
    return [marks.legend_entry(mark) for mark in (*items, *MARKS.values()) if mark in shown]


class ItemGlyph(NamedTuple):
    """Symbol of an item on the floor."""

    mark: ItemMark
    symbol: Mark
    is_filled: bool
    """True: with the colour of the robot that is responsible."""


def show_item(task: TaskDeclaration, items: dict[ItemKey, ItemGlyph], mark: ItemMark) -> None:
    """Apply a new mark to the items shown; a disc keeps the symbol that the item had first."""
    symbol = glyphs.item_marks(task).get(mark.state)
    if symbol is None:
        items.pop(mark.key, None)
        return
    before, is_filled = items.get(mark.key), symbol.shape == "disc"
    if is_filled and before is not None and before.symbol.shape != "ring":
        symbol = before.symbol
    items[mark.key] = ItemGlyph(mark, symbol, is_filled)


def shown_items(run: RunData) -> list[ItemGlyph]:
    """Return the items on the floor at the end."""
    items: dict[ItemKey, ItemGlyph] = {}
    for _, mark in run.marks:
        show_item(run.description.task, items, mark)
    return [*items.values()]


def item_style(run: RunData, item: ItemGlyph, *, few: bool) -> dict[str, Any]:
    """Return the properties of a line that draws an item."""
    size = (4.6 if few else 2.6) + (item.symbol.shape == "cross")
    fill = style.robot_colour(run.robots, item.mark.by, item.mark.owner) if item.is_filled else ""
    colour = style.robot_colour(run.robots, item.mark.owner, item.mark.by)
    return marks.line_style(item.symbol, colour, size, fill)


def _draw_trail(axes: Axes, run: RunData, index: int, *, few: bool) -> set[str]:
    """Draw a robot's trail with start and end; return {"carried"} if it was carried."""
    track, colour = run.true[:, index, :2].copy(), style.colour(index)
    start, end = track[0].copy(), track[-1].copy()
    jumps = np.flatnonzero(np.hypot(*np.diff(track, axis=0).T) > JUMP) + 1
    for jump in jumps.tolist():
        axes.plot(*track[jump - 1 : jump + 1].T, color=colour, lw=0.9, ls=":", zorder=2)
    track[jumps] = np.nan
    axes.plot(*track.T, color=colour, lw=0.9 if few else 0.5, alpha=0.75 if few else 0.5, zorder=2)
    marks.plot(axes, MARKS["start"], float(start[0]), float(start[1]), colour, size=4.0, zorder=4)
    axes.add_patch(Circle((float(end[0]), float(end[1])), glyphs.RADIUS, color=colour, zorder=6))
    return {"carried"} if jumps.size else set()


def _draw_person(axes: Axes, path: Floats) -> None:
    """Draw a person's path, (steps, 2), m, and final position."""
    colour = marks.colour_of(MARKS["person"])
    axes.plot(*path.T, color=colour, lw=0.4, alpha=0.5, zorder=1.5)
    axes.add_patch(person(path[-1]))


def person(at: Floats) -> Circle:
    """Return the disc of a person at a point, (2,), m."""
    colour = marks.colour_of(MARKS["person"])
    x, y = at.tolist()
    return Circle((x, y), glyphs.PERSON_RADIUS, fc=f"{colour}60", ec=colour, lw=1.2, zorder=5.5)


def _robot_label(run: RunData, index: int, robot: str, *, few: bool) -> PointLabel:
    x, y = run.true[-1, index, :2].tolist()
    return PointLabel(robot, x, y, style.colour(index), 5.0 if few else 2.5, 8.5 if few else 5.5, bold=True)


def _draw_stopped(axes: Axes, interval: CauseInterval, run: RunData) -> None:
    """Mark the position of a robot that was off or frozen."""
    colour = style.colour(run.robots.index(interval.robot))
    marks.plot(axes, MARKS[interval.cause], interval.x, interval.y, colour, size=9.0, zorder=7)


def _draw_blocked(axes: Axes, x: float, y: float, duration: float) -> PointLabel:
    """Draw a disc where robots were blocked, larger for a longer time; return its label."""
    size = 9 + 0.6 * min(duration, 900.0) ** 0.5
    marks.plot(axes, MARKS["stood"], x, y, "", size=size, zorder=7)
    return PointLabel(f"{duration:.0f} s", x, y, _BLOCKED_COLOUR, size / 2, 7.0)


def blocked_positions(intervals: Sequence[CauseInterval]) -> list[tuple[float, float, float]]:
    """Return positions where robots blocked others, x, y, m, with total durations, s, without short ones."""
    clusters: list[list[CauseInterval]] = []
    blocked = (one for one in intervals if one.cause in BY_ROBOTS)
    for one in sorted(blocked, key=lambda one: one.begin - one.end):
        near = (c for c in clusters if math.hypot(c[0].x - one.x, c[0].y - one.y) < _SAME_POSITION)
        if (cluster := next(near, None)) is None:
            clusters.append(cluster := [])
        cluster.append(one)
    found = [(*_mean_position(cluster), _total_duration(cluster)) for cluster in clusters]
    return [(x, y, duration) for x, y, duration in found if duration >= _MIN_BLOCKED_S]


def _mean_position(cluster: Sequence[CauseInterval]) -> tuple[float, float]:
    """Return the mean position, weighted by duration."""
    total = sum(one.end - one.begin for one in cluster)
    x = sum(one.x * (one.end - one.begin) for one in cluster)
    y = sum(one.y * (one.end - one.begin) for one in cluster)
    return x / total, y / total


def _total_duration(cluster: Sequence[CauseInterval]) -> float:
    """Return the total duration of the union of intervals, s."""
    duration, until = 0.0, -math.inf
    for one in sorted(cluster, key=lambda one: one.begin):
        duration += max(0.0, one.end - max(one.begin, until))
        until = max(until, one.end)
    return duration
