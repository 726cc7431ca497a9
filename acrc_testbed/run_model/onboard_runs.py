"""Run model of one robot on board, from its recordings as they grow."""

from pathlib import Path
from typing import Final

from msgspec.structs import asdict

from acrc_testbed.recordings.run_recordings import read_setup, recordings
from acrc_testbed.run_model.data import RunDescription
from acrc_testbed.run_model.model import RunModel
from acrc_testbed.run_model.simulated_runs import FROM_ROBOT, RecordedTopics, RunReader
from actors.floor.map_file import load_map
from actors.instant import seconds
from actors.messages import DRIVE, TRUTH, Drive, RobotTruth, SensorData, Truth
from actors.topic import Message
from firmware_bridge.onboard.device_loop import BaseSetup

_TIMEOUT: Final = seconds(1)
"""Time after which sensor data are returned without the robot's answer."""
_FROM_BASE: Final[RecordedTopics] = {DRIVE: "in"}


class OnboardReader(RunReader):
    """Incremental reader of the recordings of a robot and its base since their last start.

    Seconds are those of the robot's clock since the Unix epoch. Items of the task have no state, as no judge
    runs. True poses are unknown; `RunData.true` has the odometry's.
    """

    def __init__(self, out: Path, robot: str) -> None:
        """Open a run on board. Raises RecordingError if the base's recording has not begun or is damaged."""
        self._robot, self._answered = robot, -1
        super().__init__(out, internals=True, senses=True)

    def _create_model(self, out: Path) -> RunModel:
        setup = read_setup(_latest(out, f"{self._robot}.base"), BaseSetup, "a base")
        description = RunDescription(
            out=out,
            title=f"{self._robot} on board",
            robots=(self._robot,),
            grid=load_map(out / self._robot / "map.yaml"),
            step_us=setup.step_us,
            task=setup.task.declaration,
            item_counts={self._robot: len(setup.items)},
            has_truth=False,
        )
        return RunModel(description)

    def _topics(self, actor: str, path: Path) -> RecordedTopics:
        folder = path.parent.name
        topics = {self._robot: FROM_ROBOT, f"{self._robot}.base": _FROM_BASE}.get(folder, {})
        return topics if topics and path == _latest(self.description.out, folder) else {}

    def _add_message(self, actor: str, robot: str, key: str, message: Message) -> None:
        if isinstance(message, Drive):
            self._answered = message.step
        elif isinstance(message, SensorData) and not message.halt:
            odometry = asdict(message.odometry)
            body = RobotTruth(id=self._robot, **odometry, stepping=True, powered=True, transmits=0)
            self.model.extend(TRUTH.key(), Truth(message.step, message.instant, (body,)))
            self.model.since = self.model.since or message.instant / 1e6
        super()._add_message(actor, robot, key, message)

    def _last_complete_step(self) -> int:
        truths = self.model.truths
        if truths and truths[-1].instant - truths[0].instant > _TIMEOUT:
            return truths[-1].step
        return self._answered


def _latest(out: Path, folder: str) -> Path:
    """Return the recording of the last start of a process."""
    return [path for path in recordings(out).values() if path.parent.name == folder][-1]
