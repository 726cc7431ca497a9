"""Poses of a robot, found by matching its scans with the map: ray casting and robust least squares."""

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from acrc_testbed.results.field_recordings import RobotLog
from acrc_testbed.run_model.hardware_runs import TrialClock
from actors.array_types import Floats
from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose
from actors.messages import NO_ECHO_MM, Drive
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

    def match(self, guess: Pose, ranges_mm: bytes) -> tuple[Pose, Floats] | None:
        """Return the pose near `guess` and the residuals; None: the scan does not determine the pose.

        Raises AcrcError for a scan of another sensor.
        """
        measured = np.frombuffer(ranges_mm, "<u2")
        if len(measured) != self._model.sensor.rays:
            raise AcrcError(
                f"a scan of the field trial has {len(measured)} rays, but the simulated sensor "
                f"{self._model.default_sensor} {self._model.sensor.rays}; simulate the same sensor"
            )

        def errors(pose: Floats) -> Floats:
            expected = self._sensors.scan([0], pose[None], np.zeros((0, 3)))[0]
            return ((measured - expected.astype(np.float64)) / 1000.0).clip(-0.5, 0.5)

        def slopes(pose: Floats) -> Floats:
            at = errors(pose)
            moved = [(errors(pose + step) - at) / _STEP for step in _STEP * np.eye(3)]
            return np.column_stack(moved).clip(-2.0, 2.0)

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

        `log`: with sensor data; `clock`: of the log.
        """
        assert log.senses is not None
        instants = np.array([tick.instant for tick in log.ticks], np.int64)
        readings = [(one.odometry.x, one.odometry.y, one.odometry.heading) for one in log.senses]
        columns = np.unwrap(np.reshape(readings, (-1, 3)).T)  # no position jumps by π m within a step
        estimates = {tick: drive.pose for tick, drive in log.messages_of(Drive) if drive.pose is not None}
        found: list[Keyframe] = []
        last = -PERIOD_S
        for tick, senses in enumerate(log.senses):
            if senses.scan is None:
                continue
            second = clock.instant(senses.scan.stamp) / 1e6
            if second < last + PERIOD_S:
                continue
            last = second
            odometry = Pose(*(float(np.interp(senses.scan.stamp, instants, one)) for one in columns))
            if found and second < found[-1].second + MAX_PAUSE_S:
                guess = found[-1].pose.frame(found[-1].odometry).compose(odometry)
            elif tick in estimates:
                guess = Pose(*estimates[tick])
            else:
                continue
            if match := self.match(guess, senses.scan.ranges_mm):
                found.append(Keyframe(second, odometry, *match))
        return found
