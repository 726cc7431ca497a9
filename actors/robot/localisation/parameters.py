"""Every number of the particle filter, and the sets of them that have a name."""

from collections.abc import Mapping, Sequence
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
    """Augmented Monte Carlo localisation; defaults as d3scomp/ROSRemote, simulation/robot.launch, has them.

    Where nothing else stands, a field is amcl's of the same meaning (wiki.ros.org/amcl). Raises
    ParameterError for a value that makes no sense.
    """

    min_particles: PositiveCount = 500
    """Least number of particles."""
    max_particles: PositiveCount = 2000
    """Largest number, and that at the start."""
    kld_error: Positive = 0.05
    """ε: largest Kullback-Leibler distance of the particles from the distribution they stand for."""
    kld_quantile: NotNegative = 0.99
    """z: upper standard normal quantile of the probability that ε is kept; amcl's kld_z, which is mostly set
    like a probability (0.99 means 84 %)."""
    odometry_model: OdometryModel = "diff"
    """Whether alphas give standard deviations ("diff", ROS 1) or variances ("diff-corrected", the book)."""
    alpha1: NotNegative = 0.2
    """Noise of turning due to turning."""
    alpha2: NotNegative = 0.2
    """Noise of turning due to driving, 1/m²."""
    alpha3: NotNegative = 0.2
    """Noise of driving due to driving."""
    alpha4: NotNegative = 0.2
    """Noise of driving due to turning, m²."""
    weighting: Weighting = "cubes"
    """What makes one weight of the beams' p: 1 + Σp³ (amcl's "likelihood_field") or Πp
    ("likelihood_field_prob")."""
    sharpness: Positive = 1.0
    """Power of the product, as neighbouring beams are not independent ("Probabilistic Robotics", 6.3.4)."""
    beams: PositiveCount = 60
    """Number of beams of a scan that are used, at equal angles; all, if it has fewer."""
    z_hit: Share = 0.5
    """Share of beams that end at a wall of the map."""
    z_rand: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.5
    """Share of beams that end anywhere within the sensor's range: above 0, as no beam may be impossible."""
    sigma_hit: Positive = 0.2
    """Standard deviation of a beam's end from the wall, m."""
    max_distance: Positive = 2.0
    """Largest distance to a wall that counts, m; amcl's laser_likelihood_max_dist."""
    beam_skip: bool = False
    """With "product": drop beams that few particles agree with, while the particles are together."""
    beam_skip_distance: NotNegative = 0.5
    """A particle agrees with a beam that ends nearer to a wall than this, m. The fit, by which recovery goes,
    is the share of believed beams, over all particles, that are agreed with."""
    beam_skip_threshold: Share = 0.3
    """A beam is dropped if a smaller share of the particles agrees with it, ..."""
    beam_skip_error_threshold: Share = 0.9
    """... unless at least this share of the beams would be."""
    stranger_filter: bool = False
    """Drop beams that end in the open, in sight of the estimate, while the particles are together. Own form
    of the distance filter of Fox, Burgard and Thrun, "Markov localization for mobile robots in dynamic
    environments", JAIR 11, 1999."""
    stranger_distance: NotNegative = 0.12
    """The open is farther from walls than this, m; own choice by measurement."""
    peer_radius: NotNegative = 0.45
    """A beam that ends so near a masked peer is dropped, m; own choice: two bodies' radii and 0.1 m."""
    update_distance: NotNegative = 0.25
    """A scan counts only after this way, m, ..."""
    update_angle: NotNegative = 0.2
    """... or this turn, rad, since the last one that did."""
    resample_interval: PositiveCount = 1
    """Scans that count from one resampling to the next."""
    recovery_slow: Share = 0.0
    """Decay of the slow average of the fit, per scan that counts; 0: no new poses among the particles."""
    recovery_fast: Share = 0.0
    """Decay of the fast average; new poses are tried where it falls below the slow one."""
    search_poses: Count = 0
    """Poses tried on the whole map per scan that counts while the robot is lost, until one explains the scans
    and the particles are gathered there; 0: no search. Own addition."""
    start_spread: NotNegative = 0.1
    """Standard deviation of the start's x and y, m: the root of amcl's initial_cov_xx and _yy. Own choice, as
    robots are placed with care; amcl's default is 0.5 m."""
    start_turn_spread: NotNegative = 0.1
    """Standard deviation of the start's heading, rad: the root of amcl's initial_cov_aa. Own choice, as
    above; amcl's default is 15°."""

    @property
    def recovers(self) -> bool:
        """Whether new poses are tried at all: not if one of the averages stands still."""
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

PRESETS: Final[Mapping[str, AmclParameters]] = MappingProxyType(
    {"chapter": AmclParameters(), "robust": _ROBUST}
)
"""`chapter`: what the chapter's robots ran. `robust`: what keeps track among other robots best."""


class Estimate(msgspec.Struct, frozen=True, gc=False):
    """Where the robot holds itself to be, and how far it trusts that."""

    pose: Pose
    covariance: Covariance
    located: bool = True
    """False while the robot does not know where it is: it should stand."""
    lost: float = 0.0
    """Probability that the robot is somewhere else altogether."""


class Localisation(Protocol):
    """Keeps track of the robot's pose in the map frame."""

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """The estimate at a step's start: `here` is the odometry's pose then, `sweep` the scan that came."""

    def mask(self, peers: Sequence[Point]) -> None:
        """From now on, believe no beam that ends at one of these points of the map frame, m.

        They replace the former ones; without any, all beams are believed.
        """

    def relocalise(self) -> None:
        """Forget where the robot is, and look for it all over the map."""

    def outcome(self) -> dict[str, object]:
        """What can be said about the whole run, JSON-able, by subject."""


_IN_A_ROW: Final = 5
"""So many scans have to say so on end; own choices, as all below."""
_REACH: Final = 3.0
"""No farther from where it last was than so many standard deviations, for rooms are alike, ..."""
_TOGETHER: Final = 0.95
"""So much of the particles' weight is in one cluster, ..."""
_APART: Final = 0.15
"""... which lies within so much of its mean on the root of the mean square, m, ..."""
_TURNED: Final = 0.1
"""... and rad, ..."""
_FIT: Final = 0.85
"""... and such a share of the beams end where the map has something."""


class Locating:
    """Counts the scans that agree, all made while the robot stands."""

    def __init__(self, doubt: float) -> None:
        """`doubt`: standard deviation of what was known, m."""
        self._reach = _REACH * doubt
        self._agreed = 0
        self.believed: Point | None = None
        """First estimate of the position, to be set by the caller."""

    def take(self, cluster: Cluster, fit: float) -> bool:
        """Take one more scan; return True once the robot is located."""
        pose, covariance, weight = cluster
        near = self.believed is not None and self.believed.distance_to(pose.point) <= self._reach
        narrow = covariance[0] + covariance[4] <= _APART * _APART and covariance[8] <= _TURNED * _TURNED
        agrees = near and narrow and weight >= _TOGETHER and fit >= _FIT
        self._agreed = self._agreed + 1 if agrees else 0
        return self._agreed >= _IN_A_ROW


class DeadReckoning:
    """The pose at switch-on, moved as the odometry says: as exact as that."""

    def __init__(self, start: Pose, doubt: float | None = None) -> None:
        """`doubt`: as for Amcl; it never ends, for nothing here finds out where the robot is."""
        self._start = start
        self._located = doubt is None

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """The odometry's pose in the frame of the start pose; the covariance is 0, for it knows no better."""
        lost = 0.0 if self._located else 1.0
        return Estimate(self._start.compose(here), CERTAIN, self._located, lost)

    def mask(self, peers: Sequence[Point]) -> None:
        """Without effect, as no beam is believed."""

    def relocalise(self) -> None:
        """Without effect: nothing here could find out where the robot is."""

    def outcome(self) -> dict[str, object]:
        """Nothing to say."""
        return {}
