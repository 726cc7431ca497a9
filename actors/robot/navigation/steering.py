"""What a local planner is asked and says: so much is the same whatever it chooses by."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.array_types import Flags, Floats
from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Duration, Instant, in_seconds, seconds
from actors.portable import hypot
from actors.robot.navigation.cost_map import CostMap
from actors.robot_model import DriveParameters
from actors.settings import Interval, NotNegative, Positive, PositiveInterval, Settings

_IDLE: Final = {
    "indigo": (
        *("min_speed", "stop_buffer", "scaling_speed", "max_scaling_factor"),
        *("goal_slack", "detour", "shortcut", "spot_angle", "spot_rate", "front_angle", "escape"),
    ),
    "disc": ("heading_tolerance", "stopped_speed", "stopped_turn"),
}
"""By rules: parameters that they do not use."""
_MOST_POINTS: Final = 10_000
"""Of a trajectory; own choice: a hundred times what it has."""
_Samples = Annotated[int, Meta(ge=2)]


class DwaParameters(Settings, frozen=True):
    """The local planner. Defaults: d3scomp/ROSRemote, simulation/params, else those of dwa_local_planner."""

    rules: Literal["indigo", "disc"] = "indigo"
    """"indigo": dwa_local_planner of ROS Indigo (`local_planner`). "disc": our own (`disc_local_planner`)."""
    period: PositiveInterval = seconds(0.2)
    """Time from one command to the next (move_base controller_frequency 5 Hz)."""
    max_speed: Positive = 0.5
    """m/s (max_vel_x)."""
    min_speed: Annotated[float, Meta(ge=-10)] = 0.0
    """m/s (min_vel_x). Rules "disc": below 0 it is the speed of backing out of obstacles over known floor."""
    least_speed: NotNegative = 0.1
    """Least speed of a command (min_trans_vel), m/s, ..."""
    max_turn: Positive = 5.0
    """rad/s (max_rot_vel)."""
    least_turn: NotNegative = 0.4
    """... or least turn rate (min_rot_vel), rad/s."""
    acceleration: Positive = 1.0
    """Largest change of the speed (acc_lim_x), m/s²; braking is planned with it."""
    turn_acceleration: Positive = 2.0
    """Largest change of the turn rate (acc_lim_theta), rad/s²."""
    speed_samples: _Samples = 15
    """Speeds tried (vx_samples)."""
    turn_samples: _Samples = 20
    """Turn rates tried with each (vth_samples)."""
    sim_time: Positive = 3.0
    """Duration of a trajectory at constant velocity, s, ..."""
    stop_buffer: NotNegative = 0.2
    """Rules "disc": ... or until the robot could have braked from this much later on, if that is longer, s
    (stop_time_buffer, which dwa_local_planner documents and ignores)."""
    granularity: Positive = 0.025
    """Spacing of the checked points of a trajectory, m (sim_granularity, default), ..."""
    angular_granularity: Positive = 0.1
    """... or rad (angular_sim_granularity, default)."""
    path_bias: NotNegative = 64.0
    """Weight of the distance to the plan (path_distance_bias)."""
    goal_bias: NotNegative = 24.0
    """Weight of the distance to the local goal (goal_distance_bias)."""
    occdist_scale: NotNegative = 0.5
    """Weight of the cost below the body: at the end of a trajectory (indigo, ObstacleCostFunction), or the
    highest along it (disc)."""
    forward_point: NotNegative = 0.325
    """Distance of the nose from the centre, m; the nose is drawn to plan and goal, too."""
    scaling_speed: Positive = 0.25
    """Rules "disc": above this speed, m/s, the body counts as larger, ..."""
    max_scaling_factor: NotNegative = 0.2
    """... by this share at the highest speed (computed but unused in Indigo, used in Noetic)."""
    oscillation_distance: NotNegative = 0.05
    """A reversed direction is barred until the robot is this far away, m (oscillation_reset_dist), ..."""
    oscillation_angle: NotNegative = 0.2
    """... or has turned this far, rad (oscillation_reset_angle, default)."""
    goal_tolerance: Positive = 0.15
    """Distance from the plan's end at which the goal is reached, m (xy_goal_tolerance)."""
    heading_tolerance: NotNegative = 0.3
    """Rules "indigo": ... with the goal's heading to within this angle, rad (yaw_goal_tolerance), ..."""
    stopped_speed: NotNegative = 0.1
    """... at no more than this speed, m/s (trans_stopped_vel, default), ..."""
    stopped_turn: NotNegative = 0.1
    """... and no more than this turn rate, rad/s (rot_stopped_vel, default)."""
    goal_slack: NotNegative = 0.15
    """Rules "disc": if the robot cannot stand at the plan's end, the nearest cell within this distance is the
    goal, m; against rounding of cells and poses. Own choice."""
    detour: NotNegative = 2.0
    """Rules "disc": no trajectory is valid if the way to the local goal is longer than the plan by more than
    this, m. Half the window; unseen cells count as free, and waves find ways behind walls. Own choice."""
    shortcut: NotNegative = 0.0
    """Rules "disc": the local goal moves nearer along the plan until the plan is at most this much longer
    than the shortest way to it, m; 0: it stays. Else plan and shortest way may pull in opposite directions at
    a gap that the plan avoids. Own choice."""
    spot_angle: NotNegative = 1.6
    """Rules "disc": the robot turns on the spot while the plan leads away at more than this angle, until half
    of it, rad. Own choice; dwa_local_planner (here: 4) drives wide arcs."""
    spot_rate: NotNegative = 0.0
    """Rules "disc": highest turn rate on the spot, straight towards the plan, rad/s; 0: the critics choose.
    As Nav2's rotation shim (rotate_to_heading_angular_vel 1.8)."""
    front_angle: NotNegative = 3.2
    """Rules "disc": the nose is not drawn to the goal if the plan leads aside of it by more than this angle,
    rad; above π it always is, as in dwa_local_planner, which may oscillate at a wall's end. Own choice."""
    escape: NotNegative = 0.035
    """Rules "disc": a robot that is too near to a mark by at most this, m, may drive as long as the distance
    does not fall. Own choice, what the padding adds: marks may jump by a cell."""
    scan_patience: Interval = seconds(0.5)
    """Without a scan for this long the robot does not drive: five periods at 10 Hz. Own choice."""

    def __post_init__(self) -> None:
        super().__post_init__()
        finest = max(self.max_speed / self.granularity, self.max_turn / self.angular_granularity)
        if self.sim_time * finest > _MOST_POINTS:
            right = f"such that a trajectory has at most {_MOST_POINTS} points at the highest speeds"
            raise self.wrong("sim_time", right)
        self.check_unused(_IDLE[self.rules], f'dwa.rules is "{self.rules}"')


_DISC: Final = DwaParameters(rules="disc", granularity=0.05)
DWA_PRESETS: Final[Mapping[str, DwaParameters]] = MappingProxyType(
    {
        "chapter": DwaParameters(),
        "robust": replace(
            _DISC,
            min_speed=-0.1,
            least_turn=0.2,
            turn_acceleration=3.5,
            sim_time=1.7,
            path_bias=16.0,
            spot_rate=1.8,
            front_angle=0.8,
            shortcut=1.5,
            escape=1.0,
        ),
    }
)
"""`chapter`: the original's rules and numbers. `robust`: our own rules and numbers, tried on the corridor
map. The plan pulls less than the goal, so that the robot leaves it to pass obstacles; trajectories are
shorter (default of sim_time in dwa_local_planner); turn rates are lower and change faster, as at min_rot_vel
a robot cannot turn back within a period."""


class OscillationCritic:
    """Remembers the directions that were commanded, and bars the reverse of them for a while."""

    def __init__(self, distance: float, angle: float, least_speed: float) -> None:
        """All is allowed again `distance`, m, or `angle`, rad, from where it was barred.

        Turns count from `least_speed`, m/s, downward only.
        """
        self._distance = distance
        self._angle = angle
        self._least_speed = least_speed
        self._last = [0, 0]  # sign of the last motion along, and of the last turn
        self._barred = np.zeros(4, np.bool_)
        self._where = Pose(0.0, 0.0, 0.0)

    @property
    def barred(self) -> Flags:
        """(4,): True if forward, backward, left turn, right turn must not be commanded."""
        return self._barred

    def forget(self) -> None:
        """Allow everything."""
        self._last = [0, 0]
        self._barred[:] = False

    def note(self, here: Pose, speed: float, turn: float) -> None:
        """`speed`, m/s, and `turn`, rad/s, are commanded at `here`, odometry frame."""
        reversed_now = self._reverse(0, speed)
        if abs(speed) <= self._least_speed:
            reversed_now |= self._reverse(1, turn)
        if reversed_now:
            self._where = here
        if self._barred.any() and self._away(here):
            self.forget()

    def _reverse(self, axis: int, value: float) -> bool:
        """Note the sign of a motion; True if it was the other one before, which is barred from now on."""
        sign = (value > 0) - (value < 0)
        if sign == 0:
            return False
        turned = self._last[axis] == -sign
        if turned:
            self._barred[2 * axis + (1 if sign > 0 else 0)] = True
        self._last[axis] = sign
        return turned

    def _away(self, here: Pose) -> bool:
        gone = hypot(here.x - self._where.x, here.y - self._where.y)
        return gone > self._distance or abs(wrap(here.heading - self._where.heading)) > self._angle


class Steering(NamedTuple):
    """What to command now."""

    twist: Twist
    valid: bool
    """False without any valid trajectory, or without a plan or a scan to find one with; `twist` is STILL."""


NOWHERE: Final = Steering(STILL, False)


class BaseLocalPlanner(ABC):
    """Follows one plan at a time."""

    def __init__(self, local: CostMap, limits: DriveParameters, parameters: DwaParameters) -> None:
        """`local` is kept up to date by its owner; `limits`: of the base."""
        self._local = local
        self._p = p = parameters
        self._cell = local.parameters.cell
        self._max_speed, self._max_turn = min(p.max_speed, limits.speed), min(p.max_turn, limits.turn_rate)
        self._acceleration = min(p.acceleration, limits.acceleration)
        self._turn_acceleration = min(p.turn_acceleration, limits.turn_acceleration)
        self._gain = self._acceleration * in_seconds(p.period)
        self._turn_gain = self._turn_acceleration * in_seconds(p.period)
        inscribed = local.inflation.inscribed / self._cell
        self._limit = inscribed * inscribed
        """Squared distance to a mark, cells², that the body's centre has to exceed."""
        self._oscillation = OscillationCritic(p.oscillation_distance, p.oscillation_angle, p.least_speed)
        self._way: Floats = np.zeros((0, 2))
        self._turning = False
        self.steered: Instant | None = None
        """When it chose last, with a fresh scan; None: never."""

    @property
    def local(self) -> CostMap:
        """Its local cost map."""
        return self._local

    @property
    def period(self) -> Duration:
        """How often it is to be asked: so long a command holds."""
        return self._p.period

    def begin(self) -> None:
        """Forget plan, command and oscillations: the robot has a new goal."""
        self._way = np.zeros((0, 2))
        self._oscillation.forget()
        self._turning = False

    def follow(self, way: Floats) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame."""
        self._way = way

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """What to command from `instant` on, for a period; not valid without a fresh scan.

        `here` and `estimate`: the body's pose at that instant, in the odometry frame, to which the local map
        has been rolled, and in the map frame. `velocity`: the base's own.
        """
        if not self._local.age(instant) <= in_seconds(self._p.scan_patience):
            return NOWHERE
        self.steered = instant
        return self._choose(instant, here, estimate, velocity) if self._way.size else NOWHERE

    @abstractmethod
    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """True once the robot is where its plan ends, as this local planner means it."""

    @abstractmethod
    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """One cycle; there is a plan."""

    def _record(self, kind: np.dtype[np.void], **values: float) -> NDArray[np.void]:
        """Return the parameters of a kernel, (1,), with the weights of the critics that both kernels have.

        Path and goal weigh bias · cell · ½ per cell of distance (DWAPlanner::reconfigure).
        """
        record = np.zeros(1, kind)
        record["path"] = record["alignment"] = self._p.path_bias * self._cell * 0.5
        record["goal"] = record["front"] = self._p.goal_bias * self._cell * 0.5
        record["nose"] = self._p.forward_point / self._cell
        for name, value in values.items():
            record[name] = value
        return record


def reachable(value: float, gain: float, low: float, high: float) -> tuple[float, float]:
    """The dynamic window: what is within `gain` of `value` and within the limits; else the nearest limit."""
    return min(max(value - gain, low), high), max(min(value + gain, high), low)
