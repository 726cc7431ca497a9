"""Samples at any angles, as ranges of a model's rays."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.instant import Instant
from actors.messages import NO_ECHO_MM
from actors.robot_model import RangeSensor as SensorModel
from actors.robot_model import scan_angles
from firmware_bridge.range_sensors.sensor import Rays


def sensor(view_deg: float, rays: int, range_min: float = 0.0) -> SensorModel:
    return SensorModel.model_validate(
        {
            "field_of_view_deg": view_deg,
            "rays": rays,
            "range_min": range_min,
            "range_max": 5.0,
            "rate": 10.0,
        }
    )


CIRCLE = sensor(360.0, 8, range_min=0.1)
"""At -135, -90, -45, 0, 45, 90, 135 and 180 degrees."""
VIEW = sensor(90.0, 3)
"""At -45, 0 and 45 degrees."""
NONE = NO_ECHO_MM


def seen(model: SensorModel, samples: Sequence[tuple[float, float]], reach_deg: float = 1.0) -> list[int]:
    """The ranges that samples at (degrees, m) make."""
    angles, ranges = np.array(samples, np.float64).reshape(-1, 2).T
    scan = Rays(model, math.radians(reach_deg)).scan(Instant(5), np.radians(angles), ranges)
    assert scan.stamp == 5
    found: list[int] = np.frombuffer(scan.ranges_mm, "<u2").tolist()
    return found


@pytest.mark.parametrize(
    "model",
    [CIRCLE, VIEW, sensor(360.0, 7)],
)
def test_the_rays_are_those_of_the_model(model: SensorModel) -> None:
    turned: NDArray[np.float64] = Rays(model).angles - scan_angles(model)
    assert np.abs(np.sin(turned / 2)).max() < 1e-12
    one_each = [(math.degrees(angle), 1.0 + k) for k, angle in enumerate(Rays(model).angles.tolist())]
    wanted = [1000 * (1 + k) if 1 + k <= 5 else NONE for k in range(model.rays)]
    assert seen(model, one_each) == wanted
    shifted = [(degrees - 720.0, metres) for degrees, metres in one_each]
    assert seen(model, shifted) == wanted


def test_the_nearest_of_the_samples_of_a_ray_counts() -> None:
    assert seen(CIRCLE, [(-22, 2.0), (3, 1.5), (22, 3.0), (23, 1.0)]) == [
        NONE, NONE, NONE, 1500, 1000, NONE, NONE, NONE,
    ]  # fmt: skip


def test_what_lies_outside_the_view_is_not_seen() -> None:
    assert seen(VIEW, [(68, 1.0), (-68, 1.0), (180, 1.0)]) == [NONE, NONE, NONE]
    assert seen(VIEW, [(67, 1.0), (-67, 2.0)]) == [2000, NONE, 1000]


def test_a_ray_without_a_sample_of_its_own_takes_the_nearest_within_reach() -> None:
    samples = [(-23.0, 1.0), (23.5, 2.0)]
    assert seen(CIRCLE, samples, reach_deg=23.2)[3] == 1000
    assert seen(CIRCLE, samples, reach_deg=22.0)[3] == NONE
    assert seen(CIRCLE, [(157.0, 1.0)], reach_deg=23.5)[-1] == 1000  # over the back, too
    assert seen(CIRCLE, [(-157.0, 1.0)], reach_deg=23.5)[-1] == 1000


def test_no_echo_is_no_echo() -> None:
    samples = [(0, 0.0), (45, math.inf), (90, math.nan), (135, -1.0), (180, 5.001), (-135, 5.0)]
    assert seen(CIRCLE, samples) == [5000, NONE, NONE, NONE, NONE, NONE, NONE, NONE]
    assert seen(CIRCLE, []) == [NONE] * 8


def test_what_is_too_near_hides_what_is_behind_it() -> None:
    assert seen(CIRCLE, [(0, 0.099), (1, 2.0), (45, 0.1)])[3:5] == [NONE, 100]
    assert seen(CIRCLE, [(0, 1.2344), (45, 1.2346)])[3:5] == [1234, 1235]


def by_hand(model: SensorModel, samples: list[tuple[float, float]], reach: float) -> list[int]:
    """The same, ray by ray, in the plainest words."""
    found = []
    for ray in Rays(model).angles.tolist():
        aside = [(abs(math.remainder(angle - ray, math.tau)), metres) for angle, metres in samples]
        own = [metres for angle, metres in aside if angle < model.increment / 2]
        angle, nearest = min(aside)
        best = min(own) if own else nearest if angle <= reach else math.inf
        found.append(math.floor(1000 * best + 0.5) if model.range_min <= best <= model.range_max else NONE)
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "model", [sensor(360.0, 97), sensor(360.0, 8), sensor(120.0, 50, 0.3), sensor(58.0, 7)]
)
def test_any_samples_give_what_they_give_by_hand(model: SensorModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples = np.column_stack((rng.uniform(-7, 7, 60), rng.uniform(0.01, 6.0, 60)))
    scan = Rays(model, reach=0.05).scan(Instant(0), samples[:, 0], samples[:, 1])
    pairs = [(angle, metres) for angle, metres in samples.tolist()]
    assert np.frombuffer(scan.ranges_mm, "<u2").tolist() == by_hand(model, pairs, 0.05)
