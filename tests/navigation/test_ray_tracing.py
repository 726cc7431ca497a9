"""What scans mark and clear, against ray by ray and cell by cell in plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.messages import NO_ECHO_MM
from actors.robot.cost_maps.ray_tracing import fingerprint, stamp, take_in

Marks = NDArray[np.uint8]
SIDE = 24
CELL_MM = 50
FAR_AWAY = np.array([-100.0, -100.0, 1.0])


class View:
    """A sensor with so many rays over a field of view, rad, and what the kernels need of it."""

    def __init__(self, rays: int, field: float, silent: float = 0.0, raytrace: float = 12.0) -> None:
        full = field == math.tau
        self.first = -math.pi if full else -field / 2
        self.increment = field / (rays if full else rays - 1)
        angles = self.first + self.increment * np.arange(rays)
        self.rays = np.column_stack((np.cos(angles), np.sin(angles)))
        self.fan = np.array([self.first, self.increment])
        self.limits = np.array([1 / CELL_MM, 10.0, raytrace, silent])


def through(x: float, y: float, dx: float, dy: float, row: int, column: int) -> tuple[float, float] | None:
    """Where the ray enters and leaves a cell, in small steps of algebra: clipping to four half planes."""
    enter, leave = 0.0, math.inf
    for at, along, low in ((x, dx, column), (y, dy, row)):
        if abs(along) < 1e-15:
            if not low <= at <= low + 1:
                return None
            continue
        ends = sorted(((low - at) / along, (low + 1 - at) / along))
        enter, leave = max(enter, ends[0]), min(leave, ends[1])
    return (enter, leave) if enter < leave else None


def passed(view: View, ranges: NDArray[np.uint16], eye: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(SIDE, SIDE): which cells some ray passes through."""
    cells = np.zeros((SIDE, SIDE), np.bool_)
    c, s = math.cos(eye[2]), math.sin(eye[2])
    for k in range(len(ranges)):
        silent = ranges[k] == NO_ECHO_MM
        begin = view.limits[3] if silent else 0.0
        end = view.limits[2] if silent else min(ranges[k] * view.limits[0], view.limits[2])
        dx, dy = c * view.rays[k, 0] - s * view.rays[k, 1], s * view.rays[k, 0] + c * view.rays[k, 1]
        for row in range(SIDE):
            for column in range(SIDE):
                hit = through(eye[0], eye[1], dx, dy, row, column)
                if hit and begin <= hit[0] and hit[1] <= end:
                    cells[row, column] = True
    return cells


def ends(view: View, ranges: NDArray[np.uint16], eye: NDArray[np.float64]) -> set[tuple[int, int]]:
    """The cells that echoes within the obstacle range come from."""
    angle = view.first + view.increment * np.arange(len(ranges)) + eye[2]
    apart = ranges / CELL_MM
    near = (ranges != NO_ECHO_MM) & (apart < view.limits[1])
    rows = np.floor(eye[1] + apart * np.sin(angle))[near].astype(int)
    columns = np.floor(eye[0] + apart * np.cos(angle))[near].astype(int)
    return {(r, c) for r, c in zip(rows, columns, strict=True) if 0 <= r < SIDE and 0 <= c < SIDE}


scans = arrays(np.uint16, 30, elements=st.one_of(st.just(NO_ECHO_MM), st.integers(20, 900)))
# anywhere but on the lines between cells and along them, where the two ways of rounding may differ
eyes = st.integers(0, 10**6).map(
    lambda seed: np.random.default_rng(seed).uniform((8, 8, -3.1), (16, 16, 3.1))
)


@settings(max_examples=40, deadline=None)
@given(
    ranges=scans, eye=eyes, field=st.sampled_from([math.tau, 1.0, 4.0]), silent=st.sampled_from([0.0, 6.0])
)
def test_a_cell_is_cleared_if_a_ray_passes_through_and_marked_if_one_ends_in_it(
    ranges: NDArray[np.uint16], eye: NDArray[np.float64], field: float, silent: float
) -> None:
    view = View(len(ranges), field, silent)
    marks = np.ones((SIDE, SIDE), np.uint8)
    take_in(marks, ranges, view.rays, view.fan, eye, FAR_AWAY, view.limits)
    expected = (~passed(view, ranges, eye)).astype(np.uint8)
    for cell in ends(view, ranges, eye):
        expected[cell] = 1
    assert np.array_equal(marks, expected)


@settings(max_examples=40, deadline=None)
@given(ranges=scans, eye=eyes, field=st.sampled_from([math.tau, 1.0]), silent=st.sampled_from([0.0, 6.0]))
def test_what_is_stamped_is_what_would_be_cleared(
    ranges: NDArray[np.uint16], eye: NDArray[np.float64], field: float, silent: float
) -> None:
    view = View(len(ranges), field, silent)
    stamps = np.zeros((SIDE, SIDE), np.int64)
    stamp(stamps, 5, ranges, view.rays, eye, FAR_AWAY, view.limits)
    assert set(np.unique(stamps)) <= {0, 5}
    assert np.array_equal(stamps == 5, passed(view, ranges, eye))


def test_rays_without_echo_can_be_told_not_to_clear() -> None:
    view = View(60, math.tau, silent=math.inf)
    marks = np.ones((SIDE, SIDE), np.uint8)
    silence = np.full(60, NO_ECHO_MM, np.uint16)
    take_in(marks, silence, view.rays, view.fan, np.array([12.2, 12.3, 0.1]), FAR_AWAY, view.limits)
    assert marks.all()


def test_an_echo_beyond_the_obstacle_range_marks_nothing_and_clears_up_to_the_raytrace_range() -> None:
    view = View(200, math.tau, raytrace=5.0)
    marks = np.ones((SIDE, SIDE), np.uint8)
    eye = np.array([12.5, 12.5, 0.0])
    take_in(marks, np.full(200, 550, np.uint16), view.rays, view.fan, eye, FAR_AWAY, view.limits)
    row, column = np.indices(marks.shape)
    apart = np.hypot(row - 12, column - 12)
    assert not marks[apart < 4].any() and marks[apart > 5.8].all()


@pytest.mark.parametrize("radius", [3.5, 0.9])
def test_the_body_clears_the_cells_that_lie_wholly_below_it(radius: float) -> None:
    view = View(4, math.tau, silent=math.inf)
    marks = np.ones((SIDE, SIDE), np.uint8)
    silence = np.full(4, NO_ECHO_MM, np.uint16)
    body = np.array([12.3, 11.8, radius])
    take_in(marks, silence, view.rays, view.fan, np.array([12.0, 12.0, 0.0]), body, view.limits)
    for row in range(SIDE):
        for column in range(SIDE):
            corners = [(x, y) for x in (column, column + 1) for y in (row, row + 1)]
            farthest = max(math.hypot(x - body[0], y - body[1]) for x, y in corners)
            if farthest > radius + 1e-9 and math.hypot(column + 0.5 - 12.3, row + 0.5 - 11.8) > radius - 0.7:
                assert marks[row, column]
            if math.hypot(column + 0.5 - 12.3, row + 0.5 - 11.8) <= radius - math.sqrt(0.5):
                assert not marks[row, column]


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
