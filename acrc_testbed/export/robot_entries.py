"""ROS 2 messages of a run: map, poses, scans, commands, introspection and markers.

The log of `acrc export --mcap` and the live topics of `--ros2` consist of these entries.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from heapq import merge
from itertools import groupby
from operator import attrgetter
from typing import Any, Final

import numpy as np
from msgspec.structs import astuple
from numpy.typing import NDArray

from acrc_testbed.export import ros2_log
from acrc_testbed.export.ros2_log import (
    MAP,
    UNKNOWN_CELL,
    LogEntry,
    Marker,
    NewMessage,
    Transform,
    ascending_instants,
    disc,
    label,
    lines,
    log_entries,
    marker_array,
    occupancy_grid,
    robot_topic,
)
from acrc_testbed.run_model.data import RunData, RunDescription, Trajectory
from acrc_testbed.run_model.floor import FloorObject
from acrc_testbed.run_model.robot_introspection import RecordedProcess, RobotInternals
from acrc_testbed.run_model.task_state import ItemState, ItemTable
from actors.array_types import Floats, Octets
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose
from actors.instant import LATEST
from actors.items import ItemKey
from actors.messages import NO_ECHO_MM, SensorData
from actors.observer import glyphs
from actors.observer.glyphs import MARKS, Colour
from actors.robot_model import RobotModel

_NEAR_S: Final = 1e-6
"""Tolerance of instants of one step, s."""
_BEFORE_S: Final = 1.0
"""Maximum time of a robot's first scan before the start of the run, s."""
_INSCRIBED: Final = 253
"""Cost of cells within the inscribed radius, as in costmap_2d; 254 is lethal, 255 unknown."""
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
            yield iter(self._initial_entries(run.grid))
        yield from (self._item_entries(run), self._body_entries(run), obstacle_entries(run))
        yield from true_streams(run)
        yield from estimate_streams(run)
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

    def _initial_entries(self, grid: OccupancyGrid) -> Sequence[LogEntry]:
        """Return the robots' map, the mounting poses of the range sensors and the robots' discs."""
        values = np.full(grid.cells.shape, UNKNOWN_CELL, np.int8)
        values[grid.cells == FREE], values[grid.cells == OCCUPIED] = 0, 100
        frames = [
            Transform(f"{robot}/base_link", f"{robot}/laser", model.sensor.mount)
            for robot, model in self._models.items()
        ]
        return (
            LogEntry(0, "/map", occupancy_grid((*grid.origin, 0.0), grid.resolution, values, 0), 0),
            LogEntry(0, "/tf_static", ros2_log.transforms(frames, 0), 0),
            self._body_entry(0.0),
        )

    def _item_entries(self, run: RunData) -> Iterator[LogEntry]:
        """Yield all items at each change of state: solid while open, then faint; grey if not done."""
        for change in self._items.extend(run):
            states = self._items.states
            current = {key: one[:3] for key, one in states.items()}
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
        markers = []
        for number, robot in enumerate(self._description.robots):
            if (state := self._states.get(robot)) is not None:
                frame = f"{robot}/{'truth' if self._description.has_truth else 'base_link'}"
                colour = glyphs.GREY if state == "off" else glyphs.robot(number)
                body = disc(robot, (0.0, 0.0), self._models[robot].footprint.circumradius, _HIGH, colour)
                name = label(f"{robot}/name", robot, _LETTERS, glyphs.WHITE)
                markers += [
                    body._replace(opacity=0.4 if state else 0.9, frame=frame),
                    name._replace(frame=frame),
                ]
        return _marker_entry(second, "/acrc/robots", markers)

    def _activity_entries(self, robot: RobotInternals) -> Iterator[LogEntry]:
        """Yield the activities as log lines, and each new destination."""
        name = robot.process.robot
        colour = glyphs.robot(self._description.robots.index(name))
        actor = robot.process.actor
        times = ascending_instants([one.second for one in robot.activities])
        for time, one in zip(times, robot.activities, strict=True):
            where = f" to {one.destination}" if one.destination else ""
            yield LogEntry(time, "/rosout", ros2_log.log_line(name, one.activity + where, time), time)
            if (destination := one[2:]) != self._destinations.get(actor, ("", None)):
                self._destinations[actor] = destination
                markers = _destination_markers(*destination, colour)
                yield LogEntry(time, robot_topic(name, "destination"), marker_array(markers, time), time)


def true_streams(run: RunData) -> Iterator[Iterator[LogEntry]]:
    """Yield the true poses of all robots per step; nothing without ground truth."""
    if not run.description.has_truth:
        return
    tracks = {robot: track.poses for robot, track in run.trajectories.items()}
    steps = zip(*tracks.values(), strict=True)
    frames = (
        [Transform(MAP, f"{robot}/truth", pose) for robot, pose in zip(tracks, poses, strict=True)]
        for poses in steps
    )
    yield log_entries("/tf", run.seconds, frames, ros2_log.transforms)
    for robot, poses in tracks.items():
        yield log_entries(robot_topic(robot, "truth"), run.seconds, poses, ros2_log.placed_pose)


def estimate_streams(run: RunData) -> Iterator[Iterator[LogEntry]]:
    """Yield the pose estimates, without those of global localisation if introspection was recorded.

    Then their covariance is that of the filter, else 0 (unknown).
    """
    recorded = set()
    for internals in run.internals:
        if internals.is_recorded:
            recorded.add(internals.process.robot)
            located = [one for one in internals.step_estimates if one.quality.located]
            seconds = [one.second for one in located]
            poses = ((one.pose, one.quality.covariance) for one in located)
            yield log_entries(
                robot_topic(internals.process.robot, "amcl_pose"), seconds, poses, ros2_log.uncertain_pose
            )
    for robot, track in run.trajectories.items():
        if robot not in recorded:
            known = ~np.isnan(track.estimated[:, 0])
            poses = ((pose, (0.0,) * 9) for pose in track.estimated[known])
            yield log_entries(
                robot_topic(robot, "amcl_pose"), track.seconds[known], poses, ros2_log.uncertain_pose
            )


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
        scans = [
            one
            for one in received
            if len(one.ranges_mm) == 2 * model.sensor.rays and abs(one.stamp) <= LATEST
        ]
        left_out[scanned] += len(received) - len(scans)
        instants = np.array([senses.instant, *(scan.stamp for scan in scans)], np.int64)
        second, *stamps = clock(instants).tolist()
        yield from _odometry_entries(robot, senses, second, _estimate_at(track, second))
        for scan, stamp in zip(scans, stamps, strict=True):
            if -_BEFORE_S < stamp < 0:
                continue
            at = round(stamp * 1e6)
            millimetres = np.frombuffer(scan.ranges_mm, "<u2")
            ranges = np.where(millimetres == NO_ECHO_MM, np.inf, millimetres / 1000.0).astype(np.float32)
            sweep = ros2_log.laser_scan(f"{robot}/laser", model.sensor, ranges, at)
            yield LogEntry(round(second * 1e6), scanned, sweep, at)


def command_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the commanded velocities, at the instants of the senses that they answer."""
    known = ~np.isnan(track.commanded[:, 0]) & (np.abs(track.seconds) <= LATEST / 1e6)
    return log_entries(
        robot_topic(robot, "cmd_vel"),
        track.seconds[known],
        track.commanded[known],
        lambda velocity, _: ros2_log.twist(velocity),
    )


def _odometry_entries(
    robot: str, senses: SensorData, second: float, estimate: Pose | None
) -> Iterator[LogEntry]:
    odom, base, at = f"{robot}/odom", f"{robot}/base_link", round(second * 1e6)
    x, y, heading, *velocity = astuple(senses.odometry)
    odometry = Pose(x, y, heading)
    frames = [Transform(odom, base, odometry)]
    if estimate is not None:
        frames.insert(0, Transform(MAP, odom, estimate.frame(odometry)))
    yield LogEntry(at, "/tf", ros2_log.transforms(frames, at), at)
    message = ros2_log.odometry(odom, base, odometry, velocity, at)
    yield LogEntry(at, robot_topic(robot, "odom"), message, at)


def _estimate_at(track: Trajectory, second: float) -> Pose | None:
    """Return the pose estimate at an instant; None: not reported."""
    at = int(np.searchsorted(track.seconds, second - _NEAR_S))
    if at == len(track.seconds) or track.seconds[at] > second + _NEAR_S or np.isnan(track.estimated[at, 0]):
        return None
    return Pose(*track.estimated[at].tolist())


def internal_streams(robot: RobotInternals) -> Iterator[Iterator[LogEntry]]:
    """Yield streams of a robot's introspection, each in order of time."""

    def stream(name: str, seconds: Floats, values: Iterable[Any], message: NewMessage) -> Iterator[LogEntry]:
        return log_entries(robot_topic(robot.process.robot, name), seconds, values, message)

    particles, windows, plans = robot.particles, robot.windows, robot.plans
    yield stream("particles", particles.seconds, particles.sets(), ros2_log.point_cloud)
    grids = zip(windows.costs, windows.corners, strict=True)
    yield stream(
        "local_costmap/costmap",
        windows.seconds,
        grids,
        lambda grid, at: occupancy_grid(grid[1], windows.cell, occupancy(grid[0]), at),
    )
    yield stream("plan", plans.seconds, plans.sets(), ros2_log.path)


def occupancy(costs: Octets) -> NDArray[np.int8]:
    """Convert costs to values of nav_msgs/OccupancyGrid, as costmap_2d_ros does.

    100: lethal; 99: within the inscribed radius; 1 to 98: inflated; -1: unknown.
    """
    inflated = 1 + 97 * np.arange(_INSCRIBED - 1) // (_INSCRIBED - 2)
    return np.array([0, *inflated, 99, 100, UNKNOWN_CELL], np.int8)[costs]


_ITEM_RADIUS: Final = 0.15
_FLAT: Final = 0.02
_HIGH: Final = 0.4
"""Height of robots, walls and obstacles, m."""
_LINK: Final = 0.02
_LETTERS: Final = 0.3
_PERIOD_S: Final = 1.0
"""Interval for which links are counted, s."""


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
    kind, points, radius = floor_object
    mark = MARKS[kind]
    name, colour, is_jammer = f"{kind} {number}", mark.colour or glyphs.GREY, mark.shape == "dashed ring"
    if floor_object.is_round:
        marker = disc(name, points[0], radius, _FLAT if is_jammer else _HIGH, colour)
    else:
        marker = lines(name, points, 2 * radius, colour)
    return marker._replace(opacity=0.3 if is_jammer else 1.0)


class LinkEntries:
    """Once per second, a line for each pair of robots that exchanged a frame in this second."""

    def __init__(self, description: RunDescription) -> None:
        self._positions: Floats = np.full((len(description.robots), 2), np.nan)
        """Last positions of the previous parts, m; NaN: unknown."""
        self._heard: Floats = np.zeros((0, 4))
        """`RunData.heard` of the current second."""

    def take(self, run: RunData) -> Iterator[LogEntry]:
        """Yield the entries of the next part."""
        heard = np.concatenate((self._heard, run.heard))
        periods = heard[:, 0] // _PERIOD_S
        for period in range(int(run.since / _PERIOD_S) + 1, int(run.end / _PERIOD_S) + 1):
            second = period * _PERIOD_S
            pairs = np.sort(heard[periods == period - 1, 1:3].astype(np.int64), axis=1)
            ends = self._positions_at(run, second)[np.unique(pairs, axis=0)]
            points = ends[~np.isnan(ends).any(axis=(1, 2))].reshape(-1, 2).tolist()
            links = [lines("links", points, _LINK, glyphs.LINK)] if points else []
            yield _marker_entry(second, "/acrc/links", links)
        self._positions = self._positions_at(run, run.end)
        self._heard = heard[periods >= int(run.end / _PERIOD_S)]

    def _positions_at(self, run: RunData, second: float) -> Floats:
        """Return the last positions until then, (robots, 2), m."""
        found = self._positions.copy()
        for position, track in zip(found, run.trajectories.values(), strict=True):
            if at := int(np.searchsorted(track.seconds, second, side="right")):
                position[:] = track.poses[at - 1, :2]
        return found


def _marker_entry(second: float, topic: str, markers: list[Marker]) -> LogEntry:
    instant = round(second * 1e6)
    return LogEntry(instant, topic, marker_array(markers, instant), instant)
