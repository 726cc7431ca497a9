"""What a scan says of a pose: which beams end at walls of the map, which fall short of them, which pass them.

Things that are not on the map make beams shorter and never longer, so however many others are around, from
the right pose next to no beam passes a wall; from a wrong one many do.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.kernels import njit
from actors.portable import arrays
from actors.portable.compiled import cos_sin
from actors.robot.localisation.likelihood_field import LevelGrid, LikelihoodField, specimen
from actors.robot.localisation.line_of_sight import AGREEING, BEYOND, SHORT, level_at, placed, sight

AGREES: Final = 0.3
"""A beam agrees with the map if its end is so near a wall, m; own choice."""
_PASSING: Final = 2.0
"""A beam that passes a wall takes as much away as two beams give that end at one; own choice."""


class Judgement(NamedTuple):
    """A scan seen from one pose."""

    known: NDArray[np.float64]
    """(k, 2), m, body's frame: the ends that are not strangers."""
    strangers: int
    """So many end in the open, in sight: at what is not on the map."""
    agreeing: int
    """So many end within AGREES of a wall."""
    beyond: int
    """So many end elsewhere, and have passed a wall."""


class PoseFit(NamedTuple):
    """How well each of n poses explains a scan."""

    score: NDArray[np.float64]
    """(n,), at most 1: the mean over the beams of 1 for an end at a wall, less with the distance, 0 for one
    that falls short, and minus 2 for one that passes a wall."""
    agreeing: NDArray[np.int64]
    beyond: NDArray[np.int64]
    """(n,): beams, as in Judgement."""


def judge(
    field: LikelihoodField,
    points: NDArray[np.float64],
    mount: NDArray[np.float64],
    pose: Pose,
    stranger_distance: float,
) -> Judgement:
    """The scan with these ends, (b, 2), m, body's frame, seen from `pose`; `mount`: (2,), where beams begin.

    Strangers are in sight, and farther than `stranger_distance`, m, from walls; inf: there are none.
    """
    known, strangers, agreeing, beyond = _judge(field.grid, points, mount, *pose, stranger_distance, AGREES)
    return Judgement(known, strangers, agreeing, beyond)


def worth(field: LikelihoodField, sigma: float) -> NDArray[np.float64]:
    """(256,): what a beam's end counts by the level of its cell; `sigma`, m: how exact the poses are."""
    return arrays.exp(-0.5 * np.square(field.distances / sigma))


def explain(
    field: LikelihoodField,
    points: NDArray[np.float64],
    mount: NDArray[np.float64],
    poses: NDArray[np.float64],
    worth: NDArray[np.float64],
) -> PoseFit:
    """The scan with these ends seen from each of `poses`, (3, n); at least one end. See `judge`."""
    return PoseFit(*_explain(field.grid, points, mount, poses, worth, AGREES))


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    field = specimen()
    angles, mount = np.arange(40.0), np.array([-0.1, 0.0])
    ends = 2.1 * np.column_stack((arrays.cos(angles), arrays.sin(angles)))
    judged = judge(field, ends, mount, Pose(1.0, 2.0, 0.5), 0.12)
    poses = np.linspace(-1.5, 3.0, 60, dtype=np.float64).reshape(3, 20)
    explained = explain(field, ends, mount, poses, worth(field, 0.1))
    return judged.known.tobytes() + bytes(judged[1:]) + b"".join(part.tobytes() for part in explained)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _judge(
    grid: LevelGrid,
    points: NDArray[np.float64],
    mount: NDArray[np.float64],
    x: float,
    y: float,
    heading: float,
    stranger_distance: float,
    agrees: float,
) -> tuple[NDArray[np.float64], int, int, int]:
    levels, frame, step = grid
    known = np.empty(points.shape)
    kept = strangers = agreeing = beyond = 0
    c, s = cos_sin(heading)
    eye_x, eye_y = placed(x, y, c, s, mount[0], mount[1])
    for i in range(points.shape[0]):
        end_x, end_y = placed(x, y, c, s, points[i, 0], points[i, 1])
        apart = step * level_at(levels, frame, end_x, end_y)
        seen = sight(levels, frame, step, min(agrees, stranger_distance), eye_x, eye_y, end_x, end_y)
        if apart <= agrees:
            agreeing += 1
        elif seen == BEYOND:
            beyond += 1
        if seen == SHORT and apart > stranger_distance:
            strangers += 1
        else:
            known[kept, 0], known[kept, 1] = points[i, 0], points[i, 1]
            kept += 1
    return known[:kept], strangers, agreeing, beyond


@njit(cache=True)  # type: ignore[untyped-decorator]
def _explain(
    grid: LevelGrid,
    points: NDArray[np.float64],
    mount: NDArray[np.float64],
    poses: NDArray[np.float64],
    worth: NDArray[np.float64],
    agrees: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    levels, frame, step = grid
    count, beams = poses.shape[1], points.shape[0]
    scores = np.empty(count)
    agreeing, beyond = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for i in range(count):
        x, y = poses[0, i], poses[1, i]
        c, s = cos_sin(poses[2, i])
        eye_x, eye_y = placed(x, y, c, s, mount[0], mount[1])
        total = 0.0
        for k in range(beams):
            end_x, end_y = placed(x, y, c, s, points[k, 0], points[k, 1])
            seen = sight(levels, frame, step, agrees, eye_x, eye_y, end_x, end_y)
            if seen == AGREEING:
                agreeing[i] += 1
                total += worth[level_at(levels, frame, end_x, end_y)]
            elif seen == BEYOND:
                beyond[i] += 1
                total -= _PASSING
        scores[i] = total / beams
    return scores, agreeing, beyond
