"""The kernels of swerving against the same rules in plain numpy."""

import math

import numpy as np
import pytest
from numba import typeof
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.messages import NO_ECHO_MM, Drive
from actors.robot import detour, swerve
from actors.robot.driving import Driver, DrivingParameters
from actors.robot.planning import ground
from actors.robot.surroundings import Surroundings
from tests.robot.base import TWO_ROOMS, FakeBase, at_step, model

Array = NDArray[np.float64]
FRAME = np.array([-1.0, -2.0, 0.1])
BERTH, VIEW, BEYOND, TURN, WIDEST, SPARE, NEED = 0.3, 2.0, 0.6, 0.05, 1.6, 0.3, 0.2


def room(clearance: Array, x: Array, y: Array) -> Array:
    row = np.floor((y - FRAME[1]) / FRAME[2]).astype(int)
    column = np.floor((x - FRAME[0]) / FRAME[2]).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < clearance.shape[0]) & (column < clearance.shape[1])
    padded = np.pad(clearance, 1)
    return np.where(inside, padded[np.where(inside, row + 1, 0), np.where(inside, column + 1, 0)], 0.0)


def keeps_berth(points: Array, begin: Array, end: Array) -> bool:
    line, to = end - begin, points - begin
    ahead = to @ line > 0
    part = np.clip(to @ line / max(float(line @ line), 1e-12), 0, 1)
    return not (ahead & (np.hypot(*(to - part[:, None] * line).T) < BERTH)).any()


def in_sight(clearance: Array, begin: Array, end: Array, need: float) -> bool:
    samples = int(math.hypot(*(end - begin)) / (0.5 * FRAME[2])) + 1
    line = begin + np.arange(1, samples + 1)[:, None] / samples * (end - begin)
    return bool((room(clearance, line[:, 0], line[:, 1]) >= need).all())


def free_way(points: Array, way: Array, here: Array, to: Array) -> float:
    if not keeps_berth(points, here, to):
        return max(0.0, float(np.hypot(*(points - here).T).min()) - BERTH)
    for i in range(1, len(way)):
        apart = math.hypot(*(way[i] - here))
        if apart > VIEW:
            return math.inf
        if apart > math.hypot(*(to - here)) and not keeps_berth(points, way[i - 1], way[i]):
            return apart
    return math.inf


def plain(points: Array, way: Array, here: Array, to: Array, left: float, clearance: Array) -> list[float]:
    """`swerve` from the way's first point on, which is the nearest."""
    free = free_way(points, way, here, to)
    if free == math.inf:
        return [swerve.FREE, *to]
    need = min(NEED, float(room(clearance, here[:1], here[1:])[0]))
    far = way[1]
    for point in way[1:]:
        if math.hypot(*(point - here)) > VIEW:
            break
        if in_sight(clearance, here, point, need):
            far = point
    centre, length = math.atan2(far[1] - here[1], far[0] - here[0]), min(VIEW, free + BEYOND)
    beyond = np.append(np.nonzero(np.hypot(*(way[:-1] - here).T) >= length)[0], len(way) - 1)
    back = way[beyond[0] : beyond[0] + swerve.REJOIN : swerve.REJOIN // 4]
    best: tuple[float, float, Array] = (math.inf, swerve.SHUT, to)
    for side, cost in ((swerve.RIGHT, 0.0), (swerve.LEFT, left)):
        angles = centre + side * TURN * np.arange(int(WIDEST / TURN))
        ends = here + length * np.column_stack((np.cos(angles), np.sin(angles)))
        seen = [any(in_sight(clearance, end, point, need) for point in back) for end in ends]
        out = [keeps_berth(points, here, end) and in_sight(clearance, here, end, need) for end in ends]
        good = [a and b for a, b in zip(seen, out, strict=True)]
        if True in good:
            first = good.index(True)
            taken = first
            while taken + 1 < len(good) and good[taken + 1] and taken < first + min(first, int(SPARE / TURN)):
                taken += 1
            if first * TURN + cost < best[0]:
                best = (first * TURN + cost, side, ends[taken])
    return [best[1], *best[2]]


def test_the_kernel_follows_the_rule_and_every_outcome_occurs() -> None:
    sides = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        clearance = np.full((40, 60), 0.5)
        clearance[rng.integers(0, 40, 25), rng.integers(15, 60, 25)] = 0.0
        if seed % 3 == 0:  # a passage
            clearance[:16], clearance[25:] = 0.0, 0.0
        way = np.column_stack((np.linspace(0, 3, 61), np.cumsum(rng.normal(0, 0.01, 61))))
        here, to = way[0] + np.array([-0.01, 0.0]), way[9]
        points = rng.uniform((0.3, -0.6), (1.8, 0.6), (int(rng.integers(1, 6)), 2))
        left = float(rng.choice([0.1, 0.5, math.inf]))
        numbers = (BERTH, VIEW, BEYOND, TURN, WIDEST, SPARE, left)
        found = swerve.swerve(points, way, 0, *here, *to, *numbers, clearance, FRAME, NEED)
        assert list(found) == pytest.approx(plain(points, way, here, to, left, clearance), abs=1e-9)
        sides.append(found[0])
    assert all(sides.count(side) >= 10 for side in (swerve.FREE, swerve.RIGHT, swerve.LEFT, swerve.SHUT))


def test_strangers_are_what_the_map_does_not_show() -> None:
    rng = np.random.default_rng(3)
    angles = np.linspace(-3, 3, 50)
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    ranges = rng.integers(200, 2500, 50).astype(np.uint16)
    ranges[::7] = NO_ECHO_MM
    clearance = rng.uniform(0.0, 0.3, (40, 60))
    pose, moved, mount = Pose(1.0, 0.2, 0.7), Pose(0.05, -0.02, 0.1), Pose(-0.1, 0.02, 0.0)
    eye = pose.compose(moved).compose(mount)
    seen = (ranges != NO_ECHO_MM) & (ranges <= 1500)
    turned = angles[seen] + eye.heading
    points = np.array(eye.point) + ranges[seen, None] / 1000 * np.column_stack(
        (np.cos(turned), np.sin(turned))
    )
    expected = points[room(clearance, points[:, 0], points[:, 1]) >= 0.1]
    found = swerve.strangers(
        ranges, rays, np.array(mount[:2]), np.array(moved), *pose, clearance, FRAME, 0.1, 1.5
    )
    assert 5 < len(expected) < len(points)
    assert found == pytest.approx(expected, abs=1e-9)


def test_the_fingerprint_calls_the_kernel_with_the_types_that_a_driver_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kernel, types = swerve.swerve, []

    def spy(*arguments: object) -> object:
        types.append(tuple(typeof(argument) for argument in arguments))
        return kernel(*arguments)

    monkeypatch.setattr(swerve, "swerve", spy)
    monkeypatch.setattr(detour, "swerve", spy)
    swerve.fingerprint()
    base, seen = FakeBase(TWO_ROOMS, model(), Pose(1.5, 1.75, 0.0)), Surroundings(model().sensor)
    base.obstacles = [(Point(2.5, 1.75), 0.2)]
    driver = Driver(ground(TWO_ROOMS, 0.177), seen, 0.177, 0.1, DrivingParameters())
    driver.follow(np.column_stack((np.linspace(1.0, 4.0, 61), np.full(61, 1.75))))
    senses = base.senses(0)
    seen.take(at_step(0), senses.odometry, senses.scan)
    base.drive(Drive(0, *driver.steer(at_step(0), base.pose, base.velocity).twist, 0))
    assert len(types) == 2 and len(set(types)) == 1


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert swerve.fingerprint() == swerve.fingerprint()
