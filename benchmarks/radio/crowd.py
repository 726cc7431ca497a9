"""What a frame costs the medium alone among more and more robots at one density, all of whom drive."""

import math
import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.radio.medium.medium import Medium, Poisson
from actors.radio.propagation.indoor import IndoorPropagation
from actors.radio.propagation.walls import build
from actors.radio.radio_model import preset
from benchmarks.radio.trials import SECOND

PER_FLOOR: Final = 20
"""Robots to each copy of the floor plan."""
_OCTETS: Final = 100
_STEP_NS: Final = SECOND // 10


def frame_cost(plan: OccupancyGrid, robots: int, seconds: int, seed: int = 1) -> float:
    """CPU time, µs, of one frame: preset `chapter`, a frame a second from each robot, everybody listens.

    Copies of the plan lie side by side in a rectangle, with 20 robots to each; robots stand at random on free
    cells and swing to and fro by up to 0.3 m, so that no loss is known from before.
    """
    parameters = preset("chapter")
    copies = max(1, round(robots / PER_FLOOR))
    wide = math.ceil(math.sqrt(copies))
    floor = OccupancyGrid(np.tile(plan.cells, (-(-copies // wide), wide)), plan.resolution, plan.origin)
    medium = Medium(
        [parameters.transceiver.numbered(1 + number) for number in range(robots)],
        IndoorPropagation(parameters.propagation, build(floor, parameters.propagation.walls)),
        parameters.phy,
        seed=seed,
    )
    rng = np.random.default_rng(seed)
    free = np.argwhere(floor.free)
    places = (free[rng.integers(0, len(free), robots)][:, ::-1] + 0.5) * plan.resolution + plan.origin
    swing = rng.uniform(-0.3, 0.3, (robots, 2))

    def where(instant_ns: int) -> NDArray[np.float64]:
        at: NDArray[np.float64] = places + swing * math.sin(instant_ns / 1e9)
        return at

    medium.follow(where)
    for number in range(robots):
        medium.offer(number, Poisson(_OCTETS, 1.0))
    medium.run(SECOND)  # kernels are loaded, queues filled
    sent = int(medium.counters()["sent"].sum())
    begun = time.process_time()
    for until_ns in range(SECOND + _STEP_NS, (1 + seconds) * SECOND + 1, _STEP_NS):
        medium.run(until_ns)
    spent = time.process_time() - begun
    return 1e6 * spent / (int(medium.counters()["sent"].sum()) - sent)
