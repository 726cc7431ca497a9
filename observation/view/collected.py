"""The story of a field trial, from its robots' own recordings: nobody knows where they were but they."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import FREE, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import RECEIVED, Heard
from actors.task.words import PlaceKey
from observation.evidence.recorded import taken
from observation.evidence.said_places import Deed, Route
from observation.field_trial.aligned_clocks import AlignedClocks
from observation.field_trial.recordings import FieldTrial, read_field_trial
from observation.field_trial.reported_places import reported_places
from observation.field_trial.robot_log import Moment, RobotLog
from observation.view.story import Floats, Source, Story, Track

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
        heard=_heard(trial, times, robots),
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


def _heard(trial: FieldTrial, times: dict[int, _Times], robots: Sequence[str]) -> Floats:
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
