"""Log entries of one robot: odometry, scans and poses of its recording, navigation state of its trace."""

from collections import Counter
from collections.abc import Iterator, Mapping
from heapq import merge
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.message_limits import senses_fault
from actors.messages import DRIVE, NO_ECHO_MM, SENSES, Scan, Senses
from actors.robot_model import RobotModel
from observation.evidence.recorded import taken
from observation.robot_logs import ros2_log
from observation.robot_logs.ros2_log import MAP, UNKNOWN_CELL, LogEntry, Transform
from observation.trace.rows import Trace
from observation.view.story import Source, Story, Track

_NEAR_S: Final = 1e-6
"""Two instants of one step differ by less, s."""
_FAR: Final = 10**15
"""µs; nobody lives to see more."""
_INSCRIBED: Final = 253
"""The cost of a cell that the robot's middle must not enter, as costmap_2d has it; 254 blocks, and of 255
nothing is known."""
_LETHAL: Final = 254


def true_entries(story: Story) -> Iterator[LogEntry]:
    """Where robots truly were, step by step; nothing where nobody knows."""
    if not story.true:
        return
    tracks = list(story.tracks.items())
    for step, second in enumerate(tracks[0][1].seconds.tolist()):
        poses = [(robot, Pose(*track.poses[step].tolist())) for robot, track in tracks]
        yield _frames(second * 1e6, [Transform(MAP, f"{robot}/truth", pose) for robot, pose in poses])
        for robot, pose in poses:
            yield _placed(second * 1e6, f"/{robot}/truth", pose)


def held_entries(robot: str, track: Track) -> Iterator[LogEntry]:
    """Where a robot held itself to be, as often as it said so."""
    for second, held in zip(track.seconds.tolist(), track.held.tolist(), strict=True):
        if held[0] == held[0]:
            yield _placed(second * 1e6, f"/{robot}/pose", Pose(*held))


def sensed_entries(
    path: Path, source: Source, track: Track, model: RobotModel, left_out: Counter[str]
) -> Iterator[LogEntry]:
    """What a robot's process sensed, and its frames. Raises RecordingError and WireError.

    `left_out` counts by topic what no sensor says.
    """
    robot, clock = source.robot, source.clock
    for _, senses in taken(path, SENSES):
        if senses.halt:
            continue
        if senses_fault(senses) is not None or abs(senses.instant) > _FAR:
            left_out[f"/{robot}/odom"] += 1
            continue
        told = [*senses.earlier_scans, *(() if senses.scan is None else (senses.scan,))]
        scans = [one for one in told if _is_of(one, model)]
        left_out[f"/{robot}/scan"] += len(told) - len(scans)
        instants = np.array([senses.instant, *(scan.stamp for scan in scans)], np.int64)
        second, *stamps = clock(instants).tolist()
        yield from _moved(robot, senses, second, _held(track, second))
        for scan, stamp in zip(scans, stamps, strict=True):
            at = round(stamp * 1e6)
            sweep = ros2_log.laser_scan(f"{robot}/laser", model.sensor, _ranges(scan), at)
            yield LogEntry(round(second * 1e6), f"/{robot}/scan", sweep, at)


def command_entries(path: Path, source: Source) -> Iterator[LogEntry]:
    """Yield the velocities that a robot commanded, at the instants of the senses that they answer."""
    for (_, senses), (_, drive) in zip(taken(path, SENSES), taken(path, DRIVE, "out"), strict=False):
        if abs(senses.instant) <= _FAR:
            at = round(source.clock(np.array([senses.instant])).item() * 1e6)
            velocity = ros2_log.twist(drive.vx, drive.vy, drive.omega)
            yield LogEntry(at, f"/{source.robot}/cmd_vel", velocity, at)


def _is_of(scan: Scan, model: RobotModel) -> bool:
    """True if a scan has a range for each ray of the sensor, and an instant."""
    return len(scan.ranges_mm) == 2 * model.sensor.rays and abs(scan.stamp) <= _FAR


def _moved(robot: str, senses: Senses, second: float, held: Pose | None) -> Iterator[LogEntry]:
    told = senses.odometry
    odometry, odom, base = Pose(told.x, told.y, told.heading), f"{robot}/odom", f"{robot}/base_link"
    frames = [Transform(odom, base, odometry)]
    if held is not None:
        frames.insert(0, Transform(MAP, odom, held.frame(odometry)))
    yield _frames(second * 1e6, frames)
    at, velocity = round(second * 1e6), ros2_log.twist(told.vx, told.vy, told.omega)
    yield LogEntry(at, f"/{robot}/odom", ros2_log.odometry(odom, base, odometry, velocity, at), at)


def _held(track: Track, second: float) -> Pose | None:
    """Where the robot held itself to be at an instant; None: it did not say."""
    at = int(np.searchsorted(track.seconds, second - _NEAR_S))
    if at == len(track.seconds) or track.seconds[at] > second + _NEAR_S or np.isnan(track.held[at, 0]):
        return None
    return Pose(*track.held[at].tolist())


def _ranges(scan: Scan) -> NDArray[np.float32]:
    """(rays,), m; inf: no echo (REP 117)."""
    told = np.frombuffer(scan.ranges_mm, "<u2")
    return np.where(told == NO_ECHO_MM, np.inf, told / 1000.0).astype(np.float32)


def traced_entries(source: Source, trace: Trace) -> Iterator[LogEntry]:
    """What a robot perceived and meant, by a part of its trace, in order of time."""
    return merge(
        _meant(source, trace), _clouds(source, trace), _costs(source, trace), _plans(source, trace),
        key=lambda one: one.logged,
    )  # fmt: skip


def _times(source: Source, instants: NDArray[np.int64]) -> list[int]:
    """Return µs of the run, in ascending order."""
    found: list[float] = (np.maximum.accumulate(source.clock(instants)) * 1e6).tolist()
    return [round(one) for one in found]


def _clouds(source: Source, trace: Trace) -> Iterator[LogEntry]:
    for time, points in zip(_times(source, trace.particles_at), trace.particles.rows(), strict=True):
        yield LogEntry(time, f"/{source.robot}/particles", ros2_log.point_cloud(points, time), time)


def _plans(source: Source, trace: Trace) -> Iterator[LogEntry]:
    for time, points in zip(_times(source, trace.plans_at), trace.plans.rows(), strict=True):
        yield LogEntry(time, f"/{source.robot}/plan", ros2_log.path(points, time), time)


def _costs(source: Source, trace: Trace) -> Iterator[LogEntry]:
    times = _times(source, trace.costs_at)
    for time, costs, corner in zip(times, trace.costs, trace.corners.tolist(), strict=True):
        grid = ros2_log.occupancy_grid(Pose(*corner), trace.cell, occupancy(costs), time)
        yield LogEntry(time, f"/{source.robot}/local_costmap", grid, time)


def _meant(source: Source, trace: Trace) -> Iterator[LogEntry]:
    """What it is about in words; and its goal, where that is another one."""
    before = None
    times = _times(source, np.array([one.instant for one in trace.doings], np.int64))
    for time, one in zip(times, trace.doings, strict=True):
        where = f" to {one.destination}" if one.destination else ""
        yield LogEntry(time, "/rosout", ros2_log.log_line(source.robot, one.activity + where, time), time)
        if one.point is not None and one.point != before:
            yield _placed(time, f"/{source.robot}/goal", Pose(*one.point, 0.0))
        before = one.point


def occupancy(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Costs as nav_msgs/OccupancyGrid has them: 100 blocks, 99 is within a radius of that, 1 to 98 is near.

    As costmap_2d_ros publishes them.
    """
    found = np.zeros(256, np.int8)
    found[1:_INSCRIBED] = 1 + 97 * (np.arange(1, _INSCRIBED) - 1) // (_INSCRIBED - 2)
    found[_INSCRIBED], found[_LETHAL], found[255] = 99, 100, UNKNOWN_CELL
    values: NDArray[np.int8] = found[costs]
    return values


def static_frames(models: Mapping[str, RobotModel]) -> LogEntry:
    """Where each robot's range sensor sits."""
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
