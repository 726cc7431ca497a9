"""How an odometry adds up true motion, sub-step by sub-step, for all robots of a kind at once."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable import arrays
from actors.portable.compiled import cos_sin

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

BASE = np.dtype(
    [
        ("left_travel", np.float64),
        ("right_travel", np.float64),
        ("left_scale", np.float64),
        ("right_scale", np.float64),
        ("left_ticks", np.int64),
        ("right_ticks", np.int64),
        ("angle", np.float64),
        ("bias", np.float64),
        ("substeps", np.int64),
    ],
    align=True,
)
"""What a Kobuki knows and does not know of itself: true travel of its wheels and by how much each is off,
ticks at the last feedback, the gyro's angle and bias, sub-steps since it was switched on."""


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_scaled(track: Floats, robots: Indices, last: Floats, factors: Floats, estimates: Floats) -> None:
    """Add the motion along a track to estimates, each axis of the body's frame times a factor.

    track (s, n, 3): poses after each sub-step; robots (k,): of this kind; last (n, 3): their poses before;
    factors (n, 3); estimates (n, 3), written.
    """
    for i in robots:
        x, y, heading = last[i, 0], last[i, 1], last[i, 2]
        for k in range(track.shape[0]):
            forward, leftward, turn = _motion(x, y, heading, track[k, i])
            x, y, heading = track[k, i, 0], track[k, i, 1], track[k, i, 2]
            _add(estimates[i], estimates[i, 2], forward * factors[i, 0], leftward * factors[i, 1])
            estimates[i, 2] += turn * factors[i, 2]


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_measured(
    track: Floats,
    robots: Indices,
    last: Floats,
    normals: Floats,
    dt: float,
    model: tuple[float, float, float, float, float, float, int],
    bases: NDArray[np.void],
    estimates: Floats,
    velocities: Floats,
) -> None:
    """The same as wheel encoders and a gyro measure it.

    normals (k, s, 4): standard normal draws; model: track width m, metres per tick, slip m/√m, gyro noise
    rad/√s, bias walk rad/s/√s, gyro resolution rad, sub-steps per feedback; bases (n,) of BASE; velocities
    (n, 3), written: those of the last feedback, body frame.
    """
    width, per_tick, slip, noise, walk, resolution, every = model
    for row in range(robots.size):
        i = robots[row]
        base = bases[i]
        x, y, heading = last[i, 0], last[i, 1], last[i, 2]
        for k in range(track.shape[0]):
            forward, _, turn = _motion(x, y, heading, track[k, i])
            x, y, heading = track[k, i, 0], track[k, i, 1], track[k, i, 2]
            left, right = forward - turn * width / 2, forward + turn * width / 2
            base.left_travel += left * base.left_scale + normals[row, k, 0] * slip * math.sqrt(abs(left))
            base.right_travel += right * base.right_scale + normals[row, k, 1] * slip * math.sqrt(abs(right))
            base.angle += turn + base.bias * dt + normals[row, k, 2] * noise * math.sqrt(dt)
            base.bias += normals[row, k, 3] * walk * math.sqrt(dt)
            base.substeps += 1
            if base.substeps % every == 0:
                _feed_back(base, per_tick, resolution, every * dt, estimates[i], velocities[i])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _feed_back(
    base: Any, per_tick: float, resolution: float, period: float, estimate: Floats, velocity: Floats
) -> None:
    """Let a base read its encoders and its gyro, and move its estimate on."""
    left = math.floor(base.left_travel / per_tick)
    right = math.floor(base.right_travel / per_tick)
    forward = (left - base.left_ticks + right - base.right_ticks) * per_tick / 2
    base.left_ticks, base.right_ticks = left, right
    heading = math.floor(base.angle / resolution + 0.5) * resolution
    turn = heading - estimate[2]
    _add(estimate, estimate[2] + turn / 2, forward, 0.0)
    estimate[2] = heading
    velocity[0], velocity[1], velocity[2] = forward / period, 0.0, turn / period


@njit(cache=True)  # type: ignore[untyped-decorator]
def _motion(x: float, y: float, heading: float, pose: Floats) -> tuple[float, float, float]:
    """From one pose to the next: forward and leftward in the first one's frame, m; turn in [−π, π), rad."""
    dx, dy = pose[0] - x, pose[1] - y
    c, s = cos_sin(heading)
    turn = pose[2] - heading
    turn -= 2 * math.pi * math.floor((turn + math.pi) / (2 * math.pi))
    return c * dx + s * dy, c * dy - s * dx, turn


@njit(cache=True)  # type: ignore[untyped-decorator]
def _add(estimate: Floats, heading: float, forward: float, leftward: float) -> None:
    c, s = cos_sin(heading)
    estimate[0] += c * forward - s * leftward
    estimate[1] += s * forward + c * leftward


@njit(cache=True)  # type: ignore[untyped-decorator]
def tell(
    last: Floats,
    origin: Floats,
    true: Floats,
    estimates: Floats,
    velocities: Floats,
    exact: NDArray[np.bool_],
    measured: NDArray[np.bool_],
    rows: Floats,
) -> None:
    """Write what each base says: x, y, m, heading, rad, not wrapped, and velocity, m/s and rad/s; (n, 6).

    last, origin (n, 3): poses now and at the start; true (n, 3): velocities, map frame; estimates, velocities
    (n, 3): of odometries that are wrong, the latter where `measured`; exact (n,): which ones are not.
    """
    for i in range(last.shape[0]):
        rows[i, 0:3] = estimates[i]
        if exact[i]:
            x, y = last[i, 0] - origin[i, 0], last[i, 1] - origin[i, 1]
            rows[i, 0], rows[i, 1] = _turned_back(origin[i, 2], x, y)
            rows[i, 2] = last[i, 2] - origin[i, 2]
        rows[i, 3:6] = velocities[i]
        if not measured[i]:
            rows[i, 3], rows[i, 4] = _turned_back(last[i, 2], true[i, 0], true[i, 1])
            rows[i, 5] = true[i, 2]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _turned_back(heading: float, x: float, y: float) -> tuple[float, float]:
    """A vector as seen from a frame that is turned by this heading."""
    c, s = cos_sin(heading)
    return c * x + s * y, c * y - s * x


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    track = arrays.sin(np.arange(60.0)).reshape(10, 2, 3)
    robots, last = np.arange(2), np.zeros((2, 3))
    estimates, velocities = np.zeros((2, 3)), np.zeros((2, 3))
    add_scaled(track, robots, last, 1 + arrays.cos(np.arange(6.0)).reshape(2, 3) / 100, estimates)
    bases = np.zeros(2, BASE)
    bases["left_scale"], bases["right_scale"], bases["bias"] = 1.001, 0.999, 1e-4
    normals = arrays.cos(np.arange(80.0)).reshape(2, 10, 4)
    model = (0.23, 8.5e-5, 0.002, 5e-4, 1e-5, 1.7e-4, 2)
    add_measured(track, robots, last, normals, 0.01, model, bases, estimates, velocities)
    rows, kinds = np.zeros((2, 6)), np.array([True, False])
    tell(track[9], track[0], track[1], estimates, velocities, kinds, kinds, rows)
    return estimates.tobytes() + velocities.tobytes() + bases.tobytes() + rows.tobytes()
