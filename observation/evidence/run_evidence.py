"""A run as its recordings have it: ground truth, what robots said of themselves, and what became of places.

Nothing is executed again, so whoever's code it was, nothing of it runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.instant import in_seconds
from actors.messages import DRIVE, RECEIVED, TRUTH, Drive, Heard, Jam
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.task.referee import PlaceOutcome
from actors.task.words import PlaceKey
from actors.world.world_setup import WorldSetup
from observation.evidence.recorded import outcome, taken
from observation.evidence.said_places import Deed, Route, SaidPlaces
from observation.replay.recorded_setup import setup_of
from observation.replay.run_recordings import recordings
from observation.results.result import RunResult

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


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """One simulated run. The first axis of all arrays is the step, the second the robot."""

    out: Path
    setup: WorldSetup
    grid: OccupancyGrid
    """The robots' map."""
    robots: tuple[str, ...]
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
    places: tuple[PlaceOutcome, ...]
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
    result: RunResult | None
    """None where the run did not end as planned."""

    @property
    def end(self) -> float:
        """Simulated s."""
        return float(self.seconds[-1]) + in_seconds(self.setup.step_us)


def read_run(out: Path) -> RunEvidence:
    """What a run's folder shows.

    Raises RecordingError for damaged files, EvidenceError where there is no run in the simulated world.
    """
    files = recordings(out)
    for actor in ("world", "radio"):
        if actor not in files:
            raise EvidenceError(
                f"{out}: there is no recording of the {actor}; it should be the folder of a simulated run"
            )
    setup = world_setup(files["world"])
    truths = [truth for _, truth in taken(files["radio"], TRUTH) if not truth.halt and truth.robots]
    if not truths:
        raise EvidenceError(f"{out}: the run ended before its first step")
    robots = tuple(robot.id for robot in truths[0].robots)
    if any(tuple(robot.id for robot in truth.robots) != robots for truth in truths):
        raise EvidenceError(f"{files['radio']}: its robots change; they should be the same in all steps")
    said = _Said(robots, len(truths), setup)
    for robot, drive in taken(files["world"], DRIVE):
        said.take(robot, drive)
    heard = np.zeros((len(truths), len(robots)), np.int64)
    receptions: list[HeardCopy] = []
    for actor, path in files.items():
        robot = path.parent.name
        if actor not in ("world", "radio") and robot in robots:
            _count_heard(path, robot, heard[:, robots.index(robot)], receptions)
    true = np.array([[(r.x, r.y, r.heading) for r in truth.robots] for truth in truths], np.float64)
    return RunEvidence(
        out=out,
        setup=setup,
        grid=load_map(setup.map),
        robots=robots,
        seconds=np.array([in_seconds(truth.instant) for truth in truths]),
        true=true,
        held=said.held,
        wished=said.wished,
        powered=np.array([[robot.powered for robot in truth.robots] for truth in truths]),
        stepping=np.array([[robot.stepping for robot in truth.robots] for truth in truths]),
        left=said.left,
        sent=said.sent,
        heard=heard,
        places=_places(files["world"], setup, said.places.reported),
        reported=tuple(said.places.reported),
        taken_over=tuple(said.places.taken_over),
        given_up=tuple(said.places.given_up),
        routes=tuple(said.places.routes),
        receptions=tuple(receptions),
        jams=tuple((in_seconds(truth.instant), jam) for truth in truths for jam in truth.jams),
        result=_result(out / "run.json"),
    )


class _Said:
    """What robots said, step by step; silence means: as before."""

    def __init__(self, robots: tuple[str, ...], steps: int, setup: WorldSetup) -> None:
        shape = (steps, len(robots))
        self._index = {robot: index for index, robot in enumerate(robots)}
        self.places = SaidPlaces({body.id: len(body.places) for body in setup.robots}, setup.step_us)
        self.held = np.full((*shape, 3), np.nan)
        self.wished = np.full((*shape, 3), np.nan)
        self.sent = np.zeros(shape, np.int64)
        self.left = np.zeros(shape, np.int64)
        for robot, index in self._index.items():
            self.left[:, index] = self.places.left(robot)

    def take(self, robot: str, drive: Drive) -> None:
        """The robot's word of one step."""
        index = self._index.get(robot)
        if index is None or not 0 <= drive.step < len(self.left):
            return
        if drive.pose is not None:
            self.held[drive.step, index] = drive.pose
        self.wished[drive.step, index] = (drive.vx, drive.vy, drive.omega)
        self.sent[drive.step, index] = drive.transmits
        self.places.take(robot, drive)
        if drive.route is not None:
            self.left[drive.step :, index] = self.places.left(robot)


def world_setup(path: Path) -> WorldSetup:
    """What the world was told, its files as they lie now. Raises RecordingError."""
    return setup_of(path, WorldSetup, "a world").located(path.parent)


def _count_heard(path: Path, robot: str, counts: NDArray[np.int64], receptions: list[HeardCopy]) -> None:
    """Add what a robot heard to its column, (steps,), and to all that was heard."""
    for _, received in taken(path, RECEIVED):
        heard = [event for event in received.events if isinstance(event, Heard)]
        if 0 <= received.step < len(counts):
            counts[received.step] += len(heard)
        for event in heard:
            receptions.append(HeardCopy(in_seconds(event.instant), event.sender, robot, event.rssi_dbm))


def _places(path: Path, setup: WorldSetup, reported: Sequence[Deed]) -> tuple[PlaceOutcome, ...]:
    """As the referee has them; of a run that was cut, as far as robots said."""
    judged = outcome(path, "places", tuple[PlaceOutcome, ...], "a world")
    if judged is not None:
        return judged
    first: dict[PlaceKey, Deed] = {}
    for deed in reported:
        first.setdefault(deed.place, deed)
    return tuple(
        _unjudged(body.id, index, point, first.get(PlaceKey(body.id, index)))
        for body in setup.robots
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


def _result(path: Path) -> RunResult | None:
    """The run's result; None where there is none."""
    if not path.is_file():
        return None
    if path.stat().st_size > _MOST_BYTES:
        raise EvidenceError(f"{path}: has more than {_MOST_BYTES} bytes; it should be a run's result")
    try:
        return msgspec.json.decode(regular_file.content(path), type=RunResult)
    except (ValueError, RecursionError) as error:
        raise EvidenceError(f"{path}: is no run's result: {error}") from error
