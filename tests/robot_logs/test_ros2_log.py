"""`acrc export --mcap`: the ROS 2 log of a run with orders, decoded by another library."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from acrc_testbed.command_line.replay_commands import export
from acrc_testbed.export import robot_entries, ros2_log
from acrc_testbed.export.log_export import LogReport, log_run, robot_models, sensor_data
from acrc_testbed.export.robot_entries import RunEntries, occupancy
from acrc_testbed.export.ros2_log import ROBOT_TYPES, SHARED_TYPES, LogEntry
from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.run_model.data import RunData, Trajectory
from acrc_testbed.run_model.recording_readers import messages_on
from acrc_testbed.run_model.robot_introspection import RecordedProcess
from acrc_testbed.run_model.simulated_runs import RunReader, read_run
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN
from actors.geometry import Pose
from actors.installation.usage import OptionError
from actors.messages import DRIVE, SENSES, Odometry, Scan, SensorData
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from tests.field_trial.runs import clock, copies, rewrite
from tests.recorded_runs import HEAD_ON, record

Log = dict[str, list[tuple[int, Any]]]
"""Messages by topic: log time, ns, and the decoded message."""
ADD, DELETE_ALL = 0, 3
CYLINDER, LINES = 3, 5


EVENTS: Final = """
event = [
    { at = 1.0, obstacle = [14.0, 12.0], radius = 0.2 },
    { at = 2.0, jam = [5.0, 12.0], radius = 1.5, duration = 2.0 },
    { at = 3.0, close = [12.5, 9.4] },
    { at = 4.0, freeze = "r2" },
    { at = 6.0, thaw = "r2" },
    { at = 7.0, restart = "r1" },
]
"""
MODEL = load_model("turtlebot2")
SCAN = Scan(0, b"\0\0" * MODEL.sensor.rays)
GOOD = SensorData(
    step=0, instant=0, events=0, odometry=Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), bumper=0,
    scan=SCAN,
)  # fmt: skip


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of ten seconds of two robots with localisation."""
    folder = tmp_path_factory.mktemp("logs") / "run"
    record(folder, EVENTS + HEAD_ON.read_text().replace('"odometry"', '"chapter"'), duration=10.0)
    return folder


@pytest.fixture(scope="module")
def evidence(out: Path) -> RunData:
    return read_run(out)


def write(out: Path, path: Path, *robots: str) -> LogReport:
    return log_run(out, path, robots)


def decoded(path: Path) -> Log:
    """Read a log with the schemas in the file only."""
    found: Log = defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages(log_time_order=False):
            found[channel.topic].append((message.log_time, content))
    return dict(found)


@pytest.fixture(scope="module")
def ros2_file(out: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ros2") / "log.mcap"
    assert write(out, path).notes == ()
    return path


@pytest.fixture(scope="module")
def ros2(ros2_file: Path) -> Log:
    return decoded(ros2_file)


def stamp(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def pose(told: Any) -> Pose:
    turned = told.orientation
    assert turned.x == turned.y == 0 and turned.z**2 + turned.w**2 == pytest.approx(1)
    return Pose(told.position.x, told.position.y, 2 * math.atan2(turned.z, turned.w))


def placed(transform: Any) -> Pose:
    shift, turned = transform.transform.translation, transform.transform.rotation
    return Pose(shift.x, shift.y, 2 * math.atan2(turned.z, turned.w))


def near(one: Pose, other: Pose) -> bool:
    turned = math.remainder(one.heading - other.heading, math.tau)
    return math.hypot(one.x - other.x, one.y - other.y) < 1e-9 and abs(turned) < 1e-9


def shapes(log: Log, topic: str) -> dict[float, list[Any]]:
    """Return the markers by time; each message starts with DELETEALL."""
    found = {}
    for logged, message in log[topic]:
        first, *markers = message.markers
        assert first.action == DELETE_ALL and all(one.action == ADD for one in markers)
        found[logged / 1e9] = markers
    return found


def test_the_file_has_what_rosbag2_needs(ros2_file: Path) -> None:
    with ros2_file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2" and summary is not None
        (about,) = reader.iter_metadata()
        assert (about.name, about.metadata) == ("rosbag2", {"serialized_metadata": ""})
        latched = set()
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert (qos["history"], qos["reliability"], qos["liveliness"]) == (1, 1, 1)
            assert (qos["durability"], qos["depth"]) in {(1, 1), (2, 10)}
            if qos["durability"] == 1:
                latched.add(channel.topic)
        assert latched == {
            "/map", "/tf_static", "/acrc/items", "/acrc/robots", "/acrc/things", "/acrc/r1/destination",
            "/acrc/r2/destination",
        }  # fmt: skip
        found = {one.topic: summary.schemas[one.schema_id].name for one in summary.channels.values()}
        assert found == SHARED_TYPES | {
            f"/acrc/{robot}/{name}": kind for robot in ("r1", "r2") for name, kind in ROBOT_TYPES.items()
        }
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times) and times[0] == 0


def test_commanded_velocities_are_those_that_the_world_received(ros2: Log, out: Path) -> None:
    sent = [(robot, drive.vx, drive.omega) for robot, drive in messages_on(out / "world/world.mcap", DRIVE)]
    for robot in ("r1", "r2"):
        told = [(message.linear.x, message.angular.z) for _, message in ros2[f"/acrc/{robot}/cmd_vel"]]
        assert told == [tuple(velocity) for one, *velocity in sent if one == robot]
        assert any(forward for forward, _ in told)
    assert [at for at, _ in ros2["/acrc/r2/cmd_vel"]] == [at for at, _ in ros2["/acrc/r2/odom"]]


def test_true_and_estimated_poses_are_those_of_every_step(ros2: Log, evidence: RunData) -> None:
    for index, robot in enumerate(evidence.robots):
        true = ros2[f"/acrc/{robot}/truth"]
        assert [logged for logged, _ in true] == [round(second * 1e6) * 1000 for second in evidence.seconds]
        for (logged, message), wanted in zip(true, evidence.true[:, index].tolist(), strict=True):
            assert stamp(message.header.stamp) == logged and message.header.frame_id == "map"
            assert near(pose(message.pose), Pose(*wanted))
        held = evidence.estimated[:, index]
        told = [message.pose for _, message in ros2[f"/acrc/{robot}/amcl_pose"]]
        wanted_poses = held[~np.isnan(held[:, 0])].tolist()
        assert len(told) == len(wanted_poses) > 70
        assert all(near(pose(m.pose), Pose(*w)) for m, w in zip(told, wanted_poses, strict=True))


def test_estimates_have_the_covariance_of_the_filter(ros2: Log, out: Path) -> None:
    for internals in read_run(out, internals=True).internals:
        name, planar = internals.process.robot, np.ix_((0, 1, 5), (0, 1, 5))
        told = {logged // 1000: message for logged, message in ros2[f"/acrc/{name}/amcl_pose"]}
        for one in internals.step_estimates:
            covariance = np.reshape(told[round(one.second * 1e6)].pose.covariance, (6, 6))
            assert covariance[planar].reshape(-1).tolist() == list(one.quality.covariance)
            assert np.count_nonzero(covariance) == np.count_nonzero(one.quality.covariance)
        assert internals.step_estimates[-1].quality.covariance[0] > 0


@pytest.mark.parametrize("length", [1, 13])
def test_parts_of_a_run_have_the_bytes_of_the_whole(
    length: int, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, files = read_run(out, internals=True), recordings(out)
    models = robot_models(whole, files)
    sensed = {one.actor: sensor_data(files[one.actor]) for one in whole.processes}
    wanted = encoded(RunEntries(whole.description, models).take(whole, sensed))
    entries = RunEntries(whole.description, models)
    found: dict[str, list[tuple[int, int, bytes]]] = defaultdict(list)
    with RunReader(out, internals=True, senses=True) as reader:
        for until in [*range(0, 100, length), None]:
            monkeypatch.setattr(reader, "_last_complete_step", lambda until=until: until)
            if (part := reader.poll(last=until is None)) is not None:
                for topic, messages in encoded(entries.take(part, part.senses)).items():
                    found[topic] += messages
    assert found == wanted and "/acrc/links" in wanted


def encoded(entries: Iterable[LogEntry]) -> dict[str, list[tuple[int, int, bytes]]]:
    """Return log time, stamp and bytes of messages by topic."""
    found: dict[str, list[tuple[int, int, bytes]]] = defaultdict(list)
    for one in entries:
        found[one.topic].append((one.logged, one.stamp, one.encode()))
    return found


def test_frames_lead_from_the_map_to_the_estimate_and_to_the_truth(ros2: Log, evidence: RunData) -> None:
    frames: dict[tuple[int, str], tuple[str, Pose]] = {}
    for logged, message in ros2["/tf"]:
        for one in message.transforms:
            assert stamp(one.header.stamp) == logged
            frames[logged, one.child_frame_id] = (one.header.frame_id, placed(one))
    for index, robot in enumerate(evidence.robots):
        compared = 0
        for logged, message in ros2[f"/acrc/{robot}/amcl_pose"]:
            parent, odom = frames[logged, f"{robot}/odom"]
            between, base = frames[logged, f"{robot}/base_link"]
            assert (parent, between) == ("map", f"{robot}/odom")
            assert near(odom.compose(base), pose(message.pose.pose))
            parent, true = frames[logged, f"{robot}/truth"]
            step = int(np.flatnonzero(np.isclose(evidence.seconds, logged / 1e9))[0])
            assert parent == "map" and near(true, Pose(*evidence.true[step, index].tolist()))
            compared += 1
        assert compared > 70
    ((_, static),) = ros2["/tf_static"]
    assert [(one.header.frame_id, one.child_frame_id) for one in static.transforms] == [
        ("r1/base_link", "r1/laser"),
        ("r2/base_link", "r2/laser"),
    ]
    assert static.transforms[0].transform.translation.x == -0.1  # turtlebot2.toml


def test_scans_are_as_recorded_and_infinite_without_echo(ros2: Log, out: Path) -> None:
    recorded = [
        scan
        for path in (out / "r1" / "r1.mcap", out / "r1" / "r1.1.mcap")
        for _, senses in messages_on(path, SENSES)
        if not senses.halt
        for scan in (*senses.earlier_scans, *([senses.scan] if senses.scan else []))
    ]
    told = [message for _, message in ros2["/acrc/r1/scan"]]
    assert [stamp(one.header.stamp) for one in told] == [scan.stamp * 1000 for scan in recorded]
    seen = infinite = 0
    for message, scan in zip(told, recorded, strict=True):
        ranges = np.array(message.ranges)
        millimetres = np.frombuffer(scan.ranges_mm, "<u2")
        nothing = millimetres == 65535
        assert message.header.frame_id == "r1/laser" and len(ranges) == len(millimetres)
        assert np.isposinf(ranges[nothing]).all()
        assert np.abs(ranges[~nothing] - millimetres[~nothing] / 1000).max() < 1e-6
        last = message.angle_min + (len(ranges) - 1) * message.angle_increment
        assert last == pytest.approx(message.angle_max, abs=1e-5)
        seen, infinite = seen + int((~nothing).sum()), infinite + int(nothing.sum())
    assert seen > 1000 and infinite > 1000


def test_the_map_is_the_robots_map(ros2: Log, evidence: RunData) -> None:
    ((_, told),) = ros2["/map"]
    grid = evidence.grid
    assert (told.info.height, told.info.width) == grid.cells.shape
    assert told.info.resolution == pytest.approx(grid.resolution)
    assert pose(told.info.origin) == (*grid.origin, 0.0)
    cells = np.array(told.data).reshape(grid.cells.shape)
    for kind, value in ((FREE, 0), (OCCUPIED, 100), (UNKNOWN, -1)):
        assert (grid.cells == kind).any() and (cells[grid.cells == kind] == value).all()


def test_costs_have_the_numbers_of_an_occupancy_grid() -> None:
    costs = np.array([[0, 1, 252, 253, 254, 255]], np.uint8)
    assert occupancy(costs).tolist() == [[0, 1, 98, 99, 100, -1]]
    every = occupancy(np.arange(255, dtype=np.uint8))
    assert (np.diff(every) >= 0).all()


def test_a_cost_map_lies_around_its_robot(ros2: Log) -> None:
    held = {logged: pose(message.pose.pose) for logged, message in ros2["/acrc/r1/amcl_pose"]}
    for logged, message in ros2["/acrc/r1/local_costmap/costmap"]:
        side = message.info.width * message.info.resolution
        middle = pose(message.info.origin).compose(Pose(side / 2, side / 2, 0.0))
        assert math.dist(middle[:2], held[logged][:2]) < 0.2
        assert min(message.data) >= -1 and max(message.data) == 100


def test_plans_lead_from_the_robot_to_its_goal(ros2: Log) -> None:
    goal, name = shapes(ros2, "/acrc/r1/destination")[0.0]
    assert (goal.type, name.text) == (CYLINDER, "r1/0") and goal.pose.position.x == name.pose.position.x
    plan = next(message for _, message in ros2["/acrc/r1/plan"] if message.poses)
    held = pose(ros2["/acrc/r1/amcl_pose"][0][1].pose.pose)
    assert math.dist(pose(plan.poses[0].pose)[:2], held[:2]) < 0.3
    assert math.dist(pose(plan.poses[-1].pose)[:2], pose(goal.pose)[:2]) < 0.3


def test_particles_are_at_the_estimate(ros2: Log) -> None:
    _, message = ros2["/acrc/r1/particles"][-1]
    points = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 3)
    assert message.point_step == 12 and message.width == len(points) > 100
    last = pose(ros2["/acrc/r1/amcl_pose"][-1][1].pose.pose)
    assert np.hypot(*(points[:, :2].mean(axis=0) - last[:2])) < 0.3 and not points[:, 2].any()


def test_orders_add_and_remove_floor_objects(ros2: Log) -> None:
    things = shapes(ros2, "/acrc/things")
    kinds = {second: sorted(one.type for one in found) for second, found in things.items()}
    assert kinds[1.0] == [CYLINDER] and kinds[2.0] == [CYLINDER, CYLINDER]
    assert kinds[3.0] == [CYLINDER, CYLINDER, LINES] and kinds[4.0] == [CYLINDER, LINES]
    (obstacle,) = things[1.0]
    assert (obstacle.pose.position.x, obstacle.pose.position.y, obstacle.scale.x) == (14.0, 12.0, 0.4)
    (door,) = (one for one in things[4.0] if one.type == LINES)
    middle = np.mean([(one.x, one.y) for one in door.points], axis=0)
    assert math.dist(middle, (12.5, 9.4)) < 0.6


def test_items_and_bodies_are_in_the_robots_colours_and_states(ros2: Log, evidence: RunData) -> None:
    items = shapes(ros2, "/acrc/items")[0.0]
    wanted = [(mark.x, mark.y) for second, mark in evidence.marks if second == 0.0]
    assert [(one.pose.position.x, one.pose.position.y) for one in items] == wanted
    assert [one.ns for one in items] == ["r1"] * 3 + ["r2"] * 3
    red, orange = items[0].color, items[-1].color
    assert (red.r, red.b) == (0.0, pytest.approx(178 / 255)) and orange.r == pytest.approx(213 / 255)
    opacity = {
        second: {one.ns: one.color.a for one in found if one.type == CYLINDER}
        for second, found in shapes(ros2, "/acrc/robots").items()
    }
    assert opacity[0.0]["r2"] == pytest.approx(0.9) and opacity[4.0]["r2"] == pytest.approx(0.4)
    assert opacity[6.0]["r2"] == pytest.approx(0.9)
    assert all(one.frame_locked for one in shapes(ros2, "/acrc/robots")[0.0])


def test_a_frozen_robot_logs_nothing(ros2: Log) -> None:
    logged = np.array([one for one, _ in ros2["/acrc/r2/odom"]]) / 1e9
    assert not ((logged > 4.0) & (logged < 5.9)).any() and (logged > 6.0).any()


def test_receptions_are_lines_between_robots(ros2: Log, evidence: RunData) -> None:
    links = shapes(ros2, "/acrc/links")
    second, (line,) = next((second, found) for second, found in links.items() if found)
    step = round(second / 0.1)
    ends = [(one.x, one.y) for one in line.points]
    assert ends == [tuple(one) for one in evidence.true[step, :, :2].tolist()]
    assert ((second - 1 <= evidence.heard[:, 0]) & (evidence.heard[:, 0] <= second)).any()


def test_the_command_never_overwrites(out: Path, ros2_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export(out, mcap="ros2")
    path = out.with_name("run.ros2.mcap")
    said = capsys.readouterr().out.replace("\n", " ")
    assert said.startswith(f"{path}: ") and " messages of 26 topics, " in said
    assert path.read_bytes() == ros2_file.read_bytes()
    with pytest.raises(OptionError, match="give a new file"):
        export(out, mcap="ros2")


def test_other_robots_have_poses_only(out: Path, tmp_path: Path) -> None:
    report = write(out, tmp_path / "one.mcap", "r2")
    of_others = {topic for topic in report.counts if topic.startswith("/acrc/r1/")}
    assert of_others == {"/acrc/r1/truth", "/acrc/r1/amcl_pose"} and report.counts["/acrc/r2/scan"] > 50


def test_hardware_runs_have_no_ground_truth(out: Path, tmp_path: Path) -> None:
    trial = copies(out, tmp_path / "trial", {"r2": clock(0)})
    for path in (out / "r1").glob("*.mcap"):
        rewrite(path, trial / "r1" / path.name, {"r1": clock(5_000_000)}, lidar=clock(0))
    bare, early = write(trial, tmp_path / "trial.mcap").notes
    assert bare == "the recordings have no map; the floor is drawn empty"
    # The clock of r1 is 5 s ahead of its scans' stamps.
    assert early.startswith("/acrc/r1/scan: 41 messages")
    log = decoded(tmp_path / "trial.mcap")
    assert "/acrc/things" not in log and not any(topic.endswith("/truth") for topic in log)
    frames = {one.child_frame_id for _, message in log["/tf"] for one in message.transforms}
    assert frames == {f"{robot}/{name}" for robot in ("r1", "r2") for name in ("odom", "base_link")}
    bodies = shapes(log, "/acrc/robots")[0.0]
    assert {one.header.frame_id for one in bodies} == {"r1/base_link", "r2/base_link"}
    assert max(logged for logged, _ in log["/acrc/r1/scan"]) < 11e9


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"mcap": "foxglove"}, "--mcap: foxglove; must be ros2, which RViz and Foxglove read"),
        ({"mcap": "ros2", "robot": ["r9"]}, "--robot: r9; must be one of r1, r2"),
        ({"robot": ["r1"]}, "--robot: requires --mcap; tables contain all robots"),
        ({"mcap": "ros2", "out": "empty"}, "empty: not a run folder: it contains no */*.mcap"),
    ],
)
def test_wrong_options(options: dict[str, Any], sentence: str, out: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    given = {"out": out, "folder": tmp_path / "new"} | options
    given["out"] = tmp_path / given["out"]
    with pytest.raises(AcrcError) as raised:
        export(**given)
    assert str(raised.value).endswith(sentence)
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def entries(*told: SensorData) -> tuple[list[LogEntry], Counter[str]]:
    """Return the log entries of a robot that reports no pose, and the counts of rejected messages."""
    left_out = Counter[str]()
    source = RecordedProcess("r1", "r1", lambda instants: instants / 1e6)
    none = np.zeros((0, 3))
    track = Trajectory(np.zeros(0), none, none, none, ())
    return list(robot_entries.sensor_entries(source, told, track, MODEL, left_out)), +left_out


def test_invalid_messages_are_left_out_and_counted() -> None:
    replace = msgspec.structs.replace
    short, late = Scan(0, b"\0\0\0"), replace(SCAN, stamp=2**63)
    found, left_out = entries(
        GOOD,
        replace(GOOD, scan=short),
        replace(GOOD, earlier_scans=(late,)),
        replace(GOOD, instant=-(2**63)),
        replace(GOOD, halt=True),
    )
    assert left_out == {"/acrc/r1/scan": 2, "/acrc/r1/odom": 1}
    assert Counter(one.topic for one in found) == {"/tf": 3, "/acrc/r1/odom": 3, "/acrc/r1/scan": 2}


@pytest.mark.parametrize("instant", [-1, 2**31 * 1_000_000])
def test_an_instant_beyond_ros_time_is_left_out(instant: int, tmp_path: Path) -> None:
    left_out = Counter[str]()
    given = [
        LogEntry(0, "/rosout", ros2_log.log_line("r1", "a", 0), 0),
        LogEntry(0, "/rosout", None, instant),
    ]
    counts = ros2_log.write(tmp_path / "a.mcap", given, left_out)
    assert (counts["/rosout"], left_out["/rosout"]) == (1, 1)
