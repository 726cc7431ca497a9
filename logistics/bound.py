"""Upper bound of the orders that any strategy could deliver in a run of a scenario.

Relaxation: robots know all orders in advance, never meet, drive at full speed on shortest paths, need no time
and no way between orders, share all work, and charge wherever they are. The remaining limits: a load moves
after its order has arrived and before the run ends, by robots of limited number, capacity and speed; and the
energy of that distance comes from batteries and chargers, whose use takes the robots' time. For these limits
the rule of Moore and Hodgson (Moore 1968) gives the greatest number of orders: add orders by latest possible
start, and drop the longest one whenever the work does not fit.

Each limit is one of the run, too, so no run delivers more. Distances are 8 % shorter than paths on the map's
grid, which turn by multiples of 45°, and end at the judge's reach. Exceptions: `[uncertainty]` may move
walls, a `restart` replaces an empty battery, and a `move` carries a robot.
"""

import heapq
import math
from typing import Final

import numpy as np

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, potential
from actors.robot_model import RobotModel, load_model
from actors.settings import decode
from actors.world.world_setup import WorldSetup
from logistics.demand import LogisticsTable, arrivals
from logistics.items import decoded, facilities
from logistics.judge import REACH

_DETOUR: Final = 1.0824
"""Greatest ratio of a path in steps of 45° to a straight one: 1 / cos(22.5°)."""


def delivery_bound(world: WorldSetup) -> int:
    """Return the greatest number of orders that can be delivered in a run. Raises AcrcError."""
    settings = decode(LogisticsTable, world.task.settings, "logistics")
    models = [load_model(robot.model, robot.sensor) for robot in world.robots]
    points, chargers = facilities(decoded(world.robots[0].items))
    duration, speed = world.duration_us / 1e6, max(model.drive.speed for model in models)
    lengths = _lengths(world.map, points)
    supply = len(chargers), settings.power
    driven = max(_range(world, models, speed, supply) * settings.capacity, 0.0)
    jobs = []
    for _, order in arrivals(settings, len(points), len(models), world.world_seed, world.duration_us):
        left, length = duration - order.arrived / 1e6, lengths[order.pickup][order.delivery]
        if length <= left * speed:
            jobs.append((left * speed * len(models) * settings.capacity, length))
    chosen: list[float] = []
    work = 0.0
    for limit, length in sorted(jobs):
        heapq.heappush(chosen, -length)
        work += length
        if work > min(limit, driven):
            work += heapq.heappop(chosen)
    return len(chosen)


def _range(world: WorldSetup, models: list[RobotModel], speed: float, supply: tuple[int, float]) -> float:
    """Return the greatest distance that all robots can drive together, m."""
    duration, count = world.duration_us / 1e6, len(models)
    most = duration * count * speed
    batteries = [model.battery for model in models if model.battery]
    if any(robot.battery is None for robot in world.robots) or not batteries:
        return most
    idle = min(one.electronics + model.sensor.power for one, model in zip(batteries, models, strict=True))
    speeds = {speed, *(v for one in batteries for v, _ in one.driving or () if 0 < v < speed)}
    per_metre = min((idle + one.motor_power(v, 0.0)) / v for one in batteries for v in speeds)
    stored = math.fsum(
        (robot.battery or 0) * one.capacity_uj / 1e6
        for robot, one in zip(world.robots, batteries, strict=True)
    )
    gain = max(0.0, min(supply[1], max(one.charging for one in batteries)) - idle)
    charging = (most - stored / per_metre) / (speed + gain / per_metre)
    charging = min(max(charging, 0.0), supply[0] * duration)
    return min(most - speed * charging, (stored + gain * charging) / per_metre)


def _lengths(map_name: str, points: tuple[Point, ...]) -> list[list[float]]:
    """Return lower bounds of the ways between points, m; infinite if there is none."""
    grid = load_map(map_name)
    costs, cells = grid.free.astype(np.int32), [grid.cell(point) for point in points]
    costs.setflags(write=False)
    found = []
    for goal in cells:
        field = potential(costs, *goal)
        steps = [int(field[cell]) for cell in cells]
        found.append(
            [
                math.inf
                if one == UNREACHABLE
                else max(0.0, (one / (2 * STRAIGHT) / _DETOUR - 4) * grid.resolution - 2 * REACH)
                for one in steps
            ]
        )
    return found
