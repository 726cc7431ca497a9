"""Which beams the filter looks at, and which it does not believe."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.messages import NO_ECHO_MM
from actors.robot.localisation import beams
from actors.robot.localisation.beams import Beams, Ends, ends
from actors.robot_model import RobotModel, scan_angles
from tests.localisation.scenes import CAMERA, ROOM, TURTLEBOT, frozen, scan

ALL = beams.beams(TURTLEBOT.sensor, 60)
HERE = Pose(3.2, 4.0, 0.4)
NOBODY = np.empty((0, 2))


def twin(
    ranges: NDArray[np.uint16], chosen: Beams, pose: Pose, peers: list[Point], radius: float
) -> tuple[list[tuple[float, float]], int]:
    """The kernel's twin in plain Python."""
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


def believed(ranges: NDArray[np.uint16], pose: Pose = HERE, peers: NDArray[np.float64] = NOBODY) -> Ends:
    return ends(ranges, ALL, pose, peers, 0.45)


@pytest.mark.parametrize(("model", "view"), [(TURTLEBOT, 360.0), (CAMERA, 58.0)], ids=["all round", "camera"])
@pytest.mark.parametrize("count", [7, 30, 60])
def test_beams_lie_at_equal_angles_over_the_whole_view(model: RobotModel, view: float, count: int) -> None:
    chosen = beams.beams(model.sensor, count)
    angles = np.unwrap(scan_angles(model.sensor)[chosen.rays])
    spaces = count if view == 360.0 else count - 1
    gaps = np.diff(angles)
    assert len(chosen.rays) == count
    assert gaps == pytest.approx(math.radians(view) / spaces, abs=1.01 * model.sensor.increment)
    if view < 360:
        assert chosen.rays[0] == 0 and chosen.rays[-1] == model.sensor.rays - 1


def test_a_sensor_with_fewer_rays_gives_them_all() -> None:
    few = TURTLEBOT.sensor.model_copy(update={"rays": 12})
    assert beams.beams(few, 60).rays.tolist() == list(range(12))


def test_beams_without_an_echo_or_at_full_range_say_nothing() -> None:
    ranges = np.full(640, 1000, np.uint16)
    ranges[ALL.rays[:10]] = NO_ECHO_MM
    ranges[ALL.rays[10:15]] = 6500
    found = believed(frozen(ranges))
    assert found.points.shape == (45, 2)
    assert np.hypot(*(found.points - ALL.mount).T) == pytest.approx(1.0)


def test_beams_that_end_at_a_peer_are_masked_and_no_others() -> None:
    peer = Point(4.2, 4.8)
    ranges = scan(ROOM, HERE, np.array([[*peer, 0.18]]))
    free = scan(ROOM, HERE)
    hidden = int((ranges[ALL.rays] < free[ALL.rays] - 200).sum())
    found = believed(ranges, peers=np.array([peer]))
    assert 0 < hidden <= found.masked <= hidden + 2
    assert len(found.points) == len(believed(ranges).points) - found.masked
    assert believed(ranges).masked == 0


@pytest.mark.parametrize("seed", range(12))
def test_kernel_is_its_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    peers = [Point(*at) for at in rng.uniform(1, 7, (2, 2)).tolist()]
    ranges = scan(ROOM, HERE, np.array([(*peer, 0.2) for peer in peers]))
    away = Pose(HERE.x + rng.normal(0, 0.3), HERE.y + rng.normal(0, 0.3), HERE.heading + rng.normal(0, 0.2))
    points, masked = twin(ranges, ALL, away, peers, 0.45)
    found = believed(ranges, away, np.array(peers))
    assert found.masked == masked
    assert found.points == pytest.approx(np.array(points))


def test_no_pose_is_too_far_off_the_map_and_what_ends_in_the_open_stays() -> None:
    """What is a stranger is for `evidence` to say."""
    ranges = scan(ROOM, HERE, np.array([[4.2, 4.8, 0.18]]))
    for off in (HERE, Pose(-50.0, 3.0, 0.0), Pose(1e6, -1e6, 1.0)):
        assert np.array_equal(believed(ranges, off).points, believed(ranges).points)


def test_fingerprint_is_the_same_each_time() -> None:
    assert beams.fingerprint() == beams.fingerprint()
