"""The dynamic window approach over again, in plain Python: every trajectory point by point."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.robot.local_planning.disc_dwa import INVALID, Fields

Numbers = dict[str, float]


@dataclass(frozen=True)
class Trajectory:
    """One pair of velocities and what became of it."""

    speed: float
    turn: float
    points: list[tuple[float, float]]
    """cells; up to where it was given up."""
    score: float
    room: float = 0.0
    """cells; by how much it keeps farther off than it must, where it comes nearest."""


def squared_at(marks: NDArray[np.bool_], x: float, y: float, most: float) -> float:
    """Squared distance from a point to the nearest marked cell's centre, at most `most`."""
    rows, columns = np.nonzero(marks)
    if not rows.size:
        return most
    return min(most, float(np.min((columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2)))


def samples(low: float, high: float, count: int) -> list[float]:
    """Evenly, with zero between."""
    if low == high:
        return [low]
    values = [low + (high - low) * k / (count - 1) for k in range(count)]
    if low < 0 < high and 0.0 not in values:
        values.append(0.0)
    return sorted(values)


def nearest_steps(steps: NDArray[np.int32], x: float, y: float) -> int:
    """Of the cell, or else the least of the four round the point."""
    if steps[int(y), int(x)] < steps.size:
        return int(steps[int(y), int(x)])
    row, column = int(y - 0.5), int(x - 0.5)
    return int(steps[row : row + 2, column : column + 2].min())


class Twin:
    """Everything that `best` is given; `squared` of the fields is not used, but `marks`."""

    def __init__(
        self, fields: Fields, marks: NDArray[np.bool_], table: NDArray[np.float64], w: Numbers
    ) -> None:
        self.fields, self.marks, self.table, self.w = fields, marks, table, w

    def limit(self, speed: float) -> float:
        """Distance that the centre has to keep."""
        w = self.w
        share = max(0.0, abs(speed) - w["scaling_speed"]) / w["scaling_range"]
        return w["radius"] * (1 + w["scaling_factor"] * share) + w["padding"]

    def trajectories(
        self, pose: tuple[float, float, float], window: NDArray[np.float64], counts: tuple[int, int]
    ) -> list[Trajectory]:
        """Those that are fast enough, in the order in which they are tried."""
        found = []
        for speed in samples(window[0], window[1], counts[0]):
            for turn in samples(window[2], window[3], counts[1]):
                if abs(speed) < self.w["least_speed"] - 1e-4 and abs(turn) < self.w["least_turn"] - 1e-4:
                    continue
                found.append(self._drive(pose, speed, turn))
        return found

    def _drive(self, pose: tuple[float, float, float], speed: float, turn: float) -> Trajectory:
        w, side = self.w, self.marks.shape[0]
        stopping = abs(speed) / w["deceleration"] + w["stop_buffer"]
        time = max(w["horizon"], stopping)
        count = max(1, math.ceil(max(abs(speed) * time / w["stride"], abs(turn) * time / w["turn_stride"])))
        count = count if speed else 1
        chord = abs(speed) * time / count * (np.sinc(turn * time / count / math.tau) if turn else 1.0)
        last = count
        if count * chord > w["goal_distance"]:
            braking = abs(speed) * w["stop_buffer"] + speed**2 / (2 * w["deceleration"])
            last = min(count, math.ceil(max(w["goal_distance"], braking) / chord))
        x, y, heading = pose
        points = [(x, y)]
        least = squared_at(self.marks, x, y, self.fields.squared.max())
        if least <= self.limit(speed) ** 2:
            return Trajectory(speed, turn, points, INVALID)
        for k in range(1, last + 1):
            t = k * time / count
            if turn:
                x = pose[0] + speed / turn * (math.sin(pose[2] + turn * t) - math.sin(pose[2]))
                y = pose[1] - speed / turn * (math.cos(pose[2] + turn * t) - math.cos(pose[2]))
            else:
                x, y = pose[0] + speed * t * math.cos(pose[2]), pose[1] + speed * t * math.sin(pose[2])
            points.append((x, y))
            if not (0.5 <= x < side - 0.5 and 0.5 <= y < side - 0.5):
                return Trajectory(speed, turn, points, INVALID)
            here = squared_at(self.marks, x, y, self.fields.squared.max())
            if here <= self.limit(speed) ** 2:
                return Trajectory(speed, turn, points, INVALID)
            least = min(least, here)
            heading = pose[2] + turn * t
        room = math.sqrt(least) - self.limit(speed)
        return Trajectory(speed, turn, points, self._score(least, x, y, heading), room)

    def _score(self, least: float, x: float, y: float, heading: float) -> float:
        w, side = self.w, self.marks.shape[0]
        path, goal = nearest_steps(self.fields.path, x, y), nearest_steps(self.fields.goal, x, y)
        if max(path, goal) >= side * side:
            return INVALID
        nose_x, nose_y = x + w["nose"] * math.cos(heading), y + w["nose"] * math.sin(heading)
        if not (0 <= nose_x < side and 0 <= nose_y < side):
            return INVALID
        nose = [float(f[int(nose_y), int(nose_x)]) for f in (self.fields.path, self.fields.front)]
        nose = [
            a + math.sqrt(2) * w["nose"] if n >= side * side else n
            for n, a in zip(nose, (path, goal), strict=True)
        ]
        cost = self.table[min(int(least), len(self.table) - 1)]
        return float(
            cost + w["path"] * path + w["alignment"] * nose[0] + w["goal"] * goal + w["front"] * nose[1]
        )
