"""One run in which much is ordered, written in both forms, and read again by readers that wrote neither."""

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import McapReader, make_reader
from mcap_ros2.decoder import DecoderFactory

from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.isolation import sandbox
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from observation.evidence.run_evidence import RunEvidence
from observation.evidence.run_reader import read_run
from observation.robot_logs.logging_run import LogReport, form_of, log_run

Log = dict[str, list[tuple[int, Any]]]
"""By topic: when each message was logged, ns, and what it says."""
EVENTS: Final = """
[[event]]
at = 1.0
obstacle = [14.0, 12.0]
radius = 0.2

[[event]]
at = 2.0
jam = [5.0, 12.0]
radius = 1.5
duration = 2.0

[[event]]
at = 3.0
close = [12.5, 9.4]

[[event]]
at = 4.0
freeze = "r2"

[[event]]
at = 6.0
thaw = "r2"

[[event]]
at = 7.0
restart = "r1"
"""


@pytest.fixture(scope="session")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots that localise, for ten seconds."""
    folder = tmp_path_factory.mktemp("logs")
    shipped = (REPOSITORY / "scenarios" / "head_on.toml").read_text()
    own = shipped.replace('"odometry"', '"chapter"').replace("../maps", str(REPOSITORY / "maps"))
    (folder / "own.toml").write_text(own.replace("duration = 600.0", "duration = 10.0") + EVENTS)
    settled = load_scenario(folder / "own.toml")
    swarm.run_in_memory(swarm.plan(settled, RunOptions(folder / "run", bus="memory")), lambda progress: None)
    return folder / "run"


@pytest.fixture(scope="session")
def evidence(out: Path) -> RunEvidence:
    return read_run(out)


def write(out: Path, name: str, path: Path, *robots: str) -> LogReport:
    isolate = sandbox.available() is None
    return log_run(out, path, form_of(name), robots, permit=INSTALLED, isolate=isolate)


@pytest.fixture(scope="session")
def ros2_file(out: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ros2") / "log.mcap"
    assert write(out, "ros2", path).notes == ()
    return path


@pytest.fixture(scope="session")
def foxglove_file(out: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foxglove") / "log.mcap"
    assert write(out, "foxglove", path).notes == ()
    return path


@pytest.fixture(scope="session")
def ros2(ros2_file: Path) -> Log:
    """By a decoder that knows of the schemas in the file alone."""
    found: Log = defaultdict(list)
    with ros2_file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            found[channel.topic].append((message.log_time, decoded))
    return dict(found)


@pytest.fixture(scope="session")
def foxglove(foxglove_file: Path) -> Log:
    with foxglove_file.open("rb") as stream:
        return parsed(make_reader(stream, validate_crcs=True))


def parsed(reader: McapReader) -> Log:
    """By the descriptors that are in the file."""
    found: Log = defaultdict(list)
    kinds: dict[int, Callable[[], Any]] = {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        assert schema is not None and schema.encoding == channel.message_encoding == "protobuf"
        if schema.id not in kinds:
            pool = DescriptorPool()
            for file in FileDescriptorSet.FromString(schema.data).file:
                pool.Add(file)
            kinds[schema.id] = GetMessageClass(pool.FindMessageTypeByName(schema.name))
        told = kinds[schema.id]()
        told.ParseFromString(message.data)
        found[channel.topic].append((message.log_time, told))
    return dict(found)
