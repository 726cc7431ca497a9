"""Odometry, drives and bumpers, compared with plain Python."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Pose, Twist, wrap
from actors.messages import Odometry
from actors.robot_model import KobukiErrors, RobotModel
from actors.world import drive, odometry
from actors.world.odometry import Odometers
from actors.world.physics import SUBSTEP, Arena
from actors.world.uncertainty import Uncertainty, with_drift
from tests.refusals import refused
from tests.world.scenery import OMNIBOX, TURTLEBOT, arena

STARTS = (Pose(-2, 1, 2.0), Pose(3, -1, -1.0), Pose(0, 3, 0.3))
NOT_NOISY = KobukiErrors(gyro_noise_deg=0, gyro_bias_deg=0, gyro_walk_deg=0, wheel_scale=0, slip=0)


def odometers(world: Arena, kind: str, seed: int = 1, kobuki: KobukiErrors = NOT_NOISY) -> Odometers:
    n = len(world)
    generators = [np.random.default_rng([seed, k]) for k in range(n)]
    model = msgspec.structs.replace(TURTLEBOT, kobuki_errors=kobuki)
    return Odometers([kind] * n, [model] * n, world.poses, generators, SUBSTEP)


def tour(world: Arena, odometry: Odometers, substeps: int = 10, moves: int = 12) -> list[Odometry]:
    rng = np.random.default_rng(9)
    for _ in range(moves):
        for index in range(len(world)):
            world.command(index, Twist(rng.uniform(0, 0.5), 0, rng.uniform(-1.5, 1.5)), world.now)
        for _ in range(50 // substeps):
            odometry.follow(world.advance(substeps), world.velocities)
    return [odometry.read(index) for index in range(len(world))]


def truth(world: Arena, index: int) -> Pose:
    return STARTS[index].relative(Pose(*world.poses[index].tolist()))


def test_exact_odometry_is_the_true_pose_from_the_first_one_and_the_true_velocity() -> None:
    world = arena(*STARTS)
    for index, said in enumerate(tour(world, odometers(world, "exact"))):
        assert (said.x, said.y, said.heading) == pytest.approx(truth(world, index), abs=1e-12)
        assert math.hypot(said.vx, said.vy) == pytest.approx(np.hypot(*world.velocities[index, :2]))
        assert said.vy == pytest.approx(0, abs=1e-9) and said.omega == world.velocities[index, 2]


@pytest.mark.parametrize(("kind", "notices"), [("exact", True), ("stage", False), ("kobuki", False)])
def test_only_exact_odometry_follows_a_relocation(kind: str, notices: bool) -> None:
    world = arena(*STARTS)
    odometry = odometers(world, kind)
    before = tour(world, odometry)[0]
    world.move(0, Pose(4, 4, 1.0))
    odometry.relocate(0, Pose(4, 4, 1.0))
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


def straight(length: float, turn: float, substeps: int) -> NDArray[np.float64]:
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
    model = msgspec.structs.replace(TURTLEBOT, kobuki_errors=kobuki)
    odometry = Odometers([kind], [model], np.zeros((1, 3)), generators, SUBSTEP)
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
    said = [after_straight("kobuki", seed, msgspec.structs.replace(NOT_NOISY, **only)) for seed in range(400)]
    if spread_x is not None:
        assert np.std([s.x for s in said]) == pytest.approx(spread_x, rel=0.12)
    assert np.std([s.heading for s in said]) == pytest.approx(spread_heading, rel=0.12, abs=1e-9)


def test_the_bias_of_both_wheels_scales_distances_and_grows_with_the_drift() -> None:
    biased = msgspec.structs.replace(NOT_NOISY, wheel_bias=0.03)
    assert after_straight("kobuki", 1, biased).x == pytest.approx(2.06, abs=1e-3)
    assert after_straight("kobuki", 1, biased).heading == pytest.approx(1.0, abs=1e-3)
    scaled = with_drift(msgspec.structs.replace(TURTLEBOT, kobuki_errors=biased), Uncertainty(drift=2.0))
    assert scaled.kobuki_errors.wheel_bias == 0.06


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.tuples(*[st.floats(-0.01, 0.01)] * 2, st.floats(-0.1, 0.1)), min_size=1, max_size=30),
    st.tuples(*[st.floats(0.9, 1.1)] * 3),
)
def test_scaled_motion_equals_plain_python(
    motions: list[tuple[float, float, float]], factors: tuple[float, float, float]
) -> None:
    pose, expected = Pose(1, 2, 3), Pose(0, 0, 0)
    track = []
    for forward, leftward, turn in motions:
        pose = pose.compose(Pose(forward, leftward, turn))
        track.append([pose])
        expected = expected.compose(Pose(forward * factors[0], leftward * factors[1], turn * factors[2]))
    got = np.zeros((1, 3))
    odometry.add_scaled(np.array(track), np.array([0]), np.array([[1.0, 2.0, 3.0]]), np.array([factors]), got)
    assert (*got[0, :2], wrap(got[0, 2])) == pytest.approx(expected, abs=1e-9)


class PlainKobuki:
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
        x, y, _ = self.estimate
        self.estimate = Pose(x + forward * math.cos(middle), y + forward * math.sin(middle), heading)
        self.velocity = Twist(forward / 0.02, 0.0, turn / 0.02)


def test_measured_motion_equals_plain_python() -> None:
    errors, rng = KobukiErrors(), np.random.default_rng(3)
    pose, plain = Pose(1, 2, 3), PlainKobuki(1.003, 0.998, 1e-3)
    track, normals = [], rng.standard_normal((301, 4))
    for k in range(301):
        motion = Pose(*rng.uniform((-0.002, -0.001, -0.05), (0.005, 0.001, 0.05)).tolist())
        pose = pose.compose(motion)
        track.append([pose])
        plain.move(motion, normals[k], errors)
    bases, got, velocities = np.zeros(1, odometry.BASE), np.zeros((1, 3)), np.zeros((1, 3))
    bases["left_scale"], bases["right_scale"], bases["bias"] = 1.003, 0.998, 1e-3
    degrees = (errors.gyro_noise_deg, errors.gyro_walk_deg, errors.gyro_resolution_deg)
    model = (errors.track, errors.tick_um * 1e-6, errors.slip, *map(math.radians, degrees), 2)
    last = np.array([[1.0, 2.0, 3.0]])
    odometry.add_measured(
        np.array(track), np.array([0]), last, normals[None], 0.01, model, bases, got, velocities
    )
    assert got[0] == pytest.approx(plain.estimate, abs=1e-9)
    assert velocities[0] == pytest.approx(plain.velocity, abs=1e-9)
    assert bases["left_ticks"][0] == plain.ticks[0] and bases["right_ticks"][0] == plain.ticks[1]


def test_invalid_odometry_is_refused() -> None:
    drive = "needs a differential drive; use exact or stage"
    for kind, model, sentence in (
        ("kobuki", OMNIBOX, f"odometry 'kobuki' of model 'Omnibox' {drive}"),
        ("gps", TURTLEBOT, "odometry is 'gps'; must be one of exact, stage, kobuki"),
    ):
        with refused(sentence):
            Odometers([kind], [model], np.zeros((1, 3)), [np.random.default_rng(0)], SUBSTEP)


speed = st.floats(-1.2, 1.2)
body = st.tuples(*[st.floats(-9, 9)] * 3, speed, speed, st.floats(-6, 6))
command = st.tuples(speed, speed, st.floats(-9, 9))
hold = st.floats(-0.05, 0.05)
DT = 0.01


def shortened(vector: complex, longest: float) -> complex:
    return vector * min(1.0, longest / max(abs(vector), 1e-300))


class PlainDrive:
    def __init__(self, model: RobotModel, memory: Sequence[float]) -> None:
        self.drive, self.turn, self.hold_turn = model.drive, memory[2], memory[5]
        self.wheels, self.holding = complex(*memory[:2]), complex(*memory[3:5])
        lever = model.footprint.circumradius / 2
        self.turn_grip = model.drive.grip * model.mass * lever / drive.moment_of_inertia(model)

    def velocity_after(self, before: Sequence[float], wanted: Sequence[float], age: float) -> list[float]:
        _, _, heading, east, north, omega = before
        vx, vy, rate = wanted if age <= self.drive.watchdog else (0.0, 0.0, 0.0)
        everywhere = self.drive.kind == "omnidirectional"
        limit = self.drive.speed
        goal = shortened(complex(vx, vy), limit) if everywhere else complex(np.clip(vx, -limit, limit))
        next_heading = heading + omega * DT
        now = complex(east, north)
        change = self.change(goal, now * np.exp(-1j * heading), now * np.exp(-1j * next_heading))
        after = now + change * np.exp(1j * next_heading)
        reach, top, grip = self.drive.turn_acceleration * DT, self.drive.turn_rate, self.turn_grip * DT
        self.hold_turn = float(np.clip(0.995 * self.hold_turn - (omega - self.turn) / 4, -grip, grip))
        self.turn += float(np.clip(np.clip(rate, -top, top) - self.turn, -reach, reach))
        turning = omega + float(np.clip(self.turn - omega + self.hold_turn, -grip, grip))
        return [after.real, after.imag, turning]

    def change(self, goal: complex, now: complex, velocity: complex) -> complex:
        reach, grip = self.drive.acceleration * DT, self.drive.grip * DT
        slip = now - self.wheels
        self.wheels += shortened(goal - self.wheels, reach)
        lag = self.wheels - velocity
        everywhere = self.drive.kind == "omnidirectional"
        behind = (lag * self.wheels.conjugate()).real if everywhere else lag.real * self.wheels.real
        if behind > 0 and everywhere:
            pull = shortened(lag, reach)
            self.wheels, self.holding = velocity + pull, 0j
            return pull
        held = 0.995 * self.holding - slip / 4
        aside = float(np.clip(held.imag, -grip, grip))
        if behind > 0:
            ahead = float(np.clip(lag.real, -reach, reach))
            self.wheels, self.holding = complex(velocity.real + ahead, self.wheels.imag), complex(0, aside)
        else:
            self.holding = complex(np.clip(held.real, -grip, grip), aside)
            ahead = float(np.clip(lag.real + self.holding.real, -grip, grip))
        return complex(ahead, np.clip(lag.imag + aside, -grip, grip))


@settings(deadline=None)  # the first call compiles
@given(
    body,
    command,
    st.floats(0, 1),
    st.sampled_from([TURTLEBOT, OMNIBOX]),
    st.tuples(speed, speed, st.floats(-5, 5), hold, hold, st.floats(-0.2, 0.2)),
)
def test_velocities_equal_plain_python(
    before: tuple[float, ...],
    wanted: tuple[float, ...],
    age: float,
    model: RobotModel,
    memory: tuple[float, ...],
) -> None:
    forces, kept = np.zeros((1, 3)), np.array([memory], drive.MEMORY)
    now_us = 2_000_000
    issued = np.array([now_us - round(age * 1e6)])
    drive.drive_forces(
        np.array([before]), np.array([wanted]), issued, now_us, DT, drive.limits([model]), kept, forces
    )
    inertia = np.array([model.mass, model.mass, drive.moment_of_inertia(model)])
    plain = PlainDrive(model, memory)
    expected = plain.velocity_after(before, wanted, round(age * 1e6) / 1e6)
    assert np.array(before[3:]) + forces[0] / inertia * DT == pytest.approx(expected, abs=1e-9)
    after = [plain.wheels.real, plain.wheels.imag, plain.turn]
    after += [plain.holding.real, plain.holding.imag, plain.hold_turn]
    assert list(kept[0].tolist()) == pytest.approx(after, abs=1e-9)


def sector(bearing: float, model: RobotModel) -> int:
    assert model.bumper is not None
    degrees = math.degrees(wrap(bearing))
    if abs(degrees) <= model.bumper.centre_deg:
        return 2
    return 0 if abs(degrees) > model.bumper.reach_deg else (4 if degrees > 0 else 1)


@settings(deadline=None)  # the first call compiles
@given(
    st.lists(
        st.tuples(st.integers(0, 5), st.integers(0, 5), st.booleans(), st.floats(-3.1, 3.1)), max_size=12
    )
)
def test_bumper_sectors_equal_plain_python(contacts: list[tuple[int, int, bool, float]]) -> None:
    numbers = [700, 30, 900, 41]  # of the robots' bodies; 1 and 2 stand for walls
    bodies = [*numbers, 1, 2]
    states = np.zeros((4, 6))
    states[:, 2] = [0.0, 2.0, -8.0, 3.0]
    models = [TURTLEBOT, OMNIBOX, TURTLEBOT, OMNIBOX]
    touching = np.array([True, False, False, True])
    expected, touches, begun = [0] * 4, [False] * 4, 0
    for a, b, new, bearing in contacts:
        for robot, seen in ((a, bearing), (b, bearing + math.pi)):
            if robot < 4:
                expected[robot] |= sector(seen - states[robot, 2], models[robot])
                touches[robot] |= max(a, b) >= 4
        begun += new and a < 4 and b < 4
    begun += sum(now and not before for now, before in zip(touches, touching, strict=True))
    pairs = np.array([(bodies[a], bodies[b], new) for a, b, new, _ in contacts], np.uint64).reshape(-1, 3)
    normals = np.array([(math.cos(t), math.sin(t)) for *_, t in contacts]).reshape(-1, 2)
    robots = np.argsort(numbers)
    bumpers = np.zeros(4, np.uint8)
    ids, limits = np.array(numbers, np.uint64)[robots], drive.limits(models)
    got = drive.set_bumpers(states, pairs, normals, ids, robots, limits, bumpers, touching)
    assert bumpers.tolist() == expected and touching.tolist() == touches
    assert got == (begun, any(touches))
