"""Reversals bar the way back until the robot has got somewhere."""

import pytest

from actors.geometry import Pose
from actors.robot.local_planning.oscillation import OscillationCritic

HERE = Pose(1.0, 2.0, 3.1)


def critic(*motions: tuple[float, float]) -> OscillationCritic:
    made = OscillationCritic(0.05, 0.2, 0.1)
    for speed, turn in motions:
        made.note(HERE, speed, turn)
    return made


@pytest.mark.parametrize(
    ("motions", "barred"),
    [
        ([(0.3, 1.0), (0.3, -1.0), (0.3, 1.0)], []),
        ([(0.0, 1.0), (0.0, -1.0)], [2]),
        ([(0.0, -1.0), (0.1, 1.0)], [3]),
        ([(0.3, 0.0), (-0.1, 0.0)], [0]),
        ([(-0.1, 0.0), (0.0, 0.5), (0.3, 0.0)], [1]),
        ([(0.0, 1.0), (0.5, 0.0), (0.0, -1.0)], [2]),
    ],
)
def test_what_is_barred_after_which_motions(motions: list[tuple[float, float]], barred: list[int]) -> None:
    assert critic(*motions).barred.nonzero()[0].tolist() == barred


@pytest.mark.parametrize(
    ("where", "free"),
    [(Pose(1.04, 2.0, 3.1), False), (Pose(1.06, 2.0, 3.1), True), (Pose(1.0, 2.0, -3.0), False),
     (Pose(1.0, 2.0, -2.9), True)],
)  # fmt: skip
def test_it_ends_with_distance_or_angle(where: Pose, free: bool) -> None:
    made = critic((0.0, 1.0), (0.0, -1.0))
    made.note(where, 0.0, -1.0)
    assert made.barred.any() != free


def test_a_new_goal_ends_it_too() -> None:
    made = critic((0.0, 1.0), (0.0, -1.0))
    made.forget()
    assert not made.barred.any()
    made.note(HERE, 0.0, 1.0)
    assert not made.barred.any()
