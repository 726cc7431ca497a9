"""The particle filter: tracking, covariance, reproducibility and parameters."""

import json
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from actors.geometry import Point, Pose, wrap
from actors.robot.localisation import PRESETS, Amcl, AmclParameters, DeadReckoning, Estimate
from actors.robot.localisation.amcl import RecoveryAverages
from actors.robot.localisation.motion import step_count
from actors.robot.sweep import Sweep
from actors.settings import ParameterError
from tests.localisation.scenes import ROOM, Drive, amcl, blind, error, scan

CHAPTER, ROBUST = PRESETS["chapter"], PRESETS["robust"]
START = Pose(1.0, 4.5, 0.0)
BOTH = pytest.mark.parametrize("parameters", [CHAPTER, ROBUST], ids=["chapter", "robust"])
Track = list[tuple[Pose, Sweep]]


@cache
def drive(seed: int = 0, seconds: float = 40.0) -> Track:
    return list(Drive(ROOM, START, seed).sweeps(seconds))


def follow(localiser: Amcl, track: Track) -> list[Pose]:
    return [localiser.update(sweep.pose, sweep).pose for _, sweep in track]


def rmse(poses: Sequence[Pose], track: Track) -> float:
    errors = [error(pose, truth) for pose, (truth, _) in zip(poses, track, strict=True)]
    return float(np.sqrt(np.mean(np.square(errors))))


def normalised(found: Estimate, truth: Pose) -> float:
    """Return the squared error in units of the covariance."""
    pose = found.pose
    wrong = np.array([pose.x - truth.x, pose.y - truth.y, wrap(pose.heading - truth.heading)])
    return float(wrong @ np.linalg.solve(np.array(found.covariance).reshape(3, 3), wrong))


@BOTH
def test_keeps_track(parameters: AmclParameters) -> None:
    track = drive(1)
    localiser = amcl(parameters, START, seed=1)
    poses = follow(localiser, track)
    assert rmse(poses, track) < (0.08 if parameters is CHAPTER else 0.03)
    assert abs(wrap(poses[-1].heading - track[-1][0].heading)) < 0.1
    assert localiser.particles.shape == (len(localiser.weights), 3)
    assert localiser.weights.sum() == pytest.approx(1.0)
    assert not localiser.particles.flags.writeable and not localiser.weights.flags.writeable
    told = json.loads(json.dumps(localiser.outcome()))
    assert 0 < told["beams_used"] <= 60 * told["updates"] and told["resamplings"] == told["updates"]
    assert 500 <= told["mean_particles"] <= 2000 or parameters is ROBUST
    thinned = amcl(replace(parameters, resample_interval=3), START)
    follow(thinned, track[:150])
    assert thinned.outcome()["resamplings"] == thinned.outcome()["updates"] // 3  # type: ignore[operator]


def test_corrects_odometry_drift() -> None:
    """With wheels 5 % too large and 1°/s of drift, dead reckoning ends metres away."""
    localiser, reckoning = amcl(ROBUST, START), DeadReckoning(START)
    told = before = Pose(0.0, 0.0, 0.0)
    for number, (_, sweep) in enumerate(drive(seconds=60.0)):
        made = before.relative(sweep.pose)
        drift = math.radians(0.1) if number else 0.0
        told = told.compose(Pose(1.05 * made.x, 1.05 * made.y, wrap(made.heading + drift)))
        before = sweep.pose
        found = localiser.update(told, Sweep(sweep.ranges_mm, told)).pose
    truth = drive(seconds=60.0)[-1][0]
    assert error(found, truth) < 0.1
    assert error(reckoning.update(told, None).pose, truth) > 1.0


def test_the_origin_of_the_odometry_is_irrelevant() -> None:
    """The drive's steps equal the presets' update distance; rounding must not matter."""
    parameters = replace(ROBUST, update_distance=0.23, update_angle=0.19)
    far = Pose(1000.0, -500.0, 2.0)
    near, away = amcl(parameters, START), amcl(parameters, START, origin=far)
    assert away.update(far, None).pose == pytest.approx(START, abs=1e-9)
    for _, sweep in drive():
        one = near.update(sweep.pose, sweep)
        there = far.compose(sweep.pose)
        other = away.update(there, Sweep(sweep.ranges_mm, there))
        assert other.pose == pytest.approx(one.pose, abs=1e-6)
        assert (*other.covariance, other.lost) == pytest.approx((*one.covariance, one.lost), abs=1e-6)


@BOTH
def test_the_covariance_is_about_as_large_as_the_errors(parameters: AmclParameters) -> None:
    """The normalised squared error of three numbers has a median of 2.37."""
    squared = []
    for seed in range(2):
        localiser = amcl(parameters, START, seed=seed)
        for truth, sweep in drive(seed):
            squared.append(normalised(localiser.update(sweep.pose, sweep), truth))
    assert 2.37 / 2.5 < np.median(squared) < 2.37 * 2.5


@pytest.mark.parametrize("parameters", [ROBUST, replace(ROBUST, stranger_filter=False, beam_skip=True)])
def test_other_robots_do_not_distract(parameters: AmclParameters) -> None:
    crowd = [(1.2, 5.5, 0.18), (2.6, 5.2, 0.18), (3.0, 6.6, 0.18), (1.3, 3.4, 0.18), (4.2, 4.6, 0.18)]
    track = list(Drive(ROOM, START, others=crowd).sweeps(40.0))
    localiser = amcl(parameters, START)
    assert rmse(follow(localiser, track), track) < 0.05
    told = localiser.outcome()
    dropped = told["beams_strange"] if parameters is ROBUST else told["beams_skipped"]
    assert isinstance(dropped, int) and dropped > 100


def test_beams_at_masked_peers_are_ignored_until_the_mask_is_removed() -> None:
    peer = Point(1.6, 5.2)
    crowd = list(Drive(ROOM, START, others=[(*peer, 0.18)]).sweeps(10.0))
    localiser = amcl(CHAPTER, START)
    localiser.mask([peer])
    follow(localiser, crowd[:40])
    masked = localiser.outcome()["beams_masked"]
    assert isinstance(masked, int) and masked > 20
    localiser.mask([])
    follow(localiser, crowd[40:])
    assert localiser.outcome()["beams_masked"] == masked


def test_the_first_scan_is_used_and_then_those_after_some_motion() -> None:
    localiser = amcl(CHAPTER, START)
    ranges = scan(ROOM, START)
    steps = [
        (0.0, 0.0, 1),
        (0.24, 0.0, 1),
        (0.26, 0.0, 2),
        (0.26, 0.19, 2),
        (0.26, -0.21, 3),
        (0.26, 0.0, 4),
        (0.1, 0.1, 4),
    ]
    for x, heading, updates in steps:
        pose = Pose(x, 0.0, heading)
        localiser.update(pose, None)
        localiser.update(pose, Sweep(ranges, pose))
        assert localiser.outcome()["updates"] == updates


def test_motion_is_that_between_the_scans_own_poses() -> None:
    punctual, late = amcl(ROBUST, START), amcl(ROBUST, START)
    for (_, sweep), (_, ahead) in zip(drive(), drive()[3:], strict=False):
        now = punctual.update(sweep.pose, sweep)
        then = late.update(ahead.pose, sweep)
        moved = punctual.update(ahead.pose, None)
        assert then == moved and now.covariance == then.covariance


def test_same_inputs_give_the_same_bytes_whatever_the_step() -> None:
    coarse, fine = amcl(ROBUST, START), amcl(ROBUST, START)
    before = Pose(0.0, 0.0, 0.0)
    for _, sweep in drive():
        once = coarse.update(sweep.pose, sweep)
        for share in (0.25, 0.5, 0.75):
            between = before.relative(sweep.pose)
            fine.update(before.compose(Pose(share * between.x, share * between.y, 0.0)), None)
        assert fine.update(sweep.pose, sweep) == once
        before = sweep.pose
    assert coarse.particles.tobytes() == fine.particles.tobytes()
    other = amcl(ROBUST, START, seed=1)
    follow(other, drive())
    assert other.particles.tobytes() != coarse.particles.tobytes()


@BOTH
def test_without_echoes_it_follows_odometry_with_growing_covariance(parameters: AmclParameters) -> None:
    localiser = amcl(replace(parameters, start_spread=0.02, start_turn_spread=0.02), START)
    unsure = []
    for _, sweep in drive()[:80]:
        found = localiser.update(sweep.pose, Sweep(blind(), sweep.pose))
        unsure.append(found.covariance[0] + found.covariance[4])
    assert error(found.pose, drive()[79][0]) < 0.2 and unsure[-1] > 2 * unsure[0]
    told = localiser.outcome()
    assert told["blind"] == told["updates"] != 0
    assert told["resamplings"] == told["injected"] == 0


@BOTH
def test_particles_off_the_map_do_no_harm(parameters: AmclParameters) -> None:
    localiser = amcl(parameters, Pose(-40.0, 900.0, 1.0))
    for pose in follow(localiser, drive()):
        assert all(map(math.isfinite, pose))
    assert np.isfinite(localiser.particles).all() and localiser.weights.sum() == pytest.approx(1.0)


def test_dead_reckoning_composes_start_and_odometry_and_needs_no_scan() -> None:
    reckoning = DeadReckoning(Pose(2.0, 3.0, np.pi / 2))
    reckoning.mask([Point(0.0, 0.0)])
    there = Pose(1.0, 0.5, np.pi)
    found = reckoning.update(there, Sweep(blind(), there))
    assert found.pose == pytest.approx((1.5, 4.0, -np.pi / 2))
    assert (found.covariance, found.located, found.lost) == ((0.0,) * 9, True, 0.0)
    assert reckoning.outcome() == {}
    reckoning.relocalise()
    assert reckoning.update(there, None) == found
    assert not DeadReckoning(START, 0.3).update(there, None).located


@BOTH
def test_motion_before_the_first_scan_is_not_sampled(parameters: AmclParameters) -> None:
    """As after a restart: the base has driven 3 m with realistic odometry."""
    localiser, odometry = amcl(parameters, START), Pose(3.0, 0.0, 0.0)
    localiser.update(odometry, Sweep(blind(), odometry))
    particles = localiser.particles
    middle = np.mean(particles[:, :2], axis=0)
    assert np.hypot(*(middle - (START.x + 3.0, START.y))) < 0.02
    spread = parameters.start_spread + 0.02 * 3.0
    assert np.std(particles, axis=0) == pytest.approx([spread, spread, spread], rel=0.1)


def test_short_steps_are_not_divided() -> None:
    assert step_count(Pose(1.0, 2.0, 0.3), Pose(1.4, 2.4, 3.0), CHAPTER) == 1
    assert step_count(Pose(0.0, 0.0, 0.0), Pose(3.0, 0.0, 0.0), CHAPTER) == 12


@pytest.mark.parametrize("fast", [0.1, 0.05])
def test_the_long_average_has_to_be_the_slower_one(fast: float) -> None:
    with pytest.raises(ParameterError, match=f"recovery_slow is 0.1, but must be below recovery_fast {fast}"):
        AmclParameters(recovery_slow=0.1, recovery_fast=fast)


@pytest.mark.parametrize(
    ("field", "value", "right"),
    [
        ("min_particles", 0, "be a whole number of at least 1"),
        ("max_particles", 499, "be at least min_particles 500"),
        ("alpha1", -0.1, "be a number of at least 0"),
        ("sigma_hit", 0.0, "be a number above 0"),
        ("z_rand", 0.0, "be a number above 0 and at most 1"),
        ("recovery_fast", 1.5, "be a number from 0 to 1"),
        ("z_hit", -0.5, "be a number from 0 to 1"),
        ("search_poses", -1, "be a whole number of at least 0"),
        ("weighting", "sum", 'be "cubes" or "product"'),
        ("odometry_model", "omni", 'be "diff" or "diff-corrected"'),
        ("max_distance", float("nan"), "be a number above 0"),
    ],
)
def test_an_invalid_value_is_rejected_with_a_sentence(field: str, value: Any, right: str) -> None:
    with pytest.raises(ParameterError) as raised:
        AmclParameters(**{field: value})
    assert str(raised.value) == f"AmclParameters.{field} is {json.dumps(value)}, but must {right}"


@pytest.mark.parametrize(("slow", "fast"), [(0.0, 0.0), (0.0, 0.1), (0.001, 0.0)])
def test_recovery_is_off_if_an_average_is_constant(slow: float, fast: float) -> None:
    recovery = RecoveryAverages(AmclParameters(recovery_slow=slow, recovery_fast=fast))
    assert [recovery.injection(fit) for fit in (1.0, 0.0, 0.0, 0.5)] == [0.0] * 4
