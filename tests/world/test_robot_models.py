"""Robot models, and pose errors of robots."""

import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from actors import geometry
from actors.messages import RobotTruth
from actors.robot_model import load_model, scan_angles
from actors.runtime.errors import AcrcError
from actors.world.sensing import PoseError, PoseErrorSum
from tests.recorded_runs import HEAD_ON, record
from tests.refusals import refused


def _truth(x: float, y: float = 0.0) -> RobotTruth:
    return RobotTruth("r1", x, y, 0.0, 0.0, 0.0, 0.0, True, True, 0)


def test_errors_are_those_of_the_samples() -> None:
    errors = PoseErrorSum()
    assert errors.error() == PoseError(0, 0.0, 0.0, 0.0, 0.0, 0, False)
    for held, x in ((0.0, 0.3), (0.0, -0.6), (5.0, 5.0), (0.0, 1.2), (0.0, 1.5), (0.0, 0.9)):
        errors.add((held, 0.0, 1.0), _truth(x))
    error = errors.error()
    assert error.samples == 6
    assert error.rmse == pytest.approx(math.sqrt((0.09 + 0.36 + 1.44 + 2.25 + 0.81) / 6))
    assert (error.greatest, error.astray_share, error.lost_share) == (1.5, 4 / 6, 2 / 6)
    assert (error.times_lost, error.lost_at_end) == (1, False)
    errors = PoseErrorSum()
    for y in (1.1, 1.3, 0.0, 2.0):
        errors.add((0.0, 0.0, 0.0), _truth(0.0, y))
    assert (errors.error().times_lost, errors.error().lost_at_end) == (2, True)


MASS = "but must be a number above 0 and at most 10000"
SHIPPED = Path(__file__).parents[2] / "actors" / "models"


def refusal(tmp_path: Path, old: str, new: str) -> str:
    text = (SHIPPED / "omnibox.toml").read_text()
    assert old in text
    file = tmp_path / "broken.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(AcrcError) as caught:
        load_model(str(file))
    return str(caught.value).removeprefix(f"{tmp_path}/")


def test_models_and_sensors_are_loaded(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text((SHIPPED / "omnibox.toml").read_text())
    assert load_model(str(file), "lidar") == load_model("omnibox", "lidar")
    model = load_model("turtlebot2", sensor="kinect")
    assert (model.default_sensor, model.sensor.field_of_view_deg, model.sensor.range_min) == (
        "kinect",
        58,
        0.45,
    )
    model = load_model("turtlebot2")
    assert model.footprint.radius == model.footprint.circumradius == model.footprint.inradius == 0.177
    assert (model.mass, model.drive.speed, model.drive.watchdog, model.odometry) == (10, 0.5, 0.5, "exact")
    assert (model.default_sensor, model.sensor.rays, model.sensor.range_max) == ("chapter", 640, 5.0)
    assert model.sensor.full_circle and model.sensor.period == 100_000 and model.sensor.mount.x == -0.1


def test_robots_of_ros2_localise_with_their_lidars_and_clean_their_places(tmp_path: Path) -> None:
    scenario = HEAD_ON.read_text().replace('preset = "odometry"', 'preset = "chapter"')
    scenario = scenario.replace("[robots]", '[robots]\nmodel = "turtlebot3_burger"')
    result = record(tmp_path / "run", scenario.replace('id = "r1"', 'id = "r1"\nmodel = "turtlebot4"'))
    robots = json.loads(msgspec.json.encode(result.per_robot)).values()
    assert [robot["task"]["places_done"] for robot in robots] == [3, 3]
    assert max(robot["pose_error"]["rmse"] for robot in robots) < 0.05  # m


def test_a_full_circle_has_no_direction_twice_and_a_view_has_both_its_ends() -> None:
    full = scan_angles(load_model("turtlebot2").sensor)
    assert full[-1] == math.pi and full[319] == 0 and np.allclose(np.diff(full), math.tau / 640)
    view = scan_angles(load_model("turtlebot2", "kinect").sensor)
    assert view[0] == -view[-1] == pytest.approx(math.radians(-29)) and len(view) == 640


@given(st.floats(-179.9, 180), st.floats(1, 360), st.integers(2, 500))
def test_rays_point_within_the_circle_at_equal_angles(heading: float, view: float, rays: int) -> None:
    sensor = replace(load_model("omnibox").sensor, heading_deg=heading, field_of_view_deg=view, rays=rays)
    angles = scan_angles(sensor)
    assert angles.shape == (rays,) and (angles > -math.pi).all() and (angles <= math.pi).all()
    expected = sensor.mount.heading + sensor.first_angle + sensor.increment * np.arange(rays)
    assert np.allclose(np.exp(1j * angles), np.exp(1j * expected), atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("mass = 22.0", "mass = nan", f"mass is NaN, {MASS}"),
        ("mass = 22.0", "", f"mass is missing, {MASS}"),
        ("mass = 22.0", "mass = 22.0\ncolour = 'red'",
         "unknown key colour; known keys: name, mass, friction, odometry, default_sensor, "
         "footprint, drive, bumper, battery, stage_errors, kobuki_errors, sensors"),
        ("watchdog", "watch_dog", "unknown key drive.watch_dog; did you mean drive.watchdog?"),
        ("range_max = 8.0", "range_max = 0.1",
         "sensors.lidar must have a range_max above range_min, not 0.1 m and 0.15 m"),
        ("reach_deg = 100.0", "reach_deg = 30.0",
         "bumper must have a reach_deg of at least centre_deg, not 30 and 40"),
        ('"stage"', '"kobuki"',
         "the file must have a differential drive where odometry is 'kobuki', which reads two wheels"),
        ('default_sensor = "kinect"', 'default_sensor = "sonar"',
         'default_sensor is "sonar", but must be "kinect" or "lidar"'),
        ("vertices = [", "radius = 0.2\nvertices = [",
         "footprint must have either radius or vertices, but has both"),
        ("[0.19, 0.19]", "[0.0, 0.15]",
         "footprint must have the vertices of a convex polygon round (0, 0), but it is not convex "
         "at (0, 0.15)"),
        ("[0.19, 0.19]", "[0.19, true]",
         "footprint.vertices[2] is [0.19, true], but must be a point [x, y] in m"),
        ("[sensors.lidar]", "[sensors]\nlidar = 3\n[sensors.other]",
         "sensors.lidar is 3, but must be a table [sensors.lidar]"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    said = refusal(tmp_path, old, new)
    assert said == f"broken.toml: {sentence}"


def test_unknown_names_are_refused_with_those_that_exist(tmp_path: Path) -> None:
    with refused(
        'unknown robot model "turtlebot9"; must be "omnibox", "turtlebot2", "turtlebot3_burger", '
        '"turtlebot4" or the path of a .toml file'
    ):
        load_model("turtlebot9")
    with refused('turtlebot2.toml: the sensor is "sonar", but must be "chapter", "kinect" or "written"'):
        load_model("turtlebot2", "sonar")
    with refused(f"{tmp_path}/none.toml: the robot model file cannot be read: No such file or directory"):
        load_model(str(tmp_path / "none.toml"))


def test_polygons_not_around_the_origin_are_refused() -> None:
    star = [(math.cos(k * 0.8 * math.pi), math.sin(k * 0.8 * math.pi)) for k in range(5)]
    assert geometry.polygon_fault(star) == "its border goes around more than once"
    beside = [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)]
    assert geometry.polygon_fault(beside) == "(0, 0) is not inside the edge from (1, 0) to (2, 0)"
    rectangle = [(0.3, -0.2), (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2)]
    assert geometry.moment_of_inertia(rectangle, 12.0) == pytest.approx(12.0 * (0.6**2 + 0.4**2) / 12)
    ring = [(math.cos(a), math.sin(a)) for a in np.linspace(0, math.tau, 500, endpoint=False)]
    assert geometry.moment_of_inertia(ring, 2.0) == pytest.approx(1.0, rel=1e-3)


@given(st.lists(st.floats(0.05, 2.0), min_size=3, max_size=20), st.floats(0.1, 2.0))
def test_polygons_on_a_circle_are_convex_in_either_direction(gaps: list[float], radius: float) -> None:
    angles = np.cumsum(gaps) / sum(gaps) * math.tau
    ring = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    if max(gaps) / sum(gaps) < 0.49:  # otherwise the centre is outside
        assert geometry.polygon_fault(ring) == geometry.polygon_fault(ring[::-1]) == ""
        assert geometry.distance_to_border(ring) <= radius
