"""Parameters and presets of localisation, and its interface."""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Annotated, Final, Literal, Protocol

import msgspec

from actors.geometry import CERTAIN, Covariance, Point, Pose
from actors.robot.localisation.resampling import Cluster
from actors.robot.sweep import Sweep
from actors.settings import Count, NotNegative, Positive, PositiveCount, Settings, Share

OdometryModel = Literal["diff", "diff-corrected"]
Weighting = Literal["cubes", "product"]


class AmclParameters(Settings, frozen=True):
    """Augmented Monte Carlo localisation; defaults from d3scomp/ROSRemote, simulation/robot.launch.

    Unless stated, fields correspond to parameters of amcl (wiki.ros.org/amcl). Raises ParameterError for an
    invalid value.
    """

    min_particles: PositiveCount = 500
    """Minimum number of particles."""
    max_particles: PositiveCount = 2000
    """Maximum and initial number of particles."""
    kld_error: Positive = 0.05
    """ε: maximum Kullback-Leibler distance of the particles from their distribution."""
    kld_quantile: NotNegative = 0.99
    """z: upper standard normal quantile of the probability of keeping ε; amcl's kld_z, which is often set
    like a probability (0.99 means 84 %)."""
    odometry_model: OdometryModel = "diff"
    """Alphas are standard deviations ("diff", ROS 1) or variances ("diff-corrected", the book)."""
    alpha1: NotNegative = 0.2
    """Noise of turning due to turning."""
    alpha2: NotNegative = 0.2
    """Noise of turning due to driving, 1/m²."""
    alpha3: NotNegative = 0.2
    """Noise of driving due to driving."""
    alpha4: NotNegative = 0.2
    """Noise of driving due to turning, m²."""
    weighting: Weighting = "cubes"
    """Combination of the beams' p into a weight: 1 + Σp³ (amcl's "likelihood_field") or Πp
    ("likelihood_field_prob")."""
    sharpness: Positive = 1.0
    """Exponent of the product, since neighbouring beams are dependent ("Probabilistic Robotics", 6.3.4)."""
    beams: PositiveCount = 60
    """Number of beams used per scan, at equal angles; all if the scan has fewer."""
    z_hit: Share = 0.5
    """Share of beams that end at a wall of the map."""
    z_rand: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.5
    """Share of beams that end anywhere within the sensor's range; above 0, so that every beam is possible."""
    sigma_hit: Positive = 0.2
    """Standard deviation of a beam's end from the wall, m."""
    max_distance: Positive = 2.0
    """Maximum distance to a wall that is distinguished, m; amcl's laser_likelihood_max_dist."""
    beam_skip: bool = False
    """With "product": skip beams with which few particles agree, if the filter has converged."""
    beam_skip_distance: NotNegative = 0.5
    """Distance of a beam's end from a wall within which a particle agrees with it, m. The fit, used for
    recovery, is the share of agreements over all valid beams and particles."""
    beam_skip_threshold: Share = 0.3
    """Minimum share of agreeing particles; beams below are skipped."""
    beam_skip_error_threshold: Share = 0.9
    """Share of skipped beams from which no beam is skipped."""
    stranger_filter: bool = False
    """Drop beams that end in visible open space of the map, if the filter has converged. Own form of the
    distance filter of Fox, Burgard and Thrun, "Markov localization for mobile robots in dynamic
    environments", JAIR 11, 1999."""
    stranger_distance: NotNegative = 0.12
    """Distance from walls beyond which space is open, m; own choice by measurement."""
    peer_radius: NotNegative = 0.45
    """Radius around a masked peer in which beams are dropped, m; own choice: two bodies' radii and 0.1 m."""
    update_distance: NotNegative = 0.25
    """Minimum distance between used scans, m."""
    update_angle: NotNegative = 0.2
    """Turn after which a scan is used, too, rad."""
    resample_interval: PositiveCount = 1
    """Number of used scans between resamplings."""
    recovery_slow: Share = 0.0
    """Decay of the slow average of the fit, per used scan; 0: no random poses are injected."""
    recovery_fast: Share = 0.0
    """Decay of the fast average; random poses are injected if it falls below the slow one."""
    search_poses: Count = 0
    """Poses tried on the whole map per used scan while the robot is lost, until one fits the scans and the
    particles are moved there; 0: no search. Own addition."""
    start_spread: NotNegative = 0.1
    """Standard deviation of the start's x and y, m: root of amcl's initial_cov_xx and _yy. Own choice, since
    robots are placed with care; amcl's default is 0.5 m."""
    start_turn_spread: NotNegative = 0.1
    """Standard deviation of the start's heading, rad: root of amcl's initial_cov_aa. Own choice as above;
    amcl's default is 15°."""

    @property
    def recovers(self) -> bool:
        """True if random poses may be injected: both averages change."""
        return self.recovery_slow > 0 and self.recovery_fast > 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.recovers and self.recovery_slow >= self.recovery_fast:
            raise self.wrong("recovery_slow", f"below recovery_fast {self.recovery_fast:g}")
        if self.max_particles < self.min_particles:
            raise self.wrong("max_particles", f"at least min_particles {self.min_particles}")


_ROBUST: Final = AmclParameters(
    odometry_model="diff-corrected",
    alpha1=0.002,
    alpha2=0.002,
    alpha3=0.002,
    alpha4=0.002,
    weighting="product",
    sharpness=0.2,
    beam_skip_distance=0.3,
    stranger_filter=True,
    search_poses=3000,
)

PRESETS: Final = MappingProxyType({"chapter": AmclParameters(), "robust": _ROBUST})
"""`chapter`: the original's parameters. `robust`: most reliable tracking among other robots."""


class Estimate(msgspec.Struct, frozen=True, gc=False):
    """Pose estimate and its uncertainty."""

    pose: Pose
    covariance: Covariance
    located: bool = True
    """False until the robot is located; until then it should stand."""
    lost: float = 0.0
    """Probability that the pose is wrong."""


class Localisation(Protocol):
    """Estimator of the robot's pose in the map frame."""

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """Return the estimate at a step's start; `here`: odometry pose, `sweep`: new scan."""

    def mask(self, peers: Sequence[Point]) -> None:
        """Ignore beams that end at one of these points from now on, m, map frame.

        Replaces the previous points; an empty sequence: use all beams.
        """

    def relocalise(self) -> None:
        """Discard the estimate and search the whole map."""

    def outcome(self) -> dict[str, object]:
        """Return results of the run as JSON values by name."""


_MIN_SCANS: Final = 5
"""Number of consecutive scans that must agree; own choices, as all below."""
_MAX_DISTANCE: Final = 3.0
"""Maximum distance from the known position in standard deviations, since rooms are similar."""
_MIN_WEIGHT: Final = 0.95
"""Minimum share of the particles' weight in the cluster."""
_MAX_SPREAD: Final = 0.15
"""Maximum root mean square distance of the cluster from its mean, m."""
_MAX_TURN_SPREAD: Final = 0.1
"""Maximum root mean square deviation of its headings, rad."""
_MIN_FIT: Final = 0.85
"""Minimum share of beams that agree with the map."""


class StartLocator:
    """Counter of consecutive scans that agree with the estimate of a standing robot."""

    def __init__(self, doubt: float) -> None:
        """Create a counter; `doubt`: standard deviation of the known position, m."""
        self._max_distance = _MAX_DISTANCE * doubt
        self._agreements = 0
        self.expected: Point | None = None
        """Known position, set by the caller."""

    def take(self, cluster: Cluster, fit: float) -> bool:
        """Process a scan; return True if the robot is located."""
        pose, covariance, weight = cluster
        is_near = self.expected is not None and self.expected.distance_to(pose.point) <= self._max_distance
        is_narrow = (
            covariance[0] + covariance[4] <= _MAX_SPREAD * _MAX_SPREAD
            and covariance[8] <= _MAX_TURN_SPREAD * _MAX_TURN_SPREAD
        )
        agrees = is_near and is_narrow and weight >= _MIN_WEIGHT and fit >= _MIN_FIT
        self._agreements = self._agreements + 1 if agrees else 0
        return self._agreements >= _MIN_SCANS


class DeadReckoning:
    """Localisation by odometry alone."""

    def __init__(self, start: Pose, doubt: float | None = None) -> None:
        """Create an estimator; with `doubt`, as for Amcl, the robot is never located."""
        self._start = start
        self._located = doubt is None

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """Return the odometry pose relative to the start pose, with covariance 0."""
        lost = 0.0 if self._located else 1.0
        return Estimate(self._start.compose(here), CERTAIN, self._located, lost)

    def mask(self, peers: Sequence[Point]) -> None:
        """Do nothing: scans are not used."""

    def relocalise(self) -> None:
        """Do nothing: scans are not used."""

    def outcome(self) -> dict[str, object]:
        """Return no results."""
        return {}
