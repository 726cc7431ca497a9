import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.world.clearance import Shape, disc, gap, placed, wall_gap
from tests.world.scenery import OMNIBOX, TURTLEBOT, room

poses = st.builds(Pose, st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-3, 3))
BOX = Shape(np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), 0.0)


def shifted(shape: Shape, by: complex) -> Shape:
    return Shape(shape.vertices + np.array([by.real, by.imag]), shape.radius)


def line(x0: float, y0: float, x1: float, y1: float) -> Shape:
    return Shape(np.array([[x0, y0], [x1, y1]]), 0.0)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (disc(0, 0, 1), disc(3, 4, 2), 2.0),
        (disc(0, 0, 1), disc(0.5, 0, 1), -1.5),
        (disc(0, 0, 0.5), line(1, -1, 1, 1), 0.5),
        (disc(0, 0, 0.5), line(0.4, -1, 0.4, 1), -0.1),
        (disc(0, 0, 0.5), line(3, 4, 9, 4), 4.5),  # nearest at its end
        (disc(2, 0, 0.5), BOX, 0.5),
        (disc(2, 2, 0.5), BOX, math.sqrt(2) - 0.5),
        (disc(0.7, 0, 0.5), BOX, -0.8),  # its centre is inside: 0.3 to the edge, and its radius
        (line(2, -3, 2, 3), BOX, 1.0),
        (line(0.8, -3, 0.8, 3), BOX, -0.2),
        (shifted(BOX, 1.9 + 0.5j), BOX, -0.1),
        (shifted(BOX, 3 + 3j), BOX, math.sqrt(2)),
    ],
)
def test_known_gaps(a: Shape, b: Shape, expected: float) -> None:
    assert gap(a, b) == pytest.approx(expected, abs=1e-12)
    assert gap(b, a) == pytest.approx(expected, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(poses, poses)
def test_moving_apart_by_the_overlap_is_enough_and_by_less_is_not(one: Pose, other: Pose) -> None:
    a, b = placed(OMNIBOX.footprint, one), placed(OMNIBOX.footprint, other)
    depth = -gap(a, b)
    if depth <= 1e-3:
        return
    ways = np.exp(1j * np.linspace(0, math.tau, 360, endpoint=False))
    gaps_by = {share: [gap(shifted(a, way * depth * share), b) for way in ways] for share in (0.98, 1.001)}
    assert max(gaps_by[0.98]) < 0
    assert max(gaps_by[1.001]) > -depth * 0.02


@given(poses)
def test_the_gap_of_apart_shapes_is_that_of_their_nearest_border_points(pose: Pose) -> None:
    a = placed(OMNIBOX.footprint, pose)
    b = placed(TURTLEBOT.footprint, Pose(0, 0, 0))
    if gap(a, b) > 0:
        assert gap(a, b) == pytest.approx(np.hypot(*border(a).T).min() - 0.177, abs=2e-3)


def border(shape: Shape) -> NDArray[np.float64]:
    steps = np.linspace(0, 1, 300)[:, None]
    ends = np.roll(shape.vertices, -1, axis=0)
    return np.concatenate([a + steps * (b - a) for a, b in zip(shape.vertices, ends, strict=True)])


def test_only_walls_that_can_overlap_count() -> None:
    assert wall_gap(disc(4.9, 0, 0.2), room()) == pytest.approx(-0.1)
    assert wall_gap(placed(OMNIBOX.footprint, Pose(4.8, 4.8, 0)), room()) == pytest.approx(-0.05)
    assert wall_gap(disc(4.5, 0, 0.2), room()) == math.inf
