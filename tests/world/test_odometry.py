import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Pose, Twist, wrap
from actors.messages import Odometry
from actors.runtime.errors import AcrcError
from actors.world import odometry_kernel
from actors.world.odometry import KobukiErrors, Odometers, StageErrors
from actors.world.physics import SUBSTEP, Arena
from tests.world.scenery import OMNIBOX, TURTLEBOT, arena

STARTS = (Pose(-2, 1, 2.0), Pose(3, -1, -1.0), Pose(0, 3, 0.3))
NOT_NOISY = KobukiErrors(gyro_noise_deg=0, gyro_bias_deg=0, gyro_walk_deg=0, wheel_scale=0, slip=0)


def odometers(world: Arena, kind: str, seed: int = 1, kobuki: KobukiErrors = NOT_NOISY) -> Odometers:
    n = len(world)
    generators = [np.random.default_rng([seed, k]) for k in range(n)]
    return Odometers([kind] * n, [TURTLEBOT] * n, world.poses, generators, SUBSTEP, StageErrors(), kobuki)


def tour(world: Arena, odometry: Odometers, substeps: int = 10, moves: int = 12) -> list[Odometry]:
    """Drive everybody about for half a second per move; odometry follows every so many sub-steps."""
    rng = np.random.default_rng(9)
    for _ in range(moves):
        for index in range(len(world)):
            world.command(index, Twist(rng.uniform(0, 0.5), 0, rng.uniform(-1.5, 1.5)), world.now)
        for _ in range(50 // substeps):
            odometry.follow(world.advance(substeps), world.velocities)
    return [odometry.read(index) for index in range(len(world))]


def truth(world: Arena, index: int) -> Pose:
    """Where a robot truly is as seen from its start."""
    return STARTS[index].relative(Pose(*world.poses[index].tolist()))


def test_exact_odometry_is_the_true_pose_from_the_first_one_and_the_true_velocity() -> None:
    world = arena(*STARTS)
    for index, said in enumerate(tour(world, odometers(world, "exact"))):
        assert (said.x, said.y, said.heading) == pytest.approx(truth(world, index), abs=1e-12)
        assert math.hypot(said.vx, said.vy) == pytest.approx(np.hypot(*world.velocities[index, :2]))
        assert said.vy == pytest.approx(0, abs=1e-9) and said.omega == world.velocities[index, 2]


@pytest.mark.parametrize(("kind", "notices"), [("exact", True), ("stage", False), ("kobuki", False)])
def test_only_exact_odometry_notices_that_the_robot_was_carried(kind: str, notices: bool) -> None:
    world = arena(*STARTS)
    odometry = odometers(world, kind)
    before = tour(world, odometry)[0]
    world.move(0, Pose(4, 4, 1.0))
    odometry.carry(0, Pose(4, 4, 1.0))
    odometry.follow(world.advance(), world.velocities)
    after = odometry.read(0)
    assert (math.hypot(after.x - before.x, after.y - before.y) > 1) == notices
    if notices:
        assert (after.x, after.y, after.heading) == pytest.approx(truth(world, 0), abs=1e-12)


@pytest.mark.parametrize("kind", ["exact", "stage", "kobuki"])
def test_odometry_does_not_depend_on_the_step(kind: str) -> None:
    said = []
    for substeps in (1, 5, 25):
        world = arena(*STARTS)
        said.append(tour(world, odometers(world, kind, kobuki=KobukiErrors()), substeps))
    assert said[0] == said[1] == said[2]


@pytest.mark.parametrize("kind", ["stage", "kobuki"])
def test_another_robot_changes_nobodys_errors(kind: str) -> None:
    few, many = arena(*STARTS[:2]), arena(*STARTS)
    alone = tour(few, odometers(few, kind, kobuki=KobukiErrors()), moves=1)
    rng = np.random.default_rng(9)
    odometry = odometers(many, kind, kobuki=KobukiErrors())
    for index in range(2):
        many.command(index, Twist(rng.uniform(0, 0.5), 0, rng.uniform(-1.5, 1.5)), many.now)
    odometry.follow(many.advance(50), many.velocities)
    assert [odometry.read(index) for index in range(2)] == alone


def straight(length: float, turn: float, substeps: int) -> NDArray[np.float64]:
    """A track of one robot from (0, 0, 0): straight ahead, then a turn on the spot."""
    ahead = np.linspace(0, length, substeps + 1)[1:]
    turning = np.linspace(0, turn, substeps + 1)[1:]
    track = np.zeros((2 * substeps, 1, 3))
    track[:substeps, 0, 0], track[substeps:, 0, 0] = ahead, length
    track[substeps:, 0, 2] = turning
    return track


def after_straight(
    kind: str, seed: int, kobuki: KobukiErrors, length: float = 2.0, turn: float = 1.0
) -> Odometry:
    generators = [np.random.default_rng(seed)]
    odometry = Odometers([kind], [TURTLEBOT], np.zeros((1, 3)), generators, SUBSTEP, StageErrors(), kobuki)
    odometry.follow(straight(length, turn, 400), np.zeros((1, 3)))
    return odometry.read(0)


def test_the_errors_of_stage_are_constant_factors_spread_evenly() -> None:
    said = [after_straight("stage", seed, NOT_NOISY) for seed in range(400)]
    forward, turn = np.array([s.x / 2 - 1 for s in said]), np.array([s.heading - 1 for s in said])
    for errors, width in ((forward, 0.03), (turn, 0.02)):
        assert np.abs(errors).max() <= width / 2
        assert errors.std() == pytest.approx(width / math.sqrt(12), rel=0.08)
        assert abs(errors.mean()) < 3 * width / math.sqrt(12 * 400)
    twice = after_straight("stage", 7, NOT_NOISY, length=4.0)
    assert twice.x == pytest.approx(2 * said[7].x)


def test_a_kobuki_without_noise_is_right_to_a_tick_and_a_hundredth_of_a_degree() -> None:
    world = arena(*STARTS)
    for index, said in enumerate(tour(world, odometers(world, "kobuki"))):
        x, y, heading = truth(world, index)
        assert math.hypot(said.x - x, said.y - y) < 0.004  # the physics' arcs are polygons of 10 ms
        assert abs(wrap(said.heading - heading)) <= math.radians(0.0051)


def test_a_kobuki_counts_whole_ticks() -> None:
    said = after_straight("kobuki", 0, NOT_NOISY, length=0.5, turn=0.0)
    assert said.x / 85.292e-6 == pytest.approx(math.floor(0.5 / 85.292e-6), abs=1e-6)


@pytest.mark.parametrize(
    ("only", "spread_x", "spread_heading"),
    [
        ({"slip": 0.01}, 0.01 * math.sqrt(2.0 / 2), 0.0),
        ({"wheel_scale": 0.01}, 0.01 * 2.0 / math.sqrt(2), 0.0),
        ({"gyro_noise_deg": 0.5}, None, math.radians(0.5) * math.sqrt(8.0)),
        ({"gyro_bias_deg": 0.2}, None, math.radians(0.2) * 8.0),
        ({"gyro_walk_deg": 0.1}, None, math.radians(0.1) * math.sqrt(8.0**3 / 3)),
    ],
)
def test_each_error_of_a_kobuki_spreads_as_its_formula_says(
    only: dict[str, float], spread_x: float | None, spread_heading: float
) -> None:
    said = [after_straight("kobuki", seed, replace(NOT_NOISY, **only)) for seed in range(400)]  # type: ignore[arg-type]
    if spread_x is not None:
        assert np.std([s.x for s in said]) == pytest.approx(spread_x, rel=0.12)
    assert np.std([s.heading for s in said]) == pytest.approx(spread_heading, rel=0.12, abs=1e-9)


def test_a_kobuki_feels_no_push_to_its_side_and_tells_the_speed_of_its_wheels() -> None:
    odometry = Odometers(
        ["kobuki"], [TURTLEBOT], np.zeros((1, 3)), [np.random.default_rng(0)], SUBSTEP, kobuki=NOT_NOISY
    )
    track = np.zeros((10, 1, 3))
    track[:, 0, 0], track[:, 0, 1] = np.arange(1, 11) * 0.004, np.arange(1, 11) * 0.003
    odometry.follow(track, np.array([[0.4, 0.3, 0.0]]))
    said = odometry.read(0)
    assert said.y == said.vy == said.omega == 0 and said.x == pytest.approx(0.04, abs=1e-4)
    assert said.vx == pytest.approx(0.4, abs=85.292e-6 / 0.02)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.1, 0.1)),
        min_size=1,
        max_size=30,
    ),
    st.tuples(*[st.floats(0.9, 1.1)] * 3),
)
def test_adding_up_scaled_motion_beside_plain_python(
    motions: list[tuple[float, float, float]], factors: tuple[float, float, float]
) -> None:
    pose, expected = Pose(1, 2, 3), Pose(0, 0, 0)
    track = []
    for forward, leftward, turn in motions:
        pose = pose.compose(Pose(forward, leftward, turn))
        track.append([pose])
        expected = expected.compose(Pose(forward * factors[0], leftward * factors[1], turn * factors[2]))
    got = np.zeros((1, 3))
    odometry_kernel.add_scaled(
        np.array(track), np.array([0]), np.array([[1.0, 2.0, 3.0]]), np.array([factors]), got
    )
    assert (*got[0, :2], wrap(got[0, 2])) == pytest.approx(expected, abs=1e-9)


class PlainKobuki:
    """A base that measures, in plain Python."""

    def __init__(self, left: float, right: float, bias: float) -> None:
        self.scales, self.bias = (left, right), bias
        self.travel, self.ticks = [0.0, 0.0], [0, 0]
        self.angle, self.substeps = 0.0, 0
        self.estimate, self.velocity = Pose(0, 0, 0), Twist(0, 0, 0)

    def move(self, motion: Pose, normals: NDArray[np.float64], errors: KobukiErrors) -> None:
        wheels = [motion.x - motion.heading * errors.track / 2, motion.x + motion.heading * errors.track / 2]
        for k in range(2):
            slipped = normals[k] * errors.slip * math.sqrt(abs(wheels[k]))
            self.travel[k] += wheels[k] * self.scales[k] + slipped
        self.angle += (
            motion.heading + self.bias * 0.01 + normals[2] * math.radians(errors.gyro_noise_deg) * 0.1
        )
        self.bias += normals[3] * math.radians(errors.gyro_walk_deg) * 0.1
        self.substeps += 1
        if self.substeps % 2 == 0:
            self.feed_back(errors.tick_um * 1e-6, math.radians(errors.gyro_resolution_deg))

    def feed_back(self, tick: float, resolution: float) -> None:
        ticks = [math.floor(travel / tick) for travel in self.travel]
        forward = (sum(ticks) - sum(self.ticks)) * tick / 2
        self.ticks = ticks
        heading = math.floor(self.angle / resolution + 0.5) * resolution
        turn = heading - self.estimate.heading
        middle = self.estimate.heading + turn / 2
        self.estimate = Pose(
            self.estimate.x + forward * math.cos(middle),
            self.estimate.y + forward * math.sin(middle),
            heading,
        )
        self.velocity = Twist(forward / 0.02, 0.0, turn / 0.02)


def test_measuring_motion_beside_plain_python() -> None:
    errors, rng = KobukiErrors(), np.random.default_rng(3)
    pose, plain, track, normals = (
        Pose(1, 2, 3),
        PlainKobuki(1.003, 0.998, 1e-3),
        [],
        rng.standard_normal((301, 4)),
    )
    for k in range(301):
        motion = Pose(*rng.uniform((-0.002, -0.001, -0.05), (0.005, 0.001, 0.05)).tolist())
        pose = pose.compose(motion)
        track.append([pose])
        plain.move(motion, normals[k], errors)
    bases, got, velocities = np.zeros(1, odometry_kernel.BASE), np.zeros((1, 3)), np.zeros((1, 3))
    bases["left_scale"], bases["right_scale"], bases["bias"] = 1.003, 0.998, 1e-3
    degrees = (errors.gyro_noise_deg, errors.gyro_walk_deg, errors.gyro_resolution_deg)
    model = (errors.track, errors.tick_um * 1e-6, errors.slip, *map(math.radians, degrees), 2)
    last = np.array([[1.0, 2.0, 3.0]])
    odometry_kernel.add_measured(
        np.array(track), np.array([0]), last, normals[None], 0.01, model, bases, got, velocities
    )
    assert got[0] == pytest.approx(plain.estimate, abs=1e-9)
    assert velocities[0] == pytest.approx(plain.velocity, abs=1e-9)
    assert bases["left_ticks"][0] == plain.ticks[0] and bases["right_ticks"][0] == plain.ticks[1]


def test_what_no_robot_can_have_is_refused() -> None:
    for kind, model, sentence in (
        (
            "kobuki",
            OMNIBOX,
            "the odometry of a robot 'Omnibox' is 'kobuki', which reads the wheels of a differential drive; "
            "it should be exact or stage",
        ),
        ("gps", TURTLEBOT, "a robot's odometry is 'gps'; it should be one of exact, stage, kobuki"),
    ):
        with pytest.raises(AcrcError) as caught:
            Odometers([kind], [model], np.zeros((1, 3)), [np.random.default_rng(0)], SUBSTEP)
        assert str(caught.value) == sentence
