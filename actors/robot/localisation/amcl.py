"""Augmented Monte Carlo localisation with particles.

Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, tables 8.3 (Augmented_MCL) and 8.4 (KLD_Sampling_MCL),
with additions of ros-planning/navigation, amcl: scans are used only after some motion, and odometry is
applied between them.
"""

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.geometry import ORIGIN, Point, Pose, interpolate, wrap
from actors.portable import arrays
from actors.portable.draws import normals
from actors.robot.localisation.confidence import BeamClasses, CovarianceModel, classify_beams
from actors.robot.localisation.likelihood_field import LikelihoodField
from actors.robot.localisation.measurement import Measurement, ParticleSet, beams, end_points
from actors.robot.localisation.motion import move, odometry_step, sample_around, step_count, step_spread
from actors.robot.localisation.parameters import AmclParameters, Estimate, StartLocator
from actors.robot.localisation.resampling import Cluster, Histogram, heaviest_cluster, histogram, resample
from actors.robot.localisation.search import LostProbability, PoseSearch
from actors.robot.sweep import Sweep
from actors.robot_model import RangeSensor


class RecoveryAverages:
    """Averages w_slow and w_fast of the fit ("Probabilistic Robotics", 2005, table 8.3).

    Unlike the likelihood of a scan, the fit does not depend on the number of beams. The averages begin at 1,
    so that a wrong start is detected. They are not reset when new poses are injected, unlike in pf.c of
    ros-planning/navigation, where a reset at a bad fit ends the search.
    """

    def __init__(self, parameters: AmclParameters) -> None:
        self._parameters = parameters
        self._slow = 1.0
        self._fast = 1.0

    def injection(self, fit: float) -> float:
        """Return the probability of injecting a random pose after a scan with that fit."""
        parameters = self._parameters
        if not parameters.recovers:
            return 0.0
        self._slow += parameters.recovery_slow * (fit - self._slow)
        self._fast += parameters.recovery_fast * (fit - self._fast)
        if self._slow <= 0.0:  # after hundreds of scans without any fit
            return 1.0
        return max(0.0, 1.0 - self._fast / self._slow)


class FilterCounts(msgspec.Struct):
    """Counts of a run."""

    updates: int = 0
    """Scans used."""
    blind: int = 0
    """Used scans without valid beams."""
    resamplings: int = 0
    particles: int = 0
    """Sum over the used scans."""
    injected: int = 0
    """Random poses tried."""
    lost: int = 0
    """Used scans after which the probability of being lost was above 0.5."""
    found: int = 0
    """Times that the search found another pose."""
    beams_used: int = 0
    beams_masked: int = 0
    """Beams dropped because they end at a masked peer."""
    beams_strange: int = 0
    """Beams dropped because they end at an obstacle that is not on the map."""
    beams_skipped: int = 0
    """Beams dropped because few particles agree with them."""

    def outcome(self) -> dict[str, object]:
        """Return the counts by name, with the mean number of particles."""
        counts: dict[str, object] = msgspec.structs.asdict(self)
        del counts["particles"]
        counts["mean_particles"] = round(self.particles / self.updates, 1) if self.updates else 0.0
        return counts


_CONVERGED_WEIGHT: Final = 0.9
"""Minimum share of weight in the estimate's cluster for a converged filter."""
_CONVERGED_SPREAD: Final = 0.5
"""Maximum root mean square distance of a converged filter's particles from their mean, m."""
_SEARCH_BEGIN: Final = 0.5
"""Probability of being lost above which a search begins."""
_SEARCH_END: Final = 0.01
"""Probability of being lost below which it ends."""
_START_DRIFT: Final = 0.02
"""Assumed odometry error per m of straight distance since the start, m and rad."""
_FOUND_SPREAD: Final = (0.1, 0.1, 0.05)
"""Standard deviations of the particles around a pose found by the search: m, m, rad."""


class Amcl:
    """Particle filter of one robot. The estimate moves with the odometry and is corrected by scans."""

    def __init__(
        self,
        field: LikelihoodField,
        sensor: RangeSensor,
        start: Pose | None,
        generator: Generator,
        parameters: AmclParameters,
        doubt: float | None = None,
        origin: Pose = ORIGIN,
    ) -> None:
        """Create a filter. `start`: pose at the odometry `origin`; None: anywhere on free floor.

        `doubt`: standard deviation of the start, m and rad, for a robot that must first be located by scans
        while standing. None: given by the parameters, and the robot is located.
        """
        assert field.max_distance == parameters.max_distance
        self._field = field
        self._generator = generator
        self._parameters = parameters
        self._beams = beams(sensor, parameters.beams)
        self._measurement = Measurement(field, sensor.range_max, parameters)
        self._recovery = RecoveryAverages(parameters)
        self._confidence = CovarianceModel(field, sensor, len(self._beams.rays))
        self._lost = LostProbability() if start is not None else LostProbability(1.0)
        self._search: PoseSearch | None = None
        self._filter_counts = FilterCounts()
        self._peers = np.empty((0, 2))
        self._odometry = origin
        self._begun, self._has_start = False, start is not None
        self._doubt = doubt
        self._locator = None if doubt is None else StartLocator(doubt)
        self._count = parameters.max_particles
        self._restart(self._scatter(start))
        self._spare_poses = np.empty_like(self._poses)
        self._cluster = self._heaviest(histogram(self._poses, self._count))
        pose = self._cluster.pose if start is None else start
        self._correction = pose.frame(origin)
        self._covariance = self._cluster.covariance

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """Return the estimate at a step's start; `here`: odometry pose, `sweep`: new scan."""
        if sweep is not None and self._is_update_due(sweep.pose):
            self._process(sweep)
        located = self._locator is None
        lost = self._lost.probability if located else 1.0
        return Estimate(self._correction.compose(here), self._covariance, located, lost)

    def mask(self, peers: Sequence[Point]) -> None:
        """Ignore beams that end at one of these points from now on, m, map frame."""
        self._peers = np.array(peers, np.float64).reshape(-1, 2)

    def relocalise(self) -> None:
        """Scatter the largest number of particles over the free floor."""
        self._count = self._parameters.max_particles
        self._restart(self._scatter(None))
        self._lost, self._search = LostProbability(1.0), None

    def outcome(self) -> dict[str, object]:
        """Return the counts of the run."""
        return self._filter_counts.outcome()

    @property
    def particles(self) -> Floats:
        """(n, 3): x, y, heading, m and rad, map frame, at the last used scan; read-only."""
        return _read_only(self._poses[:, : self._count].T)

    @property
    def weights(self) -> Floats:
        """(n,): weights with sum 1 at the last used scan; read-only."""
        return _read_only(self._weights[: self._count])

    def _scatter(self, start: Pose | None, drift: float = 0.0) -> Floats:
        """Return particles around the start, spread wider by `drift`, m and rad, or everywhere: (3, n)."""
        if start is None:
            return self._field.poses(self._generator, self._count)
        parameters, doubt = self._parameters, self._doubt
        position_spread, turn_spread = (
            (parameters.start_spread, parameters.start_turn_spread) if doubt is None else (doubt, doubt)
        )
        spread = position_spread + drift, position_spread + drift, turn_spread + drift
        poses = sample_around(start, spread, normals(self._generator, (3, self._count)))
        poses[2] = _wrapped(poses[2])
        return poses

    def _restart(self, poses: Floats) -> None:
        """Replace the particles, (3, capacity), with equal weights."""
        self._poses = poses
        self._directions = np.stack((arrays.cos(poses[2]), arrays.sin(poses[2])))
        self._weights = np.full(poses.shape[1], 1 / self._count)

    def _is_update_due(self, pose: Pose) -> bool:
        """Return True for the first scan and for one far enough from the last used one."""
        if not self._begun or self._locator is not None:
            return True
        last, parameters = self._odometry, self._parameters
        x, y, turn = pose.x - last.x, pose.y - last.y, wrap(pose.heading - last.heading)
        if x * x + y * y >= parameters.update_distance * parameters.update_distance:
            return True
        return turn >= parameters.update_angle or -turn >= parameters.update_angle

    def _process(self, sweep: Sweep) -> None:
        """Update the filter with a scan."""
        if not self._begun:
            self._draw_first(sweep.pose)
        self._move(sweep.pose)
        points, beam_classes = self._classified_beams(sweep)
        if len(points):
            self._lost.take(beam_classes.agreeing, beam_classes.beyond)
        fit = self._weigh(beam_classes)
        found = histogram(self._poses, self._count)
        self._cluster = self._heaviest(found)
        self._correction = self._cluster.pose.frame(sweep.pose)
        self._filter_counts.updates += 1
        self._filter_counts.particles += self._count
        if len(beam_classes.known):
            self._draw(found, fit)
        else:
            self._filter_counts.blind += 1
        if len(points):
            self._locate_or_search(points, beam_classes, sweep.pose)
        self._covariance = self._confidence.covariance(
            beam_classes.known, self._cluster.pose, self._cluster.covariance, self._lost.probability
        )

    def _draw(self, found: Histogram, fit: float) -> None:
        """Resample the particles if it is time."""
        injection = self._recovery.injection(fit)
        if self._filter_counts.updates % self._parameters.resample_interval == 0:
            self._resample(found, injection)

    def _locate_or_search(self, points: Floats, beam_classes: BeamClasses, here: Pose) -> None:
        """Locate a robot with an uncertain start, and search for a lost one."""
        lost = self._lost.probability
        self._filter_counts.lost += lost > _SEARCH_BEGIN
        if self._locator is not None:
            if self._locator.take(self._cluster, beam_classes.agreeing / len(points)):
                self._locator = None
            return
        if self._search is None and self._parameters.search_poses and lost > _SEARCH_BEGIN:
            self._search = PoseSearch(
                self._field, self._beams.mount, self._generator, self._parameters.search_poses
            )
        elif lost < _SEARCH_END:
            self._search = None
        if self._search is not None:
            self._filter_counts.injected += self._parameters.search_poses
            place = self._search.take(points, here, self._cluster.pose)
            if place is not None:
                self._move_all_to(place.frame.compose(here), here)
                self._lost = LostProbability(max(place.lost.probability, _SEARCH_BEGIN))
            rivals = self._search.rivals(here, self._cluster.pose)
            self._lost = LostProbability(max(self._lost.probability, rivals / (rivals + 1)))

    def _move_all_to(self, pose: Pose, here: Pose) -> None:
        """Move all particles around a pose, at the odometry pose `here`."""
        self._filter_counts.found += 1
        self._count = self._parameters.min_particles
        draws = normals(self._generator, (3, self._count))
        self._poses[:, : self._count] = sample_around(pose, _FOUND_SPREAD, draws)
        self._poses[2] = _wrapped(self._poses[2])
        self._restart(self._poses)
        self._cluster = self._heaviest(histogram(self._poses, self._count))
        self._correction = pose.frame(here)

    def _draw_first(self, here: Pose) -> None:
        """Draw the particles at the first scan, moved from the start by odometry."""
        self._begun = True
        expected, distance = self._correction.compose(here), here.point.distance_to(self._odometry.point)
        if self._locator is not None:  # the uncertainty applies to the current pose
            self._poses, self._locator.expected = self._scatter(expected), expected.point
        elif self._has_start and here != self._odometry:
            self._poses = self._scatter(expected, _START_DRIFT * distance)
        self._odometry = here

    def _move(self, pose: Pose) -> None:
        """Move each particle by a sample of the odometry step; long steps are divided."""
        since = before = self._odometry
        parts = step_count(before, pose, self._parameters)
        for part in range(1, parts + 1):
            after = pose if part == parts else interpolate(since, pose, part / parts)
            odometry = odometry_step(before, after)
            draws = normals(self._generator, (3, self._count))
            move(self._poses, self._count, odometry, step_spread(odometry, self._parameters), draws)
            before = after
        self._odometry = pose

    def _classified_beams(self, sweep: Sweep) -> tuple[Floats, BeamClasses]:
        """Return the end points of the scan's beams and their classification at the estimate."""
        parameters, counts, mount = self._parameters, self._filter_counts, self._beams.mount
        pose = self._correction.compose(sweep.pose)
        points, masked = end_points(sweep.ranges_mm, self._beams, pose, self._peers, parameters.peer_radius)
        filtered = parameters.stranger_filter and self._has_converged()
        beam_classes = classify_beams(
            self._field.grid, points, mount, pose, parameters.stranger_distance if filtered else math.inf
        )
        counts.beams_masked += masked
        counts.beams_strange += beam_classes.strangers
        return points, beam_classes

    def _weigh(self, beam_classes: BeamClasses) -> float:
        """Weigh the particles by the valid beams; return the fit."""
        known, counts = beam_classes.known, self._filter_counts
        fit, skipped = self._measurement.weigh(
            known,
            ParticleSet(self._poses, self._weights, self._directions, self._count),
            together=self._has_converged(),
        )
        counts.beams_skipped += skipped
        counts.beams_used += len(known) - skipped
        return fit

    def _has_converged(self) -> bool:
        """Return True if the filter has converged."""
        _, covariance, weight = self._cluster
        return (
            weight >= _CONVERGED_WEIGHT
            and covariance[0] + covariance[4] <= _CONVERGED_SPREAD * _CONVERGED_SPREAD
        )

    def _heaviest(self, found: Histogram) -> Cluster:
        return heaviest_cluster(found, self._poses, self._directions, self._weights)

    def _resample(self, found: Histogram, injection: float) -> None:
        """Resample as many particles as needed; each is a random pose with probability `injection`."""
        most, poses = self._parameters.max_particles, self._poses
        if injection > 0:
            poses = np.hstack((poses[:, : self._count], self._field.poses(self._generator, most)))
            found = histogram(poses, poses.shape[1])
        self._count, injected = resample(
            poses,
            self._weights,
            self._count,
            found,
            self._generator.random(most),
            injection,
            self._parameters.min_particles,
            self._parameters.kld_error,
            self._parameters.kld_quantile,
            self._spare_poses,
        )
        self._poses, self._spare_poses = self._spare_poses, self._poses
        self._weights[: self._count] = 1 / self._count
        self._filter_counts.resamplings += 1
        self._filter_counts.injected += injected


def _wrapped(angles: Floats) -> Floats:
    return np.remainder(angles + np.pi, 2 * np.pi) - np.pi


def _read_only(array: Floats) -> Floats:
    view = array.view()
    view.setflags(write=False)
    return view
