"""Run model of hardware runs, from the robots' recordings with aligned clocks."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from acrc_testbed.recordings.run_recordings import read_run_note, recordings
from acrc_testbed.recordings.topics import recorded_span
from acrc_testbed.results.clocks import AlignedClocks
from acrc_testbed.results.field_recordings import FieldTrial, Moment, RobotLog, read_field_trial
from acrc_testbed.results.trial_judgement import judge_if_loadable
from acrc_testbed.run_model.data import RunData, RunDescription
from acrc_testbed.run_model.model import RunModel, convert_instants
from acrc_testbed.run_model.robot_introspection import RecordedProcess, RobotInternals, process_model
from acrc_testbed.run_model.simulated_runs import recorded_run
from actors.array_types import Floats, Int64s
from actors.floor.grid import FREE, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import INTROSPECTION, RECEIVED, SENSES, TASK_CHANGED, Drive
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Note, read_recording
from actors.runtime.replay_bus import topic_of
from actors.topic import Message

_MARGIN: Final = 2.0
"""Margin around the robots' estimates on a floor without a map, m."""
_CELL: Final = 0.1


def whole_run(out: Path) -> RunData:
    """Return the recorded part of a simulated or hardware run, with introspection. Raises an AcrcError."""
    if "world" not in recordings(out):
        return collected_run(out)
    run = recorded_run(out, internals=True)
    if (out / "run.json").is_file():
        return run
    title = f"{run.description.title}, {recorded_span(out, run.end)}"
    return replace(run, description=replace(run.description, title=title))


def collected_run(out: Path) -> RunData:
    """Read a folder with the robots' folders. Raises FieldTrialError if they are not of one trial."""
    trial = read_field_trial([out])
    clocks = AlignedClocks(trial)
    times = {id(log): TrialClock(log, clocks) for log in trial.all_logs()}
    grid, missing = trial_map(trial)
    judgement = judge_if_loadable(trial, clocks)
    model = RunModel(
        RunDescription(
            out=out,
            title=f"{len(trial.logs)} robots, from their own recordings",
            robots=tuple(trial.logs),
            grid=grid,
            step_us=next(trial.all_logs()).identity.step_us,
            task=judgement.declaration,
            item_counts={robot: len(logs[0].identity.items) for robot, logs in trial.logs.items()},
            addresses={log.identity.address: log.identity.id for log in trial.all_logs()},
            has_truth=False,
        )
    )
    for second, key, message in sorted(_messages(trial, times), key=lambda one: one[0]):
        model.extend(key, message, second)
    for instant, changed in judgement.changes:
        model.extend(TASK_CHANGED.key(), changed, instant / 1e6)
    for robot, second, state in _state_changes(trial, times):
        model.set_state(robot, second, state)
    for sentence in (*trial.notes, *clocks.notes, *judgement.notes, *missing):
        model.add_note(sentence)
    processes = [
        RecordedProcess(log.path.stem, log.identity.id, times[id(log)].seconds) for log in trial.all_logs()
    ]
    run = replace(model.take_reports(clocks.span / 1e6, processes), items=judgement.outcome.items)
    return replace(run, internals=tuple(map(_introspection, trial.all_logs(), processes)))


def _introspection(log: RobotLog, process: RecordedProcess) -> RobotInternals:
    """Return a robot's introspection up to the first damage of its recording."""
    model = process_model(process, log.path, read_run_note(log.path))
    topics = (SENSES, RECEIVED, INTROSPECTION)
    with suppress(AcrcError):  # the trial's notes report the damage
        for item in read_recording(log.path):
            if not isinstance(item, Note) and item.payload is not None and topic_of(item.key) in topics:
                model.extend(decode(topic_of(item.key), item.key, item.payload))
    last = max((tick.step for tick in log.ticks), default=-1)
    return model.take(last, {drive.step: drive for _, drive in log.messages_of(Drive)})


class TrialClock:
    """Conversion of one recording's instants to the seconds of the trial."""

    def __init__(self, log: RobotLog, clocks: AlignedClocks) -> None:
        self._own = np.array([tick.instant for tick in log.ticks], np.int64)
        begin = clocks.begin
        aligned = [clocks.instant(log, Moment(k, tick.instant)) - begin for k, tick in enumerate(log.ticks)]
        self.ticks: Floats = np.array(aligned, np.float64) / 1e6
        self._shift = self.ticks - self._own / 1e6

    def seconds(self, instants: Int64s) -> Floats:
        """Convert instants, interpolating linearly between steps."""
        if not len(self._own):
            return np.zeros(len(instants))
        shift = np.interp(instants, self._own, self._shift)
        return instants / 1e6 + shift

    def instant(self, instant: int) -> int:
        """Convert one instant to µs of the trial."""
        return round(float(self.seconds(np.array([instant], np.int64))[0]) * 1e6)


def _messages(trial: FieldTrial, times: Mapping[int, TrialClock]) -> Iterator[tuple[float, str, Message]]:
    """Yield the start of the step, s, key and message, with all instants converted to the trial's clock."""
    for log in trial.all_logs():
        own = times[id(log)]
        for tick, key, message in log.messages:
            yield float(own.ticks[tick]), key, convert_instants(message, own.instant)


def _state_changes(trial: FieldTrial, times: Mapping[int, TrialClock]) -> Iterator[tuple[str, float, str]]:
    """Yield the starts and exits of each robot in order of time."""
    for robot, logs in trial.logs.items():
        spans = [ticks for log in logs if len(ticks := times[id(log)].ticks)]
        changes = [change for ticks in spans for change in ((float(ticks[0]), ""), (float(ticks[-1]), "off"))]
        for second, state in sorted(changes) or [(0.0, "off")]:
            yield robot, second, state


def trial_map(trial: FieldTrial) -> tuple[OccupancyGrid, tuple[str, ...]]:
    """Return the map stored with a recording; else empty floor around the robots' estimates, and a note."""
    for log in trial.all_logs():
        for path in (log.path.parent / "map.yaml", log.path.parent.parent / "map" / "map.yaml"):
            if path.is_file():
                return load_map(path), ()
    poses = [drive.pose[:2] for log in trial.all_logs() for _, drive in log.messages_of(Drive) if drive.pose]
    known = np.array(poses, np.float64).reshape(-1, 2)
    low, high = (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(2), np.ones(2))
    columns, rows = np.ceil((high - low + 2 * _MARGIN) / _CELL).astype(np.int64).tolist()
    empty = np.full((rows, columns), FREE, np.uint8)
    corner = Point(*(low - _MARGIN).tolist())
    return OccupancyGrid(empty, _CELL, corner), ("the recordings have no map; the floor is drawn empty",)
