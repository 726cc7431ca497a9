"""Odometry: pose estimates of the bases from true motion and the error models of their kinds."""

import math
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from numpy.random import Generator

from actors.array_types import Flags, Floats, Int64s, Records
from actors.geometry import Pose, wrap
from actors.instant import Duration, in_seconds
from actors.kernels import kernel, njit
from actors.messages import Odometry
from actors.portable import arrays
from actors.portable.compiled import cos_sin
from actors.portable.draws import normals, uniforms
from actors.robot_model import KobukiErrors, OdometryKind, RobotModel
from actors.runtime.errors import AcrcError

BASE = np.dtype(
    [
        *[(name, "f8") for name in ("left_travel", "right_travel", "left_scale", "right_scale")],
        *[(name, "i8") for name in ("left_ticks", "right_ticks")],
        *[(name, "f8") for name in ("angle", "bias")],
        ("substeps", "i8"),
    ],
    align=True,
)
"""State of a Kobuki base: true travel of its wheels and their scale errors, encoder ticks at the last
feedback, angle and bias of the gyro, sub-steps since power-on."""


@kernel
def add_scaled(track: Floats, robots: Int64s, last: Floats, factors: Floats, estimates: Floats) -> None:
    """Add the motion along a track to estimates, each axis of the body's frame scaled by a factor.

    track (s, n, 3): poses after each sub-step; robots (k,): of this kind; last (n, 3): poses before; factors
    (n, 3); estimates (n, 3), written.
    """
    for i in robots:
        x, y, heading = last[i, 0], last[i, 1], last[i, 2]
        for k in range(track.shape[0]):
            forward, leftward, turn = _motion(x, y, heading, track[k, i])
            x, y, heading = track[k, i, 0], track[k, i, 1], track[k, i, 2]
            _add_motion(estimates[i], estimates[i, 2], forward * factors[i, 0], leftward * factors[i, 1])
            estimates[i, 2] += turn * factors[i, 2]


@njit()  # type: ignore[untyped-decorator]
def add_measured(
    track: Floats,
    robots: Int64s,
    last: Floats,
    normals: Floats,
    dt: float,
    model: tuple[float, float, float, float, float, float, int],
    bases: Records,
    estimates: Floats,
    velocities: Floats,
) -> None:
    """Add the motion along a track as measured by wheel encoders and a gyro.

    normals (k, s, 4): standard normal draws; model: track width m, metres per tick, slip m/√m, gyro noise
    rad/√s, bias walk rad/s/√s, gyro resolution rad, sub-steps per feedback; bases (n,) of BASE; velocities
    (n, 3), written: at the last feedback, body frame.
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
                _read_sensors(base, per_tick, resolution, every * dt, estimates[i], velocities[i])


@kernel
def _read_sensors(
    base: Any, per_tick: float, resolution: float, period: float, estimate: Floats, velocity: Floats
) -> None:
    """Read the encoders and the gyro of a base and update its estimate."""
    left = math.floor(base.left_travel / per_tick)
    right = math.floor(base.right_travel / per_tick)
    forward = (left - base.left_ticks + right - base.right_ticks) * per_tick / 2
    base.left_ticks, base.right_ticks = left, right
    heading = math.floor(base.angle / resolution + 0.5) * resolution
    turn = heading - estimate[2]
    _add_motion(estimate, estimate[2] + turn / 2, forward, 0.0)
    estimate[2] = heading
    velocity[0], velocity[1], velocity[2] = forward / period, 0.0, turn / period


@kernel
def _motion(x: float, y: float, heading: float, pose: Floats) -> tuple[float, float, float]:
    """Return the motion to a pose: forward and leftward, m; turn in [−π, π), rad."""
    dx, dy = pose[0] - x, pose[1] - y
    c, s = cos_sin(heading)
    turn = pose[2] - heading
    turn -= 2 * math.pi * math.floor((turn + math.pi) / (2 * math.pi))
    return c * dx + s * dy, c * dy - s * dx, turn


@kernel
def _add_motion(estimate: Floats, heading: float, forward: float, leftward: float) -> None:
    c, s = cos_sin(heading)
    estimate[0] += c * forward - s * leftward
    estimate[1] += s * forward + c * leftward


@kernel
def write_odometry(
    last: Floats,
    origin: Floats,
    true: Floats,
    estimates: Floats,
    velocities: Floats,
    exact: Flags,
    measured: Flags,
    rows: Floats,
) -> None:
    """Write the odometry of each base, (n, 6): x, y, m, heading, rad, not wrapped, and velocity, m/s and
    rad/s.

    last, origin (n, 3): poses now and at the start; true (n, 3): velocities, map frame; estimates, velocities
    (n, 3): of inexact odometries, the latter where `measured`; exact (n,): which are exact.
    """
    for i in range(last.shape[0]):
        rows[i, 0:3] = estimates[i]
        if exact[i]:
            x, y = last[i, 0] - origin[i, 0], last[i, 1] - origin[i, 1]
            rows[i, 0], rows[i, 1] = _rotated_back(origin[i, 2], x, y)
            rows[i, 2] = last[i, 2] - origin[i, 2]
        rows[i, 3:6] = velocities[i]
        if not measured[i]:
            rows[i, 3], rows[i, 4] = _rotated_back(last[i, 2], true[i, 0], true[i, 1])
            rows[i, 5] = true[i, 2]


@kernel
def _rotated_back(heading: float, x: float, y: float) -> tuple[float, float]:
    """Return a vector in a frame rotated by this heading."""
    c, s = cos_sin(heading)
    return c * x + s * y, c * y - s * x


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
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
    write_odometry(track[9], track[0], track[1], estimates, velocities, kinds, kinds, rows)
    return estimates.tobytes() + velocities.tobytes() + bases.tobytes() + rows.tobytes()


class Odometers:
    """Odometry of all robots, by index; the errors of a robot depend on its own generator only.

    Motion is added per sub-step, so the result does not depend on the number of sub-steps per call.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        models: Sequence[RobotModel],
        poses: Floats,
        generators: Sequence[Generator],
        substep: Duration,
    ) -> None:
        """Create the odometries; `poses`: (n, 3), at power-on. Raises AcrcError."""
        n = len(kinds)
        assert n == len(models) == len(poses) == len(generators)
        for model, kind in zip(models, kinds, strict=True):
            _check(model, kind)
        self._generators = tuple(generators)
        self._dt = in_seconds(substep)
        self._origin = np.array(poses, np.float64)
        self._last = np.array(poses, np.float64)
        self._true_velocities = np.zeros((n, 3))
        self._estimates = np.zeros((n, 3))
        self._velocities = np.zeros((n, 3))
        self._rows = np.zeros((n, 6))
        self._readings: list[tuple[float, ...]] | None = None
        """Readings of all robots; None after a motion, until the next `read`."""
        self._is_exact = np.array([kind == "exact" for kind in kinds], np.bool_)
        self._is_measured = np.array([kind == "kobuki" for kind in kinds], np.bool_)
        self._scaled = np.flatnonzero(~(self._is_exact | self._is_measured))
        measured = np.flatnonzero(self._is_measured).tolist()
        errors = dict.fromkeys(models[i].kobuki_errors for i in measured)
        self._measured = [
            (np.array([i for i in measured if models[i].kobuki_errors == one]), _kernel_model(one, substep))
            for one in errors
        ]
        """Robots with equal errors, and the parameter `model` of `add_measured`."""
        self._factors = np.ones((n, 3))
        for i in self._scaled:
            stage = models[i].stage_errors
            spread = np.array([stage.forward, stage.leftward, stage.turn])
            self._factors[i] += uniforms(generators[i], -0.5, 0.5, 3) * spread
        self._bases = np.zeros(n, BASE)
        for i in measured:
            left, right, bias = normals(generators[i], 3).tolist()
            base, kobuki = self._bases[i], models[i].kobuki_errors
            base["left_scale"] = 1 + kobuki.wheel_bias + left * kobuki.wheel_scale
            base["right_scale"] = 1 + kobuki.wheel_bias + right * kobuki.wheel_scale
            base["bias"] = bias * math.radians(kobuki.gyro_bias_deg)

    def follow(self, track: Floats, velocities: Floats) -> None:
        """Add true motion, map frame.

        `track`: (substeps, n, 3), poses after each sub-step; `velocities`: (n, 3), at the end.
        """
        if self._scaled.size:
            add_scaled(track, self._scaled, self._last, self._factors, self._estimates)
        for robots, model in self._measured:
            draws = np.stack([normals(self._generators[i], (len(track), 4)) for i in robots])
            written = self._bases, self._estimates, self._velocities
            add_measured(track, robots, self._last, draws, self._dt, model, *written)
        self._last[:] = track[-1]
        self._true_velocities[:] = velocities
        self._readings = None

    def relocate(self, index: int, pose: Pose) -> None:
        """Record a relocation of the robot; only exact odometry follows it."""
        self._last[index] = pose
        self._true_velocities[index] = 0.0
        self._readings = None

    def read(self, index: int) -> Odometry:
        """Return the odometry of the robot's base."""
        if self._readings is None:
            true = self._last, self._origin, self._true_velocities
            estimated = self._estimates, self._velocities
            write_odometry(*true, *estimated, self._is_exact, self._is_measured, self._rows)
            rows = self._rows.tolist()
            self._readings = [(x, y, wrap(heading), vx, vy, omega) for x, y, heading, vx, vy, omega in rows]
        return Odometry(*self._readings[index])


def _kernel_model(
    errors: KobukiErrors, substep: Duration
) -> tuple[float, float, float, float, float, float, int]:
    """Return the parameter `model` of `add_measured`."""
    assert errors.feedback % substep == 0
    return (
        errors.track,
        errors.tick_um * 1e-6,
        errors.slip,
        math.radians(errors.gyro_noise_deg),
        math.radians(errors.gyro_walk_deg),
        math.radians(errors.gyro_resolution_deg),
        errors.feedback // substep,
    )


def _check(model: RobotModel, kind: str) -> None:
    known = get_args(OdometryKind)
    if kind not in known:
        raise AcrcError(f"odometry is {kind!r}; must be one of {', '.join(known)}")
    if kind == "kobuki" and model.drive.kind != "differential":
        raise AcrcError(
            f"odometry 'kobuki' of model {model.name!r} needs a differential drive; use exact or stage"
        )
