"""Log entries of a run: map, poses, scans, commands, introspection and markers."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from heapq import merge
from itertools import groupby
from pathlib import Path
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
)
from acrc_testbed.run_model.data import RunData, Trajectory
from acrc_testbed.run_model.floor import FloorObject
from acrc_testbed.run_model.recording_readers import messages_on
from acrc_testbed.run_model.robot_introspection import PointSets, RecordedProcess, RobotInternals
from acrc_testbed.run_model.task_state import ItemState, ItemTable
from actors.array_types import Floats, Octets, Singles
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose
from actors.instant import LATEST
from actors.items import ItemKey
from actors.messages import NO_ECHO_MM, SENSES, Scan, SensorData
from actors.observer import glyphs
from actors.observer.glyphs import MARKS
from actors.robot_model import RobotModel

_NEAR_S: Final = 1e-6
"""Tolerance of instants of one step, s."""
_BEFORE_S: Final = 1.0
"""Maximum time of a robot's first scan before the start of the run, s."""
_INSCRIBED: Final = 253
"""Cost of cells within the inscribed radius, as in costmap_2d; 254 is lethal, 255 unknown."""
_LETHAL: Final = 254


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
            yield _pose_entry(at, f"/{robot}/truth", pose)


def estimate_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the pose estimates that a robot reported."""
    for second, estimate in zip(track.seconds.tolist(), track.estimated.tolist(), strict=True):
        if estimate[0] == estimate[0]:
            yield _pose_entry(round(second * 1e6), f"/{robot}/pose", Pose(*estimate))


def sensor_entries(
    path: Path, source: RecordedProcess, track: Trajectory, model: RobotModel, left_out: Counter[str]
) -> Iterator[LogEntry]:
    """Yield odometry, scans and frames of a robot's process. Raises RecordingError and WireError.

    `left_out` counts invalid messages by topic.
    """
    robot, clock = source.robot, source.clock
    for _, senses in messages_on(path, SENSES):
        if senses.halt:
            continue
        if abs(senses.instant) > LATEST:
            left_out[f"/{robot}/odom"] += 1
            continue
        received = [*senses.earlier_scans, *(() if senses.scan is None else (senses.scan,))]
        scans = [one for one in received if _is_valid_scan(one, model)]
        left_out[f"/{robot}/scan"] += len(received) - len(scans)
        instants = np.array([senses.instant, *(scan.stamp for scan in scans)], np.int64)
        second, *stamps = clock(instants).tolist()
        yield from _odometry_entries(robot, senses, second, _estimate_at(track, second))
        for scan, stamp in zip(scans, stamps, strict=True):
            if -_BEFORE_S < stamp < 0:
                continue
            at = round(stamp * 1e6)
            sweep = ros2_log.laser_scan(f"{robot}/laser", model.sensor, _ranges(scan), at)
            yield LogEntry(round(second * 1e6), f"/{robot}/scan", sweep, at)


def command_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the commanded velocities, at the instants of the senses that they answer."""
    for second, (vx, vy, omega) in zip(track.seconds.tolist(), track.commanded.tolist(), strict=True):
        if not np.isnan(vx) and abs(at := round(second * 1e6)) <= LATEST:
            yield LogEntry(at, f"/{robot}/cmd_vel", ros2_log.twist(vx, vy, omega), at)


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
    yield LogEntry(at, f"/{robot}/odom", ros2_log.odometry(odom, base, odometry, velocity, at), at)


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


def internal_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    """Yield a robot's introspection in order of time."""
    return merge(
        _activity_entries(robot),
        _point_entries(robot, "particles", robot.particles, ros2_log.point_cloud),
        _cost_map_entries(robot),
        _point_entries(robot, "plan", robot.plans, ros2_log.path),
        key=lambda one: one.logged,
    )


def _ascending_instants(seconds: Sequence[float] | Floats) -> list[int]:
    """Return instants of the run in µs, in ascending order."""
    found: list[float] = (np.maximum.accumulate(np.asarray(seconds, np.float64)) * 1e6).tolist()
    return [round(one) for one in found]


def _point_entries(
    robot: RobotInternals, name: str, sets: PointSets, message: Callable[[Points, int], Any]
) -> Iterator[LogEntry]:
    """Yield a message for each set of points."""
    for time, points in zip(_ascending_instants(sets.seconds), sets.sets(), strict=True):
        yield LogEntry(time, f"/{robot.process.robot}/{name}", message(points, time), time)


def _cost_map_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    topic, windows = f"/{robot.process.robot}/local_costmap", robot.windows
    times = _ascending_instants(windows.seconds)
    for time, costs, corner in zip(times, windows.costs, windows.corners.tolist(), strict=True):
        grid = ros2_log.occupancy_grid(Pose(*corner), windows.cell, occupancy(costs), time)
        yield LogEntry(time, topic, grid, time)


def _activity_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    """Yield the activities as log lines, and each new goal."""
    before, name = None, robot.process.robot
    times = _ascending_instants([one.second for one in robot.activities])
    for time, one in zip(times, robot.activities, strict=True):
        where = f" to {one.destination}" if one.destination else ""
        yield LogEntry(time, "/rosout", ros2_log.log_line(name, one.activity + where, time), time)
        if one.point is not None and one.point != before:
            yield _pose_entry(time, f"/{name}/goal", Pose(*one.point, 0.0))
        before = one.point


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


def _pose_entry(at: int, topic: str, pose: Pose) -> LogEntry:
    return LogEntry(at, topic, ros2_log.placed_pose(pose, at), at)


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


def item_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield all items of the task at each change of state: solid while open, then faint; grey if not done."""
    table, previous = ItemTable(), dict[ItemKey, tuple[float, float, str]]()
    for change in table.extend(run):
        current = {key: (one.x, one.y, one.state) for key, one in table.states.items()}
        if current != previous:
            previous = current
            yield _marker_entry(change.second, "/items", _item_markers(run, table.states))


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


def body_entries(run: RunData, models: Mapping[str, RobotModel]) -> Iterator[LogEntry]:
    """Yield the robots' discs at each change of state: faint while frozen, grey while off."""
    states = dict.fromkeys(models, "")
    changes = [
        (second, robot, state)
        for robot, track in run.trajectories.items()
        for second, state in track.states
        if robot in states
    ]
    yield _marker_entry(0.0, "/robots", _body_markers(run, models, states))
    for second, now in groupby(sorted(changes), key=lambda one: one[0]):
        before = dict(states)
        states |= {robot: state for _, robot, state in now}
        if states != before:
            yield _marker_entry(second, "/robots", _body_markers(run, models, states))


def _body_markers(run: RunData, models: Mapping[str, RobotModel], states: Mapping[str, str]) -> list[Marker]:
    markers = []
    for number, robot in enumerate(run.robots):
        if robot in models:
            frame = f"{robot}/{'truth' if run.description.has_truth else 'base_link'}"
            colour = glyphs.GREY if states[robot] == "off" else glyphs.robot(number)
            body = disc(robot, (0.0, 0.0), models[robot].footprint.circumradius, _HIGH, colour)
            markers.append(body._replace(opacity=0.4 if states[robot] else 0.9, frame=frame))
            name = label(f"{robot}/name", robot, _LETTERS, glyphs.WHITE)
            markers.append(name._replace(frame=frame))
    return markers


def obstacle_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield obstacles, walls, jammers and closed doors at each change."""
    for second, objects in run.floor:
        yield _marker_entry(second, "/things", [_obstacle_marker(*one) for one in enumerate(objects)])


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


def link_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield, once per second, a line for each pair of robots that exchanged a frame in this second."""
    tracks = list(run.trajectories.values())
    for period in range(1, int(run.end / _PERIOD_S) + 1):
        second = period * _PERIOD_S
        first, last = np.searchsorted(run.heard[:, 0], (second - _PERIOD_S, second))
        pairs = np.unique(np.sort(run.heard[first:last, 1:3].astype(np.int64), axis=1), axis=0)
        points: list[tuple[float, float]] = []
        for one, other in pairs.tolist():
            ends = [_last_position(tracks[index], second) for index in (one, other)]
            points += [end for end in ends if end is not None] if None not in ends else []
        links = [lines("links", tuple(points), _LINK, glyphs.LINK)] if points else []
        yield _marker_entry(second, "/links", links)


def _last_position(track: Trajectory, second: float) -> tuple[float, float] | None:
    """Return the last position of a robot until then, m; None: unknown."""
    at = int(np.searchsorted(track.seconds, second, side="right")) - 1
    if at < 0 or np.isnan(track.poses[at, 0]):
        return None
    x, y = track.poses[at, :2].tolist()
    return x, y


def _marker_entry(second: float, topic: str, markers: list[Marker]) -> LogEntry:
    instant = round(second * 1e6)
    return LogEntry(instant, topic, marker_array(markers, instant), instant)
