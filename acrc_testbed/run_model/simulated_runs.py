"""Run model of simulated runs, from the recordings in a run's folder: finished, truncated or growing."""

import time
from collections import defaultdict
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Self

from acrc_testbed.recordings.run_recordings import RecordedOrder, read_setup, recordings
from acrc_testbed.recordings.topics import GrowingRecording
from acrc_testbed.run_model.data import RunData, RunDataError, RunDescription
from acrc_testbed.run_model.model import RunModel, robot_of
from acrc_testbed.run_model.recording_readers import (
    final_items,
    largest_radius,
    robot_report,
    run_result,
    world_setup,
)
from acrc_testbed.run_model.robot_introspection import (
    ProcessModel,
    RecordedProcess,
    process_model,
    seconds_of,
)
from actors.floor.map_file import load_map
from actors.messages import (
    AIRED,
    CONTROL,
    DRIVE,
    FLOOR_CHANGED,
    FRAME_OUTCOMES,
    INTROSPECTION,
    RECEIVED,
    SENSES,
    TASK_CHANGED,
    TRUTH,
    Drive,
    FrameOutcomes,
    SensorData,
)
from actors.radio.radio_model import RadioSetup
from actors.runtime.recording import Direction
from actors.topic import Message, Topic
from actors.world.world_setup import WorldSetup

_TIMEOUT_S: Final = 1.0
"""Timeout for the robots' recordings of a step, s."""
RecordedTopics = Mapping[Topic[Any], Direction]
"""Topics to read from a recording: those of received ("in") and of sent ("out") messages."""
_FROM_OTHERS: Final[RecordedTopics] = {FRAME_OUTCOMES: "out", FLOOR_CHANGED: "out", TASK_CHANGED: "out"}
_TOPICS: Final[Mapping[str, RecordedTopics]] = {
    "radio": {**_FROM_OTHERS, TRUTH: "in"},
    "world": {**_FROM_OTHERS, DRIVE: "in", AIRED: "in", CONTROL: "in"},
}
FROM_ROBOT: Final[RecordedTopics] = {SENSES: "in", RECEIVED: "in", INTROSPECTION: "out"}


def run_model(out: Path, setup: WorldSetup, radio: RadioSetup) -> RunModel:
    """Return the model of a simulated run before its first step."""
    description = RunDescription(
        out=out,
        title=f"{len(setup.robots)} robots, seed {setup.seed}",
        robots=tuple(body.id for body in setup.robots),
        grid=load_map(setup.map),
        step_us=setup.step_us,
        task=setup.task.declaration,
        item_counts={body.id: len(body.items) for body in setup.robots},
        addresses={address: robot for robot, address in radio.robots},
        radius=largest_radius(setup),
        records_frames=radio.detail == "full",
        seed=setup.seed,
        has_batteries=any(body.battery is not None for body in setup.robots),
    )
    return RunModel(description, [RecordedOrder(one.step(setup.step_us), one.order) for one in setup.events])


class RunReader:
    """Incremental reader of a run's folder; a context manager that closes the files."""

    def __init__(self, out: Path, *, internals: bool = False, senses: bool = False) -> None:
        """Open a run; `internals`: also read the robots' introspection, `senses`: return their sensor data.

        Raises RecordingError or RunDataError if the run has not begun or is damaged.
        """
        self.model = self._create_model(out)
        self.description = self.model.description
        self._stack, self._files = ExitStack(), dict[str, GrowingRecording]()
        self._has_internals, self._has_senses = internals, senses
        self._unneeded: set[Topic[Any]] = set() if internals else {INTROSPECTION}
        self._internals: dict[str, ProcessModel] = {}
        """By actor."""
        self._senses: dict[str, list[SensorData]] = {}
        """By actor, not returned yet."""
        self._answers = defaultdict[str, dict[int, Drive]](dict)
        """Answers of each robot by step, for its introspection."""
        self._sensed_steps: dict[str, int] = {}
        """Last step whose senses were read, by robot."""
        self._completed_step = -1
        """Last step that the world has completed."""
        self._outcome_step = -1
        """Last step whose outcomes of frames were read."""
        self._last_progress = time.monotonic()
        self._is_finished = False
        """The last part was returned."""

    def _create_model(self, out: Path) -> RunModel:
        files = recordings(out)
        for actor in ("world", "radio"):
            if actor not in files:
                raise RunDataError(
                    f"{out}: contains no recording of the {actor}; give the folder of a simulated run"
                )
        setup, radio = world_setup(files["world"]), read_setup(files["radio"], RadioSetup, "a radio")
        return run_model(out, setup, radio)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots in scenario order."""
        return self.description.robots

    def count_unread(self) -> int:
        """Read the radio's recording, and return the number of steps that were not returned."""
        self._read_messages("radio", recordings(self.description.out)["radio"])
        return len(self.model.truths)

    def initial_data(self) -> RunData:
        """Return the run before its first step."""
        return self.model.advance(-1)

    def poll(self, *, last: bool = False) -> RunData | None:
        """Return the data since the last call, or None; `last`: the run has ended, so return everything.

        Raises RecordingError for damaged files, RunDataError if the set of robots changes.
        """
        if last and not (self._has_internals or self._has_senses):  # their steps are only needed for waiting
            self._unneeded.add(SENSES)
        for actor, path in recordings(self.description.out).items():
            self._read_messages(actor, path)
        truths = self.model.truths
        until = truths[-1].step if last and truths else self._last_complete_step()
        ready = bool(truths) and truths[0].step <= until
        if self._is_finished or not (ready or last):
            return None
        self._is_finished = last
        if ready:
            self._last_progress = time.monotonic()
        run = self.model.advance(until, last=last, processes=self._processes())
        step = self.model.step
        senses = {
            actor: [one for one in found if last or one.step <= step] for actor, found in self._senses.items()
        }
        self._senses = {actor: found[len(senses[actor]) :] for actor, found in self._senses.items()}
        models = self._internals.values()
        internals = tuple(one.take(step, self._answers[one.process.robot]) for one in models)
        for one in models:
            robot, until = one.process.robot, min(step, one.covered) if one.is_recorded else step
            self._answers[robot] = {at: drive for at, drive in self._answers[robot].items() if at > until}
        return replace(run, senses=senses, internals=internals)

    def _processes(self) -> list[RecordedProcess]:
        return [
            RecordedProcess(actor, robot, seconds_of)
            for actor, growing in self._files.items()
            if growing.run is not None and (robot := growing.reading.path.parent.name) in self.robots
        ]

    def _topics(self, actor: str, path: Path) -> RecordedTopics:
        """Return the topics to read; each is read from the process that records it in full."""
        topics = FROM_ROBOT if path.parent.name in self.robots else _TOPICS.get(actor, _FROM_OTHERS)
        return {topic: way for topic, way in topics.items() if topic not in self._unneeded}

    def _read_messages(self, actor: str, path: Path) -> None:
        topics = self._topics(actor, path)
        if actor not in self._files:
            wanted = {(way, topic.key(robot)) for topic, way in topics.items() for robot in self.robots}
            growing = GrowingRecording(path, wanted={*wanted, ("out", TRUTH.pattern)})
            self._files[actor] = self._stack.enter_context(growing)
        robot = path.parent.name
        for one in self._files[actor].poll() if topics else ():
            if one.key == TRUTH.pattern and one.direction == "out":
                self._completed_step = max(self._completed_step, one.step - 1)
            elif (message := one.message()) is not None:
                try:
                    self._add_message(actor, robot, one.key, message)
                except RunDataError as error:
                    raise RunDataError(f"{path}: {error}") from None

    def _add_message(self, actor: str, robot: str, key: str, message: Message) -> None:
        self.model.extend(key, message)
        if isinstance(message, SensorData):
            self._sensed_steps[robot] = message.step
            if self._has_senses:
                self._senses.setdefault(actor, []).append(message)
        elif isinstance(message, FrameOutcomes):
            self._outcome_step = message.step
        if not self._has_internals:
            return
        if isinstance(message, Drive):
            self._answers[robot_of(key)][message.step] = message
        elif robot in self.robots:
            if actor not in self._internals:
                growing = self._files[actor]
                assert growing.run is not None, "every recording begins with it"
                process = RecordedProcess(actor, robot, seconds_of)
                self._internals[actor] = process_model(process, growing.reading.path, growing.run)
            self._internals[actor].extend(message)

    def _last_complete_step(self) -> int:
        """Return the last step whose messages have all been read."""
        truths = self.model.truths
        if not truths:
            return -1
        until = min(truths[-1].step, self._completed_step)
        if self.description.records_frames:
            until = min(until, self._outcome_step)
        if time.monotonic() <= self._last_progress + _TIMEOUT_S:
            acting = [robot.id for robot in truths[-1].robots if robot.stepping]
            until = min([until, *(self._sensed_steps.get(robot, -1) for robot in acting)])
        return until


def recorded_run(out: Path, *, internals: bool = False) -> RunData:
    """Return the recorded part of a simulated run; `internals`: include the robots' introspection.

    Raises RecordingError or OutcomeError for damaged files, RunDataError without a simulated run.
    """
    with RunReader(out, internals=internals) as reader:
        run = reader.poll(last=True)
    if run is None or not len(run.seconds):
        raise RunDataError(f"{out}: the run ended before its first step")
    files = recordings(out).values()
    reports = {
        robot: robot_report([path for path in files if path.parent.name == robot]) for robot in run.robots
    }
    return replace(run, reports=reports)


def read_run(out: Path, *, internals: bool = False) -> RunData:
    """Return a simulated run with the final items and the result.

    Raises as `recorded_run`, and RunDataError for a damaged result.
    """
    run = recorded_run(out, internals=internals)
    return replace(run, items=final_items(run), result=run_result(out))
