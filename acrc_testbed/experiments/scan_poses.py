"""Poses of a robot, found by matching its scans with the map: ray casting and robust least squares."""

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from acrc_testbed.results.field_recordings import RobotLog
from acrc_testbed.run_model.hardware_runs import TrialClock
from actors.array_types import Floats, UInt16s
from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Drive
from actors.robot.sweep import OdometryBuffer
from actors.robot_model import RobotModel
from actors.runtime.errors import AcrcError
from actors.world.sensing import RangeSensors

PERIOD_S: Final = 1.0
"""Time between two matched scans, s."""
MAX_PAUSE_S: Final = 3.0
"""Time without a matching scan after which odometry no longer predicts the pose, s."""
_STEP: Final = 0.01
"""Difference for derivatives, m and rad; above the scan's resolution of 1 mm."""
_SCALE: Final = 0.02
"""Residual from which a ray loses weight, m; own choice: a few times the noise of a lidar."""
_OUTLIER: Final = 0.1
"""Residual above which a ray meets something that is not on the map, m; own choice."""
_MIN_SHARE: Final = 0.5
"""Least share of rays with an echo that fit the map."""
_MIN_INFORMATION: Final = 10.0
"""Least information on the position in its least certain direction, as a number of rays that meet a wall at a
right angle. In a corridor without features there is none along it. Own choice."""


class Keyframe(NamedTuple):
    """A scan that fits the map."""

    second: float
    odometry: Pose
    """By odometry, in its own frame."""
    pose: Pose
    """By the scan, map frame."""
    residuals: Floats
    """Measured minus expected ranges without outliers, m."""


class ScanMatcher:
    """Matches scans of robots of one model with a map."""

    def __init__(self, grid: OccupancyGrid, model: RobotModel) -> None:
        exact = model.with_sensor(noise=0.0, noise_growth=0.0)
        self._sensors = RangeSensors(grid, [exact], [np.random.default_rng(0)])
        self._model = model

    def match(self, guess: Pose, measured: UInt16s) -> tuple[Pose, Floats] | None:
        """Return the pose near `guess` and the residuals; None: the scan, mm, does not determine the pose."""

        def errors(pose: Floats) -> Floats:
            expected = self._sensors.scan([0], pose[None], np.zeros((0, 3)))[0]
            return ((measured - expected.astype(np.float64)) / 1000.0).clip(-0.5, 0.5)

        def slopes(pose: Floats) -> Floats:
            moved = np.array([errors(pose + step) for step in _STEP * np.eye(3)])
            return ((moved - errors(pose)) / _STEP).clip(-2.0, 2.0).T

        found = least_squares(
            errors, np.array(guess), slopes, loss="soft_l1", f_scale=_SCALE, xtol=1e-5, max_nfev=15
        )
        echoes = measured < NO_ECHO_MM
        inside = echoes & (np.abs(found.fun) < _OUTLIER)
        information = np.linalg.eigvalsh((found.jac.T @ found.jac)[:2, :2])[0]
        if inside.sum() < _MIN_SHARE * echoes.sum() or information < _MIN_INFORMATION:
            return None
        return Pose(*found.x.tolist()), found.fun[inside]

    def keyframes(self, log: RobotLog, clock: TrialClock) -> list[Keyframe]:
        """Return one match per second, beginning at the robot's own estimates.

        `log`: with sensor data; `clock`: of the log. Raises AcrcError for a scan of another sensor.
        """
        estimates = {tick: drive.pose for tick, drive in log.messages_of(Drive) if drive.pose is not None}
        odometry, rays = OdometryBuffer(self._model.sensor), self._model.sensor.rays
        found: list[Keyframe] = []
        due = -np.inf
        for tick, senses in enumerate(log.senses or ()):
            base, scan = senses.odometry, senses.scan
            if scan is not None and len(scan.ranges_mm) != 2 * rays:
                raise AcrcError(
                    f"a scan of the field trial has {len(scan.ranges_mm) // 2} rays, but the simulated "
                    f"sensor {self._model.default_sensor} {rays}; simulate the same sensor"
                )
            sweep = odometry.take(Instant(senses.instant), Pose(base.x, base.y, base.heading), scan)
            if scan is None or sweep is None or (second := clock.instant(scan.stamp) / 1e6) < due:
                continue
            due = second + PERIOD_S
            if found and second < found[-1].second + MAX_PAUSE_S:
                guess = found[-1].pose.frame(found[-1].odometry).compose(sweep.pose)
            elif tick in estimates:
                guess = Pose(*estimates[tick])
            else:
                continue
            if match := self.match(guess, sweep.ranges_mm):
                found.append(Keyframe(second, sweep.pose, *match))
        return found
