"""The kernels of drives and bumpers beside plain Python."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import wrap
from actors.robot_model import RobotModel
from actors.world import drive
from tests.world.scenery import OMNIBOX, TURTLEBOT

speed = st.floats(-1.2, 1.2)
body = st.tuples(*[st.floats(-9, 9)] * 3, speed, speed, st.floats(-6, 6))
command = st.tuples(speed, speed, st.floats(-9, 9))
hold = st.floats(-0.05, 0.05)
DT = 0.01


def shortened(vector: complex, longest: float) -> complex:
    return vector * min(1.0, longest / max(abs(vector), 1e-300))


class PlainDrive:
    """One drive in plain Python; complex numbers are vectors in the body's frame."""

    def __init__(
        self, model: RobotModel, wheels: complex, turn: float, holding: complex, hold_turn: float
    ) -> None:
        self.drive, self.wheels, self.turn = model.drive, wheels, turn
        self.holding, self.hold_turn = holding, hold_turn
        lever = model.footprint.circumradius / 2
        self.turn_grip = model.drive.grip * model.mass * lever / drive.moment_of_inertia(model)

    def velocity_after(self, before: Sequence[float], wanted: Sequence[float], age: float) -> list[float]:
        """vx, vy, omega in the map frame after one sub-step on a free floor."""
        _, _, heading, east, north, omega = before
        vx, vy, rate = wanted if age <= self.drive.watchdog else (0.0, 0.0, 0.0)
        everywhere = self.drive.kind == "omnidirectional"
        limit = self.drive.speed
        goal = shortened(complex(vx, vy), limit) if everywhere else complex(np.clip(vx, -limit, limit))
        next_heading = heading + omega * DT
        change = self.change(
            goal,
            complex(east, north) * np.exp(-1j * heading),
            complex(east, north) * np.exp(-1j * next_heading),
        )
        after = complex(east, north) + change * np.exp(1j * next_heading)
        reach, top, grip = self.drive.turn_acceleration * DT, self.drive.turn_rate, self.turn_grip * DT
        self.hold_turn = float(np.clip(0.995 * self.hold_turn - (omega - self.turn) / 4, -grip, grip))
        self.turn += float(np.clip(np.clip(rate, -top, top) - self.turn, -reach, reach))
        return [
            after.real,
            after.imag,
            omega + float(np.clip(self.turn - omega + self.hold_turn, -grip, grip)),
        ]

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
def test_forces_lead_to_the_velocity_that_plain_python_computes(
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
    plain = PlainDrive(model, complex(*memory[:2]), memory[2], complex(*memory[3:5]), memory[5])
    expected = plain.velocity_after(before, wanted, round(age * 1e6) / 1e6)
    assert np.array(before[3:]) + forces[0] / inertia * DT == pytest.approx(expected, abs=1e-9)
    after = [plain.wheels.real, plain.wheels.imag, plain.turn]
    after += [plain.holding.real, plain.holding.imag, plain.hold_turn]
    assert list(kept[0].tolist()) == pytest.approx(after, abs=1e-9)


def sector(bearing: float, model: RobotModel) -> int:
    """The bit that a contact at that bearing, rad, presses, in plain Python."""
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
def test_contacts_press_the_sectors_that_plain_python_finds(
    contacts: list[tuple[int, int, bool, float]],
) -> None:
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
    got = drive.press_bumpers(
        states,
        pairs,
        normals,
        np.array(numbers, np.uint64)[robots],
        robots,
        drive.limits(models),
        bumpers,
        touching,
    )
    assert bumpers.tolist() == expected and touching.tolist() == touches and got == begun
