"""Kernels of walking people: the social force model, routes around walls, and contacts with robots.

The equation of motion is that of Helbing and Molnár, "Social force model for pedestrian dynamics", Phys. Rev.
E 51, 4282 (1995), with the interaction that Moussaïd, Helbing, Garnier, Johansson, Combe and Theraulaz fitted
to experiments: "Experimental study of the behavioural mechanisms underlying self-organization in human
crowds", Proc. R. Soc. B 276, 2755 (2009). Person i at x_i with velocity v_i accelerates by

    dv_i/dt = (v0_i e_i − v_i) / τ + Σ_j f_ij + f_wall

- v0_i e_i: desired velocity, towards the farthest visible point of the route; τ = 0.54 s.
- f_ij = −A exp(−d/B) [exp(−(n' B θ)²) t + sign(θ) exp(−(n B θ)²) n]: slowing and turning away from each
  visible person and robot j, with D = λ (v_i − v_j) + e_ij, t = D/|D|, n: t turned left, θ: angle from t to
  e_ij, B = γ |D|, d: distance; A = 4.5 m/s², γ = 0.35, λ = 2, n = 2, n' = 3.
- f_wall = a exp(−d_w/b) away from the nearest wall or obstacle, d_w from the body; a = 3 m/s², b = 0.1 m.

A speed is at most 1.3 v0 (Helbing and Molnár). Own choices: distances to robots count as if these had a
person's radius; others act up to 5 m and if no wall is between. People stop for robots: they approach a robot
only as fast as they can brake, with 2 m/s², 5 cm before it. Bodies and contacts are those of the physics.
"""

import math
from typing import Final

import numpy as np

from actors.array_types import Flags, Floats, Int64s, UInt16s, UInt64s
from actors.kernels import kernel, njit
from actors.portable import arrays
from actors.portable.compiled import atan2, exp, hypot
from actors.world.drive import body_of

RADIUS: Final = 0.25
"""Radius of a person's body, m: the least of Helbing, Farkas and Vicsek, Nature 407, 487 (2000)."""
MASS: Final = 80.0
"""Mass of a person, kg (ibid.)."""
_TAU: Final = 0.54
_A, _GAMMA, _LAMBDA, _TURNING, _SLOWING = 4.5, 0.35, 2.0, 2.0, 3.0
_WALL_A, _WALL_B = 3.0, 0.1
_HASTE: Final = 1.3
REACH: Final = 5.0
"""Distance up to which people and robots act on a person, m."""
_STOP, _BRAKING = 0.05, 2.0
UNREACHED: Final = 65535
"""Cost of a cell from which no path leads to the destination."""
_STRAIGHT, _DIAGONAL, _NARROW = 5, 7, 3
"""UInt16s of a step to a neighbouring cell, and their factor where the route is near a wall."""
_COMFORT: Final = 0.45
"""Distance from walls that routes keep where there is room, m."""
_AHEAD: Final = 25
"""Cells of a route that a person looks ahead."""


@kernel
def social_forces(
    state: Floats,
    robots: int,
    radii: Floats,
    wishes: Floats,
    sees: Flags,
    walls: Floats,
    obstacles: Floats,
    dt: float,
    forces: Floats,
) -> None:
    """Compute the forces on all people in the next sub-step.

    state (n, 6): x, y, heading, vx, vy, omega of robots, then people; radii (n,); wishes (p, 4): direction
    of the desired velocity, its magnitude, and the speed v0; sees (p, n): whether each acts on each person;
    walls (m, 4): x0, y0, x1, y1; obstacles (o, 3): x, y, radius; forces (p, 3), written: N, N, N m.
    """
    for person in range(wishes.shape[0]):
        own = robots + person
        x, y, vx, vy = state[own, 0], state[own, 1], state[own, 3], state[own, 4]
        drive_x = (wishes[person, 2] * wishes[person, 0] - vx) / _TAU
        drive_y = (wishes[person, 2] * wishes[person, 1] - vy) / _TAU
        away_x, away_y = _away_from_walls(x, y, walls, obstacles)
        for other in range(state.shape[0]):
            if not sees[person, other]:
                continue
            apart, to_x, to_y = _direction(state[other, 0] - x, state[other, 1] - y)
            apart = max(apart - radii[other] + RADIUS, 0.0)
            push_x, push_y = _interaction(to_x, to_y, vx - state[other, 3], vy - state[other, 4], apart)
            away_x, away_y = away_x + push_x, away_y + push_y
        next_x, next_y = vx + (drive_x + away_x) * dt, vy + (drive_y + away_y) * dt
        share = min(1.0, _HASTE * wishes[person, 3] / max(hypot(next_x, next_y), 1e-6))
        next_x, next_y = share * next_x, share * next_y
        for robot in range(robots):
            if sees[person, robot]:
                apart, to_x, to_y = _direction(state[robot, 0] - x, state[robot, 1] - y)
                gap = max(apart - radii[robot] - RADIUS - _STOP, 0.0)
                over = max(next_x * to_x + next_y * to_y - math.sqrt(2 * _BRAKING * gap), 0.0)
                next_x, next_y = next_x - over * to_x, next_y - over * to_y
        forces[person, 0] = MASS * (next_x - vx) / dt
        forces[person, 1] = MASS * (next_y - vy) / dt
        forces[person, 2] = 0.0


@kernel
def _direction(x: float, y: float) -> tuple[float, float, float]:
    """Return the length of a vector, at least 1e-6, and the vector divided by it."""
    length = max(hypot(x, y), 1e-6)
    return length, x / length, y / length


@njit()  # type: ignore[untyped-decorator]
def _interaction(
    to_x: float, to_y: float, faster_x: float, faster_y: float, apart: float
) -> tuple[float, float]:
    """Return f_ij, m/s²; e_ij, v_i − v_j and d are given."""
    along_x, along_y = _LAMBDA * faster_x + to_x, _LAMBDA * faster_y + to_y
    length, along_x, along_y = _direction(along_x, along_y)
    theta = atan2(along_x * to_y - along_y * to_x, along_x * to_x + along_y * to_y)
    reach = _GAMMA * length
    slow, turn = _SLOWING * reach * theta, _TURNING * reach * theta
    strength = _A * exp(-apart / reach)
    slowing, turning = -strength * exp(-slow * slow), -strength * exp(-turn * turn)
    if theta < 0:
        turning = -turning
    return slowing * along_x - turning * along_y, slowing * along_y + turning * along_x


@kernel
def _away_from_walls(x: float, y: float, walls: Floats, obstacles: Floats) -> tuple[float, float]:
    """Return f_wall, m/s², at a point."""
    nearest, away_x, away_y = REACH, 0.0, 0.0
    for k in range(walls.shape[0]):
        x0, y0, x1, y1 = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if min(x0, x1) - x > nearest or x - max(x0, x1) > nearest:
            continue
        along_x, along_y = x1 - x0, y1 - y0
        squared = along_x * along_x + along_y * along_y
        share = min(max(((x - x0) * along_x + (y - y0) * along_y) / squared, 0.0), 1.0)
        apart, dx, dy = _direction(x - (x0 + share * along_x), y - (y0 + share * along_y))
        if apart < nearest:
            nearest, away_x, away_y = apart, dx, dy
    for k in range(obstacles.shape[0]):
        centre, dx, dy = _direction(x - obstacles[k, 0], y - obstacles[k, 1])
        apart = centre - obstacles[k, 2]
        if apart < nearest:
            nearest, away_x, away_y = apart, dx, dy
    strength = _WALL_A * exp(-max(nearest - RADIUS, 0.0) / _WALL_B)
    return strength * away_x, strength * away_y


@kernel
def travel_costs(room: Floats, row: int, column: int, costs: UInt16s) -> None:
    """Compute the cost of the cheapest path from every cell to (row, column).

    room (rows, columns): distance of each cell's centre from walls, m; costs, written: UNREACHED without a
    path. A path leads over cells where a person has room. UInt16s are whole numbers: the result is exact.
    """
    rows, columns = room.shape
    costs[:] = UNREACHED
    queue, waiting = np.empty(room.size, np.int64), np.zeros(room.size, np.bool_)
    queue[0], first, count = row * columns + column, 0, 1
    costs[row, column] = 0
    while count:
        cell = queue[first]
        first, count = (first + 1) % room.size, count - 1
        waiting[cell] = False
        here_row, here_column = divmod(cell, columns)
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = here_row + down, here_column + right
                if not (0 <= r < rows and 0 <= c < columns) or room[r, c] < RADIUS:
                    continue
                step = _DIAGONAL if down and right else _STRAIGHT
                cost = int(costs[here_row, here_column]) + step * (1 if room[r, c] >= _COMFORT else _NARROW)
                if cost < costs[r, c]:
                    costs[r, c] = cost
                    if not waiting[r * columns + c]:
                        waiting[r * columns + c] = True
                        queue[(first + count) % room.size] = r * columns + c
                        count += 1


@kernel
def guide(cells: Floats, room: Floats, costs: UInt16s, wishes: Floats, left: Int64s) -> None:
    """Point each walking person to the farthest visible point of the route.

    cells (p, 2): x and y in cells from the map's corner; room: as for `travel_costs`; costs (p, rows,
    columns): of each person's destination; wishes (p, 4): direction, written; left (p,), written: cost of the
    way left.
    """
    rows, columns = room.shape
    for person in range(cells.shape[0]):
        x, y = cells[person, 0], cells[person, 1]
        row, column = min(max(math.floor(y), 0), rows - 1), min(max(math.floor(x), 0), columns - 1)
        row, column = _next_cell(costs[person], row, column)
        left[person] = costs[person, row, column]
        if left[person] == UNREACHED:
            wishes[person, 0] = wishes[person, 1] = 0.0
            continue
        target_row, target_column = row, column
        for _ in range(_AHEAD):
            row, column = _next_cell(costs[person], row, column)
            if not _has_room(room, x, y, column + 0.5, row + 0.5, RADIUS):
                break
            target_row, target_column = row, column
        _, wishes[person, 0], wishes[person, 1] = _direction(target_column + 0.5 - x, target_row + 0.5 - y)


@kernel
def _next_cell(costs: UInt16s, row: int, column: int) -> tuple[int, int]:
    """Return the cheapest cell among a cell and its neighbours."""
    rows, columns = costs.shape
    best_row, best_column = row, column
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            if costs[r, c] < costs[best_row, best_column]:
                best_row, best_column = r, c
    return best_row, best_column


@kernel
def _has_room(room: Floats, x: float, y: float, to_x: float, to_y: float, least: float) -> bool:
    """Return whether all cells on a line, but the first, have more room than `least`, m."""
    rows, columns = room.shape
    own_row, own_column = math.floor(y), math.floor(x)
    samples = int(2 * max(abs(to_x - x), abs(to_y - y))) + 1
    for k in range(1, samples + 1):
        row = math.floor(y + (to_y - y) * k / samples)
        column = math.floor(x + (to_x - x) * k / samples)
        if row == own_row and column == own_column:
            continue
        if not (0 <= row < rows and 0 <= column < columns) or room[row, column] <= least:
            return False
    return True


@kernel
def look_around(cells: Floats, robots: int, room: Floats, reach: float, sees: Flags) -> None:
    """Compute which robots and people each person sees: near, and without a wall between.

    cells (n, 2): x and y of robots, then people, in cells; reach: REACH in cells; sees (p, n), written.
    """
    for person in range(sees.shape[0]):
        x, y = cells[robots + person, 0], cells[robots + person, 1]
        for other in range(sees.shape[1]):
            to_x, to_y = cells[other, 0], cells[other, 1]
            near = other != robots + person and hypot(to_x - x, to_y - y) <= reach
            sees[person, other] = near and _has_room(room, x, y, to_x, to_y, 0.0)


@kernel
def count_contacts(
    pairs: UInt64s,
    numbers: UInt64s,
    bodies: Int64s,
    robots: int,
    now_us: int,
    separation_us: int,
    last_us: Int64s,
) -> tuple[int, int]:
    """Return the contacts between robots and people begun, and the number of touching pairs.

    pairs, numbers, bodies: as for `drive.set_bumpers`, people after the robots; last_us (p, robots), updated:
    instant of each pair's last contact. A contact is new if its pair has not touched for `separation_us`.
    """
    begun = touching = 0
    for k in range(pairs.shape[0]):
        one, other = body_of(pairs[k, 0], numbers, bodies), body_of(pairs[k, 1], numbers, bodies)
        robot, person = min(one, other), max(one, other) - robots
        if 0 <= robot < robots and person >= 0:
            begun += 1 if now_us - last_us[person, robot] > separation_us else 0
            last_us[person, robot] = now_us
            touching += 1
    return begun, touching


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    room = np.abs(arrays.sin(np.arange(600.0))).reshape(20, 30)
    state = 1.0 + arrays.cos(np.arange(18.0)).reshape(3, 6)
    cells, costs = state[:, :2] / 0.1, np.empty((2, 20, 30), np.uint16)
    travel_costs(room, 10, 5, costs[0])
    costs[1] = costs[0]
    wishes, left, forces = np.ones((2, 4)), np.empty(2, np.int64), np.empty((2, 3))
    guide(cells[1:], room, costs, wishes, left)
    sees = np.empty((2, 3), np.bool_)
    look_around(cells, 1, room, 50.0, sees)
    sees[:, 0] = True
    social_forces(state, 1, state[0], wishes, sees, 0.9 * state[:, :4], state[:, 2:5], 0.01, forces)
    return costs.tobytes() + wishes.tobytes() + left.tobytes() + sees.tobytes() + forces.tobytes()
