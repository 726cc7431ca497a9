"""The search for a lost robot: what it finds, what it leaves open, and what it never takes for the truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose, wrap
from actors.robot.localisation import LikelihoodField, likelihood_field
from actors.robot.localisation.search import PoseHypothesis, Search
from tests.localisation.scenes import (
    APARTMENT,
    BEAMS,
    FIELD,
    ROOM,
    Drive,
    anywhere,
    apartment,
    counted,
    ends,
    error,
    place,
    twin_of,
    twins,
)
from tests.seeds import sampled

START = Pose(1.0, 4.5, 0.0)
ELSEWHERE = Pose(6.5, 1.0, 2.0)
TWINS = twins()
TWIN_FIELD = likelihood_field(TWINS, 2.0)
WEST = Pose(3.0, 1.0, 0.5)
SAMPLE = (0,)
"""The seed of every day, of searches that each come to the same."""
Scans = list[tuple[Pose, NDArray[np.float64], Pose]]


@dataclass
class Found:
    """What a search said of some scans."""

    places: list[Pose] = field(default_factory=list)
    """Where the robot was, it said,"""
    truths: list[Pose] = field(default_factory=list)
    """where it really was then,"""
    scans: list[int] = field(default_factory=list)
    """and after how many scans."""
    hypotheses: list[PoseHypothesis] = field(default_factory=list)

    @property
    def right(self) -> list[bool]:
        pairs = zip(self.places, self.truths, strict=True)
        return [error(a, b) < 0.15 and abs(wrap(a.heading - b.heading)) < 0.1 for a, b in pairs]


def scans(
    plan: OccupancyGrid,
    start: Pose,
    seed: int = 0,
    others: Sequence[tuple[float, float, float]] = (),
    seconds: float = 20.0,
) -> Scans:
    """The truth, the ends of the beams and the odometry of every scan that counts on a drive."""
    drive = Drive(plan, start, seed, others).sweeps(seconds)
    return [(truth, ends(sweep.ranges_mm), sweep.pose) for truth, sweep in counted(drive)]


def searched(
    plan: LikelihoodField, made: Scans, estimate: Pose, seed: int = 0, poses: int = 3000, moves: bool = False
) -> Found:
    """`moves`: the estimate follows the odometry, of which it is the start; what was found always does."""
    search = Search(plan, BEAMS.mount, np.random.default_rng(seed), poses)
    found = Found()
    frame = estimate if moves else None
    for number, (truth, points, here) in enumerate(made, 1):
        place = search.take(points, here, estimate if frame is None else frame.compose(here))
        if place is not None:
            frame = place.frame
            found.places.append(place.frame.compose(here))
            found.truths.append(truth)
            found.scans.append(number)
            found.hypotheses.append(place)
    return found


@pytest.mark.parametrize("seed", sampled(range(6), SAMPLE))
@pytest.mark.parametrize("others", [0, 6])
def test_in_a_room_it_finds_the_robot_within_20_scans(seed: int, others: int) -> None:
    rng = np.random.default_rng(seed)
    crowd = [(*place(ROOM, rng), 0.18) for _ in range(others)]
    found = searched(FIELD, scans(ROOM, START, seed, crowd, 8.0), ELSEWHERE, seed)
    assert found.right[0] and found.scans[0] <= 20


@pytest.mark.parametrize("seed", sampled(range(6), SAMPLE))
def test_in_an_apartment_it_finds_the_robot_within_40_scans(seed: int) -> None:
    found = searched(apartment(), scans(APARTMENT, anywhere(seed), seed), anywhere(seed, 1), seed)
    assert found.right[0] and found.scans[0] <= 40


@pytest.mark.parametrize("seed", sampled(range(4), SAMPLE))
def test_it_leaves_a_right_estimate_alone(seed: int) -> None:
    assert searched(FIELD, scans(ROOM, START, seed), START, seed, moves=True).scans == []


def test_after_some_scans_and_no_sooner_it_decides() -> None:
    """However well a place explains one scan."""
    made = [scans(ROOM, START, seed, seconds=6.0) for seed in range(4)]
    assert min(searched(FIELD, one, ELSEWHERE).scans[0] for one in made) > 5


@pytest.mark.parametrize("seed", sampled(range(4), SAMPLE))
def test_of_two_rooms_that_are_alike_it_takes_neither(seed: int) -> None:
    made = scans(TWINS, WEST, seed)
    assert len(made) > 40
    assert searched(TWIN_FIELD, made, ELSEWHERE, seed).scans == []


@pytest.mark.parametrize("seed", sampled(range(4), SAMPLE))
def test_a_place_that_walls_contradict_is_never_given(seed: int) -> None:
    """The robot sees farther than the other room, which is else like its own, is long."""
    plan = twins(shorter=1.0)
    found = searched(likelihood_field(plan, 2.0), scans(plan, WEST, seed), twin_of(WEST), seed)
    assert found.right and all(found.right)


@pytest.mark.parametrize("seed", sampled(range(3), SAMPLE))
def test_off_its_map_it_gives_hardly_anything_and_nothing_that_walls_contradict(seed: int) -> None:
    """The robot is in a house that is not on the map."""
    for plan, here in (
        (FIELD, scans(APARTMENT, anywhere(seed), seed)),
        (apartment(), scans(ROOM, START, seed)),
    ):
        found = searched(plan, here, Pose(0.5, 0.5, 0.0), seed)
        assert len(found.scans) < 0.1 * len(here)
        assert all(one.lost.probability < 0.1 and one.score >= 0.5 for one in found.hypotheses)


def test_the_same_inputs_give_the_same_hypotheses() -> None:
    def told(seed: int) -> list[tuple[Pose, float, int, float]]:
        found = searched(FIELD, made, ELSEWHERE, seed)
        return [(one.frame, one.score, one.scans, one.lost.probability) for one in found.hypotheses]

    made = scans(ROOM, START, seconds=10.0)
    assert told(0) == told(0) != told(1)
    assert told(0)


@pytest.mark.parametrize("poses", [1, 50])
def test_few_poses_do_no_harm(poses: int) -> None:
    found = searched(FIELD, scans(ROOM, START), Pose(1e5, -1e5, 0.0), poses=poses)
    assert all(math.isfinite(number) for pose in found.places for number in pose)


def test_one_beam_alone_convinces_of_nothing() -> None:
    made = [(truth, points[:1], here) for truth, points, here in scans(ROOM, START)]
    assert searched(FIELD, made, ELSEWHERE).scans == []
