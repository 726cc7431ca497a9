"""Live ROS 2 topics of a run: queues, skipped and dropped messages, and a run watched by zenoh-ros2-sdk."""

import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.export.live_topics import LiveTopics, TopicQueues
from acrc_testbed.export.log_export import robot_models, sensor_data
from acrc_testbed.export.robot_entries import RunEntries
from acrc_testbed.export.ros2_log import ROBOT_TYPES, SHARED_TYPES, topic_type
from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.run_model.simulated_runs import RunReader, read_run
from actors.installation.repository import REPOSITORY
from firmware_bridge.ros2.message_types import decode
from firmware_bridge.ros2.names import LATCHED_QOS
from firmware_bridge.ros2.settings import RouterLink
from tests.helpers import free_port
from tests.recorded_runs import HEAD_ON, record
from tests.ros2.routers import start_router
from tests.ros2.test_session import session, wait_for
from tests.ros2.watcher import plain
from tests.swarm.command import acrc


def test_a_full_queue_drops_the_oldest_message_of_its_topic() -> None:
    queues = TopicQueues({"/tf": 2, "/map": 1})
    for number in range(4):
        queues.add("/tf", b"%d" % number)
        queues.add("/map", b"%d" % number)
    assert [(one.topic, one.payload) for one in queues.take()] == [
        ("/tf", b"2"), ("/tf", b"3"), ("/map", b"3"),
    ]  # fmt: skip
    assert queues.dropped == {"/tf": 2, "/map": 3}
    queues.close()
    assert queues.take() == []


class StuckPublisher:
    """A publisher whose reader has stopped."""

    def __init__(self) -> None:
        self.released = threading.Event()
        self.payloads: list[bytes] = []

    def put(self, payload: bytes, stamp_ns: int) -> None:
        self.released.wait()
        self.payloads.append(payload)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live") / "run"
    record(folder, HEAD_ON.read_text(), duration=6.0)
    return folder


def test_a_stopped_reader_delays_nothing_and_what_it_misses_is_counted(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher: Any = StuckPublisher()
    with RunReader(out, internals=True, senses=True) as reader:
        topics = LiveTopics(reader.description, lambda topic, kind: publisher)
        for until in range(2, 60, 3):
            monkeypatch.setattr(reader, "_last_complete_step", lambda until=until: until)
            part = reader.poll()
            assert part is not None
            topics.add(part)
    dropped = topics.queues.dropped.total()
    assert dropped > 100
    publisher.released.set()
    topics.close()
    assert len(publisher.payloads) == topics.published - dropped
    report = [*topics.report()]
    assert report[0] == f"ROS 2: {topics.published} messages were published on 27 topics"
    scans = topics.queues.dropped["/acrc/r1/scan"]
    assert f"ROS 2: /acrc/r1/scan: {scans} messages were dropped: a reader is slow" in report
    assert topics.skipped == 0


def test_a_fast_run_shows_the_newest_message_of_each_topic_and_frame(out: Path) -> None:
    publisher: Any = StuckPublisher()
    publisher.released.set()
    with RunReader(out, internals=True, senses=True) as reader:
        topics = LiveTopics(reader.description, lambda topic, kind: publisher)
        part = reader.poll(last=True)
    assert part is not None
    topics.add(part)
    topics.close()
    whole = entries_of(out)
    frames = {tuple(f.child_frame_id for f in one.message.transforms) for one in whole if one.topic == "/tf"}
    kept = {one.topic for one in whole} - {"/tf", "/rosout"}
    lines = sum(one.topic == "/rosout" for one in whole)
    assert topics.published == len(kept) + len(frames) + lines + 1 and not topics.queues.dropped.total()
    assert topics.published + topics.skipped == len(whole) + len(part.seconds)


def entries_of(out: Path) -> list[Any]:
    """Return all entries of a finished run."""
    run, files = read_run(out, internals=True), recordings(out)
    senses = {one.actor: sensor_data(files[one.actor]) for one in run.processes}
    return [*RunEntries(run.description, robot_models(run, files)).take(run, senses)]


def test_a_session_without_a_router_is_the_router() -> None:
    link = RouterLink(router=f"tcp/127.0.0.1:{free_port()}")
    with session(link, "run", serves=True) as first:
        wait_for(lambda: first.is_connected)
        publisher = first.publisher("/map", "std_msgs/msg/Header", LATCHED_QOS)
        with session(link, "other", serves=True) as second:
            wait_for(lambda: len(second.endpoints()) == 1)
            assert (first.is_router, second.is_router) == (True, False)
            assert second.publisher_names("/map") == {publisher.gid: "/run"}
            second.publisher("/tf_static", "std_msgs/msg/Header", LATCHED_QOS)
            wait_for(lambda: len(first.endpoints()) == 2)


def test_a_run_without_it_loads_nothing_of_ros_2(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from acrc_testbed.command_line.run import run; "
        f"run(duration='0.2', bus='memory', json=True, out=Path({str(tmp_path / 'out')!r})); "
        "loaded = [one for one in sys.modules if one.startswith(('rosbags', 'firmware_bridge.ros2'))]; "
        "assert not loaded, loaded"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--ros2", "--bus", "memory"), "--ros2: requires --bus zenoh; --bus memory has one process for all"),
        (("--router", "tcp/10.0.0.1:7447"), "--router: tcp/10.0.0.1:7447; requires --ros2"),
        (
            ("--ros2", "--router", "10.0.0.1"),
            '--ros2: router is "10.0.0.1", but must be an endpoint such as ',
        ),
    ],
)
def test_wrong_options_are_refused(words: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    refused = acrc("run", *words, "--out", tmp_path / "out")
    assert refused.returncode == 2 and refused.stderr.startswith(f"acrc: {sentence}"), refused.stderr


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_another_implementation_sees_a_running_swarm(tmp_path: Path) -> None:
    port = free_port()
    router = start_router(port)
    seen = tmp_path / "seen"
    with seen.open("w") as stream:  # not a pipe, which would have to be read during the run
        command = [sys.executable, "-m", "tests.ros2.watcher", str(port)]
        watcher = subprocess.Popen(command, cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=stream)
    try:
        wait_for(lambda: seen.read_text() == "ready\n", 60.0)
        words = ("--duration", "15", "--speed", "1", "--out", tmp_path / "out", "--json")
        ros2 = ("--ros2", "--router", f"tcp/127.0.0.1:{port}")
        done = acrc("run", HEAD_ON, *words, *ros2, timeout_s=120.0)
        assert done.returncode == 0, done.stderr
        watcher.communicate(timeout=30.0)
    finally:
        watcher.kill()
        router.close()  # type: ignore[no-untyped-call]
    messages = [json.loads(line) for line in seen.read_text().splitlines()[1:]]
    whole = entries_of(tmp_path / "out")
    for topic in ("/map", "/tf", "/acrc/r1/scan"):
        found = [content for name, content in messages if name == topic]
        kind = topic_type(topic)
        wanted = [plain(decode(one.encode(), kind)) for one in whole if one.topic == topic]
        assert found and all(one in wanted for one in found), topic
    (listed,) = (content for name, content in messages if name == "list")
    own = {f"/acrc/{robot}/{name}": kind for robot in ("r1", "r2") for name, kind in ROBOT_TYPES.items()}
    kinds = SHARED_TYPES | own | {"/clock": "rosgraph_msgs/msg/Clock"}
    assert {*listed} >= {f"{topic} [{kind}]" for topic, kind in kinds.items()}
    plain_run = acrc("run", HEAD_ON, "--duration", "15", "--bus", "memory", "--out", tmp_path / "b", "--json")
    assert json.loads(done.stdout)["digest"] == json.loads(plain_run.stdout)["digest"]
