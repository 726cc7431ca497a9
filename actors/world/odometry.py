"""Odometry: where a robot's base believes to be, from its true motion and the errors of a kind of base."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.geometry import Pose, wrap
from actors.instant import Duration, in_seconds
from actors.messages import Odometry
from actors.portable.draws import normals, uniforms
from actors.robot_model import OdometryKind, RobotModel
from actors.runtime.errors import AcrcError
from actors.world.odometry_kernel import BASE, add_measured, add_scaled, tell


@dataclass(frozen=True)
class StageErrors:
    """Stage's model of a position device with `localization "odom"`: a constant factor per axis and run.

    Each factor is 1 + e with e drawn evenly from −E/2 to E/2 (rtv/Stage, libstage/model_position.cc).
    """

    forward: float = 0.03
    """E of motion forward; d3scomp/ROSRemote, simulation/turtlebot.inc, odom_error."""
    leftward: float = 0.03
    """E of motion to the left; same file."""
    turn: float = 0.02
    """E of turning; same file."""


@dataclass(frozen=True)
class KobukiErrors:
    """A Kobuki: position from its wheels' encoders, heading from its gyro (kobuki_node, odometry)."""

    track: float = 0.230
    """Between the wheels, m; kobuki_driver, "Kobuki Parameters"."""
    tick_um: float = 85.292
    """Travel per encoder tick, µm; kobuki_driver, "Kobuki Parameters"."""
    feedback: Duration = Duration(20_000)  # noqa: RUF009 - a NewType makes no object
    """Period of the base's feedback; kobuki_driver, "Protocol Specification": 50 Hz. Whole sub-steps."""
    gyro_resolution_deg: float = 0.01
    """Of the heading in the feedback, degrees; kobuki_driver, "Protocol Specification", inertial data."""
    gyro_noise_deg: float = 0.03
    """White noise of the rate, °/s per √Hz, hence degrees per √s; ST L3G4200D data sheet."""
    gyro_bias_deg: float = 0.01
    """Standard deviation of the rate's bias at the start, °/s; own estimate: what a third of a kelvin since
    its calibration makes of the gyro (same data sheet: 0.03 °/s per K)."""
    gyro_walk_deg: float = 0.0005
    """How the bias wanders, °/s per √s; own estimate: as much again as at the start within 7 minutes."""
    wheel_scale: float = 0.002
    """Standard deviation of a wheel's radius, as a share of it; own estimate: 0.07 mm of 35 mm."""
    slip: float = 0.002
    """Standard deviation of a wheel's travel, m per √m travelled; own estimate for a smooth floor."""


class Odometers:
    """The odometry of all robots, by index. A robot's errors depend on its own generator only.

    Motion is added up per sub-step, so the result does not depend on how many sub-steps one call brings.
    """

    def __init__(
        self,
        kinds: Sequence[str],
        models: Sequence[RobotModel],
        poses: NDArray[np.float64],
        generators: Sequence[Generator],
        substep: Duration,
        stage: StageErrors = StageErrors(),
        kobuki: KobukiErrors = KobukiErrors(),
    ) -> None:
        """`kinds`: OdometryKinds; `poses`: (n, 3), where they were switched on. Raises AcrcError."""
        n = len(kinds)
        assert n == len(models) == len(poses) == len(generators)
        assert kobuki.feedback % substep == 0
        for model, kind in zip(models, kinds, strict=True):
            _check(model, kind)
        self._generators = tuple(generators)
        self._dt = in_seconds(substep)
        self._kobuki = _in_si(kobuki, substep)
        self._origin = np.array(poses, np.float64)
        self._last = np.array(poses, np.float64)
        self._true_velocities = np.zeros((n, 3))
        self._estimates = np.zeros((n, 3))
        self._velocities = np.zeros((n, 3))
        self._said: list[tuple[float, ...]] | None = None
        """What `read` gives, of all robots at once, until something has moved."""
        self._is_exact = np.array([kind == "exact" for kind in kinds], np.bool_)
        self._is_measured = np.array([kind == "kobuki" for kind in kinds], np.bool_)
        self._rows = np.zeros((n, 6))
        self._scaled = np.array([i for i, kind in enumerate(kinds) if kind == "stage"], np.int64)
        self._measured = np.array([i for i, kind in enumerate(kinds) if kind == "kobuki"], np.int64)
        self._factors = np.ones((n, 3))
        for i in self._scaled:
            spread = np.array([stage.forward, stage.leftward, stage.turn])
            self._factors[i] += uniforms(generators[i], -0.5, 0.5, 3) * spread
        self._bases = np.zeros(n, BASE)
        for i in self._measured:
            left, right, bias = normals(generators[i], 3).tolist()
            base = self._bases[i]
            base["left_scale"] = 1 + left * kobuki.wheel_scale
            base["right_scale"] = 1 + right * kobuki.wheel_scale
            base["bias"] = bias * math.radians(kobuki.gyro_bias_deg)

    def follow(self, track: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Take in true motion, map frame: `track`, (substeps, n, 3), the poses after each sub-step, and
        `velocities`, (n, 3), at the end."""
        if self._scaled.size:
            add_scaled(track, self._scaled, self._last, self._factors, self._estimates)
        if self._measured.size:
            draws = np.stack([normals(self._generators[i], (len(track), 4)) for i in self._measured])
            add_measured(
                track,
                self._measured,
                self._last,
                draws,
                self._dt,
                self._kobuki,
                self._bases,
                self._estimates,
                self._velocities,
            )
        self._last[:] = track[-1]
        self._true_velocities[:] = velocities
        self._said = None

    def carry(self, index: int, pose: Pose) -> None:
        """Tell that somebody lifted the robot and put it elsewhere: only an exact odometry notices."""
        self._last[index] = pose
        self._true_velocities[index] = 0.0
        self._said = None

    def read(self, index: int) -> Odometry:
        """What the robot's base says."""
        if self._said is None:
            self._said = self._all()
        return Odometry(*self._said[index])

    def _all(self) -> list[tuple[float, ...]]:
        """The fields of what each base says."""
        said = self._estimates, self._velocities
        true = self._last, self._origin, self._true_velocities
        tell(*true, *said, self._is_exact, self._is_measured, self._rows)
        rows = self._rows.tolist()
        return [(x, y, wrap(heading), vx, vy, omega) for x, y, heading, vx, vy, omega in rows]


def _check(model: RobotModel, kind: str) -> None:
    known = get_args(OdometryKind)
    if kind not in known:
        raise AcrcError(f"a robot's odometry is {kind!r}; it should be one of {', '.join(known)}")
    if kind == "kobuki" and model.drive.kind != "differential":
        raise AcrcError(
            f"the odometry of a robot {model.name!r} is 'kobuki', which reads the wheels of a differential "
            "drive; it should be exact or stage"
        )


def _in_si(kobuki: KobukiErrors, substep: Duration) -> tuple[float, float, float, float, float, float, int]:
    """As the kernel `add_measured` wants it."""
    return (
        kobuki.track,
        kobuki.tick_um * 1e-6,
        kobuki.slip,
        math.radians(kobuki.gyro_noise_deg),
        math.radians(kobuki.gyro_walk_deg),
        math.radians(kobuki.gyro_resolution_deg),
        kobuki.feedback // substep,
    )
