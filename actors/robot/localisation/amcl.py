"""Augmented Monte Carlo localisation: where a robot is, as a cloud of particles.

Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, tables 8.3 (Augmented_MCL) and 8.4 (KLD_Sampling_MCL),
with what ros-planning/navigation, amcl, adds: scans count only after some motion, and the odometry leads from
one to the next.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.geometry import Point, Pose, between
from actors.portable import arrays
from actors.portable.draws import normals
from actors.robot.localisation.beams import beams, ends
from actors.robot.localisation.estimate import Estimate
from actors.robot.localisation.histogram import Cluster, Histogram, heaviest_cluster, histogram
from actors.robot.localisation.likelihood_field import LikelihoodField
from actors.robot.localisation.locating import Locating
from actors.robot.localisation.measurement import Measurement
from actors.robot.localisation.motion import move, parts_of, spread, step
from actors.robot.localisation.parameters import AmclParameters
from actors.robot.localisation.recovery import Recovery
from actors.robot.localisation.resampling import resample
from actors.robot.localisation.tally import Tally
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor

_ORIGIN: Final = Pose(0.0, 0.0, 0.0)
_TOGETHER: Final = 0.9
"""The particles are together while the estimate's cluster has so much of their weight,"""
_APART: Final = 0.5
"""and they are, on the root of the mean square, no farther from it than this, m."""


class Amcl:
    """One robot's filter. Its pose moves with the odometry; a scan that counts puts the odometry right."""

    def __init__(
        self,
        field: LikelihoodField,
        sensor: RangeSensor,
        start: Pose | None,
        generator: Generator,
        parameters: AmclParameters,
        doubt: float | None = None,
    ) -> None:
        """`start`: the pose where the odometry is (0, 0, 0), as far as known; None: anywhere on free floor.

        `doubt`: standard deviation of the start, m and rad: the robot has to be located first, by scans made
        while it stands. None: as the parameters say, and it is located.

        `field`: with the parameters' max_distance.
        """
        assert field.max_distance == parameters.max_distance
        self._field = field
        self._generator = generator
        self._parameters = parameters
        self._beams = beams(sensor, parameters.beams)
        self._measurement = Measurement(field, sensor.range_max, parameters)
        self._recovery = Recovery(parameters)
        self._tally = Tally()
        self._peers = np.empty((0, 2))
        self._odometry: Pose | None = None
        self._doubt = doubt
        self._locating = None if doubt is None else Locating(doubt)
        self._count = parameters.max_particles
        self._poses = self._scatter(start)
        self._drawn = np.empty_like(self._poses)
        self._directions = np.stack((arrays.cos(self._poses[2]), arrays.sin(self._poses[2])))
        self._weights = np.full(self._count, 1 / self._count)
        self._cluster = self._heaviest(histogram(self._poses, self._count))
        self._correction = self._cluster.pose if start is None else start

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """The estimate at a step's start: `here` is the odometry's pose then, `sweep` the scan that came."""
        if sweep is not None and self._counts(sweep.pose):
            self._take(sweep)
        located = self._locating is None
        return Estimate(self._correction.compose(here), self._cluster.covariance, located)

    def mask(self, peers: Sequence[Point]) -> None:
        """From now on, believe no beam that ends at one of these points of the map frame, m."""
        self._peers = np.array(peers, np.float64).reshape(-1, 2)

    def outcome(self) -> dict[str, object]:
        """The run's `Tally`."""
        return self._tally.outcome()

    @property
    def particles(self) -> NDArray[np.float64]:
        """(n, 3): x, y, heading, m and rad, map frame, as of the last scan that counted; read-only."""
        return _read_only(self._poses[:, : self._count].T)

    @property
    def weights(self) -> NDArray[np.float64]:
        """(n,): of the particles, their sum is 1; read-only, as of the last scan that counted."""
        return _read_only(self._weights[: self._count])

    def _scatter(self, start: Pose | None) -> NDArray[np.float64]:
        """(3, n): particles around the start, or everywhere."""
        if start is None:
            return self._field.poses(self._generator, self._count)
        p, doubt = self._parameters, self._doubt
        around, turned = (p.start_spread, p.start_turn_spread) if doubt is None else (doubt, doubt)
        poses = np.array([[around], [around], [turned]]) * normals(self._generator, (3, self._count))
        poses += np.array(start)[:, np.newaxis]
        poses[2] = np.remainder(poses[2] + np.pi, 2 * np.pi) - np.pi
        return poses

    def _counts(self, pose: Pose) -> bool:
        """True for a scan made far enough from the last one that counted, and for the first one."""
        if self._odometry is None or self._locating is not None:
            return True
        moved = self._odometry.relative(pose)
        far = moved.point.distance_to(_ORIGIN.point) >= self._parameters.update_distance
        return far or abs(moved.heading) >= self._parameters.update_angle

    def _take(self, sweep: Sweep) -> None:
        """One update of the filter by a scan that counts."""
        if self._odometry is None and self._locating is not None:  # the doubt is of where it is now
            believed = self._correction.compose(sweep.pose)
            self._poses, self._locating.believed = self._scatter(believed), believed.point
            self._odometry = sweep.pose
        self._move(sweep.pose)
        fit = self._weigh(sweep)
        found = histogram(self._poses, self._count)
        self._cluster = self._heaviest(found)
        self._correction = self._cluster.pose.compose(sweep.pose.relative(_ORIGIN))
        self._tally.updates += 1
        self._tally.particles += self._count
        if fit is None:
            self._tally.blind += 1
            return
        if self._locating is not None and self._locating.take(self._cluster, fit):
            self._locating = None
        injection = self._recovery.injection(fit)
        if self._tally.updates % self._parameters.resample_interval == 0:
            self._resample(found, injection)

    def _move(self, pose: Pose) -> None:
        """Each particle by its own idea of what the odometry's step was.

        A long way without a scan that counts, such as all since the base was switched on or that of a robot
        that was blind, is gone in parts: as one step it would have the spread of a single turn and dash.
        """
        since = before = self._odometry or _ORIGIN
        parts = parts_of(before, pose, self._parameters)
        for part in range(1, parts + 1):
            after = pose if part == parts else between(since, pose, part / parts)
            made = step(before, after)
            draws = normals(self._generator, (3, self._count))
            move(self._poses, self._count, made, spread(made, self._parameters), draws)
            before = after
        self._odometry = pose

    def _weigh(self, sweep: Sweep) -> float | None:
        """Each particle by the scan; gives the fit, None without a beam to believe."""
        parameters, tally, together = self._parameters, self._tally, self._together()
        points, masked, strangers = ends(
            sweep.ranges_mm,
            self._beams,
            self._correction.compose(sweep.pose),
            self._peers,
            parameters.peer_radius,
            self._field,
            parameters.stranger_distance if parameters.stranger_filter and together else math.inf,
            parameters.stranger_error_threshold,
        )
        fit, skipped = self._measurement.weigh(
            points, self._poses, self._weights, self._directions, self._count, together=together
        )
        tally.beams_masked += masked
        tally.beams_strange += strangers
        tally.beams_skipped += skipped
        tally.beams_used += len(points) - skipped
        return fit * len(points) / (len(points) + strangers) if len(points) else None

    def _together(self) -> bool:
        """True while nearly all particles, by weight, are about the estimate."""
        _, covariance, weight = self._cluster
        return weight >= _TOGETHER and covariance[0] + covariance[4] <= _APART * _APART

    def _heaviest(self, found: Histogram) -> Cluster:
        return heaviest_cluster(found, self._poses, self._directions, self._weights)

    def _resample(self, found: Histogram, injection: float) -> None:
        """As many as needed: each a particle by its weight, or with a probability of `injection` new."""
        most, poses = self._parameters.max_particles, self._poses
        if injection > 0:
            poses = np.hstack((poses[:, : self._count], self._field.poses(self._generator, most)))
            found = histogram(poses, poses.shape[1])
        self._count, new = resample(
            poses,
            self._weights,
            self._count,
            found,
            self._generator.random(most),
            injection,
            self._parameters.min_particles,
            self._parameters.kld_error,
            self._parameters.kld_quantile,
            self._drawn,
        )
        self._poses, self._drawn = self._drawn, self._poses
        self._weights[: self._count] = 1 / self._count
        self._tally.resamplings += 1
        self._tally.injected += new


def _read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    view = array.view()
    view.setflags(write=False)
    return view
