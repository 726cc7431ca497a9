"""What lies along a beam on the map, as a particle filter sees it; numeric kernels for the others here.

They take the parts of a LevelGrid one by one: numba counts references to what it takes out of a tuple, which
in the innermost loop costs 6 % of a search.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import hypot
from actors.robot.localisation.likelihood_field import specimen

AGREEING: Final = 0
"""The beam ends at a wall of the map."""
SHORT: Final = 1
"""It ends in the open, in sight: there is something that is not on the map."""
BEYOND: Final = 2
"""It has passed a wall of the map: no thing in the room makes a beam longer."""


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    grid = specimen().grid
    ends = [(0.1 * x, 0.13 * x) for x in range(-9, 40)]
    return bytes(sight(*grid, 0.3, 1.0, 1.0, x, y) for x, y in ends)


@njit(cache=True)  # type: ignore[untyped-decorator]
def placed(x: float, y: float, c: float, s: float, forward: float, left: float) -> tuple[float, float]:
    """Where in the map frame a point of the body's frame is, m; (x, y): the body's place, c and s: cosine and
    sine of its heading."""
    return x + c * forward - s * left, y + s * forward + c * left


@njit(cache=True)  # type: ignore[untyped-decorator]
def level_at(levels: NDArray[np.uint8], frame: NDArray[np.float64], x: float, y: float) -> int:
    """The level of the cell that holds a point, m; beyond the edge that of the ring around the map."""
    column = min(max((x - frame[0]) / frame[2], 0.0), levels.shape[1] - 1.0)
    row = min(max((y - frame[1]) / frame[2], 0.0), levels.shape[0] - 1.0)
    return int(levels[int(row), int(column)])


@njit(cache=True)  # type: ignore[untyped-decorator]
def sight(
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    step: float,
    margin: float,
    eye_x: float,
    eye_y: float,
    end_x: float,
    end_y: float,
) -> int:
    """How a beam from the eye to its end goes with the map: AGREEING if its end is within `margin` of a wall,
    else BEYOND if a wall lies before it, else SHORT. `step`: metres per level.

    The line is followed in leaps as long as the distance to the nearest wall (Hart, "Sphere tracing", The
    Visual Computer 12, 1996). That needs no more than the levels, which lie in the cache anyway;
    `actors.floor.traversal` would need squares for four quadrants, and knows of nothing short of a wall.
    """
    if step * level_at(levels, frame, end_x, end_y) <= margin:
        return AGREEING
    length = hypot(end_x - eye_x, end_y - eye_y)
    gone = 0.0
    while gone < length:
        share = gone / length
        level = level_at(levels, frame, eye_x + share * (end_x - eye_x), eye_y + share * (end_y - eye_y))
        if level == 0:
            return BEYOND
        gone += max(step * level - frame[2], 0.5 * frame[2])
    return SHORT
