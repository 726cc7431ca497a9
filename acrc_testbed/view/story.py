"""What there is to draw of a run, simulated or of real robots that recorded it themselves."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.evidence.run_evidence import Deed, Route, RunEvidence, taken
from acrc_testbed.evidence.run_reader import recorded_run
from acrc_testbed.evidence.things_over_time import OrderedChange, Things, ThingsOverTime, ordered
from acrc_testbed.field_trial.clocks import AlignedClocks
from acrc_testbed.field_trial.recordings import FieldTrial, Moment, RobotLog, read_field_trial
from acrc_testbed.field_trial.reported_places import reported_places
from acrc_testbed.recordings.topics import so_far
from actors.floor.grid import FREE, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import RECEIVED, Heard
from actors.task.task import PlaceKey

Floats = NDArray[np.float64]
Clock = Callable[[NDArray[np.int64]], Floats]
"""From a process's own instants, µs, to the run's seconds."""


@dataclass(frozen=True, eq=False)
class Track:
    """One robot over time; n instants."""

    seconds: Floats
    """(n,)"""
    poses: Floats
    """(n, 3): x, y, m, and heading, rad: where it was; where nobody watched, where it held itself to be."""
    held: Floats
    """(n, 3): where it held itself to be; NaN where it did not say."""
    acts: tuple[tuple[float, str], ...]
    """From when on it acts (""), is frozen, or off."""


class Source(NamedTuple):
    """A recording of a robot that may be replayed."""

    actor: str
    robot: str
    clock: Clock


@dataclass(frozen=True, eq=False)
class Story:
    """What is drawn: a whole run, or the next piece of one that goes on."""

    title: str
    out: Path
    grid: OccupancyGrid
    tracks: Mapping[str, Track]
    """By robot, in their order."""
    places: Mapping[str, tuple[tuple[float, float], ...]]
    """By owner, m; those that came while the run went on behind those that it began with."""
    begun_with: Mapping[str, int]
    """How many places each owner had at the start."""
    routes: tuple[Route, ...]
    """In the order of their instants."""
    reported: tuple[Deed, ...]
    taken_over: tuple[Deed, ...]
    given_up: tuple[Deed, ...]
    heard: Floats
    """(k, 4): instant, s, index of sender and of receiver, RSSI, dBm, in order of the instants."""
    end: float
    """Until when it tells, s; of a run that goes on, the beginning of the last step that is known."""
    true: bool
    """False: nobody knows where robots were."""
    sources: tuple[Source, ...]
    notes: tuple[str, ...] = ()
    """What is missing or not known, a sentence each."""
    doors: NDArray[np.bool_] | None = None
    """(rows, columns): cells of the map's doors."""
    things: tuple[tuple[float, Things], ...] = ()
    """From which instant on, s, these things stood on the floor beside the map."""
    ordered: tuple[OrderedChange, ...] = ()
    since: float = 0.0
    """From when on it tells, s: later pieces of a run that goes on have what is new only, but for places."""

    @property
    def robots(self) -> tuple[str, ...]:
        """In their order."""
        return tuple(self.tracks)


def simulated_story(out: Path) -> Story:
    """Read a run's folder, finished, cut or still going on. Raises RecordingError or EvidenceError."""
    story = Teller().story(recorded_run(out))
    if (out / "run.json").is_file():
        return story
    return replace(story, title=f"{story.title}, {so_far(out, story.end)}")


class Teller:
    """Makes a story of a run, or of one piece of it after another."""

    def __init__(self) -> None:
        self._acts: dict[str, str] = {}
        self._things = ThingsOverTime()
        self._doors: NDArray[np.bool_] | None = None

    def story(self, run: RunEvidence) -> Story:
        """What there is to draw of it."""
        setup = run.setup
        things = tuple(self._things.extend(run))
        if self._doors is None:
            parts = self._things.floor(run).doorways.regions
            self._doors = parts.labels > parts.count
        return Story(
            title=f"{len(run.robots)} robots, seed {setup.seed}",
            out=run.out,
            grid=run.grid,
            tracks={robot: self._track(run, index) for index, robot in enumerate(run.robots)},
            places={body.id: (*body.places, *run.given.get(body.id, ())) for body in setup.robots},
            begun_with={body.id: len(body.places) for body in setup.robots},
            routes=run.routes,
            reported=run.reported,
            taken_over=run.taken_over,
            given_up=run.given_up,
            heard=_heard(run),
            end=run.end,
            true=True,
            sources=tuple(Source(actor, robot, _seconds) for actor, robot in run.processes.items()),
            since=run.since,
            doors=self._doors,
            things=things,
            ordered=tuple(ordered(run)),
        )

    def _track(self, run: RunEvidence, index: int) -> Track:
        robot, acts = run.robots[index], []
        columns = run.seconds, run.powered[:, index], run.stepping[:, index]
        for second, powered, stepping in zip(*(one.tolist() for one in columns), strict=True):
            state = "off" if not powered else "" if stepping else "frozen"
            if self._acts.get(robot) != state:
                self._acts[robot] = state
                acts.append((second, state))
        return Track(run.seconds, run.true[:, index], run.held[:, index], tuple(acts))


def _heard(run: RunEvidence) -> Floats:
    """(k, 4): all receptions of frames whose sender is known."""
    index = {robot: number for number, robot in enumerate(run.robots)}
    known = [one for one in run.receptions if one.sender in run.addresses]
    rows = [
        (one.second, index[run.addresses[one.sender]], index[one.receiver], one.rssi_dbm) for one in known
    ]
    return np.array(sorted(rows), np.float64).reshape(-1, 4)


def _seconds(instants: NDArray[np.int64]) -> Floats:
    seconds: Floats = instants / 1e6
    return seconds


_MARGIN: Final = 2.0
"""Round what robots have seen of a floor whose plan is not there, m."""
_CELL: Final = 0.1


def collected_story(out: Path) -> Story:
    """Read a folder with the robots' folders. Raises FieldTrialError if they do not make up one trial."""
    trial = read_field_trial([out])
    clocks = AlignedClocks(trial)
    times = {id(log): _Times(log, clocks) for log in trial.all_logs()}
    tracks = {robot: _track(logs, times) for robot, logs in trial.logs.items()}
    robots = list(tracks)
    grid, notes = _grid(trial, tracks)
    told = list(_told(trial, times))
    return Story(
        title=f"{len(robots)} robots, from their own recordings",
        out=out,
        grid=grid,
        tracks=tracks,
        places={robot: logs[0].identity.places or () for robot, logs in trial.logs.items()},
        begun_with={robot: len(logs[0].identity.places or ()) for robot, logs in trial.logs.items()},
        routes=tuple(sorted((one for one in told if isinstance(one, Route)), key=lambda one: one.second)),
        reported=_deeds(trial, times, "reports"),
        taken_over=tuple(_taken_over(trial, told)),
        given_up=_deeds(trial, times, "given_up"),
        heard=_heard_by_robots(trial, times, robots),
        end=clocks.span / 1e6,
        true=False,
        sources=tuple(
            Source(log.path.stem, log.identity.id, times[id(log)].seconds) for log in trial.all_logs()
        ),
        notes=(*trial.notes, *clocks.notes, *reported_places(trial, clocks).notes, *notes),
    )


class _Times:
    """From one recording's instants to the seconds of the trial."""

    def __init__(self, log: RobotLog, clocks: AlignedClocks) -> None:
        self._own = np.array([tick.instant for tick in log.ticks], np.int64)
        begin = clocks.begin
        aligned = [clocks.instant(log, Moment(k, tick.instant)) - begin for k, tick in enumerate(log.ticks)]
        self.ticks: Floats = np.array(aligned, np.float64) / 1e6

    def seconds(self, instants: NDArray[np.int64]) -> Floats:
        """Between two steps in proportion."""
        if not len(self._own):
            return np.zeros(len(instants))
        shift: Floats = np.interp(instants, self._own, self.ticks - self._own / 1e6)
        return instants / 1e6 + shift


def _track(logs: Sequence[RobotLog], times: dict[int, _Times]) -> Track:
    rows = [
        (times[id(log)].ticks[tick], *(drive.pose or (np.nan,) * 3))
        for log in logs
        for tick, drive in log.drives
    ]
    table = np.array(sorted(rows), np.float64).reshape(-1, 4)
    acts: list[tuple[float, str]] = []
    for log in logs:
        ticks = times[id(log)].ticks
        if len(ticks):
            acts += [(float(ticks[0]), ""), (float(ticks[-1]), "off")]
    return Track(table[:, 0], table[:, 1:], table[:, 1:], tuple(sorted(acts)) or ((0.0, "off"),))


def _told(trial: FieldTrial, times: dict[int, _Times]) -> Iterator[Route]:
    for robot, logs in trial.logs.items():
        for log in logs:
            ticks = times[id(log)].ticks
            for tick, drive in log.drives:
                if drive.route is not None:
                    yield Route(robot, float(ticks[tick]), drive.route)


def _deeds(trial: FieldTrial, times: dict[int, _Times], what: str) -> tuple[Deed, ...]:
    found = []
    for robot, logs in trial.logs.items():
        for log in logs:
            for _, drive in log.drives:
                for word in drive.reports if what == "reports" else drive.given_up:
                    second = times[id(log)].seconds(np.array([word.instant], np.int64))[0]
                    found.append(Deed(robot, float(second), PlaceKey(word.owner, word.place)))
    return tuple(sorted(found, key=lambda deed: deed.second))


def _taken_over(trial: FieldTrial, told: Sequence[Route]) -> Iterator[Deed]:
    for robot in trial.logs:
        before: set[PlaceKey] = set()
        for route in told:
            if route.robot == robot:
                for place in route.places:
                    if place not in before and place.owner != robot:
                        yield Deed(robot, route.second, place)
                before = set(route.places)


def _heard_by_robots(trial: FieldTrial, times: dict[int, _Times], robots: Sequence[str]) -> Floats:
    senders = {log.identity.address: robots.index(log.identity.id) for log in trial.all_logs()}
    rows = []
    for log in trial.all_logs():
        for _, received in taken(log.path, RECEIVED):
            for event in received.events:
                if isinstance(event, Heard) and event.sender in senders:
                    second = times[id(log)].seconds(np.array([event.instant], np.int64))[0]
                    own = robots.index(log.identity.id)
                    rows.append((float(second), senders[event.sender], own, event.rssi_dbm))
    return np.array(sorted(rows), np.float64).reshape(-1, 4)


def _grid(trial: FieldTrial, tracks: dict[str, Track]) -> tuple[OccupancyGrid, tuple[str, ...]]:
    """The map that lies beside a recording; else bare floor where robots held themselves to be."""
    for log in trial.all_logs():
        for path in (log.path.parent / "map.yaml", log.path.parent.parent / "map" / "map.yaml"):
            if path.is_file():
                return load_map(path), ()
    poses = np.concatenate([track.poses[:, :2] for track in tracks.values()])
    known = poses[np.isfinite(poses[:, 0])]
    low, high = (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(2), np.ones(2))
    columns, rows = np.ceil((high - low + 2 * _MARGIN) / _CELL).astype(np.int64).tolist()
    bare = np.full((rows, columns), FREE, np.uint8)
    corner = Point(*(low - _MARGIN).tolist())
    return OccupancyGrid(bare, _CELL, corner), ("no map lies beside the recordings: the floor is drawn bare",)
