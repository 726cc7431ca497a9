"""A localisation driven along a course, as the robot's core would."""

import time
from collections.abc import Sequence

import numpy as np

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Odometry, Scan
from actors.robot.localisation import Localisation
from actors.robot.sweep import Sweeps
from benchmarks.localisation.course import Course
from benchmarks.localisation.metrics import Track


def replay(
    course: Course, localisation: Localisation, known: Sequence[tuple[Point, ...] | None] = ()
) -> Track:
    """Feed the whole course, a call per odometry pose; each with the newest scan made since the one before.

    `known`: per pose, the peers' positions to mask from then on, or None where they stay as they were.
    """
    sweeps = Sweeps(course.sensor)
    # the scan to go with each pose: the last one made by then
    newest = np.searchsorted(course.stamps, course.instants, side="right") - 1
    poses = course.odometry.tolist()
    track = np.empty((len(poses), 13))
    costs = np.empty(len(poses))
    taken = -1
    for step, here in enumerate(poses):
        if known and known[step] is not None:
            localisation.mask(known[step] or ())
        scan = None
        if newest[step] > taken:
            taken = int(newest[step])
            scan = Scan(int(course.stamps[taken]), course.scans[taken].astype("<u2").tobytes())
        odometry = Odometry(x=here[0], y=here[1], heading=here[2], vx=0.0, vy=0.0, omega=0.0)
        sweep = sweeps.take(Instant(int(course.instants[step])), odometry, scan)
        begun = time.process_time_ns()
        estimate = localisation.update(Pose(*here), sweep)
        costs[step] = (time.process_time_ns() - begun) / 1e9
        track[step] = *estimate.pose, *estimate.covariance, estimate.lost
    covariances = track[:, 3:12].reshape(-1, 3, 3)
    return Track(track[:, :3], covariances, track[:, 12], costs, localisation.outcome())
