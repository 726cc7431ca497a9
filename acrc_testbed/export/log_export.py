"""Export of a run as one ROS 2 log of all its robots (`acrc export --mcap`)."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from acrc_testbed.export.robot_entries import RunEntries
from acrc_testbed.export.ros2_log import write
from acrc_testbed.recordings.run_recordings import all_recordings, read_setup
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.hardware_runs import whole_run
from acrc_testbed.run_model.recording_readers import messages_on, world_setup
from acrc_testbed.run_model.robot_introspection import NOT_RECORDED
from actors.installation.usage import OptionError, wrong_value
from actors.messages import SENSES, SensorData
from actors.robot.assembly import RobotSetup
from actors.robot_model import RobotModel, load_model
from actors.runtime import regular_file
from actors.runtime.process_setup import resolve_model


@dataclass(frozen=True)
class LogReport:
    """Messages and gaps of a log."""

    counts: Counter[str]
    notes: tuple[str, ...]
    """Missing or unknown data, a sentence each."""


def log_run(out: Path, path: Path, robots: Sequence[str]) -> LogReport:
    """Write the log of a simulated or hardware run to a new file.

    `robots`: log all data of these, and only the poses of others; empty: of all. Raises OptionError for an
    unknown robot or an existing file, RecordingError and the like for an invalid run.
    """
    if path.exists() or path.is_symlink():
        raise OptionError(f"--out: {path} exists; give a new file")
    files = all_recordings(out)
    run = whole_run(out)
    for robot in robots:
        if robot not in run.robots:
            raise wrong_value("--robot", robot, f"one of {', '.join(run.robots)}")
    entries = RunEntries(run.description, robot_models(run, files), robots)
    sensed = {source.actor: sensor_data(files[source.actor]) for source in run.processes}
    with regular_file.atomic_replacement(path) as part:
        counts = write(part, entries.take(run, sensed), entries.left_out)
    faults = [
        f"{one.process.actor}: {NOT_RECORDED}"
        for one in run.internals
        if not one.is_recorded and (not robots or one.process.robot in robots)
    ]
    absent = [
        f"{topic}: {count} messages with invalid instants or ranges are left out"
        for topic, count in sorted(entries.left_out.items())
        if count
    ]
    return LogReport(counts, tuple(dict.fromkeys((*run.notes, *faults, *absent))))


def sensor_data(path: Path) -> Iterator[SensorData]:
    """Yield a process's sensor data. Raises RecordingError and WireError."""
    return (senses for _, senses in messages_on(path, SENSES))


def robot_models(run: RunData, files: Mapping[str, Path]) -> dict[str, RobotModel]:
    """Return each robot's model from the world's set-up, or else its own."""
    if "world" in files:
        bodies = world_setup(files["world"]).robots
        return {body.id: load_model(body.model, body.sensor) for body in bodies}
    found = {}
    for source in run.processes:
        setup = read_setup(files[source.actor], RobotSetup, "a robot")
        found[source.robot] = load_model(resolve_model(setup.model, files[source.actor].parent), setup.sensor)
    return found
