"""What there is to draw of a run, wherever it took place: in the simulated world, or on robots alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from observation.evidence.said_places import Deed, Route
from observation.evidence.things_over_time import OrderedChange, Things

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
