"""Readers of single recordings of a run (messages, set-ups, final records) and of the run's result."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Final, TypeVar, cast

import msgspec

from acrc_testbed.recordings.run_recordings import read_setup, recordings
from acrc_testbed.results.outcome import decode_subject
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.data import RobotReport, RunData, RunDataError
from actors.messages import FRAME_OUTCOMES, FrameOutcomes
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.decisions import AdaptationReport
from actors.robot.navigation.navigation_counts import NavigationReport
from actors.robot_model import load_model
from actors.runtime import regular_file, typed_json
from actors.runtime.codec import decode
from actors.runtime.process import FinalNote
from actors.runtime.recording import Direction, Note, decode_note, read_notes, read_recording
from actors.task.task import TaskOutcome, Value
from actors.topic import M, Message, Topic
from actors.world.world_setup import WorldSetup

T = TypeVar("T")
NO_FRAMES: Final = "radio: outcomes of frames were not recorded; record the run with --record full"
_MAX_BYTES: Final = 64 * 1024 * 1024
"""Limit of a result's file; a run of 1000 robots has less than 1 MB."""


def messages_on(path: Path, topic: Topic[M], direction: Direction = "in") -> Iterator[tuple[str, M]]:
    """Yield the messages of a topic, each with the robot in its key, or "".

    `direction`: "in" for received messages, "out" for sent ones. Raises RecordingError for a damaged file,
    WireError for an invalid message.
    """
    prefix, placeholder, suffix = topic.pattern.partition("{id}")
    for item in read_recording(path):
        if isinstance(item, Note) or item.direction != direction or item.payload is None:
            continue
        if item.key.startswith(prefix) and item.key.endswith(suffix):
            message = decode(cast(Topic[Message], topic), item.key, item.payload)
            assert isinstance(message, topic.kind)
            yield item.key[len(prefix) : len(item.key) - len(suffix)] if placeholder else "", message


def frame_outcomes(out: Path) -> tuple[list[str], list[FrameOutcomes]]:
    """Return the robots in the order of the radio, and the outcomes of frames.

    Raises RecordingError for damaged recordings, RunDataError if the radio did not record outcomes.
    """
    path = recordings(out)["radio"]
    setup = read_setup(path, RadioSetup, "a radio")
    if setup.detail != "full":
        raise RunDataError(f"{out}: {NO_FRAMES}")
    return [robot for robot, _ in setup.robots], [one for _, one in messages_on(path, FRAME_OUTCOMES, "out")]


def final_outcomes(path: Path) -> Mapping[str, msgspec.Raw]:
    """Return a process's final record by subject; empty if it has none. Raises RecordingError."""
    text = read_notes(path).get("final")
    return {} if text is None else decode_note(path, "final", text, FinalNote).outcome


def robot_report(records: Iterable[Path]) -> RobotReport:
    """Return the final records of one robot's processes; `records`: recordings in order of start.

    Raises RecordingError or OutcomeError for invalid records.
    """
    navigations: list[NavigationReport] = []
    adaptations: list[AdaptationReport] = []
    for record in records:
        outcome = final_outcomes(record)
        navigation = decode_subject(record, outcome, "navigation", NavigationReport, "a robot's navigation")
        navigations += filter(None, (navigation,))
        adaptation = decode_subject(record, outcome, "adaptation", AdaptationReport, "a robot's adaptation")
        adaptations += filter(None, (adaptation,))
    blocked = [one.blocked for one in adaptations if one.blocked is not None]
    return RobotReport(
        goals=_joined(one.given for one in navigations) if navigations else None,
        planless=_joined(one.without_plan for one in navigations),
        paused=_joined(one.paused for one in navigations),
        blocked=_joined(blocked) if blocked else None,
        decisions=_joined(one.decisions for one in adaptations),
        unlisted=sum(one.decisions_unlisted for one in adaptations),
    )


def _joined(parts: Iterable[Iterable[T]]) -> tuple[T, ...]:
    return tuple(chain.from_iterable(parts))


def world_setup(path: Path) -> WorldSetup:
    """Return the set-up of a world with current paths of its files. Raises RecordingError."""
    return read_setup(path, WorldSetup, "a world").resolve_paths(path.parent)


def largest_radius(setup: WorldSetup) -> float:
    """Return the radius of the largest robot, m."""
    return max(load_model(robot.model).footprint.circumradius for robot in setup.robots)


def final_items(run: RunData) -> tuple[Mapping[str, Value], ...]:
    """Return the final rows of all items; for a truncated run, their keys and points from the last marks.

    Raises RecordingError or OutcomeError for an invalid record.
    """
    world = recordings(run.out)["world"]
    outcome = decode_subject(world, final_outcomes(world), "task", TaskOutcome, "a world")
    if outcome is not None:
        return outcome.items
    task = run.description.task
    last = {mark.key: mark for _, mark in run.marks}
    return tuple(
        {"owner": key.owner, task.item: key.number, "x": mark.x, "y": mark.y}
        for key, mark in last.items()
        if mark.state
    )


def run_result(out: Path) -> RunResult | None:
    """Return the run's result; None if there is none. Raises RunDataError."""
    path = out / "run.json"
    if not path.is_file():
        return None
    if path.stat().st_size > _MAX_BYTES:
        raise RunDataError(f"{path}: larger than {_MAX_BYTES} bytes; not the result of a run")
    try:
        return typed_json.decode(regular_file.read_bytes(path), RunResult)
    except ValueError as error:
        raise RunDataError(f"{path}: not a valid run result: {error}") from error
