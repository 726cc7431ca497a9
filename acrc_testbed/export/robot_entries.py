"""Log entries of a run: map, poses, scans, commands, introspection and markers."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.export import ros2_log
from acrc_testbed.export.ros2_log import (
    MAP,
    UNKNOWN_CELL,
    LogEntry,
    Marker,
    Transform,
    disc,
    label,
    lines,
    marker_array,
    occupancy_grid,
)
from acrc_testbed.run_model.data import RunData, Trajectory
from acrc_testbed.run_model.floor import FloorObject
from acrc_testbed.run_model.place_reports import PlaceStatus, PlaceTable
from acrc_testbed.run_model.recording_readers import messages_on
from acrc_testbed.run_model.robot_introspection import RecordedProcess, RobotInternals
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose
from actors.instant import LATEST
from actors.messages import NO_ECHO_MM, SENSES, Scan, SensorData
from actors.observer import glyphs
from actors.observer.glyphs import MARKS
from actors.robot_model import RobotModel
from actors.task.task import PlaceKey

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
        yield _frames(second * 1e6, [Transform(MAP, f"{robot}/truth", pose) for robot, pose in poses])
        for robot, pose in poses:
            yield _placed(second * 1e6, f"/{robot}/truth", pose)


def held_entries(robot: str, track: Trajectory) -> Iterator[LogEntry]:
    """Yield the pose estimates that a robot reported."""
    for second, held in zip(track.seconds.tolist(), track.estimated.tolist(), strict=True):
        if held[0] == held[0]:
            yield _placed(second * 1e6, f"/{robot}/pose", Pose(*held))


def sensed_entries(
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
        told = [*senses.earlier_scans, *(() if senses.scan is None else (senses.scan,))]
        scans = [one for one in told if _is_of(one, model)]
        left_out[f"/{robot}/scan"] += len(told) - len(scans)
        instants = np.array([senses.instant, *(scan.stamp for scan in scans)], np.int64)
        second, *stamps = clock(instants).tolist()
        yield from _moved(robot, senses, second, _held(track, second))
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


def _is_of(scan: Scan, model: RobotModel) -> bool:
    """Return True if a scan has one range per ray of the sensor and a valid instant."""
    return len(scan.ranges_mm) == 2 * model.sensor.rays and abs(scan.stamp) <= LATEST


def _moved(robot: str, senses: SensorData, second: float, held: Pose | None) -> Iterator[LogEntry]:
    told = senses.odometry
    odometry, odom, base = Pose(told.x, told.y, told.heading), f"{robot}/odom", f"{robot}/base_link"
    frames = [Transform(odom, base, odometry)]
    if held is not None:
        frames.insert(0, Transform(MAP, odom, held.frame(odometry)))
    yield _frames(second * 1e6, frames)
    at, velocity = round(second * 1e6), ros2_log.twist(told.vx, told.vy, told.omega)
    yield LogEntry(at, f"/{robot}/odom", ros2_log.odometry(odom, base, odometry, velocity, at), at)


def _held(track: Trajectory, second: float) -> Pose | None:
    """Return the pose estimate at an instant; None: not reported."""
    at = int(np.searchsorted(track.seconds, second - _NEAR_S))
    if at == len(track.seconds) or track.seconds[at] > second + _NEAR_S or np.isnan(track.estimated[at, 0]):
        return None
    return Pose(*track.estimated[at].tolist())


def _ranges(scan: Scan) -> NDArray[np.float32]:
    """Return the ranges, (rays,), m; inf: no echo (REP 117)."""
    told = np.frombuffer(scan.ranges_mm, "<u2")
    return np.where(told == NO_ECHO_MM, np.inf, told / 1000.0).astype(np.float32)


def internal_entries(robot: RobotInternals) -> Iterator[LogEntry]:
    """Yield a robot's introspection in order of time."""
    return merge(_activities(robot), _clouds(robot), _costs(robot), _plans(robot), key=lambda one: one.logged)


def _times(seconds: Sequence[float] | NDArray[np.float64]) -> list[int]:
    """Return instants of the run in µs, in ascending order."""
    found: list[float] = (np.maximum.accumulate(np.asarray(seconds, np.float64)) * 1e6).tolist()
    return [round(one) for one in found]


def _clouds(robot: RobotInternals) -> Iterator[LogEntry]:
    topic, particles = f"/{robot.process.robot}/particles", robot.particles
    for time, points in zip(_times(particles.seconds), particles.sets(), strict=True):
        yield LogEntry(time, topic, ros2_log.point_cloud(points, time), time)


def _plans(robot: RobotInternals) -> Iterator[LogEntry]:
    topic, plans = f"/{robot.process.robot}/plan", robot.plans
    for time, points in zip(_times(plans.seconds), plans.sets(), strict=True):
        yield LogEntry(time, topic, ros2_log.path(points, time), time)


def _costs(robot: RobotInternals) -> Iterator[LogEntry]:
    topic, windows = f"/{robot.process.robot}/local_costmap", robot.windows
    times = _times(windows.seconds)
    for time, costs, corner in zip(times, windows.costs, windows.corners.tolist(), strict=True):
        grid = ros2_log.occupancy_grid(Pose(*corner), windows.cell, occupancy(costs), time)
        yield LogEntry(time, topic, grid, time)


def _activities(robot: RobotInternals) -> Iterator[LogEntry]:
    """Yield the activities as log lines, and each new goal."""
    before, name = None, robot.process.robot
    times = _times([one.second for one in robot.activities])
    for time, one in zip(times, robot.activities, strict=True):
        where = f" to {one.destination}" if one.destination else ""
        yield LogEntry(time, "/rosout", ros2_log.log_line(name, one.activity + where, time), time)
        if one.point is not None and one.point != before:
            yield _placed(time, f"/{name}/goal", Pose(*one.point, 0.0))
        before = one.point


def occupancy(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Convert costs to values of nav_msgs/OccupancyGrid, as costmap_2d_ros does.

    100: lethal; 99: within the inscribed radius; 1 to 98: inflated; -1: unknown.
    """
    found = np.zeros(256, np.int8)
    found[1:_INSCRIBED] = 1 + 97 * (np.arange(1, _INSCRIBED) - 1) // (_INSCRIBED - 2)
    found[_INSCRIBED], found[_LETHAL], found[255] = 99, 100, UNKNOWN_CELL
    values: NDArray[np.int8] = found[costs]
    return values


def static_frames(models: Mapping[str, RobotModel]) -> LogEntry:
    """Return the mounting poses of the range sensors."""
    frames = [
        Transform(f"{robot}/base_link", f"{robot}/laser", model.sensor.mount)
        for robot, model in models.items()
    ]
    return LogEntry(0, "/tf_static", ros2_log.transforms(frames, 0), 0)


def _frames(microseconds: float, frames: list[Transform]) -> LogEntry:
    at = round(microseconds)
    return LogEntry(at, "/tf", ros2_log.transforms(frames, at), at)


def _placed(microseconds: float, topic: str, pose: Pose) -> LogEntry:
    at = round(microseconds)
    return LogEntry(at, topic, ros2_log.placed_pose(MAP, pose, at), at)


_PLACE_RADIUS: Final = 0.15
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


def place_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield all places at each change: solid, faint once cleaned, grey once given up.

    A place that was added during the run is included from the first report about it.
    """
    states: dict[PlaceKey, PlaceStatus] = {}
    shown: dict[PlaceKey, tuple[bool, bool]] | None = None
    for second, changes in groupby(PlaceTable().extend(run), key=lambda one: one.second):
        for change in changes:
            states |= change.states
        now = {key: (one.done, one.given_up) for key, one in states.items()}
        if now != shown:
            shown = now
            yield _scene(second, "/places", _places(run, states))


def _places(run: RunData, states: Mapping[PlaceKey, PlaceStatus]) -> list[Marker]:
    markers = []
    for key, state in states.items():
        is_lost = state.given_up and not state.done
        colour = glyphs.GREY if is_lost else glyphs.robot(run.robots.index(key.owner))
        marker = disc(f"{key.owner}/{key.place}", (state.x, state.y), _PLACE_RADIUS, _FLAT, colour)
        markers.append(marker._replace(opacity=0.25) if state.done or state.given_up else marker)
    return markers


def body_entries(run: RunData, models: Mapping[str, RobotModel]) -> Iterator[LogEntry]:
    """Yield the robots' discs at each change of state: faint while frozen, grey while off."""
    acts: dict[str, str] = dict.fromkeys(models, "")
    said = [
        (second, robot, act)
        for robot, track in run.trajectories.items()
        for second, act in track.states
        if robot in acts
    ]
    yield _scene(0.0, "/robots", _bodies(run, models, acts))
    for second, now in groupby(sorted(said), key=lambda one: one[0]):
        before = dict(acts)
        acts |= {robot: act for _, robot, act in now}
        if acts != before:
            yield _scene(second, "/robots", _bodies(run, models, acts))


def _bodies(run: RunData, models: Mapping[str, RobotModel], acts: Mapping[str, str]) -> list[Marker]:
    markers = []
    for number, robot in enumerate(run.robots):
        if robot in models:
            frame = f"{robot}/{'truth' if run.description.has_truth else 'base_link'}"
            colour = glyphs.GREY if acts[robot] == "off" else glyphs.robot(number)
            body = disc(robot, (0.0, 0.0), models[robot].footprint.circumradius, _HIGH, colour)
            markers.append(body._replace(opacity=0.4 if acts[robot] else 0.9, frame=frame))
            name = label(f"{robot}/name", robot, _LETTERS, glyphs.WHITE)
            markers.append(name._replace(frame=frame))
    return markers


def thing_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield obstacles, walls, jammers and closed doors at each change."""
    for second, things in run.floor:
        yield _scene(second, "/things", [_thing(number, thing) for number, thing in enumerate(things)])


def _thing(number: int, thing: FloorObject) -> Marker:
    mark = MARKS[thing.kind]
    jams = mark.shape == "dashed ring"
    name, colour = f"{thing.kind} {number}", mark.colour or glyphs.GREY
    marker = lines(name, thing.points, 2 * thing.radius, colour)
    if thing.is_round:
        marker = disc(name, thing.points[0], thing.radius, _FLAT if jams else _HIGH, colour)
    return marker._replace(opacity=0.3 if jams else 1.0)


def link_entries(run: RunData) -> Iterator[LogEntry]:
    """Yield, once per second, a line for each pair of robots that exchanged a frame in this second."""
    tracks = list(run.trajectories.values())
    for period in range(1, int(run.end / _PERIOD_S) + 1):
        second = period * _PERIOD_S
        first, last = np.searchsorted(run.heard[:, 0], (second - _PERIOD_S, second))
        pairs = np.unique(np.sort(run.heard[first:last, 1:3].astype(np.int64), axis=1), axis=0)
        points: list[tuple[float, float]] = []
        for one, other in pairs.tolist():
            ends = [_where(tracks[index], second) for index in (one, other)]
            points += [end for end in ends if end is not None] if None not in ends else []
        links = [lines("links", tuple(points), _LINK, glyphs.LINK)] if points else []
        yield _scene(second, "/links", links)


def _where(track: Trajectory, second: float) -> tuple[float, float] | None:
    """Return the last position of a robot until then, m; None: unknown."""
    at = int(np.searchsorted(track.seconds, second, side="right")) - 1
    if at < 0 or np.isnan(track.poses[at, 0]):
        return None
    x, y = track.poses[at, :2].tolist()
    return x, y


def _scene(second: float, topic: str, markers: list[Marker]) -> LogEntry:
    instant = round(second * 1e6)
    return LogEntry(instant, topic, marker_array(markers, instant), instant)
