"""Export of a run as one ROS 2 log of all its robots (`acrc export --mcap`)."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import merge
from operator import attrgetter
from pathlib import Path

from acrc_testbed.export.robot_entries import (
    body_entries,
    command_entries,
    estimate_entries,
    internal_entries,
    item_entries,
    link_entries,
    map_entry,
    obstacle_entries,
    sensor_entries,
    static_frames,
    true_entries,
)
from acrc_testbed.export.ros2_log import LogEntry, Spool, write
from acrc_testbed.recordings.run_recordings import all_recordings, read_setup
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.hardware_runs import whole_run
from acrc_testbed.run_model.recording_readers import world_setup
from acrc_testbed.run_model.robot_introspection import NOT_RECORDED, RecordedProcess
from actors.installation.usage import OptionError, wrong_value
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


def log_run(out: Path, path: Path, robots: Sequence[str] = ()) -> LogReport:
    """Write the log of a simulated or hardware run to a new file.

    `robots`: log all data of these, and only the poses of others; empty: of all. Raises OptionError for an
    unknown robot or an existing file, RecordingError and the like for an invalid run.
    """
    if path.exists() or path.is_symlink():
        raise OptionError(f"--out: {path} exists; give a new file")
    files = all_recordings(out)
    run = whole_run(out, internals=True)
    for robot in robots:
        if robot not in run.robots:
            raise wrong_value("--robot", robot, f"one of {', '.join(run.robots)}")
    models, left_out = _models(run, files), Counter[str]()
    sources = {one.actor: one for one in run.processes if not robots or one.robot in robots}
    internals = [one for one in run.internals if one.process.actor in sources]
    with Spool() as spool, regular_file.atomic_replacement(path) as part:
        for one in internals:
            spool.extend(internal_entries(one))
        entries = merge(*_streams(run, files, sources, models, spool, left_out), key=attrgetter("logged"))
        counts = write(part, entries, left_out)
    faults = [f"{one.process.actor}: {NOT_RECORDED}" for one in internals if not one.is_recorded]
    absent = [
        f"{topic}: {count} messages with invalid instants or ranges are left out"
        for topic, count in sorted(left_out.items())
        if count
    ]
    return LogReport(counts, tuple(dict.fromkeys((*run.notes, *faults, *absent))))


def _streams(
    run: RunData,
    files: Mapping[str, Path],
    sources: Mapping[str, RecordedProcess],
    models: Mapping[str, RobotModel],
    spool: Spool,
    left_out: Counter[str],
) -> Iterator[Iterator[LogEntry]]:
    """Yield streams of entries, each by time; entries of one instant keep the order of the streams."""
    yield iter((map_entry(run.grid), static_frames(models)))
    yield from (item_entries(run), body_entries(run, models))
    if run.floor:
        yield obstacle_entries(run)
    yield true_entries(run)
    for robot, track in run.trajectories.items():
        yield estimate_entries(robot, track)
    for actor, source in sources.items():
        track, model = run.trajectories[source.robot], models[source.robot]
        yield sensor_entries(files[actor], source, track, model, left_out)
    yield link_entries(run)
    yield spool.entries()
    for robot in dict.fromkeys(source.robot for source in sources.values()):
        yield command_entries(robot, run.trajectories[robot])


def _models(run: RunData, files: Mapping[str, Path]) -> dict[str, RobotModel]:
    """Return each robot's model from the world's set-up, or else its own."""
    if "world" in files:
        bodies = world_setup(files["world"]).robots
        return {body.id: load_model(body.model, body.sensor) for body in bodies}
    found = {}
    for source in run.processes:
        setup = read_setup(files[source.actor], RobotSetup, "a robot")
        found[source.robot] = load_model(resolve_model(setup.model, files[source.actor].parent), setup.sensor)
    return found
