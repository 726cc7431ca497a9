"""People who walk about the floor: who they are, where they go, and the forces on their bodies.

A person walks to a random point of another room, door or area, stands there for a while, and walks on. All
draws are from the run's seed, with a stream per person. `social_force` has the equations of motion.
"""

from collections.abc import Sequence
from typing import Annotated, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta

from actors.array_types import Floats, Indices, UInt16s
from actors.floor.doors import Doorways
from actors.floor.grid import OccupancyGrid, largest_region
from actors.floor.placement import Area, PlacementError, draw_points
from actors.floor.raster import clearance
from actors.geometry import Point
from actors.instant import Instant, milliseconds, seconds
from actors.portable.draws import uniforms
from actors.portable.elementary import normal_quantile
from actors.randomness import generator
from actors.settings import Settings
from actors.world.social_force import (
    RADIUS,
    REACH,
    UNREACHED,
    guide,
    look_around,
    social_forces,
    travel_costs,
)

MOST_PEOPLE: Final = 100
_CELL: Final = 0.1
"""Approximate size of the cells of routes, m; own choice, as all values below."""
_PERIOD: Final = milliseconds(100)
"""Period at which people look around."""
_ARRIVED: Final = 20
"""Cost of the way left at which a person has arrived: four cells."""
_PATIENCE: Final = seconds(10)
"""Time without progress after which a person goes elsewhere, and time until the next trip after one to an
unreachable destination."""
_FREE: Final = 0.4
"""Minimum distance of starts and destinations from walls, m."""
_APART: Final = 0.8
"""Minimum distance of starts from one another, m."""
_DOORSTEP: Final = 1.5
"""Distance of destinations from a door's middle, at most, m."""
_MOST_CELLS: Final = 100_000_000
"""Cells of all routes together, 200 MB: 25 people on the largest map, 200 m by 200 m."""
_EXTREME: Final = 2.0
"""Speeds are at most this many standard deviations from their mean."""
_SLOWEST: Final = 0.1
"""Lowest walking speed, m/s."""
SEPARATION: Final = seconds(1)
"""A robot and a person that touch again within this time are still in the same contact."""


class PeopleParameters(Settings, frozen=True):
    """Number, speeds and destinations of people."""

    count: Annotated[int, Meta(ge=0, le=MOST_PEOPLE)] = 6
    """Number of people."""
    speed: Annotated[float, Meta(ge=_SLOWEST, le=2.5, extra={"unit": "metres per second"})] = 1.29
    """Mean desired walking speed, m/s (Moussaïd et al., 2009)."""
    speed_spread: Annotated[float, Meta(ge=0, le=1, extra={"unit": "metres per second"})] = 0.19
    """Standard deviation of the desired speeds, m/s (ibid.)."""
    between: Literal["rooms", "doors", "areas"] = "rooms"
    """Destinations. rooms: points of rooms, which are regions between doors; doors: points within 1.5 m of a
    door; areas: points of areas."""
    pause: Annotated[float, Meta(ge=0, le=3600, extra={"unit": "seconds"})] = 5.0
    """Mean time that a person stands at a destination, s; uniform from 0 to twice this."""


class PeopleSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """People of a run."""

    parameters: PeopleParameters
    areas: tuple[Area, ...] = ()
    """Areas of destinations; with them, all starts are in them, too."""


class _TripState(msgspec.Struct):
    """A person's current destination, or stop there."""

    room: int = -1
    """Index of the destination's room, door or area."""
    until: int = 0
    """Instant at which it ends without progress, or at which the stop ends, µs."""
    nearest: int = UNREACHED
    """Least cost of the way left so far."""
    walking: bool = False


class Pedestrians:
    """People on one floor: their speeds, starts, trips and social forces."""

    def __init__(
        self, setup: PeopleSetup, grid: OccupancyGrid, seed: int, robots: Sequence[Point], radius: float
    ) -> None:
        """Draw all people; `robots`: starts of the robots, `radius`: of the largest one, m.

        Raises PlacementError if there is no room for them, or nowhere to go.
        """
        self._parameters = one = setup.parameters
        self._grid = grid
        self._every = max(1, round(_CELL / grid.resolution))
        self._cell = self._every * grid.resolution
        self._room = self._sampled(grid.clearance)
        if one.count * self._room.size > _MOST_CELLS:
            raise PlacementError(
                f"people.count = {one.count}: at most {_MOST_CELLS // self._room.size} on a map of this size"
            )
        self._targets = self._target_cells(setup)
        names = [str(number) for number in range(one.count)]
        self._streams = [generator(seed, "people", name) for name in names]
        drawn = np.array([normal_quantile(stream.random()) for stream in self._streams])
        speeds = one.speed + one.speed_spread * np.clip(drawn, -_EXTREME, _EXTREME)
        self.speeds: Floats = np.maximum(speeds, _SLOWEST)
        """Desired walking speeds, (p,), m/s."""
        try:
            self.starts = draw_points(
                grid,
                one.count,
                rng=generator(seed, "people", "starts"),
                clearance=_FREE,
                apart=max(_APART, radius + 2 * RADIUS),
                keep_off=robots,
                areas=setup.areas or None,
                passage=RADIUS,
            )
            """Position of each person at the start, m."""
        except PlacementError as error:
            raise PlacementError(f"people.count = {one.count}: {error}") from None
        self._trips = [_TripState() for _ in names]
        self._costs: UInt16s = np.full((one.count, *self._room.shape), UNREACHED, np.uint16)
        self._goals = [(0, 0)] * one.count
        self._wishes = np.zeros((one.count, 4))
        self._wishes[:, 3] = self.speeds
        self._left = np.zeros(one.count, np.int64)
        self._sees = np.zeros((one.count, len(robots) + one.count), np.bool_)
        self.set_floor(np.zeros((0, 4)), np.zeros((0, 3)), np.zeros((0, 4)))

    def __len__(self) -> int:
        return len(self.starts)

    def set_floor(self, walls: Floats, obstacles: Floats, leaves: Floats) -> None:
        """Set walls with closed doors, (m, 4), x0, y0, x1, y1, obstacles (o, 3), x, y, radius, and the closed
        doors alone, (d, 4), m.
        """
        self._walls, self._obstacles, self._leaves = walls, obstacles, leaves
        self._is_changed = True

    def drive(self, state: Floats, radii: Floats, now: Instant, dt: float, forces: Floats) -> None:
        """Compute the forces on all people in the next sub-step, as `social_forces`."""
        robots = len(state) - len(self)
        if now % _PERIOD == 0:
            self._look(state, robots, now)
        bodies = state, robots, radii, self._wishes, self._sees
        social_forces(*bodies, self._walls, self._obstacles, dt, forces)

    def _look(self, state: Floats, robots: int, now: Instant) -> None:
        """Look around, follow routes, and begin and end trips."""
        if self._is_changed:
            self._update_room()
        cells = (state[:, :2] - np.array(self._grid.origin)) / self._cell
        look_around(cells, robots, self._room, REACH / self._cell, self._sees)
        for person, trip in enumerate(self._trips):
            if not trip.walking and now >= trip.until:
                self._begin_trip(person, now)
        guide(cells[robots:], self._room, self._costs, self._wishes, self._left)
        for person, (trip, left) in enumerate(zip(self._trips, self._left.tolist(), strict=True)):
            if not trip.walking:
                continue
            if left < trip.nearest:
                trip.nearest, trip.until = left, now + _PATIENCE
            if left <= _ARRIVED or left == UNREACHED or now >= trip.until:
                self._stop(person, now)

    def _begin_trip(self, person: int, now: Instant) -> None:
        """Draw a destination in another room, door or area, and compute the way there."""
        trip, draws = self._trips[person], self._streams[person].random(2).tolist()
        others = [index for index in range(len(self._targets)) if index != trip.room] or [0]
        trip.room = others[int(draws[0] * len(others))]
        rows, columns = self._targets[trip.room]
        chosen = int(draws[1] * len(rows))
        self._goals[person] = int(rows[chosen]), int(columns[chosen])
        travel_costs(self._room, *self._goals[person], self._costs[person])
        trip.walking, trip.nearest, trip.until = True, UNREACHED, now + _PATIENCE
        self._wishes[person, 2] = self.speeds[person]

    def _stop(self, person: int, now: Instant) -> None:
        """End a trip, at its destination or without a way there, and draw how long the person stands."""
        trip = self._trips[person]
        pause = uniforms(self._streams[person], 0.0, 2 * self._parameters.pause, 1)[0]
        retry = _PATIENCE if trip.nearest == UNREACHED else 0
        trip.walking, trip.until = False, now + int(pause * 1e6) + retry
        self._wishes[person, :3] = 0.0

    def _update_room(self) -> None:
        """Compute the free space with obstacles and closed doors, and the ways around them."""
        grid, blocking = self._grid, self._grid.blocking.copy()
        x, y = grid.centres()
        for east, north, radius in self._obstacles.tolist():
            blocking |= np.square(x - east) + np.square(y - north)[:, None] <= radius * radius
        for x0, y0, x1, y1 in self._leaves.tolist():  # along the borders of cells
            low, high = grid.cell(Point(x0, y0)), grid.cell(Point(x1, y1))
            blocking[low.row : high.row + 1, low.column : high.column + 1] = True
        self._room, self._is_changed = self._sampled(clearance(blocking, grid.resolution)), False
        for person, trip in enumerate(self._trips):
            if trip.walking:
                travel_costs(self._room, *self._goals[person], self._costs[person])
                trip.nearest = UNREACHED

    def _sampled(self, values: Floats) -> Floats:
        """Return the values in the middle of each cell of the routes."""
        middle = self._every // 2
        return np.ascontiguousarray(values[middle :: self._every, middle :: self._every])

    def _target_cells(self, setup: PeopleSetup) -> list[tuple[Indices, Indices]]:
        """Return rows and columns of the possible destinations in each room, door or area."""
        grid, between = self._grid, setup.parameters.between
        reached = self._sampled(np.where(largest_region(grid, RADIUS), grid.clearance, 0.0)) >= _FREE
        rows, columns = np.indices(reached.shape)
        x = grid.origin.x + (columns + 0.5) * self._cell
        y = grid.origin.y + (rows + 0.5) * self._cell
        parts = Doorways(grid, RADIUS).regions
        if between == "areas":
            masks = [(one.x0 <= x) & (x < one.x1) & (one.y0 <= y) & (y < one.y1) for one in setup.areas]
        elif between == "doors":
            middles, squared = [door.middle for door in parts.doors], _DOORSTEP * _DOORSTEP
            masks = [np.square(x - one.x) + np.square(y - one.y) < squared for one in middles]
        else:
            labels = self._sampled(parts.labels.astype(np.float64))
            masks = [labels == number for number in range(1, parts.count + 1)]
        found = [np.nonzero(reached & mask) for mask in masks]
        targets = [(cells[0], cells[1]) for cells in found if cells[0].size]
        if not targets or (setup.areas and len(targets) < len(masks)):
            areas = zip(setup.areas, found, strict=False)
            where = next(
                (f"area {one.name!r}" for one, cells in areas if not cells[0].size), "the map's doors"
            )
            raise PlacementError(
                f'people.between is "{between}", but people can reach no point at least {_FREE:g} m from'
                f" walls in {where}; choose other destinations"
            )
        return targets
