"""A run as its recordings have it: ground truth, what robots said of themselves, and what became of places.

Nothing is replayed, so whoever's code it was, nothing of it runs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from acrc_testbed.replay.run_recordings import GivenOrder, recordings, setup_of
from acrc_testbed.results.outcome import told
from acrc_testbed.results.result import RunResult
from actors.floor.grid import OccupancyGrid
from actors.instant import in_seconds
from actors.messages import Drive, Jam
from actors.robot.behaviour.decisions import AdaptationReport
from actors.robot_model import load_model
from actors.runtime import regular_file, typed_json
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote
from actors.runtime.recording import Direction, Note, decoded, read_notes, read_recording
from actors.task.referee import PlaceOutcome
from actors.task.task import PlaceKey
from actors.topic import M, Message, Topic
from actors.world.world_setup import WorldSetup


def adaptation(record: Path, outcome: Mapping[str, msgspec.Raw]) -> AdaptationReport | None:
    """What a process's last record says on it; None if nothing. Raises OutcomeError."""
    return told(record, outcome, "adaptation", AdaptationReport, "a robot's adaptation")


class Deed(NamedTuple):
    """Something that a robot said of a place."""

    robot: str
    second: float
    place: PlaceKey


class Route(NamedTuple):
    """What a robot means to visit from an instant on."""

    robot: str
    second: float
    places: tuple[PlaceKey, ...]


class SaidPlaces:
    """Takes in words of robots; silence means: as before, and before the first word, its own places."""

    def __init__(self, places: Mapping[str, int], step_us: int) -> None:
        """`places`: how many each robot has to clean at first."""
        self._step_us = step_us
        self._held = {robot: {PlaceKey(robot, n) for n in range(count)} for robot, count in places.items()}
        self.reported: list[Deed] = []
        self.taken_over: list[Deed] = []
        self.given_up: list[Deed] = []
        self.routes: list[Route] = []

    def left(self, robot: str) -> int:
        """How many places it means to visit now."""
        return len(self._held.get(robot, ()))

    def take(self, robot: str, drive: Drive) -> None:
        """The robot's word of one step."""
        for report in drive.reports:
            key = PlaceKey(report.owner, report.place)
            self.reported.append(Deed(robot, in_seconds(report.instant), key))
        for gone in drive.given_up:
            key = PlaceKey(gone.owner, gone.place)
            self.given_up.append(Deed(robot, in_seconds(gone.instant), key))
        if drive.route is not None:
            before, now = self._held.get(robot, set()), in_seconds(drive.step * self._step_us)
            self.routes.append(Route(robot, now, drive.route))
            for key in drive.route:
                if key not in before and key.owner != robot:
                    self.taken_over.append(Deed(robot, now, key))
            self._held[robot] = set(drive.route)

    def forget(self) -> None:
        """Begin new lists; what each means to visit stays."""
        self.reported, self.taken_over, self.given_up, self.routes = [], [], [], []


T = TypeVar("T")


def taken(path: Path, topic: Topic[M], direction: Direction = "in") -> Iterator[tuple[str, M]]:
    """Yield the messages of a topic that the process received, each with the robot in its key, or "".

    `direction`: "out" for the messages that it sent.

    Raises RecordingError for a damaged file, WireError for a message that is none of the topic.
    """
    prefix, hole, suffix = topic.pattern.partition("{id}")
    for item in read_recording(path):
        if isinstance(item, Note) or item.direction != direction or item.payload is None:
            continue
        if item.key.startswith(prefix) and item.key.endswith(suffix):
            message = decode(cast(Topic[Message], topic), item.key, item.payload)
            assert isinstance(message, topic.kind)
            yield item.key[len(prefix) : len(item.key) - len(suffix)] if hole else "", message


def outcomes(path: Path) -> Mapping[str, msgspec.Raw]:
    """What the process's last record says, by subject; empty if it left none. Raises RecordingError."""
    text = read_notes(path).get("final")
    return {} if text is None else decoded(path, "final", text, FinalNote).outcome


def outcome(path: Path, subject: str, kind: type[T], whose: str) -> T | None:
    """What it says on one subject; None if nothing. `whose`: as in `told`. Raises OutcomeError, too."""
    return told(path, outcomes(path), subject, kind, whose)


Floats = NDArray[np.float64]
_MOST_BYTES: Final = 64 * 1024 * 1024
"""Of a result; one of 1000 robots has less than 1 MB."""


class EvidenceError(AcrcError):
    """A folder from which nobody can tell what happened."""


class HeardCopy(NamedTuple):
    """A copy of a frame that a robot heard."""

    second: float
    sender: int
    """Short address."""
    receiver: str
    rssi_dbm: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RunEvidence:
    """One simulated run, or the next piece of it. The first axis of all arrays is the step, the second the
    robot."""

    out: Path
    setup: WorldSetup
    grid: OccupancyGrid
    """The robots' map."""
    robots: tuple[str, ...]
    since: float
    """From when on it tells, simulated s."""
    end: float
    """Until when it tells; of a piece, the beginning of its last step."""
    seconds: Floats
    """(steps,): when each step began, simulated s."""
    true: Floats
    """(steps, robots, 3): x, y, m, and heading, rad, in the map frame."""
    held: Floats
    """(steps, robots, 3): where the robot held itself to be; NaN where it did not say."""
    wished: Floats
    """(steps, robots, 3): the velocity that it asked for, in its own frame, m/s, m/s, rad/s; NaN: none."""
    powered: NDArray[np.bool_]
    """(steps, robots): whether its process lived."""
    stepping: NDArray[np.bool_]
    """(steps, robots): whether it took part, which one that is frozen or has ended does not."""
    left: NDArray[np.int64]
    """(steps, robots): how many places it still meant to visit."""
    sent: NDArray[np.int64]
    """(steps, robots): frames it gave to its radio."""
    heard: NDArray[np.int64]
    """(steps, robots): frames it heard."""
    reported: tuple[Deed, ...]
    """Places that robots said to have cleaned, in the order of the instants."""
    taken_over: tuple[Deed, ...]
    """Places of somebody else's that a robot put into its route."""
    given_up: tuple[Deed, ...]
    routes: tuple[Route, ...]
    """What robots said, in the order of the steps; before that each means to visit its own places."""
    receptions: tuple[HeardCopy, ...]
    """Every copy heard, robot by robot."""
    jams: tuple[tuple[float, Jam], ...]
    """Jammers, and from when on each was there, s."""
    given: Mapping[str, tuple[tuple[float, float], ...]]
    """By owner the places that have come since the run began, m."""
    orders: tuple[GivenOrder, ...]
    """What the scenario and people have ordered, in the order of the steps; who was refused is not known."""
    addresses: Mapping[int, str]
    """Robots by short address."""
    processes: Mapping[str, str]
    """By actor whose process it is, of those that have begun."""
    places: tuple[PlaceOutcome, ...] = ()
    """What became of places; of a piece, none."""
    result: RunResult | None = None
    """None where the run did not end as planned, and of a piece."""


def world_setup(path: Path) -> WorldSetup:
    """What the world was told, its files as they lie now. Raises RecordingError."""
    return setup_of(path, WorldSetup, "a world").located(path.parent)


def largest_radius(setup: WorldSetup) -> float:
    """Of the largest robot, m."""
    return max(load_model(robot.model).footprint.circumradius for robot in setup.robots)


def places(run: RunEvidence) -> tuple[PlaceOutcome, ...]:
    """As the referee has them; of a run that was cut, as far as robots said."""
    judged = outcome(recordings(run.out)["world"], "places", tuple[PlaceOutcome, ...], "a world")
    if judged is not None:
        return judged
    first: dict[PlaceKey, Deed] = {}
    for deed in run.reported:
        first.setdefault(deed.place, deed)
    return tuple(
        _unjudged(body.id, index, point, first.get(PlaceKey(body.id, index)))
        for body in run.setup.robots
        for index, point in enumerate(body.places)
    )


def _unjudged(owner: str, index: int, point: tuple[float, float], deed: Deed | None) -> PlaceOutcome:
    """A place of a run whose referee has said nothing."""
    at = None if deed is None else round(deed.second * 1e6)
    by = None if deed is None else deed.robot
    return PlaceOutcome(
        owner=owner, place=index, x=point[0], y=point[1], reached_at=at, reached_by=by, reported_at=at,
        reported_by=by, given_up_at=None, given_up_by=None, reason=None,
        in_route_of=(owner,) if at is None else (),
    )  # fmt: skip


def result(out: Path) -> RunResult | None:
    """The run's result; None where there is none."""
    path = out / "run.json"
    if not path.is_file():
        return None
    if path.stat().st_size > _MOST_BYTES:
        raise EvidenceError(f"{path}: has more than {_MOST_BYTES} bytes; it should be a run's result")
    try:
        return typed_json.decode(regular_file.content(path), RunResult)
    except ValueError as error:
        raise EvidenceError(f"{path}: is no run's result: {error}") from error
