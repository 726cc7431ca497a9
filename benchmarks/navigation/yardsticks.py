"""What navigation is measured against: shortest ways, gaps to walls and robots, contacts between steps."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import Cell, OccupancyGrid, nearest_cell, outline, passable
from actors.floor.map_file import load_map
from actors.geometry import Point, Pose, Twist
from actors.instant import Instant
from actors.robot.navigation.potential import UNREACHABLE, descent, potential
from actors.robot_model import load_model
from actors.world.physics import SUBSTEP, Arena
from actors.world.world_setup import WorldSetup
from observation.accounting.tracks import Tracks


class RetracingError(Exception):
    """The motion comes out otherwise than it was."""


def retrace(world: WorldSetup, tracks: Tracks) -> tuple[NDArray[np.float64], int]:
    """The true poses at the end of every sub-step, (samples, robots, 3), and how many contacts began.

    For runs in which all robots drive in every step and no event happens. Raises RetracingError unless every
    step begins exactly where the run has it.
    """
    arena = Arena(
        outline(load_map(world.map)),
        [robot.id for robot in world.robots],
        [load_model(robot.model, robot.sensor) for robot in world.robots],
        [Pose(*robot.start) for robot in world.robots],
    )
    parts = []
    for step, (true, wished) in enumerate(zip(tracks.true, tracks.wished, strict=True)):
        if not np.array_equal(arena.poses, true):
            raise RetracingError(f"step {step} begins elsewhere than in the run")
        for robot, wish in enumerate(wished.tolist()):
            arena.command(robot, Twist(*wish), Instant(step * tracks.step_us))
        parts.append(arena.advance(tracks.step_us // SUBSTEP))
    return np.concatenate(parts), arena.contacts


_FAR: Final = 0.05
"""Gaps beyond this are given to a cell only, m."""


def wall_gaps(grid: OccupancyGrid, true: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(samples, robots): between a disc of `radius`, m, at each position and the nearest wall, m.

    `true`: (samples, robots, 2 or more), x and y first. Exact up to 0.05 m.
    """
    cells = np.floor((true[..., :2] - grid.origin) / grid.resolution).astype(np.int64)
    gaps = grid.clearance[cells[..., 1], cells[..., 0]] - radius
    for sample, robot in np.argwhere(gaps < _FAR + grid.resolution).tolist():
        point = Point(*true[sample, robot, :2].tolist())
        gaps[sample, robot] = grid.clearance_at(point, radius + 1.0) - radius
    return gaps


def robot_gaps(true: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(samples, pairs): between each two robots, discs of `radius`, m, in the order of their indices."""
    one, other = np.triu_indices(true.shape[1], k=1)
    offsets = true[:, one, :2] - true[:, other, :2]
    gaps: NDArray[np.float64] = np.hypot(offsets[..., 0], offsets[..., 1]) - 2 * radius
    return gaps


def touches(gaps: NDArray[np.float64]) -> int:
    """How often one of the columns of gaps becomes 0 or less, the first row included."""
    near = gaps <= 0.0
    return int(near[:1].sum() + (near[1:] & ~near[:-1]).sum())


def closest(gaps: NDArray[np.float64]) -> float:
    """The smallest gap, m; inf where there is none."""
    return float(gaps.min(initial=np.inf))


_ROUNDS: Final = 40
"""The string is pulled at most so often."""
_GAIN: Final = 0.002
"""It is taut when two more pulls shorten it by less, m."""
_ASIDE: Final = 0.2
"""So far aside the way may begin or end where the disc has no room, m: what bodies and cells may overlap."""


class ShortestWays:
    """The shortest ways of a disc on one floor plan.

    The shortest way along eight directions (see `actors.robot.navigation.potential`) is pulled taut as a
    string among the walls. On a way among several that are about equally long it may take the wrong side
    (eight directions count up to 8 % too long), so a length is never too short, and seldom too long by more
    than 2 %.
    """

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        """`radius` of the disc, m."""
        self._grid = grid
        self._radius = radius
        self._costs = passable(grid, radius).astype(np.int32)
        self._costs.setflags(write=False)

    def length(self, start: Point, goal: Point) -> float | None:
        """Of the shortest way, m; None if there is none."""
        first, last = self._nearest(start), self._nearest(goal)
        if first is None or last is None:
            return None
        field = potential(self._costs, *last)
        if field[first] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *first)
        x, y = self._grid.centres()
        way = np.column_stack((x[cells[:, 1]], y[cells[:, 0]]))
        return along(self._taut(np.vstack([np.array([start]), way, np.array([goal])])))

    def _nearest(self, point: Point) -> Cell | None:
        """The cell with room for the disc nearest to `point`."""
        return nearest_cell(self._grid, self._costs > 0, point, _ASIDE)

    def _taut(self, way: NDArray[np.float64]) -> NDArray[np.float64]:
        before = np.inf
        for turn in range(_ROUNDS):
            way = self._pulled(_dense(way, self._grid.resolution))[::-1]
            if turn % 2:
                if before - along(way) < _GAIN:
                    break
                before = along(way)
        return way

    def _pulled(self, way: NDArray[np.float64]) -> NDArray[np.float64]:
        """The way cut short: from each corner straight to the last point up to which all are in sight."""
        corners = [0]
        seen = 1
        while seen < len(way) - 1:
            if self._in_sight(way[corners[-1]], way[seen + 1]):
                seen += 1
            else:
                corners.append(seen)
                seen += 1
        return way[[*corners, len(way) - 1]]

    def _in_sight(self, one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
        """True if the disc has room all along the straight line, its ends left out."""
        grid = self._grid
        pieces = max(int(np.hypot(*(other - one)) / grid.resolution * 2), 2)
        line = one + (other - one) * np.linspace(0.0, 1.0, pieces + 1)[1:-1, None]
        cells = np.floor((line - grid.origin) / grid.resolution).astype(np.int64)
        return bool((grid.clearance[cells[:, 1], cells[:, 0]] >= self._radius).all())


def _dense(way: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """The same way with a point at least every `spacing` m, corners kept."""
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    marks = np.union1d(gone, np.arange(0.0, gone[-1], spacing))
    return np.column_stack([np.interp(marks, gone, way[:, 0]), np.interp(marks, gone, way[:, 1])])


def along(way: NDArray[np.float64]) -> float:
    """The length of a way of (n, 2) points, m."""
    return float(np.hypot(*np.diff(way, axis=0).T).sum())
