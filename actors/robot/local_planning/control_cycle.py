"""Kernel: one control cycle of the local planner `chapter`, from the plan to the cheapest velocity.

What it is made of is in `local_plan`, `map_grid` and `dwa`; apart from one another they would hand arrays to
Python and back, which takes as long as to fill them.
"""

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.robot.local_planning.dwa import INVALID, Costs, Floats, Squares, cheapest, example, samples
from actors.robot.local_planning.local_plan import local_plan
from actors.robot.local_planning.map_grid import wavefront


@njit(cache=True)  # type: ignore[untyped-decorator]
def chosen(
    way: Floats,
    state: Floats,
    nose: float,
    counts: tuple[int, int],
    barred: NDArray[np.bool_],
    squared: Squares,
    limit: float,
    table: Costs,
    outline: Floats,
    critics: NDArray[np.void],
    alignment: float,
) -> tuple[float, float, float]:
    """The fields of `CheapestVelocity`; there is no valid trajectory if nothing of `way` is in the window.

    `state`, (12,): x, y, m, and heading, rad, of the robot in the map frame, then in the odometry frame; x
    and y, m, of the window's corner in the latter; the least and the greatest speed, m/s, and turn rate,
    rad/s, within reach. `nose`: so far ahead of the centre the nose is, m. `counts`: how many speeds and turn
    rates are tried. `alignment`: weight of the critic of that name while the plan's end is farther away than
    the nose; it is written to `critics`. All else as for `local_plan`, `wavefront` and `cheapest`.
    """
    cells, goal, front, far = local_plan(
        way, state[0:3], state[3:6], state[6:8], critics[0].cell, squared.shape[0], nose
    )
    if cells.shape[0] == 0:
        return 0.0, 0.0, INVALID
    # near the goal the nose is beyond it: to keep it on the plan would turn the robot round
    critics[0].alignment = alignment if far else 0.0
    to_path = wavefront(squared, limit, cells)
    to_goal = wavefront(squared, limit, goal)
    to_front = wavefront(squared, limit, front)
    window = state[8:12].astype(np.float32).astype(np.float64)  # rounded to what the original has
    speeds = samples(window[0], window[1], counts[0])
    turns = samples(window[2], window[3], counts[1])
    found: tuple[float, float, float] = cheapest(
        state[3:8], speeds, turns, barred, squared, to_path, to_goal, to_front, table, outline, critics
    )
    return found


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    squared, table, corners, critics = example()
    way = np.column_stack((np.linspace(0.1, 5.0, 90), 0.8 + np.square(np.linspace(0, 1.5, 90))))
    state = np.array([0.4, 0.8, 0.3, 1.115, 2.52, 0.6, -0.5, 0.5, -0.1, 0.5, -1.0, 1.0])
    barred = np.zeros(4, np.bool_)
    found = chosen(way, state, 0.33, (7, 8), barred, squared, 4.5, table, corners, critics, 3.2)
    return np.array(found).tobytes()
