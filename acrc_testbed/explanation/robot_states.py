"""State of each robot: standing, goal, progress, and the robot that it waits for."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from acrc_testbed.explanation.episodes import (
    ABORTED,
    NO_GOAL,
    REACHED,
    STANDARD,
    Episode,
    interval_mask,
    lost_intervals,
    pursued_goals,
    standing_mask,
    true_intervals,
)
from acrc_testbed.explanation.true_floor import FloorStage, Passages
from acrc_testbed.run_model.data import RobotReport, RunData
from actors.array_types import Flags, Floats, Int32s, Int64s
from actors.floor.grid import OccupancyGrid
from actors.instant import in_seconds, seconds

_RADIUS: Final = 0.177
"""Radius of a TurtleBot 2, m."""


class RobotStates:
    """States of all robots of a run; flags are (steps, robots)."""

    def __init__(self, run: RunData, stages: Sequence[FloorStage]) -> None:
        steps = len(run.true)
        self.run, self.stages = run, stages
        self._reports = [run.reports.get(robot, RobotReport()) for robot in run.robots]
        self.stage = np.searchsorted([one.begin for one in stages], np.arange(steps), side="right") - 1
        """(steps,): index of the floor's stage."""
        self.goal = np.column_stack(
            [
                np.full(steps, NO_GOAL) if one.goals is None else pursued_goals(one.goals, run)
                for one in self._reports
            ]
        )
        """(steps, robots): number of the current goal; NO_GOAL: none or unknown."""
        self.on = run.stepping
        self.frozen = run.frozen
        self.stands = self._standing(self.on, STANDARD.pause_s)
        unknown = np.array([one.goals is None for one in self._reports])
        self.wants = ((self.goal != NO_GOAL) | unknown) & run.busy & self.on
        """It has a goal that is not reached, and items left."""
        self.waits = self.stands & self.wants
        """It stands although it has a goal."""
        self.stands_long = self._standing(self.wants, STANDARD.turn_s)
        self.done = self.stands & ~run.busy
        least = min(self._steps(STANDARD.pause_s), steps)
        self.strategy_idle = _columns(
            _mask_of(true_intervals(idles, least), steps)
            for idles in (self.stands & ~self.wants & run.busy).T
        )
        """It stands with items left, but without a goal."""
        self.planless = _columns(interval_mask(one.planless, run) for one in self._reports) & self.wants
        self.paused = _columns(interval_mask(one.paused, run) for one in self._reports) & self.wants
        """Its strategy has paused navigation and keeps the goal."""
        self.lost = _columns(_lost(error) for error in localisation_errors(run).T)
        self._turns = _turns(run)
        turning = np.abs(self._turns) > STANDARD.turning * in_seconds(run.step_us)
        idle = [self._without_progress(index) for index in range(len(self._reports))]
        self.drives_to_and_fro = self._moving(idle, ~self.stands)
        """It drives to and fro without progress."""
        self.moves_to_and_fro = self.drives_to_and_fro | self._moving(idle, ~self.stands | turning)
        """It drives or turns to and fro without progress."""

    def goal_of(self, robot: int, number: int) -> tuple[float, float] | None:
        """Return the position of a robot's goal, m; None: none."""
        goals = self._reports[robot].goals
        if goals is None or number == NO_GOAL:
            return None
        return goals[number].x, goals[number].y

    def distances_to_goal(self, robot: int) -> Floats:
        """Return the true path length to the goal, (steps,), m; beeline without a path; NaN: no goal."""
        found = np.full(len(self.run.true), np.nan)
        here = self.run.true[:, robot, :2]
        for rows, goal, stage in self.pursuits(robot, self.wants[:, robot]):
            if goal is not None:
                metres = stage.paths.lengths(here[rows], goal)
                beeline = np.hypot(*(here[rows] - goal).T)
                found[rows] = np.where(np.isfinite(metres), metres, beeline)
        return found

    def pursuits(
        self, robot: int, where: Flags
    ) -> Iterator[tuple[Int64s, tuple[float, float] | None, FloorStage]]:
        """Yield the steps where a mask is true, grouped by goal and stage of the floor."""
        points: dict[tuple[tuple[float, float] | None, int], list[Int64s]] = {}
        rows = np.flatnonzero(where)
        pairs = np.column_stack([self.goal[rows, robot], self.stage[rows]])
        kinds, groups = np.unique(pairs, axis=0, return_inverse=True)
        for number, (goal, stage) in enumerate(kinds.tolist()):
            key = self.goal_of(robot, goal), stage
            points.setdefault(key, []).append(rows[groups.reshape(-1) == number])
        for (point, stage), parts in points.items():
            yield np.sort(np.concatenate(parts)), point, self.stages[stage]

    def _standing(self, where: Flags, lasting_s: float) -> Flags:
        """Return where a robot stands for `lasting_s` while a mask is true."""
        true, window = self.run.true, min(self._steps(lasting_s), len(self.run.true))
        robots = range(true.shape[1])
        return _columns(
            standing_mask(true[:, index, :2], where[:, index], window, STANDARD.stand_radius)
            for index in robots
        )

    def _without_progress(self, robot: int) -> list[Episode]:
        """Return the intervals without progress towards any goal."""
        if self._reports[robot].goals is None:
            return []
        return true_intervals(~self._progresses(robot) & self.wants[:, robot], self._steps(STANDARD.wait_s))

    def _moving(self, stretches: Sequence[Sequence[Episode]], moves: Flags) -> Flags:
        """Return the intervals in which a robot moves to and fro most of the time, (steps, robots)."""
        found = np.zeros_like(moves)
        for robot, own in enumerate(stretches):
            for one in own:
                steps = slice(*one)
                most = 2 * int(moves[steps, robot].sum()) >= one.end - one.begin
                found[steps, robot] = most and self._to_and_fro(robot, one)
        return found

    def _to_and_fro(self, robot: int, stretch: Episode) -> bool:
        """Return True if a point of the outline travelled much farther than the extent of its path."""
        steps = slice(*stretch)
        path = self.run.true[steps, robot, :2]
        driven = np.hypot(*np.diff(path, axis=0).T).sum() + _RADIUS * np.abs(self._turns[steps, robot]).sum()
        return bool(driven >= STANDARD.to_and_fro * np.hypot(*np.ptp(path, axis=0)))

    def _progresses(self, robot: int) -> Flags:
        """Return where a robot makes progress towards a goal, or reaches one, (steps,)."""
        far, wants = self.distances_to_goal(robot).tolist(), self.wants[:, robot].tolist()
        goals, stages = self.goal[:, robot].tolist(), self.stage.tolist()
        ended = self._reached(robot)
        best: dict[tuple[tuple[float, float] | None, int], float] = {}
        progress = np.zeros(len(far), np.bool_)
        for step, metres in enumerate(far):
            if not wants[step] or ended[step]:
                progress[step] = True
                best.clear()
                continue
            key = self.goal_of(robot, goals[step]), stages[step]
            if key not in best or metres < best[key] - STANDARD.min_progress:
                best[key] = metres
                progress[step] = True
        return progress

    def _reached(self, robot: int) -> Flags:
        """Return where a goal was reached by navigation, or by ground truth if it was replaced, (steps,)."""
        reached = np.zeros(len(self.run.true), np.bool_)
        for goal in self._reports[robot].goals or ():
            if goal.end is None or goal.how in ABORTED:
                continue
            step = self.run.index(goal.end)
            x, y = self.run.true[step, robot, :2]
            if goal.how == REACHED or np.hypot(goal.x - x, goal.y - y) <= STANDARD.visit_radius:
                reached[step] = True
        return reached

    def _steps(self, lasting_s: float) -> int:
        return seconds(lasting_s) // self.run.step_us


def localisation_errors(run: RunData) -> Floats:
    """Return the localisation errors, (steps, robots), m; NaN: unknown."""
    offset = run.estimated[..., :2] - run.true[..., :2]
    return np.hypot(offset[..., 0], offset[..., 1])


def _turns(run: RunData) -> Floats:
    """Return the change of each heading per step, (steps, robots), rad."""
    turned = np.diff(run.true[..., 2], axis=0, append=run.true[-1:, :, 2])
    return turned - 2 * np.pi * np.rint(turned / (2 * np.pi))


def estimates_in_walls(run: RunData, grid: OccupancyGrid) -> Flags:
    """Return where the estimated position is in an obstacle of the map, (steps, robots)."""
    corner = np.array(grid.origin)
    known = np.isfinite(run.estimated[..., 0])
    cells = np.floor((np.where(known[..., None], run.estimated[..., :2], corner) - corner) / grid.resolution)
    cells = cells.astype(np.int64)
    inside = ((cells >= 0) & (cells < [grid.columns, grid.rows])).all(axis=-1)
    cells[~inside] = 0
    in_obstacle: Flags = known & (~inside | grid.blocking[cells[..., 1], cells[..., 0]])
    return in_obstacle


def _lost(error: Floats) -> Flags:
    may_be_lost = np.nanmax(error, initial=0.0) > STANDARD.lost
    return _mask_of(lost_intervals(error) if may_be_lost else (), error.size)


def _mask_of(intervals: Iterable[Episode], steps: int) -> Flags:
    """Return the mask, (steps,), that is True in these intervals."""
    mask = np.zeros(steps, np.bool_)
    for begin, end in intervals:
        mask[begin:end] = True
    return mask


def _columns(parts: Iterable[Flags]) -> Flags:
    return np.column_stack(list(parts))


NO_ROBOT: Final = -1
_PATH_STEP: Final = 0.1
"""Distance of the examined points of a path, m."""
Points = Floats


def first_robots_ahead(states: RobotStates, stuck: Flags, passages: Passages) -> Int32s:
    """Return the first robot on the path of each stuck robot, (steps, robots); NO_ROBOT: none."""
    found = np.full(stuck.shape, NO_ROBOT, np.int32)
    for robot in range(stuck.shape[1]):
        for rows, goal, stage in states.pursuits(robot, stuck[:, robot]):
            squares = stage.paths.squares(states.run.true[rows, robot, :2])
            _, groups = np.unique(squares, axis=0, return_inverse=True)
            for number in range(int(groups.max()) + 1):
                same = rows[groups.reshape(-1) == number]
                path = _path_start(states, robot, int(same[0]), goal, stage, STANDARD.sensed)
                found[same, robot] = _first_blocking(states, robot, same, path, passages)
    return found


def nearest_robots_beside(states: RobotStates, stuck: Flags, passages: Passages) -> Int32s:
    """Return the nearest standing robot that a robot cannot pass, (steps, robots); NO_ROBOT: none."""
    found = np.full(stuck.shape, NO_ROBOT, np.int32)
    for robot in range(stuck.shape[1]):
        rows = np.flatnonzero(stuck[:, robot])
        there, here = states.run.true[rows, :, :2], states.run.true[rows, robot, :2]
        gaps = np.hypot(*(there - here[:, None]).transpose(2, 0, 1))
        gaps[:, robot] = np.inf
        gaps[~states.waits[rows] | (gaps >= STANDARD.in_way)] = np.inf
        nearest = gaps.argmin(axis=1)
        near = np.flatnonzero(np.isfinite(gaps.min(axis=1)))
        near = near[passages.are_visible(here[near], there[near, nearest[near]])]
        found[rows[near], robot] = nearest[near]
    return found


def _path_start(
    states: RobotStates,
    robot: int,
    step: int,
    goal: tuple[float, float] | None,
    stage: FloorStage,
    length: float,
) -> Points:
    """Return the start of a robot's path, (n, 2); straight ahead without a known goal."""
    x, y, heading = states.run.true[step, robot].tolist()
    if goal is not None:
        for paths in (stage.paths, stage.opened):
            path = paths.path((x, y), goal, length)
            if path is not None:
                distances = np.hypot(*(path - path[0]).T)
                return path[np.unique(np.floor(distances / _PATH_STEP), return_index=True)[1]]
        dx, dy = goal[0] - x, goal[1] - y
        heading, length = np.arctan2(dy, dx), min(length, float(np.hypot(dx, dy)))
    along = np.arange(0.0, length + _PATH_STEP, _PATH_STEP)
    return np.column_stack([x + along * np.cos(heading), y + along * np.sin(heading)])


def _first_blocking(
    states: RobotStates,
    robot: int,
    rows: Int64s,
    path: Points,
    passages: Passages,
) -> Int32s:
    """Return the first robot that blocks the path, (rows,); NO_ROBOT: none."""
    there = states.run.true[rows, :, :2]
    gaps = np.hypot(*(there[:, :, None] - path).transpose(3, 0, 1, 2))
    along = gaps.argmin(axis=2)
    limit = np.where(states.stands_long[rows, robot], STANDARD.view_distance, STANDARD.block_distance)
    limit[states.planless[rows, robot]] = STANDARD.sensed
    lateral = gaps.min(axis=2)
    inside = (lateral < STANDARD.in_way) & (along * _PATH_STEP >= np.maximum(lateral, _PATH_STEP))
    inside &= np.hypot(*(there - path[0]).transpose(2, 0, 1)) <= limit[:, None]
    inside[:, robot] = False
    one, other = np.nonzero(inside)
    inside[one, other] = passages.are_visible(path[along[one, other]], there[one, other])
    order = np.where(inside, along, len(path))
    first: Int32s = order.argmin(axis=1).astype(np.int32)
    first[~inside.any(axis=1)] = NO_ROBOT
    return first
