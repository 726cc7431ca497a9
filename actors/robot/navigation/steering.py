"""Parameters and base class of local planners."""

from abc import ABC, abstractmethod
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from msgspec import Meta
from msgspec.structs import replace

from actors.array_types import Flags, Floats, Records
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
"""Unused parameters by rules."""
_MOST_POINTS: Final = 10_000
"""Maximum number of points of a trajectory; own choice: a hundred times the usual number."""
_Samples = Annotated[int, Meta(ge=2)]


class DwaParameters(Settings, frozen=True):
    """Local planner. Defaults: d3scomp/ROSRemote, simulation/params, otherwise dwa_local_planner."""

    rules: Literal["indigo", "disc"] = "indigo"
    """"indigo": dwa_local_planner of ROS Indigo (`local_planner`). "disc": our own (`disc_local_planner`)."""
    period: PositiveInterval = seconds(0.2)
    """Time from one command to the next (move_base controller_frequency 5 Hz)."""
    max_speed: Positive = 0.5
    """Highest speed, m/s (max_vel_x)."""
    min_speed: Annotated[float, Meta(ge=-10)] = 0.0
    """Lowest speed, m/s (min_vel_x). Rules "disc": negative: speed of backing away from obstacles."""
    least_speed: NotNegative = 0.1
    """A command has at least this speed, m/s (min_trans_vel), or the turn rate `least_turn`."""
    max_turn: Positive = 5.0
    """Highest turn rate, rad/s (max_rot_vel)."""
    least_turn: NotNegative = 0.4
    """Least turn rate of a slow command, rad/s (min_rot_vel)."""
    acceleration: Positive = 1.0
    """Highest acceleration, m/s² (acc_lim_x); also used for braking."""
    turn_acceleration: Positive = 2.0
    """Highest angular acceleration, rad/s² (acc_lim_theta)."""
    speed_samples: _Samples = 15
    """Number of sampled speeds (vx_samples)."""
    turn_samples: _Samples = 20
    """Number of turn rates sampled for each speed (vth_samples)."""
    sim_time: Positive = 3.0
    """Duration of a trajectory at constant velocity, s."""
    stop_buffer: NotNegative = 0.2
    """Rules "disc": a trajectory lasts at least until the robot stops if it brakes after this time, s
    (stop_time_buffer, which dwa_local_planner documents and ignores)."""
    granularity: Positive = 0.025
    """Spacing of the checked points of a trajectory, m (sim_granularity, default)."""
    angular_granularity: Positive = 0.1
    """Spacing of these points, rad (angular_sim_granularity, default)."""
    path_bias: NotNegative = 64.0
    """Weight of the distance to the plan (path_distance_bias)."""
    goal_bias: NotNegative = 24.0
    """Weight of the distance to the local goal (goal_distance_bias)."""
    occdist_scale: NotNegative = 0.5
    """Weight of the footprint's cost: at the end of a trajectory (indigo, ObstacleCostFunction), or the
    highest along it (disc)."""
    forward_point: NotNegative = 0.325
    """Distance of the nose from the centre, m; distances of the nose to plan and goal count, too."""
    scaling_speed: Positive = 0.25
    """Rules "disc": speed above which the footprint grows, m/s."""
    max_scaling_factor: NotNegative = 0.2
    """Rules "disc": growth at the highest speed, a share (computed but unused in Indigo, used in Noetic)."""
    oscillation_distance: NotNegative = 0.05
    """Distance after which a reversed direction is allowed again, m (oscillation_reset_dist)."""
    oscillation_angle: NotNegative = 0.2
    """Turn after which it is allowed again, rad (oscillation_reset_angle, default)."""
    goal_tolerance: Positive = 0.15
    """Distance from the plan's end at which the goal is reached, m (xy_goal_tolerance)."""
    heading_tolerance: NotNegative = 0.3
    """Rules "indigo": tolerance of the heading at the goal, rad (yaw_goal_tolerance)."""
    stopped_speed: NotNegative = 0.1
    """Rules "indigo": highest speed at the goal, m/s (trans_stopped_vel, default)."""
    stopped_turn: NotNegative = 0.1
    """Rules "indigo": highest turn rate at the goal, rad/s (rot_stopped_vel, default)."""
    goal_slack: NotNegative = 0.15
    """Rules "disc": if the plan's end is occupied, the nearest free cell within this distance is the goal, m;
    tolerates rounding of cells and poses. Own choice."""
    detour: NotNegative = 2.0
    """Rules "disc": no trajectory is valid if the path to the local goal is longer than the plan by more than
    this, m. Half the window; unseen cells count as free, so waves find paths behind walls. Own choice."""
    shortcut: NotNegative = 0.0
    """Rules "disc": the local goal moves nearer along the plan until the plan is at most this much longer
    than the shortest path to it, m; 0: it stays. Otherwise plan and shortest path may attract the robot in
    opposite directions at a gap that the plan avoids. Own choice."""
    spot_angle: NotNegative = 1.6
    """Rules "disc": the robot turns on the spot if the plan leads away at more than this angle, until half of
    it, rad. Own choice; dwa_local_planner (here: 4) drives wide arcs."""
    spot_rate: NotNegative = 0.0
    """Rules "disc": highest turn rate on the spot towards the plan, rad/s; 0: the critics choose. As Nav2's
    rotation shim (rotate_to_heading_angular_vel 1.8)."""
    front_angle: NotNegative = 3.2
    """Rules "disc": ignore the nose's distance to the goal if the angle between plan and goal exceeds this,
    rad; above π: never, as in dwa_local_planner, which may oscillate at a wall's end. Own choice."""
    escape: NotNegative = 0.035
    """Rules "disc": a robot that is too near to a mark by at most this, m, may drive unless the distance
    falls. Own choice, as much as the padding adds: marks may jump by a cell."""
    scan_patience: Interval = seconds(0.5)
    """Age of the last scan above which the robot stands: five periods at 10 Hz. Own choice."""

    def __post_init__(self) -> None:
        super().__post_init__()
        finest = max(self.max_speed / self.granularity, self.max_turn / self.angular_granularity)
        if self.sim_time * finest > _MOST_POINTS:
            right = f"such that a trajectory has at most {_MOST_POINTS} points at the highest speeds"
            raise self.wrong("sim_time", right)
        self.check_unused(_IDLE[self.rules], f'dwa.rules is "{self.rules}"')


_DISC: Final = DwaParameters(rules="disc", granularity=0.05)
DWA_PRESETS: Final = MappingProxyType(
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
"""`chapter`: rules and values of the original. `robust`: own rules and values, tuned on the corridor map. The
plan has less weight than the goal, so that the robot leaves it to pass obstacles; trajectories are shorter
(default of sim_time in dwa_local_planner); turn rates are lower and change faster, since at min_rot_vel a
robot cannot turn back within a period."""


class OscillationCritic:
    """Critic that bars reversed directions for a while."""

    def __init__(self, distance: float, angle: float, least_speed: float) -> None:
        """Create a critic that allows all directions again after `distance`, m, or `angle`, rad.

        Turns count at speeds up to `least_speed`, m/s.
        """
        self._distance = distance
        self._angle = angle
        self._least_speed = least_speed
        self._last = [0, 0]  # signs of the last speed and turn rate
        self._barred, self._is_barring = np.zeros(4, np.bool_), False
        self._where = Pose(0.0, 0.0, 0.0)

    @property
    def barred(self) -> Flags:
        """(4,): True if forward, backward, left turn, right turn is barred."""
        return self._barred

    def forget(self) -> None:
        """Allow all directions."""
        self._last = [0, 0]
        self._barred[:] = self._is_barring = False

    def note(self, here: Pose, speed: float, turn: float) -> None:
        """Record a command: `speed`, m/s, and `turn`, rad/s, at `here`, odometry frame."""
        reversed_now = self._reverse(0, speed)
        if abs(speed) <= self._least_speed:
            reversed_now |= self._reverse(1, turn)
        if reversed_now:
            self._where = here
        if self._is_barring and self._away(here):
            self.forget()

    def _reverse(self, axis: int, value: float) -> bool:
        """Record the sign of a motion; if it is reversed, bar the previous one and return True."""
        sign = (value > 0) - (value < 0)
        if sign == 0:
            return False
        turned = self._last[axis] == -sign
        if turned:
            self._barred[2 * axis + (1 if sign > 0 else 0)] = self._is_barring = True
        self._last[axis] = sign
        return turned

    def _away(self, here: Pose) -> bool:
        gone = hypot(here.x - self._where.x, here.y - self._where.y)
        return gone > self._distance or abs(wrap(here.heading - self._where.heading)) > self._angle


class Steering(NamedTuple):
    """Command of a local planner."""

    twist: Twist
    valid: bool
    """False without a valid trajectory, plan or recent scan; then `twist` is STILL."""


NO_COMMAND: Final = Steering(STILL, False)


class BaseLocalPlanner(ABC):
    """A local planner that follows one plan at a time."""

    def __init__(self, local: CostMap, limits: DriveParameters, parameters: DwaParameters) -> None:
        """Create a planner; the caller updates `local`. `limits`: of the base."""
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
        """Squared distance from marks that the body's centre must exceed, cells²."""
        self._oscillation = OscillationCritic(p.oscillation_distance, p.oscillation_angle, p.least_speed)
        self._path: Floats = np.zeros((0, 2))
        self._turning = False
        self.steered: Instant | None = None
        """Time of the last command with a recent scan; None: never."""

    @property
    def local(self) -> CostMap:
        """Local cost map."""
        return self._local

    @property
    def period(self) -> Duration:
        """Time between commands."""
        return self._p.period

    def begin(self) -> None:
        """Reset plan and oscillations for a new goal."""
        self._path = np.zeros((0, 2))
        self._oscillation.forget()
        self._turning = False

    def follow(self, path: Floats) -> None:
        """Follow `path` from now on: (n, 2), n ≥ 1, m, map frame."""
        self._path = path

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """Return the command from `instant` on, for a period; not valid without a recent scan.

        `here`, `estimate`: the body's pose at that instant, in the odometry frame, to which the local map has
        been rolled, and in the map frame. `velocity`: of the base.
        """
        if not self._local.age(instant) <= in_seconds(self._p.scan_patience):
            return NO_COMMAND
        self.steered = instant
        return self._choose(instant, here, estimate, velocity) if self._path.size else NO_COMMAND

    @abstractmethod
    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """Return True if the robot has reached the end of its plan."""

    @abstractmethod
    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """Return the command of a cycle; there is a plan."""

    def _record(self, kind: np.dtype[np.void], **values: float) -> Records:
        """Return the parameters of a kernel, (1,), with the weights of critics common to both kernels.

        Path and goal weigh bias · cell · ½ per cell of distance (DWAPlanner::reconfigure).
        """
        record = np.zeros(1, kind)
        record["path"] = record["alignment"] = self._p.path_bias * self._cell * 0.5
        record["goal"] = record["front"] = self._p.goal_bias * self._cell * 0.5
        record["nose"] = self._p.forward_point / self._cell
        for name, value in values.items():
            record[name] = value
        return record


def reachable_range(value: float, gain: float, low: float, high: float) -> tuple[float, float]:
    """Return the dynamic window: values within `gain` of `value` and the limits, or the nearest limit."""
    return min(max(value - gain, low), high), max(min(value + gain, high), low)
