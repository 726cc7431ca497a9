"""Drive forces from velocity commands and bumper bits from contacts, for all robots at once."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actors import geometry
from actors.array_types import Flags, Floats, Int64s, Octets, Records, UInt64s
from actors.instant import seconds
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import atan2, cos_sin, hypot
from actors.robot_model import RobotModel

LIMITS = np.dtype(
    [
        ("omnidirectional", "b1"),
        *[(name, "f8") for name in ("speed", "acceleration", "turn_rate", "turn_acceleration")],
        *[(name, "f8") for name in ("grip", "turn_grip", "mass", "moment")],
        ("watchdog_us", "i8"),
        *[(name, "f8") for name in ("bumper_centre", "bumper_reach")],
    ],
    align=True,
)
"""Drive and bumper parameters of one robot; accelerations in 1/s², angles in rad."""


def moment_of_inertia(model: RobotModel) -> float:
    """Return the moment of inertia about the body's origin, kg m², for an even mass distribution."""
    if model.footprint.radius is not None:
        return model.mass * (model.footprint.radius * model.footprint.radius) / 2
    assert model.footprint.vertices is not None
    return geometry.moment_of_inertia(model.footprint.vertices, model.mass)


def limits(models: Sequence[RobotModel]) -> Records:
    """Return (n,) of LIMITS; angles are negative for a robot without bumper.

    The wheels, half-way out from the centre, slip above the angular acceleration `turn_grip`.
    """
    rows = []
    for model in models:
        drive, moment, bumper = model.drive, moment_of_inertia(model), model.bumper
        turn_grip = drive.grip * model.mass * model.footprint.circumradius / 2 / moment
        rates = drive.speed, drive.acceleration, drive.turn_rate, drive.turn_acceleration, drive.grip
        body = turn_grip, model.mass, moment, seconds(drive.watchdog)
        sectors = (
            [math.radians(bumper.centre_deg), math.radians(bumper.reach_deg)] if bumper else [-1.0, -1.0]
        )
        rows.append((drive.kind == "omnidirectional", *rates, *body, *sectors))
    return np.array(rows, LIMITS)


MEMORY = np.dtype(
    [(name, "f8") for name in ("ahead", "aside", "turn", "hold_ahead", "hold_aside", "hold_turn")]
)
"""State of a drive: target velocity of the wheels in the body's frame, m/s and rad/s, and holding action
against pushes, as velocity change per sub-step, m/s and rad/s."""


@kernel
def drive_forces(
    state: Floats,
    commands: Floats,
    issued_us: Int64s,
    now_us: int,
    dt: float,
    limits: Records,
    memory: Records,
    forces: Floats,
) -> None:
    """Compute the forces of all drives in the next sub-step, which follow commands within the limits.

    state (n, 6): x, y, heading, vx, vy, omega, map frame; commands (n, 3): vx, vy, omega, body frame; memory
    (n,) of MEMORY, updated; forces (n, 3), written: N, N, N m, map frame.

    Wheels accelerate with at most mass times the acceleration limit, but hold with their grip: one robot
    alone does not push away a standing one, and a robot that drives against a wall hardly slides along it.
    """
    for i in range(state.shape[0]):
        limit = limits[i]
        vx, vy, omega = commands[i, 0], commands[i, 1], commands[i, 2]
        if now_us - issued_us[i] > limit.watchdog_us:
            vx = vy = omega = 0.0
        if limit.omnidirectional:
            vx, vy = _shortened(vx, vy, limit.speed)
        else:
            vx, vy = min(max(vx, -limit.speed), limit.speed), 0.0
        # The physics moves bodies before it changes velocities, so the new velocity applies at the heading
        # after that move: a differential drive never drifts sideways.
        heading = state[i, 2] + state[i, 5] * dt
        c, s = cos_sin(heading)
        forward, leftward = c * state[i, 3] + s * state[i, 4], c * state[i, 4] - s * state[i, 3]
        ahead, aside = _velocity_change(state[i], forward, leftward, vx, vy, dt, limit, memory[i])
        omega = min(max(omega, -limit.turn_rate), limit.turn_rate)
        turn, turn_grip = limit.turn_acceleration * dt, limit.turn_grip * dt
        wheels = memory[i]
        wheels.hold_turn = _holding_action(wheels.hold_turn, state[i, 5] - wheels.turn, turn_grip)
        wheels.turn += min(max(omega - wheels.turn, -turn), turn)
        turning = min(max(wheels.turn - state[i, 5] + wheels.hold_turn, -turn_grip), turn_grip)
        forces[i, 0] = limit.mass * (c * ahead - s * aside) / dt
        forces[i, 1] = limit.mass * (s * ahead + c * aside) / dt
        forces[i, 2] = limit.moment * turning / dt


@kernel
def _velocity_change(
    state: Floats, forward: float, leftward: float, vx: float, vy: float, dt: float, limit: Any, wheels: Any
) -> tuple[float, float]:
    """Return the drive's velocity change, body frame; forward, leftward: current velocity."""
    reach, grip = limit.acceleration * dt, limit.grip * dt
    c, s = cos_sin(state[2])
    slip_ahead = c * state[3] + s * state[4] - wheels.ahead  # since the last sub-step: pushed
    slip_aside = c * state[4] - s * state[3] - wheels.aside
    change_x, change_y = _shortened(vx - wheels.ahead, vy - wheels.aside, reach)
    wheels.ahead += change_x
    wheels.aside += change_y
    ahead, aside = wheels.ahead - forward, wheels.aside - leftward
    if ahead * wheels.ahead + aside * wheels.aside * limit.omnidirectional > 0:  # below the target speed
        wheels.hold_ahead = 0.0
        if limit.omnidirectional:
            wheels.hold_aside = 0.0
            ahead, aside = _shortened(ahead, aside, reach)
            wheels.ahead, wheels.aside = forward + ahead, leftward + aside
            return ahead, aside
        ahead = min(max(ahead, -reach), reach)
        wheels.ahead = forward + ahead
    else:
        wheels.hold_ahead = _holding_action(wheels.hold_ahead, slip_ahead, grip)
        ahead = min(max(ahead + wheels.hold_ahead, -grip), grip)
    wheels.hold_aside = _holding_action(wheels.hold_aside, slip_aside, grip)
    aside = min(max(aside + wheels.hold_aside, -grip), grip)
    return ahead, aside


@kernel
def _holding_action(hold: float, slip: float, grip: float) -> float:
    """Return the holding action after a slip at this velocity: critically damped, with slow decay.

    Without decay, a robot wedged between walls would stay under stress after the pushing has stopped.
    """
    return min(max(0.995 * hold - slip / 4, -grip), grip)


@kernel
def _shortened(x: float, y: float, longest: float) -> tuple[float, float]:
    """Return the vector, shortened to at most `longest`."""
    length = hypot(x, y)
    share = 1.0 if length <= longest else longest / length
    return x * share, y * share


@kernel
def set_bumpers(
    state: Floats,
    pairs: UInt64s,
    normals: Floats,
    numbers: UInt64s,
    bodies: Int64s,
    limits: Records,
    bumpers: Octets,
    touching: Flags,
) -> tuple[int, bool]:
    """Set the bumper bits of all contacts.

    Returns the number of contacts begun, except with people, and whether a robot is in `touching`.

    pairs (m, 3): numbers of both bodies, and whether the contact is new; normals (m, 2): from the first to
    the second; numbers (b,), ascending, and bodies (b,): body numbers, and indices of n robots, then of
    people; bumpers (n,): bits are added; touching (n,), updated: whether each robot touches anything but
    robots and people.
    """
    n = state.shape[0]
    begun, touched = 0, False
    now_touching = np.zeros(n, np.bool_)
    for k in range(pairs.shape[0]):
        a, b = body_of(pairs[k, 0], numbers, bodies), body_of(pairs[k, 1], numbers, bodies)
        bearing = atan2(normals[k, 1], normals[k, 0])
        if 0 <= a < n:
            bumpers[a] |= _bumper_bit(bearing - state[a, 2], limits[a])
        if 0 <= b < n:
            bumpers[b] |= _bumper_bit(bearing + math.pi - state[b, 2], limits[b])
        if max(a, b) >= n:  # a person
            continue
        if a >= 0 and b >= 0:
            begun += 1 if pairs[k, 2] else 0
        elif a >= 0:
            now_touching[a] = True
        elif b >= 0:
            now_touching[b] = True
    for i in range(n):
        if now_touching[i] and not touching[i]:
            begun += 1
        touching[i] = now_touching[i]
        touched = touched or now_touching[i]
    return begun, touched


@kernel
def body_of(number: int, numbers: UInt64s, bodies: Int64s) -> int:
    """Return the index of the body with this number, or −1; numbers: ascending."""
    place = np.searchsorted(numbers, number)
    return bodies[place] if place < numbers.size and numbers[place] == number else -1


@kernel
def _bumper_bit(bearing: float, limit: Any) -> np.uint8:
    """Return the bumper bit for a bearing relative to straight ahead: 1 right, 2 centre, 4 left, 0 none."""
    bearing -= 2 * math.pi * math.floor((bearing + math.pi) / (2 * math.pi))
    if abs(bearing) <= limit.bumper_centre:
        return np.uint8(2)
    if abs(bearing) <= limit.bumper_reach:
        return np.uint8(4) if bearing > 0 else np.uint8(1)
    return np.uint8(0)


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    row = (0.5, 1.0, 5.0, 3.5, 5.0, 28.0, 10.0, 0.157, 500_000, 0.5, 1.5)
    fixed = np.array([(omnidirectional, *row) for omnidirectional in (False, True, True)], LIMITS)
    state = arrays.sin(np.arange(18.0)).reshape(3, 6)
    commands = arrays.cos(np.arange(9.0)).reshape(3, 3)
    forces, memory = np.zeros((3, 3)), np.full(3, 0.02).astype(MEMORY)
    drive_forces(state, commands, np.array([0, 1, -600_000]), 0, 0.01, fixed, memory, forces)
    bumpers, touching = np.zeros(3, np.uint8), np.zeros(3, np.bool_)
    pairs = np.array([[5, 6, 1], [6, 7, 0], [7, 1, 1]], np.uint64)
    numbers, robots = np.array([5, 6, 7], np.uint64), np.array([1, 0, 2])
    normals = arrays.cos(np.arange(6.0)).reshape(3, 2)
    begun, _ = set_bumpers(state, pairs, normals, numbers, robots, fixed, bumpers, touching)
    return forces.tobytes() + memory.tobytes() + bumpers.tobytes() + touching.tobytes() + bytes([begun])
