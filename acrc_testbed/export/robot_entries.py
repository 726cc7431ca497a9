"""ROS 2 messages of a run: map, poses, scans, commands, introspection and markers.

The log of `acrc export --mcap` and the live topics of `--ros2` consist of these entries.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from heapq import merge
from itertools import groupby
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.export import ros2_log
from acrc_testbed.export.ros2_log import (
    MAP,
    UNKNOWN_CELL,
    LogEntry,
    Marker,
    Points,
    Transform,
    disc,
    label,
    lines,
    marker_array,
    occupancy_grid,
    robot_topic,
)
from acrc_testbed.run_model.data import RunData, RunDescription, Trajectory
from acrc_testbed.run_model.floor import FloorObject
from acrc_testbed.run_model.robot_introspection import PointSets, RecordedProcess, RobotInternals
from acrc_testbed.run_model.task_state import ItemState, ItemTable
from actors.array_types import Floats, Octets, Singles
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose
from actors.instant import LATEST
from actors.items import ItemKey
from actors.messages import NO_ECHO_MM, Scan, SensorData
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, Colour
from actors.robot_model import RobotModel

_NEAR_S: Final = 1e-6
"""Tolerance of instants of one step, s."""
_BEFORE_S: Final = 1.0
"""Maximum time of a robot's first scan before the start of the run, s."""
_INSCRIBED: Final = 253
"""Cost of cells within the inscribed radius, as in costmap_2d; 254 is lethal, 255 unknown."""
_LETHAL: Final = 254
Senses = Mapping[str, Iterable[SensorData]]
"""Sensor data of a run, or of its next part, by actor: a process of a robot."""


class RunEntries:
    """Entries of a run, whole or in successive parts: the results are equal."""

    def __init__(
        self, description: RunDescription, models: Mapping[str, RobotModel], robots: Sequence[str] = ()
    ) -> None:
        """`robots`: show all data of these, and only the poses of others; empty: of all."""
        self._description, self._models, self._detailed = description, models, robots or description.robots
        self.left_out = Counter[str]()
        """Number of messages with invalid instants or ranges, by topic."""
        self._is_first = True
        self._items, self._shown_items = ItemTable(), dict[ItemKey, tuple[float, float, str]]()
        self._states = dict.fromkeys(models, "")
        self._destinations: dict[str, tuple[str, tuple[float, float] | None]] = {}
        """Destination and point by actor."""
        self._links = LinkEntries(description)

    def take(self, run: RunData, senses: Senses) -> Iterator[LogEntry]:
        """Yield the entries of the next part by time; entries of one instant keep the order of their kinds.

        Raises RecordingError and WireError, if `senses` does.
        """
        return merge(*self._streams(run, senses), key=attrgetter("logged"))

    def _streams(self, run: RunData, senses: Senses) -> Iterator[Iterator[LogEntry]]:
        if self._is_first:
            self._is_first = False
            yield iter((map_entry(run.grid), static_frames(self._models), self._body_entry(0.0)))
        yield from (self._item_entries(run), self._body_entries(run), obstacle_entries(run))
        yield true_entries(run)
        yield from self._estimate_streams(run)
        detailed = [one for one in run.processes if one.robot in self._detailed]
        for source in detailed:
            track, model = run.trajectories[source.robot], self._models[source.robot]
            yield sensor_entries(source, senses.get(source.actor, ()), track, model, self.left_out)
        yield self._links.take(run)
        for internals in run.internals:
            if internals.process.robot in self._detailed:
                yield self._activity_entries(internals)
                yield from internal_streams(internals)
        for robot in dict.fromkeys(source.robot for source in detailed):
            yield command_entries(robot, run.trajectories[robot])

    def _estimate_streams(self, run: RunData) -> Iterator[Iterator[LogEntry]]:
        """Yield the pose estimates, with covariances from the robots' introspection if it was recorded."""
        recorded = [one for one in run.internals if one.is_recorded]
        yield from map(estimate_entries, recorded)
        names = {one.process.robot for one in recorded}
        for robot, track in run.trajectories.items():
            if robot not in names:
                yield plain_estimate_entries(robot, track)

    def _item_entries(self, run: RunData) -> Iterator[LogEntry]:
        """Yield all items at each change of state: solid while open, then faint; grey if not done."""
        for change in self._items.extend(run):
            states = self._items.states
            current = {key: (one.x, one.y, one.state) for key, one in states.items()}
            if current != self._shown_items:
                self._shown_items = current
                yield _marker_entry(change.second, "/acrc/items", _item_markers(run, states))

    def _body_entries(self, run: RunData) -> Iterator[LogEntry]:
        """Yield the robots' discs at each change of state: faint while frozen, grey while off."""
        changes = [
            (second, robot, state)
            for robot, track in run.trajectories.items()
            for second, state in track.states
            if robot in self._states
        ]
        for second, now in groupby(sorted(changes), key=lambda one: one[0]):
            before = dict(self._states)
            self._states |= {robot: state for _, robot, state in now}
            if self._states != before:
                yield self._body_entry(second)

    def _body_entry(self, second: float) -> LogEntry:
        markers = _body_markers(self._description, self._models, self._states)
        return _marker_entry(second, "/acrc/robots", markers)

    def _activity_entries(self, robot: RobotInternals) -> Iterator[LogEntry]:
        """Yield the activities as log lines, and each new destination."""
        name = robot.process.robot
        colour = glyphs.robot(self._description.robots.index(name))
        times = _ascending_instants([one.second for one in robot.activities])
        for time, one in zip(times, robot.activities, strict=True):
            where = f" to {one.destination}" if one.destination else ""
            yield LogEntry(time, "/rosout", ros2_log.log_line(name, one.activity + where, time), time)
            destination = (one.destination, one.point)
            if destination != self._destinations.get(robot.process.actor, ("", None)):
                self._destinations[robot.process.actor] = destination
                markers = _destination_markers(*destination, colour)
                yield LogEntry(time, robot_topic(name, "destination"), marker_array(markers, time), time)


def true_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield the true poses of all robots per step; nothing without ground truth."""
    if not run.description.has_truth:
        return
    tracks = list(run.trajectories.items())
    for step, second in enumerate(tracks[0][1].seconds.tolist()):
        poses = [(robot, Pose(*track.poses[step].tolist())) for robot, track in tracks]
        at = round(second * 1e6)
        yield _frames_entry(at, [Transform(MAP, f"{robot}/truth", pose) for robot, pose in poses])
        for robot, pose in poses:
            yield LogEntry(at, robot_topic(robot, "truth"), ros2_log.placed_pose(pose, at), at)


def estimate_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    """Yield the pose estimates with the covariance of the filter, except during global localisation."""
    times = _ascending_instants([one.second for one in robot.step_estimates])
    for at, one in zip(times, robot.step_estimates, strict=True):
        if one.quality.located:
            yield _estimate_entry(robot.process.robot, Pose(*one.pose), one.quality.covariance, at)


def plain_estimate_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the pose estimates that a robot reported; covariances are 0 (unknown)."""
    for second, estimate in zip(track.seconds.tolist(), track.estimated.tolist(), strict=True):
        if estimate[0] == estimate[0]:
            yield _estimate_entry(robot, Pose(*estimate), (0.0,) * 9, round(second * 1e6))


def _estimate_entry(robot: str, pose: Pose, covariance: Sequence[float], at: int) -> LogEntry:
    message = ros2_log.uncertain_pose(pose, covariance, at)
    return LogEntry(at, robot_topic(robot, "amcl_pose"), message, at)


def sensor_entries(
    source: RecordedProcess,
    sensed: Iterable[SensorData],
    track: Trajectory,
    model: RobotModel,
    left_out: Counter[str],
) -> Iterator[LogEntry]:
    """Yield odometry, scans and frames of a robot's process; `left_out` counts invalid messages by topic."""
    robot, clock = source.robot, source.clock
    odometry, scanned = robot_topic(robot, "odom"), robot_topic(robot, "scan")
    for senses in sensed:
        if senses.halt:
            continue
        if abs(senses.instant) > LATEST:
            left_out[odometry] += 1
            continue
        received = [*senses.earlier_scans, *(() if senses.scan is None else (senses.scan,))]
        scans = [one for one in received if _is_valid_scan(one, model)]
        left_out[scanned] += len(received) - len(scans)
        instants = np.array([senses.instant, *(scan.stamp for scan in scans)], np.int64)
        second, *stamps = clock(instants).tolist()
        yield from _odometry_entries(robot, senses, second, _estimate_at(track, second))
        for scan, stamp in zip(scans, stamps, strict=True):
            if -_BEFORE_S < stamp < 0:
                continue
            at = round(stamp * 1e6)
            sweep = ros2_log.laser_scan(f"{robot}/laser", model.sensor, _ranges(scan), at)
            yield LogEntry(round(second * 1e6), scanned, sweep, at)


def command_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the commanded velocities, at the instants of the senses that they answer."""
    for second, (vx, vy, omega) in zip(track.seconds.tolist(), track.commanded.tolist(), strict=True):
        if not np.isnan(vx) and abs(at := round(second * 1e6)) <= LATEST:
            yield LogEntry(at, robot_topic(robot, "cmd_vel"), ros2_log.twist(vx, vy, omega), at)


def _is_valid_scan(scan: Scan, model: RobotModel) -> bool:
    """Return True if a scan has one range per ray of the sensor and a valid instant."""
    return len(scan.ranges_mm) == 2 * model.sensor.rays and abs(scan.stamp) <= LATEST


def _odometry_entries(
    robot: str, senses: SensorData, second: float, estimate: Pose | None
) -> Iterator[LogEntry]:
    odom, base, sensed = f"{robot}/odom", f"{robot}/base_link", senses.odometry
    odometry = Pose(sensed.x, sensed.y, sensed.heading)
    frames = [Transform(odom, base, odometry)]
    if estimate is not None:
        frames.insert(0, Transform(MAP, odom, estimate.frame(odometry)))
    at = round(second * 1e6)
    yield _frames_entry(at, frames)
    velocity = ros2_log.twist(sensed.vx, sensed.vy, sensed.omega)
    message = ros2_log.odometry(odom, base, odometry, velocity, at)
    yield LogEntry(at, robot_topic(robot, "odom"), message, at)


def _estimate_at(track: Trajectory, second: float) -> Pose | None:
    """Return the pose estimate at an instant; None: not reported."""
    at = int(np.searchsorted(track.seconds, second - _NEAR_S))
    if at == len(track.seconds) or track.seconds[at] > second + _NEAR_S or np.isnan(track.estimated[at, 0]):
        return None
    return Pose(*track.estimated[at].tolist())


def _ranges(scan: Scan) -> Singles:
    """Return the ranges, (rays,), m; inf: no echo (REP 117)."""
    millimetres = np.frombuffer(scan.ranges_mm, "<u2")
    return np.where(millimetres == NO_ECHO_MM, np.inf, millimetres / 1000.0).astype(np.float32)


def internal_streams(robot: RobotInternals) -> Iterator[Iterator[LogEntry]]:
    """Yield streams of a robot's introspection, each in order of time."""
    yield _point_entries(robot, "particles", robot.particles, ros2_log.point_cloud)
    yield _cost_map_entries(robot)
    yield _point_entries(robot, "plan", robot.plans, ros2_log.path)


def _ascending_instants(seconds: Sequence[float] | Floats) -> list[int]:
    """Return instants of the run in µs, in ascending order."""
    found: list[float] = (np.maximum.accumulate(np.asarray(seconds, np.float64)) * 1e6).tolist()
    return [round(one) for one in found]


def _point_entries(
    robot: RobotInternals, name: str, sets: PointSets, message: Callable[[Points, int], Any]
) -> Iterator[LogEntry]:
    """Yield a message for each set of points."""
    topic = robot_topic(robot.process.robot, name)
    for time, points in zip(_ascending_instants(sets.seconds), sets.sets(), strict=True):
        yield LogEntry(time, topic, message(points, time), time)


def _cost_map_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    topic, windows = robot_topic(robot.process.robot, "local_costmap/costmap"), robot.windows
    times = _ascending_instants(windows.seconds)
    for time, costs, corner in zip(times, windows.costs, windows.corners.tolist(), strict=True):
        grid = ros2_log.occupancy_grid(Pose(*corner), windows.cell, occupancy(costs), time)
        yield LogEntry(time, topic, grid, time)


def occupancy(costs: Octets) -> NDArray[np.int8]:
    """Convert costs to values of nav_msgs/OccupancyGrid, as costmap_2d_ros does.

    100: lethal; 99: within the inscribed radius; 1 to 98: inflated; -1: unknown.
    """
    found = np.zeros(256, np.int8)
    found[1:_INSCRIBED] = 1 + 97 * (np.arange(1, _INSCRIBED) - 1) // (_INSCRIBED - 2)
    found[_INSCRIBED], found[_LETHAL], found[255] = 99, 100, UNKNOWN_CELL
    return found[costs]


def static_frames(models: Mapping[str, RobotModel]) -> LogEntry:
    """Return the mounting poses of the range sensors."""
    frames = [
        Transform(f"{robot}/base_link", f"{robot}/laser", model.sensor.mount)
        for robot, model in models.items()
    ]
    return LogEntry(0, "/tf_static", ros2_log.transforms(frames, 0), 0)


def _frames_entry(at: int, frames: list[Transform]) -> LogEntry:
    return LogEntry(at, "/tf", ros2_log.transforms(frames, at), at)


_ITEM_RADIUS: Final = 0.15
_FLAT: Final = 0.02
_HIGH: Final = 0.4
"""Height of robots, walls and obstacles, m."""
_LINK: Final = 0.02
_LETTERS: Final = 0.3
_PERIOD_S: Final = 1.0
"""Interval for which links are counted, s."""


def map_entry(grid: OccupancyGrid) -> LogEntry:
    """Return the robots' map."""
    values = np.full(grid.cells.shape, UNKNOWN_CELL, np.int8)
    values[grid.cells == FREE], values[grid.cells == OCCUPIED] = 0, 100
    corner = Pose(grid.origin.x, grid.origin.y, 0.0)
    return LogEntry(0, "/map", occupancy_grid(corner, grid.resolution, values, 0), 0)


def _item_markers(run: RunData, states: Mapping[ItemKey, ItemState]) -> list[Marker]:
    markers = []
    for key, state in states.items():
        style, owner = run.description.task.marks.get(state.state), key.owner
        if style is not None:
            robot = next((one for one in (owner, state.by) if one in run.robots), None)
            has_colour = robot is not None and (style.is_open or style.symbol == "disc")
            colour = glyphs.robot(run.robots.index(robot)) if has_colour else glyphs.GREY
            marker = disc(str(key), (state.x, state.y), _ITEM_RADIUS, _FLAT, colour)
            markers.append(marker if style.is_open else marker._replace(opacity=0.25))
    return markers


def _body_markers(
    run: RunDescription, models: Mapping[str, RobotModel], states: Mapping[str, str]
) -> list[Marker]:
    markers = []
    for number, robot in enumerate(run.robots):
        if robot in models:
            frame = f"{robot}/{'truth' if run.has_truth else 'base_link'}"
            colour = glyphs.GREY if states[robot] == "off" else glyphs.robot(number)
            body = disc(robot, (0.0, 0.0), models[robot].footprint.circumradius, _HIGH, colour)
            markers.append(body._replace(opacity=0.4 if states[robot] else 0.9, frame=frame))
            name = label(f"{robot}/name", robot, _LETTERS, glyphs.WHITE)
            markers.append(name._replace(frame=frame))
    return markers


def _destination_markers(name: str, point: tuple[float, float] | None, colour: Colour) -> list[Marker]:
    """Return a disc at the goal of navigation with the name of the item there; nothing without a goal."""
    if point is None:
        return []
    text = label("name", name, _LETTERS, colour)
    return [
        disc("goal", point, 2 * _ITEM_RADIUS, _FLAT / 2, colour)._replace(opacity=0.5),
        text._replace(position=(*point, text.position[2])),
    ]


def obstacle_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield obstacles, walls, jammers and closed doors at each change."""
    for second, objects in run.floor:
        yield _marker_entry(second, "/acrc/things", [_obstacle_marker(*one) for one in enumerate(objects)])


def _obstacle_marker(number: int, floor_object: FloorObject) -> Marker:
    mark = MARKS[floor_object.kind]
    is_jammer = mark.shape == "dashed ring"
    name, colour = f"{floor_object.kind} {number}", mark.colour or glyphs.GREY
    marker = lines(name, floor_object.points, 2 * floor_object.radius, colour)
    if floor_object.is_round:
        marker = disc(
            name, floor_object.points[0], floor_object.radius, _FLAT if is_jammer else _HIGH, colour
        )
    return marker._replace(opacity=0.3 if is_jammer else 1.0)


class LinkEntries:
    """Once per second, a line for each pair of robots that exchanged a frame in this second."""

    def __init__(self, description: RunDescription) -> None:
        self._positions: list[tuple[float, float] | None] = [None] * len(description.robots)
        """Last positions of the previous parts, m; None: unknown."""
        self._heard: Floats = np.zeros((0, 4))
        """`RunData.heard` of the current second."""

    def take(self, run: RunData) -> Iterator[LogEntry]:
        """Yield the entries of the next part."""
        tracks = list(run.trajectories.values())
        heard = np.concatenate((self._heard, run.heard))
        for period in range(int(run.since / _PERIOD_S) + 1, int(run.end / _PERIOD_S) + 1):
            second = period * _PERIOD_S
            is_current = (second - _PERIOD_S <= heard[:, 0]) & (heard[:, 0] < second)
            pairs = np.unique(np.sort(heard[is_current, 1:3].astype(np.int64), axis=1), axis=0)
            positions = [_last_position(*each, second) for each in zip(tracks, self._positions, strict=True)]
            points: list[tuple[float, float]] = []
            for pair in pairs.tolist():
                ends = [end for index in pair if (end := positions[index]) is not None]
                points += ends if len(ends) == len(pair) else []
            links = [lines("links", tuple(points), _LINK, glyphs.LINK)] if points else []
            yield _marker_entry(second, "/acrc/links", links)
        self._positions = [
            _last_position(*each, run.end) for each in zip(tracks, self._positions, strict=True)
        ]
        self._heard = heard[heard[:, 0] >= int(run.end / _PERIOD_S) * _PERIOD_S]


def _last_position(
    track: Trajectory, before: tuple[float, float] | None, second: float
) -> tuple[float, float] | None:
    """Return the last position of a robot until then, m; `before`: of the previous part; None: unknown."""
    at = int(np.searchsorted(track.seconds, second, side="right")) - 1
    if at < 0:
        return before
    x, y = track.poses[at, :2].tolist()
    return None if np.isnan(x) else (x, y)


def _marker_entry(second: float, topic: str, markers: list[Marker]) -> LogEntry:
    instant = round(second * 1e6)
    return LogEntry(instant, topic, marker_array(markers, instant), instant)
