"""Log entries that all robots share: the floor plan, places, bodies, ordered obstacles, radio links."""

from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Final

import numpy as np

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose
from actors.observer import glyphs
from actors.observer.glyphs import MARKS
from actors.robot_model import RobotModel
from actors.task.words import PlaceKey
from observation.evidence.things_over_time import FloorThing
from observation.robot_logs.ros2_log import (
    UNKNOWN_CELL,
    LogEntry,
    Marker,
    disc,
    label,
    lines,
    marker_array,
    occupancy_grid,
)
from observation.view.story import Story, Track

_PLACE_RADIUS: Final = 0.15
_FLAT: Final = 0.02
_HIGH: Final = 0.4
"""Of a robot, a wall, a thing, m."""
_WALL: Final = 0.1
"""How thick a wall is that was ordered, m, as in `actors.world.body`."""
_LINK: Final = 0.02
_LETTERS: Final = 0.3
_PERIOD_S: Final = 1.0
"""Links are those over which something was heard within, s."""


def map_entry(grid: OccupancyGrid) -> LogEntry:
    """The robots' map."""
    values = np.full(grid.cells.shape, UNKNOWN_CELL, np.int8)
    values[grid.cells == FREE], values[grid.cells == OCCUPIED] = 0, 100
    corner = Pose(grid.origin.x, grid.origin.y, 0.0)
    return LogEntry(0, "/map", occupancy_grid(corner, grid.resolution, values, 0), 0)


def place_entries(story: Story) -> Iterator[LogEntry]:
    """All places whenever one stands otherwise: solid, faint once cleaned, grey once given up.

    One that came while the run went on is there from when a robot first speaks of it.
    """
    said = [(route.second, 0, place, "") for route in story.routes for place in route.places]
    said += [(deed.second, 1, deed.place, "given up") for deed in story.given_up]
    said += [(deed.second, 2, deed.place, "done") for deed in story.reported]
    states = {PlaceKey(owner, n): "" for owner, count in story.begun_with.items() for n in range(count)}
    yield _scene(0.0, "/places", _places(story, states))
    for second, now in groupby(sorted(said, key=lambda one: one[:2]), key=lambda one: one[0]):
        before = dict(states)
        for _, _, key, state in now:
            if key.owner in story.places and 0 <= key.place < len(story.places[key.owner]):
                states[key] = state or states.get(key, "")
        if states != before:
            yield _scene(second, "/places", _places(story, states))


def _places(story: Story, states: Mapping[PlaceKey, str]) -> list[Marker]:
    markers = []
    for key, state in states.items():
        colour = glyphs.GREY if state == "given up" else glyphs.robot(story.robots.index(key.owner))
        at = story.places[key.owner][key.place]
        marker = disc(f"{key.owner}/{key.place}", at, _PLACE_RADIUS, _FLAT, colour)
        markers.append(marker._replace(opacity=0.25) if state else marker)
    return markers


def body_entries(story: Story, models: Mapping[str, RobotModel]) -> Iterator[LogEntry]:
    """The robots' discs whenever one acts otherwise: faint while it is frozen, grey while it is off."""
    acts: dict[str, str] = dict.fromkeys(models, "")
    said = [
        (second, robot, act)
        for robot, track in story.tracks.items()
        for second, act in track.acts
        if robot in acts
    ]
    yield _scene(0.0, "/robots", _bodies(story, models, acts))
    for second, now in groupby(sorted(said), key=lambda one: one[0]):
        before = dict(acts)
        acts |= {robot: act for _, robot, act in now}
        if acts != before:
            yield _scene(second, "/robots", _bodies(story, models, acts))


def _bodies(story: Story, models: Mapping[str, RobotModel], acts: Mapping[str, str]) -> list[Marker]:
    markers = []
    for number, robot in enumerate(story.robots):
        if robot in models:
            frame = f"{robot}/{'truth' if story.true else 'base_link'}"
            colour = glyphs.GREY if acts[robot] == "off" else glyphs.robot(number)
            body = disc(robot, (0.0, 0.0), models[robot].footprint.circumradius, _HIGH, colour)
            markers.append(body._replace(opacity=0.4 if acts[robot] else 0.9, frame=frame))
            name = label(f"{robot}/name", robot, _LETTERS, glyphs.WHITE)
            markers.append(name._replace(frame=frame))
    return markers


def thing_entries(story: Story) -> Iterator[LogEntry]:
    """Obstacles, walls, jammers and closed doors, whenever one comes or goes."""
    for second, things in story.things:
        yield _scene(second, "/things", [_thing(number, thing) for number, thing in enumerate(things)])


def _thing(number: int, thing: FloorThing) -> Marker:
    mark = MARKS[thing.kind]
    jams = mark.shape == "dashed ring"
    name, colour = f"{thing.kind} {number}", mark.colour or glyphs.GREY
    marker = lines(name, thing.points, _WALL, colour)
    if thing.radius:
        marker = disc(name, thing.points[0], thing.radius, _FLAT if jams else _HIGH, colour)
    return marker._replace(opacity=0.3 if jams else 1.0)


def link_entries(story: Story) -> Iterator[LogEntry]:
    """Once a second a line between each two robots one of which has just heard the other."""
    tracks = list(story.tracks.values())
    for period in range(1, int(story.end / _PERIOD_S) + 1):
        second = period * _PERIOD_S
        first, last = np.searchsorted(story.heard[:, 0], (second - _PERIOD_S, second))
        pairs = np.unique(np.sort(story.heard[first:last, 1:3].astype(np.int64), axis=1), axis=0)
        points: list[tuple[float, float]] = []
        for one, other in pairs.tolist():
            ends = [_where(tracks[index], second) for index in (one, other)]
            points += [end for end in ends if end is not None] if None not in ends else []
        links = [lines("links", tuple(points), _LINK, glyphs.LINK)] if points else []
        yield _scene(second, "/links", links)


def _where(track: Track, second: float) -> tuple[float, float] | None:
    """Where a robot last was by then, m; None: nobody knows."""
    at = int(np.searchsorted(track.seconds, second, side="right")) - 1
    if at < 0 or np.isnan(track.poses[at, 0]):
        return None
    x, y = track.poses[at, :2].tolist()
    return x, y


def _scene(second: float, topic: str, markers: list[Marker]) -> LogEntry:
    instant = round(second * 1e6)
    return LogEntry(instant, topic, marker_array(markers, instant), instant)
