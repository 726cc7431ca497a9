"""The motion model: how a step is split, how uncertain its parts are, and what particles make of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.robot.localisation import PRESETS, motion
from actors.robot.localisation.motion import OdometryStep, StepSpread, move, spread, step

CHAPTER = PRESETS["chapter"]
CORRECTED = replace(CHAPTER, odometry_model="diff-corrected")
angles = st.floats(-math.pi, math.pi, exclude_min=True)
poses = st.builds(Pose, st.floats(-20, 20), st.floats(-20, 20), angles)


def moved(
    poses: NDArray[np.float64], made: OdometryStep, noise: StepSpread, normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The twin of the kernel: table 5.6, lines 5 to 10, with noise added."""
    turn, way, last = (part + sigma * n for part, sigma, n in zip(made, noise, normals, strict=True))
    x = poses[0] + way * np.cos(poses[2] + turn)
    y = poses[1] + way * np.sin(poses[2] + turn)
    heading = poses[2] + turn + last
    return np.stack((x, y, np.arctan2(np.sin(heading), np.cos(heading))))


@settings(deadline=None)  # the first example compiles
@given(before=poses, after=poses)
def test_without_noise_a_particle_at_the_odometry_s_pose_follows_it(before: Pose, after: Pose) -> None:
    particle = np.array(before).reshape(3, 1)
    move(particle, 1, step(before, after), StepSpread(0.0, 0.0, 0.0), np.ones((3, 1)))
    near = before.point.distance_to(after.point) < 0.01  # then it goes straight ahead
    assert particle[:2, 0] == pytest.approx(after[:2], abs=0.02 if near else 1e-9)
    assert math.cos(particle[2, 0] - after.heading) == pytest.approx(1.0)
    assert -math.pi <= particle[2, 0] <= math.pi


@pytest.mark.parametrize(
    ("to", "made"),
    [
        (Pose(0.3, 0.0, 0.0), OdometryStep(0.0, 0.3, 0.0)),
        (Pose(-0.3, 0.0, 0.0), OdometryStep(math.pi, 0.3, math.pi)),
        (Pose(0.2, 0.2, math.pi / 2), OdometryStep(math.pi / 4, math.sqrt(0.08), math.pi / 4)),
        (Pose(0.0, 0.009, 0.3), OdometryStep(0.0, 0.009, 0.3)),
    ],
    ids=["ahead", "backward", "an arc", "on the spot: the way's direction says nothing"],
)
def test_how_a_step_is_split(to: Pose, made: OdometryStep) -> None:
    here = Pose(3.0, -2.0, 0.7)
    split = step(here, here.compose(to))
    assert split.way == pytest.approx(made.way)
    for part, expected in ((split.turn, made.turn), (split.last_turn, made.last_turn)):
        assert math.cos(part - expected) == pytest.approx(1.0)


def test_ros_1_takes_the_variance_for_the_deviation() -> None:
    ahead = OdometryStep(0.0, 0.25, 0.0)
    assert spread(ahead, CHAPTER) == pytest.approx((0.0125, 0.0125, 0.0125))
    assert spread(ahead, CORRECTED) == pytest.approx((math.sqrt(0.0125),) * 3)  # 0.11 rad


@given(turn=angles, way=st.floats(0, 2), last=angles)
def test_deviations_are_those_of_the_book_and_alike_backward(turn: float, way: float, last: float) -> None:
    parameters = replace(CORRECTED, alpha1=0.1, alpha2=0.2, alpha3=0.3, alpha4=0.4)
    first, second = (min(abs(a), math.pi - abs(a)) for a in (turn, last))
    expected = (
        math.sqrt(0.1 * first**2 + 0.2 * way**2),
        math.sqrt(0.3 * way**2 + 0.4 * first**2 + 0.4 * second**2),
        math.sqrt(0.1 * second**2 + 0.2 * way**2),
    )
    assert spread(OdometryStep(turn, way, last), parameters) == pytest.approx(expected, abs=1e-7)
    back = spread(OdometryStep(turn - math.copysign(math.pi, turn), way, last), parameters)
    assert back == pytest.approx(expected, abs=1e-7)


def test_kernel_is_its_twin() -> None:
    rng = np.random.default_rng(0)
    before = rng.uniform(-3, 3, (3, 200))
    normals = rng.standard_normal((3, 200))
    made, noise = OdometryStep(2.8, 0.4, 1.9), StepSpread(0.3, 0.1, 0.4)
    after = before.copy()
    move(after, 150, made, noise, normals)
    twin = moved(before, made, noise, normals)
    assert after[:, :150] == pytest.approx(twin[:, :150])
    assert np.array_equal(after[:, 150:], before[:, 150:])


def test_the_cloud_has_the_deviations_asked_for() -> None:
    """20 000 samples: the standard error of a standard deviation is 0.5 %, and 3 % are six of it."""
    made = step(Pose(0.0, 0.0, 0.0), Pose(0.5, 0.0, 0.2))
    noise = spread(made, replace(CORRECTED, alpha1=0.02, alpha2=0.02, alpha3=0.02, alpha4=0.02))
    cloud = np.zeros((3, 20_000))
    move(cloud, 20_000, made, noise, np.random.default_rng(3).standard_normal((3, 20_000)))
    turned = math.hypot(noise.turn, noise.last_turn)
    assert cloud[2].mean() == pytest.approx(0.2, abs=0.01)
    assert cloud[2].std() == pytest.approx(turned, rel=0.03)
    assert np.hypot(cloud[0], cloud[1]).std() == pytest.approx(noise.way, rel=0.03)
    assert np.arctan2(cloud[1], cloud[0]).std() == pytest.approx(noise.turn, rel=0.03)


def test_fingerprint_is_the_same_each_time() -> None:
    assert motion.fingerprint() == motion.fingerprint()
