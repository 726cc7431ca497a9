"""The dynamic window of ROS Indigo written out plainly, trajectory by trajectory: the twin of `dwa`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Numbers = dict[str, float]
Cell = tuple[int, int]
BARRED, BEYOND = 1, 2
"""What a wave gives beyond the number of cells: 0 more in a barred cell that it meets, 1 more elsewhere."""


@dataclass
class Twin:
    """One window."""

    costs: NDArray[np.uint8]
    path: NDArray[np.int32]
    goal: NDArray[np.int32]
    front: NDArray[np.int32]
    outline: NDArray[np.float64]
    w: Numbers

    def cost(self, pose: tuple[float, float, float], speed: float, turn: float) -> float | None:
        """The total of a trajectory; None if a critic refuses it. `pose`: x, y, cells, and heading."""
        highest = 0
        for x, y, heading in self._points(pose, speed, turn):
            below, cell = self._below(x, y, heading), self._cell(x, y)
            nose = self._cell(x + self.w["nose"] * math.cos(heading), y + self.w["nose"] * math.sin(heading))
            if below is None or cell is None or nose is None:
                return None
            if max(self.path[cell], self.goal[cell]) >= self.costs.size:
                return None
            highest = max(below, int(self.costs[cell]))
        assert cell is not None and nose is not None
        return (
            self.w["obstacle"] * highest
            + self.w["front"] * int(self.front[nose])
            + self.w["alignment"] * int(self.path[nose])
            + self.w["path"] * int(self.path[cell])
            + self.w["goal"] * int(self.goal[cell])
        )

    def _points(
        self, pose: tuple[float, float, float], speed: float, turn: float
    ) -> Iterator[tuple[float, float, float]]:
        w = self.w
        count = math.ceil(
            max(abs(speed) * w["horizon"] / w["stride"], abs(turn) * w["horizon"] / w["turn_stride"])
        )
        x, y, heading = pose
        for _ in range(count):
            yield x, y, heading
            ahead = speed / w["cell"] * w["horizon"] / count
            x, y = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
            heading += turn * w["horizon"] / count

    def _cell(self, x: float, y: float) -> Cell | None:
        rows, columns = self.costs.shape
        return (int(y), int(x)) if 0 <= x < columns and 0 <= y < rows else None

    def _below(self, x: float, y: float, heading: float) -> int | None:
        """The highest cost below the outline; None if that is lethal, or off the window."""
        c, s = math.cos(heading), math.sin(heading)
        corners = [self._cell(x + a * c - b * s, y + a * s + b * c) for a, b in self.outline]
        highest = 0
        for here, there in zip(corners, corners[1:] + corners[:1], strict=True):
            if here is None or there is None:
                return None
            highest = max([highest, *(int(self.costs[cell]) for cell in line(here, there))])
        return None if highest == 254 else highest


def line(here: Cell, there: Cell) -> list[Cell]:
    """Bresenham's cells from one to the other, both included."""
    (row, column), up, right = here, there[0] - here[0], there[1] - here[1]
    length = max(abs(up), abs(right))
    cells = []
    for k in range(length + 1):
        # so often is the shorter axis stepped along in k steps, with half of the longer carried at first
        across = (length // 2 + k * min(abs(up), abs(right))) // max(length, 1)
        along_row, along_column = (across, k) if abs(right) >= abs(up) else (k, across)
        up_now, right_now = math.copysign(along_row, up), math.copysign(along_column, right)
        cells.append((row + int(up_now), column + int(right_now)))
    return cells
