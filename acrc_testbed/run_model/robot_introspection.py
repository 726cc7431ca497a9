"""Introspection of robots, read from their recordings process by process."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.recordings.run_recordings import decode_setup as first_record
from actors import geometry
from actors.array_types import Floats, Int64s, Octets, Singles
from actors.instant import LATEST, Instant
from actors.introspection import (
    CostWindow,
    DecisionRecord,
    EstimateQuality,
    GoalState,
    Introspection,
    KnowledgeCommit,
    PerceptionSample,
    StepRecord,
    ValueChange,
)
from actors.messages import NO_ECHO_MM, Drive, FrameReceived, RadioEvents, Scan, SensorData
from actors.portable import arrays
from actors.robot.introspector import cell_type
from actors.robot.navigation.cost_map import CostMap, CostMapParameters
from actors.robot_model import RangeSensor, load_model
from actors.runtime.errors import AcrcError
from actors.runtime.process import RunNote
from actors.runtime.process_setup import RecordDetail, resolve_model
from actors.topic import Message

Clock = Callable[[Int64s], Floats]
"""Conversion of a process's instants, µs, to seconds of the run."""
Pose = tuple[float, float, float]
_NO_COSTS: Final = np.zeros((0, 1, 1), np.uint8)
_MAX_FIELDS: Final = 1000
"""Limit of the fields of a robot's knowledge."""
NOT_RECORDED: Final = "introspection was not recorded; record the run with --record full"


class RecordedProcess(NamedTuple):
    """One recorded process of a robot."""

    actor: str
    robot: str
    clock: Clock


def seconds_of(instants: Int64s) -> Floats:
    """Convert simulated instants, µs, to s: the clock of simulated processes."""
    return instants / 1e6


class IntrospectionError(AcrcError):
    """Invalid or inconsistent introspection."""


class _NavigationSetup(msgspec.Struct, frozen=True):
    local_map: CostMapParameters


class _PerceptionSetup(msgspec.Struct, frozen=True):
    """The part of a robot's set-up that is needed to decode its introspection."""

    model: str
    sensor: str | None
    stack: _NavigationSetup
    detail: RecordDetail = "lean"


def process_model(process: RecordedProcess, path: Path, run: RunNote) -> "ProcessModel":
    """Return an empty model of a robot's process; `run`: first record. Raises RecordingError."""
    setup = first_record(path, run, _PerceptionSetup, "a robot")
    model = load_model(resolve_model(setup.model, path.parent), setup.sensor)
    local = CostMap(model.sensor, model.footprint.circumradius, setup.stack.local_map)
    return ProcessModel(process, model.sensor, local, is_recorded=setup.detail == "full")


class PointSets(NamedTuple):
    """Sets of points over time."""

    seconds: Floats
    """(n,)"""
    counts: Int64s
    """(n,): points in each set."""
    points: Singles
    """(sum of counts, 2): x, y, m, map frame."""

    def sets(self) -> list[Singles]:
        """Return one array per set."""
        return np.split(self.points, np.cumsum(self.counts)[:-1]) if len(self.counts) else []


class ActivityChange(NamedTuple):
    """The robot's activity from an instant on."""

    second: float
    activity: str
    destination: str
    """An item such as "r1/3"; empty: none."""
    point: tuple[float, float] | None
    """The goal, m, map frame; None: none."""


class ReplicaChange(NamedTuple):
    """A replica that was updated or removed."""

    second: float
    peer: str
    heard: float | None
    """Time of its reception, s; None: removed."""


class StepEstimate(NamedTuple):
    """The robot's pose estimate at the start of one step."""

    step: int
    second: float
    pose: Pose
    quality: EstimateQuality


class StepGoal(NamedTuple):
    """The goal of navigation at the end of one step."""

    step: int
    goal: GoalState


class StepCommit(NamedTuple):
    """A change of knowledge in one step."""

    step: int
    second: float
    number: int
    """Sequence number within the process."""
    commit: KnowledgeCommit
    via: int | None
    """Short address of the sender whose frame completed the replica; None: no frame was recorded."""


class CostWindows(msgspec.Struct, frozen=True, eq=False):
    """Local cost maps of navigation."""

    seconds: Floats
    """(c,)"""
    costs: Octets
    """(c, rows, columns), southernmost row first; costs as in costmap_2d."""
    corners: Floats
    """(c, 3): pose of the south-west corner: x, y, m, heading, rad, map frame."""
    cell: float
    """Edge of a cell, m."""


class RobotInternals(msgspec.Struct, frozen=True, eq=False):
    """Introspection of one robot process, whole or the next part; sampled at n instants."""

    process: RecordedProcess
    end: float
    """Last instant of this part, s; 0: the part is empty."""
    seconds: Floats
    """(n,)"""
    estimates: Floats
    """(n, 3): x, y, m, heading, rad, map frame."""
    covariances: Floats
    """(n, 3): xx, xy and yy, m²."""
    twists: Floats
    """(n, 2): commanded speed, m/s, and turn rate, rad/s."""
    scans: PointSets
    """End points of the last scan at the same instants, placed by the estimate."""
    particles: PointSets
    plans: PointSets
    """Empty sets: the plan was dropped."""
    windows: CostWindows
    activities: tuple[ActivityChange, ...]
    knowledge: tuple[tuple[float, tuple[tuple[str, str], ...]], ...]
    """Time, s, and all fields as text from then on."""
    contacts: tuple[ReplicaChange, ...]
    step_estimates: tuple[StepEstimate, ...]
    goals: tuple[StepGoal, ...]
    commits: tuple[StepCommit, ...]
    is_recorded: bool
    """False: recording of introspection was off."""

    def decisions(self) -> Iterator[tuple[StepCommit, DecisionRecord]]:
        """Yield the changes of knowledge that contain a decision."""
        for one in self.commits:
            if one.commit.decision is not None:
                yield one, one.commit.decision


class _SensedStep(NamedTuple):
    number: int
    instant: int
    odometry: geometry.Pose
    scan: Scan | None
    """The newest scan that the robot had received."""


class ProcessModel:
    """Introspection of one robot process, accumulated from its messages."""

    def __init__(
        self, process: RecordedProcess, sensor: RangeSensor, local: CostMap, *, is_recorded: bool
    ) -> None:
        """`local`: a cost map with the robot's parameters."""
        self.process, self._sensor, self._local = process, sensor, local
        angles = sensor.first_angle + sensor.increment * np.arange(sensor.rays)
        self._rays = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
        self._scan: Scan | None = None
        self._steps: list[_SensedStep] = []
        self._records: dict[int, StepRecord] = {}
        """By step, like `_samples`."""
        self._samples: dict[int, Introspection] = {}
        self.covered = -1
        """Last step whose introspection has been read."""
        self._senders: dict[int, int] = {}
        """Senders of frames by reception time, µs."""
        self._quality: EstimateQuality | None = None
        self._knowledge: dict[str, str] = {}
        self._values: dict[tuple[str, str], str | None] = {}
        """JSON values by component and path."""
        self._commits = 0
        self.is_recorded = is_recorded
        """Recording is enabled; a process that exited at once may still have recorded nothing."""

    def extend(self, message: Message) -> None:
        """Add one message that the process received or recorded."""
        match message:
            case SensorData():
                scans = (*message.earlier_scans, message.scan)
                self._scan = next((one for one in reversed(scans) if one is not None), self._scan)
                if not message.halt:
                    measured = message.odometry
                    odometry = geometry.Pose(measured.x, measured.y, measured.heading)
                    self._steps.append(_SensedStep(message.step, message.instant, odometry, self._scan))
            case RadioEvents():
                self._senders |= {
                    one.instant: one.sender for one in message.events if isinstance(one, FrameReceived)
                }
            case Introspection():
                self._records |= {one.step: one for one in message.steps}
                self._samples[message.step] = message
                self.covered = message.step

    def take(self, until: int, answers: Mapping[int, Drive]) -> RobotInternals:
        """Remove and return the steps up to `until` whose introspection has been read.

        `answers`: the robot's answers by step. Raises IntrospectionError for invalid values.
        """
        steps = [one for one in self._steps if one.number <= min(until, self.covered)]
        self._steps = self._steps[len(steps) :] if self.is_recorded else []
        part = _PartBuilder(self, steps)
        for step in steps:
            try:
                record = self._records.pop(step.number, None) or StepRecord(step.number)
                part.extend(step, record, self._samples.pop(step.number, None), answers.get(step.number))
            except ValueError as error:
                raise IntrospectionError(
                    f"{self.process.actor}: introspection of step {step.number} is damaged: {error}"
                ) from None
        return part.result()

    def update_quality(self, changed: EstimateQuality | None) -> EstimateQuality | None:
        """Return the current quality of the estimate."""
        if changed is not None:
            if len(changed.covariance) != 9:
                raise ValueError(f"covariance has {len(changed.covariance)} values instead of 9")
            self._quality = changed
        return self._quality

    def number_commit(self, step: int, second: float, commit: KnowledgeCommit) -> StepCommit:
        """Return a change of knowledge with its number and the sender of the frame that caused it."""
        self._commits += 1
        via = None if commit.replica is None else self._senders.get(commit.replica.heard)
        changed = tuple(self._with_previous_value(commit.component, one) for one in commit.changed)
        commit = msgspec.structs.replace(commit, changed=changed)
        return StepCommit(step, second, self._commits - 1, commit, via)

    def _with_previous_value(self, component: str, change: ValueChange) -> ValueChange:
        """Return the change with its previous value filled in."""
        field = component, change.path
        before = self._values.get(field) if change.before == "" else change.before
        self._values[field] = change.after
        return msgspec.structs.replace(change, before=before)

    def costs(self, window: CostWindow) -> Octets:
        """Return all costs of a window, (rows, columns). Raises ValueError for a wrong size."""
        side, cells = self._local.side, np.frombuffer(window.marked, cell_type(self._local.side))
        if window.side != side or (len(cells) and cells.max() >= side * side):
            raise ValueError(f"a cost window has {window.side} rows instead of {side}, or cells beyond them")
        marks = np.zeros(side * side, np.uint8)
        marks[cells] = 1
        self._local.restore(Instant(0), self._local.corner, marks.reshape(side, side))
        return self._local.costs()

    def update_knowledge(self, changes: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        """Return all fields of the knowledge as text after these changes."""
        self._knowledge |= dict(changes)
        if len(self._knowledge) > _MAX_FIELDS:
            raise ValueError(f"knowledge has more than {_MAX_FIELDS} fields")
        return tuple(self._knowledge.items())

    def scan_points(self, body: geometry.Pose | None, scan: Scan | None) -> Singles:
        """Return the end points of a scan, (k, 2), m, map frame; `body`: the robot's pose at the scan."""
        if scan is None or body is None:
            return np.zeros((0, 2), np.float32)
        sensor = body.compose(self._sensor.mount)
        ranges = np.frombuffer(scan.ranges_mm, "<u2")
        if len(ranges) != len(self._rays):
            raise ValueError(f"a scan has {len(ranges)} rays instead of {len(self._rays)}")
        hits = (ranges != NO_ECHO_MM) & (ranges >= 1000 * self._sensor.range_min)
        x, y = (self._rays[hits] * (ranges[hits, None] / 1000.0)).T
        c, s = np.cos(sensor[2]), np.sin(sensor[2])
        return np.column_stack((sensor[0] + c * x - s * y, sensor[1] + s * x + c * y)).astype(np.float32)

    @property
    def cell(self) -> float:
        """Edge of a cell of the local cost map, m."""
        return self._local.parameters.cell


class _PartBuilder:
    """Rows of one part of a process's introspection."""

    def __init__(self, model: ProcessModel, steps: Sequence[_SensedStep]) -> None:
        self._model = model
        instants = np.array([one.instant for one in steps], np.int64)
        if (np.abs(instants) > LATEST).any():
            raise IntrospectionError(f"{model.process.actor}: the instant of a step is out of range")
        self._seconds = dict(
            zip((one.number for one in steps), model.process.clock(instants).tolist(), strict=True)
        )
        self._samples: list[tuple[float, Pose, EstimateQuality, tuple[float, float]]] = []
        self._scans: list[tuple[float, Singles]] = []
        self._particles: list[tuple[float, Singles]] = []
        self._plans: list[tuple[float, Singles]] = []
        self._windows: list[tuple[float, Octets, Pose]] = []
        self._activities: list[ActivityChange] = []
        self._knowledge: list[tuple[float, tuple[tuple[str, str], ...]]] = []
        self._contacts: list[ReplicaChange] = []
        self._estimates: list[StepEstimate] = []
        self._goals: list[StepGoal] = []
        self._commits: list[StepCommit] = []

    def extend(
        self, step: _SensedStep, record: StepRecord, message: Introspection | None, drive: Drive | None
    ) -> None:
        """Add one step; `message`: its sample. Raises ValueError for invalid values."""
        second, quality = self._seconds[step.number], self._model.update_quality(record.quality)
        pose = record.pose or (None if drive is None else drive.pose)
        if pose is not None and quality is not None:
            self._estimates.append(StepEstimate(step.number, second, pose, quality))
        if (change := record.activity) is not None:
            self._activities.append(ActivityChange(second, change.activity, change.destination, change.point))
        if record.goal is not None:
            self._goals.append(StepGoal(step.number, record.goal))
        self._contacts += [
            ReplicaChange(second, peer, None if heard is None else self._second(heard))
            for peer, heard in record.contacts
        ]
        self._commits += [
            self._model.number_commit(step.number, self._second(one.instant), one) for one in record.commits
        ]
        if message is not None and message.knowledge:
            self._knowledge.append((second, self._model.update_knowledge(message.knowledge)))
        if message is not None and message.sample is not None and pose is not None and quality is not None:
            twist = (0.0, 0.0) if drive is None else (drive.vx, drive.omega)
            self._samples.append((second, pose, quality, twist))
            self._add_sample(second, message.sample, step, geometry.Pose(*pose).frame(step.odometry))

    def _add_sample(
        self, second: float, sample: PerceptionSample, step: _SensedStep, correction: geometry.Pose
    ) -> None:
        """Add a sample; `correction`: pose of the odometry frame in the map frame."""
        scanned = sample.scanned
        body = None if scanned is None else correction.compose(geometry.Pose(*scanned))
        self._scans.append((second, self._model.scan_points(body, step.scan)))
        if sample.particles is not None:
            self._particles.append((second, _points(sample.particles)))
        if sample.plan is not None:
            self._plans.append((second, _points(sample.plan)))
        if (window := sample.window) is not None:
            column, row = window.corner
            corner = correction.compose(geometry.Pose(column * self._model.cell, row * self._model.cell, 0.0))
            self._windows.append((second, self._model.costs(window), corner))

    def _second(self, instant: int) -> float:
        if abs(instant) > LATEST:
            raise ValueError(f"instant {instant} µs is out of range")
        return float(self._model.process.clock(np.array([instant], np.int64))[0])

    def result(self) -> RobotInternals:
        """Return all rows as columns."""
        samples = self._samples
        spreads = np.array([one[2].covariance for one in samples], np.float64).reshape(-1, 9)
        return RobotInternals(
            process=self._model.process,
            end=max(self._seconds.values(), default=0.0),
            seconds=np.array([one[0] for one in samples], np.float64),
            estimates=np.array([one[1] for one in samples], np.float64).reshape(-1, 3),
            covariances=spreads[:, (0, 1, 4)],
            twists=np.array([one[3] for one in samples], np.float64).reshape(-1, 2),
            scans=_point_sets(self._scans),
            particles=_point_sets(self._particles),
            plans=_point_sets(self._plans),
            windows=CostWindows(
                np.array([one[0] for one in self._windows], np.float64),
                np.stack([one[1] for one in self._windows]) if self._windows else _NO_COSTS,
                np.array([one[2] for one in self._windows], np.float64).reshape(-1, 3),
                self._model.cell,
            ),
            activities=tuple(self._activities),
            knowledge=tuple(self._knowledge),
            contacts=tuple(self._contacts),
            step_estimates=tuple(self._estimates),
            goals=tuple(self._goals),
            commits=tuple(self._commits),
            is_recorded=self._model.is_recorded,
        )


def _points(data: bytes) -> Singles:
    """Decode points, (k, 2), from little-endian float32. Raises ValueError for a wrong length."""
    if len(data) % 8:
        raise ValueError(f"{len(data)} bytes of points are not a multiple of 8")
    return np.frombuffer(data, "<f4").reshape(-1, 2)


def _point_sets(sets: Sequence[tuple[float, Singles]]) -> PointSets:
    seconds = np.array([second for second, _ in sets], np.float64)
    counts = np.array([len(points) for _, points in sets], np.int64)
    return PointSets(
        seconds, counts, np.concatenate([np.zeros((0, 2), np.float32), *(one for _, one in sets)])
    )
