from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.robot.localisation import Estimate
from actors.robot.sweep import Sweep
from benchmarks.localisation.cells import PRESETS, CourseCell
from benchmarks.localisation.course import CourseSetup
from benchmarks.localisation.crowd import ReportParameters, reports
from benchmarks.localisation.filters import Arm, replay
from benchmarks.localisation.metrics import beside_truth
from benchmarks.localisation.runs import CourseTask, drive, run_all, tasks
from tests.localisation_bench.scenes import CORRIDOR, course

SHORT = CourseSetup(CORRIDOR, 1, robots=2, base="kobuki", seconds=6)


class Witness:
    """Answers with the truth, and keeps what it is told."""

    def __init__(self, truth: NDArray[np.float64]) -> None:
        self.truth = iter(truth.tolist())
        self.heard: list[tuple[Pose, Sweep | None]] = []
        self.masks: list[tuple[int, tuple[Point, ...]]] = []

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        self.heard.append((here, sweep))
        return Estimate(Pose(*next(self.truth)), (0.0,) * 9)

    def mask(self, peers: Sequence[Point]) -> None:
        self.masks.append((len(self.heard), tuple(peers)))

    def relocalise(self) -> None:
        raise AssertionError("nobody asked for it")

    def outcome(self) -> dict[str, object]:
        return {"heard": len(self.heard)}


def test_every_pose_and_scan_is_told_once_each_scan_with_the_pose_of_its_stamp() -> None:
    a = course(SHORT)
    late = replace(a, stamps=a.stamps[::2] + 30_000, scans=a.scans[::2])
    witness = Witness(a.truth)
    track = replay(late, witness)
    assert [here for here, _ in witness.heard] == [Pose(*pose) for pose in a.odometry.tolist()]
    swept = [(k, sweep) for k, (_, sweep) in enumerate(witness.heard) if sweep is not None]
    assert [k for k, _ in swept] == list(range(1, len(a.instants), 2))
    for k, sweep in swept:
        np.testing.assert_array_equal(sweep.ranges_mm, a.scans[k - 1])
        assert not sweep.ranges_mm.flags.writeable
        between = a.odometry[k - 1] + 0.3 * (a.odometry[k] - a.odometry[k - 1])
        np.testing.assert_allclose(sweep.pose, between, atol=1e-12)
    run = beside_truth(1, a.truth, a.odometry, track)
    assert run.rmse == 0.0 and not run.lost and run.outcome == {"heard": 61}


def test_masks_come_before_the_call_of_their_step() -> None:
    a = course(SHORT)
    known: list[tuple[Point, ...] | None] = [None] * len(a.instants)
    known[3], known[9] = (Point(1.0, 2.0),), ()
    witness = Witness(a.truth)
    replay(a, witness, known)
    assert witness.masks == [(3, (Point(1.0, 2.0),)), (9, ())]


def test_reports_are_late_come_in_turn_and_are_forgotten() -> None:
    peers = np.zeros((80, 2, 2))
    peers[:, 0, 0], peers[:, 1, 0] = np.arange(80), -np.arange(80)
    peers[25:, 1] = np.nan
    told = reports(peers, np.random.default_rng(1), ReportParameters(spread=0.0))
    heard = {step: positions for step, positions in enumerate(told) if positions is not None}
    assert heard[2] == ((0, 0),) and heard[7] == ((0, 0), (-5, 0))
    assert heard[12] == ((10, 0), (-5, 0)) and heard[17] == ((10, 0), (-15, 0))
    # the last report of the one that went away, sent at 15, lives for 30 steps
    assert [step for step, positions in heard.items() if len(positions) == 2] == [7, 12, 17, 22, 32, 42]
    assert heard[46] == ((40, 0),)


def test_reports_are_off_by_their_spread() -> None:
    told = reports(np.zeros((4000, 2, 2)), np.random.default_rng(1))
    last = [positions[-1] for positions in told if positions is not None]
    assert abs(np.std(last) - 0.1) < 0.01


def test_each_course_is_driven_once_with_all_that_it_is_needed_for() -> None:
    cells = [
        CourseCell("tracking", replace(SHORT, seed=0), Arm("odometry"), 2),
        CourseCell("mask", replace(SHORT, seed=0), Arm("odometry"), 2),
        CourseCell("mask", replace(SHORT, seed=0), Arm("robust", masked=True), 1),
    ]
    robust = Arm("robust", masked=True)
    assert tasks(cells) == [
        CourseTask(SHORT, (Arm("odometry"), robust)),
        CourseTask(replace(SHORT, seed=2), (Arm("odometry"),)),
    ]


def test_a_mask_reaches_the_filter_and_the_odometry_alone_is_as_good_as_it_is() -> None:
    told, plain, alone = drive(
        CourseTask(SHORT, (Arm("robust", masked=True), Arm("robust"), Arm("odometry")))
    )
    assert told.outcome["beams_masked"] != 0 and plain.outcome["beams_masked"] == 0
    assert np.isinf(alone.nees).all() and alone.rmse < 0.05


def test_the_number_of_workers_changes_nothing() -> None:
    todo = [CourseTask(replace(SHORT, seed=seed), (Arm("chapter"), Arm("robust"))) for seed in (1, 2, 3)]
    done: list[int] = []
    alone, shared = run_all(todo, 1, done.append), run_all(todo, 2, done.append)
    assert done == [1, 2, 3, 1, 2, 3] and list(alone) == list(shared)
    for key, run in alone.items():
        np.testing.assert_array_equal(run.errors, shared[key].errors)
        np.testing.assert_array_equal(run.nees, shared[key].nees)
        assert run.outcome == shared[key].outcome


def test_recovery_is_switched_whatever_the_preset_has() -> None:
    for preset in PRESETS:
        on, off = Arm(preset, recovery=True).parameters, Arm(preset, recovery=False).parameters
        assert on.recovers or on.search_poses > 0
        assert not off.recovers and off.search_poses == 0
        assert replace(on, recovery_slow=0.0, recovery_fast=0.0, search_poses=0) == off
    assert Arm("chapter").parameters.recovery_fast == 0  # the preset's own
