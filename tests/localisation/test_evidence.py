"""Classification of beams at a pose: strangers, agreeing beams, and beams through walls."""

import math
from collections import Counter

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.array_types import Floats
from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.geometry import Point, Pose
from actors.messages import NO_ECHO_MM
from actors.robot.localisation import PRESETS, LikelihoodField, measurement
from actors.robot.localisation.confidence import AGREES, BeamClasses, beam_scores, classify_beams, explain
from actors.robot.localisation.measurement import Beams, EndPoints
from actors.robot.sweep import Sweep
from actors.robot_model import RobotModel, scan_angles
from tests.localisation.scenes import (
    APARTMENT,
    BEAMS,
    CAMERA,
    FIELD,
    ROOM,
    TURTLEBOT,
    amcl,
    apartment,
    ends,
    frozen,
    place,
    scan,
)

HERE = Pose(3.2, 4.0, 0.4)
ROBUST = PRESETS["robust"]
PLACES = pytest.mark.parametrize(
    ("plan", "field"), [(ROOM, FIELD), (APARTMENT, apartment())], ids=["room", "apartment"]
)


def judged(points: Floats, pose: Pose = HERE, margin: float = 0.12) -> BeamClasses:
    return classify_beams(FIELD.grid, points, BEAMS.mount, pose, margin)


def to_wall(point: Point) -> float:
    """Return the distance from a point to the nearest wall by the field, m."""
    row, column = np.clip(np.add(ROOM.cell(point), 1), 0, np.subtract(FIELD.levels.shape, 1))
    return float(FIELD.distances[FIELD.levels[row, column]])


def is_wall(point: Point) -> bool:
    cell = ROOM.cell(point)
    return ROOM.contains(point) and ROOM.cells[cell.row, cell.column] == OCCUPIED


def passes(eye: Point, end: Point) -> bool:
    """Return True if a wall is before the end of a beam, by small steps."""
    shares = np.arange(0.0, 1.0, 0.005 / eye.distance_to(end)).tolist()
    return any(is_wall(Point(eye.x + s * (end.x - eye.x), eye.y + s * (end.y - eye.y))) for s in shares)


def twin(points: Floats, pose: Pose, margin: float) -> BeamClasses:
    known, count = [], Counter[str]()
    eye = pose.compose(TURTLEBOT.sensor.mount).point
    for forward, left in points.tolist():
        end = pose.compose(Pose(forward, left, 0.0)).point
        apart, passed = to_wall(end), passes(eye, end)
        count["agreeing"] += apart <= AGREES
        count["beyond"] += apart > AGREES and passed
        stranger = apart > margin and not passed
        count["strangers"] += stranger
        if not stranger:
            known.append((forward, left))
    found = np.array(known).reshape(-1, 2)
    return BeamClasses(found, count["strangers"], count["agreeing"], count["beyond"])


def crowd(plan: OccupancyGrid, rng: np.random.Generator, count: int) -> Floats:
    return np.array([(*place(plan, rng), 0.18) for _ in range(count)]).reshape(-1, 3)


def about_here(seed: int) -> tuple[Floats, Pose]:
    rng = np.random.default_rng(seed)
    points = ends(scan(ROOM, HERE, crowd(ROOM, rng, 3)))
    x, y, heading = rng.normal(0.0, (0.4, 0.4, 0.3)).tolist()
    return points, Pose(HERE.x + x, HERE.y + y, HERE.heading + heading)


@pytest.mark.parametrize("margin", [0.12, 0.5, math.inf])
@pytest.mark.parametrize("seed", range(3))
def test_classify_beams_equals_the_reference(seed: int, margin: float) -> None:
    points, pose = about_here(seed)
    found, expected = judged(points, pose, margin), twin(points, pose, margin)
    assert found.agreeing == expected.agreeing
    assert abs(found.strangers - expected.strangers) <= 1  # sphere tracing may clip a cell's corner that
    assert abs(found.beyond - expected.beyond) <= 1  # small steps miss, and vice versa
    if found.strangers == expected.strangers:
        assert found.known == pytest.approx(expected.known)


@pytest.mark.parametrize("seed", range(2))
def test_explain_equals_classify_beams_and_a_numpy_score(seed: int) -> None:
    points, _ = about_here(seed)
    poses = np.random.default_rng([seed, 1]).uniform((-2.0, -2.0, -3.0), (10.0, 10.0, 3.0), (40, 3)).T
    table = beam_scores(FIELD, 0.1)
    assert table == pytest.approx(np.exp(-0.5 * (np.linspace(0.0, 2.0, 256) / 0.1) ** 2))
    found = explain(FIELD.grid, points, BEAMS.mount, poses, table)
    for i, pose in enumerate(Pose(*column) for column in poses.T.tolist()):
        single = judged(points, pose)
        assert (found.agreeing[i], found.beyond[i]) == (single.agreeing, single.beyond)
        near = [to_wall(pose.compose(Pose(x, y, 0.0)).point) for x, y in points.tolist()]
        gained = sum(math.exp(-0.5 * (apart / 0.1) ** 2) for apart in near if apart <= AGREES)
        assert found.score[i] == pytest.approx((gained - 2.0 * single.beyond) / len(points), abs=1e-9)


@PLACES
def test_no_beam_passes_a_wall_from_the_true_pose_and_some_do_from_most_others(
    plan: OccupancyGrid, field: LikelihoodField
) -> None:
    strangers, passing = [0, 0], []
    for seed in range(12):
        for others in (0, 4):
            rng = np.random.default_rng([seed, others])
            at = place(plan, rng)
            pose = Pose(at.x, at.y, rng.uniform(-math.pi, math.pi))
            points = ends(scan(plan, pose, crowd(plan, rng, others)))
            found = classify_beams(field.grid, points, BEAMS.mount, pose, 0.12)
            assert found.beyond == 0
            strangers[others > 0] += found.strangers
            wrong = explain(field.grid, points, BEAMS.mount, field.poses(rng, 40), beam_scores(field, 0.1))
            passing.append(float((wrong.beyond > 0).mean()))
    assert strangers[0] == 0 < strangers[1]
    assert np.mean(passing) > 0.9


def test_a_beam_through_a_wall_is_not_a_stranger() -> None:
    """At a pose behind the wall, the beam passes through it, which contradicts the pose."""
    ranges = np.full(640, NO_ECHO_MM, np.uint16)
    ranges[BEAMS.rays[15]] = 2000
    direction = math.atan2(BEAMS.directions[15, 1], BEAMS.directions[15, 0])
    behind = Pose(1.2, 1.5, -direction)  # the beam goes east, across the wall from x = 2 to 2.3
    found = judged(ends(frozen(ranges)), behind)
    assert (len(found.known), *found[1:]) == (1, 0, 0, 1)
    ranges[BEAMS.rays[15]] = 1000
    found = judged(ends(frozen(ranges)), Pose(4.9, 1.5, -direction))
    assert (len(found.known), *found[1:]) == (0, 1, 0, 0)


def test_if_every_beam_is_a_stranger_the_scan_is_blind() -> None:
    ranges = frozen(np.full(640, 700, np.uint16))
    found = judged(ends(ranges))
    assert (len(found.known), *found[1:]) == (0, 60, 0, 0)
    localiser = amcl(ROBUST, HERE)
    estimate = localiser.update(Pose(0.0, 0.0, 0.0), Sweep(ranges, Pose(0.0, 0.0, 0.0)))
    told = localiser.outcome()
    assert (told["beams_strange"], told["beams_used"], told["blind"], told["resamplings"]) == (60, 0, 1, 0)
    assert estimate.pose == pytest.approx(HERE, abs=0.05) and estimate.lost < 0.001


@pytest.mark.parametrize("pose", [Pose(1e6, -1e6, 1.0), Pose(-0.9, -0.9, 2.0)], ids=["far", "corner"])
def test_a_pose_may_be_off_the_map(pose: Pose) -> None:
    points = ends(scan(ROOM, HERE))
    found = judged(points, pose)
    assert len(found.known) + found.strangers == len(points) >= found.agreeing + found.beyond
    score = explain(FIELD.grid, points, BEAMS.mount, np.array([pose]).T, beam_scores(FIELD, 0.1)).score
    assert -2.0 <= score[0] <= 1.0


NO_PEERS = np.empty((0, 2))


def beams_twin(
    ranges: NDArray[np.uint16], chosen: Beams, pose: Pose, peers: list[Point], radius: float
) -> tuple[list[tuple[float, float]], int]:
    points, masked = [], 0
    for ray, (dx, dy) in zip(chosen.rays.tolist(), chosen.directions.tolist(), strict=True):
        length = ranges[ray] / 1000
        if ranges[ray] == NO_ECHO_MM or length >= chosen.reach:
            continue
        local = (chosen.mount[0] + length * dx, chosen.mount[1] + length * dy)
        end = pose.compose(Pose(*local, 0.0)).point
        if any(end.distance_to(peer) <= radius for peer in peers):
            masked += 1
        else:
            points.append(local)
    return points, masked


def believed(ranges: NDArray[np.uint16], pose: Pose = HERE, peers: Floats = NO_PEERS) -> EndPoints:
    return measurement.end_points(ranges, BEAMS, pose, peers, 0.45)


@pytest.mark.parametrize(("model", "view"), [(TURTLEBOT, 360.0), (CAMERA, 58.0)], ids=["all round", "camera"])
@pytest.mark.parametrize("count", [7, 60])
def test_beams_lie_at_equal_angles_over_the_whole_view(model: RobotModel, view: float, count: int) -> None:
    chosen = measurement.beams(model.sensor, count)
    angles = np.unwrap(scan_angles(model.sensor)[chosen.rays])
    spaces = count if view == 360.0 else count - 1
    gaps = np.diff(angles)
    assert len(chosen.rays) == count
    assert gaps == pytest.approx(math.radians(view) / spaces, abs=1.01 * model.sensor.increment)
    few = replace(TURTLEBOT.sensor, rays=12)
    assert measurement.beams(few, 60).rays.tolist() == list(range(12))
    if view < 360:
        assert chosen.rays[0] == 0 and chosen.rays[-1] == model.sensor.rays - 1


def test_beams_without_an_echo_or_at_full_range_are_ignored() -> None:
    ranges = np.full(640, 1000, np.uint16)
    ranges[BEAMS.rays[:10]] = NO_ECHO_MM
    ranges[BEAMS.rays[10:15]] = 6500
    found = believed(frozen(ranges))
    assert found.points.shape == (45, 2)
    assert np.hypot(*(found.points - BEAMS.mount).T) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(4))
def test_kernel_equals_the_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    peers = [Point(*at) for at in rng.uniform(1, 7, (2, 2)).tolist()]
    ranges = scan(ROOM, HERE, np.array([(*peer, 0.2) for peer in peers]))
    away = Pose(HERE.x + rng.normal(0, 0.3), HERE.y + rng.normal(0, 0.3), HERE.heading + rng.normal(0, 0.2))
    points, masked = beams_twin(ranges, BEAMS, away, peers, 0.45)
    found = believed(ranges, away, np.array(peers))
    assert found.masked == masked
    assert found.points == pytest.approx(np.array(points))
