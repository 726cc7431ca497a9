"""The chapter's example with each robot's places in a short tour.

Idea: shorter paths through fewer doors cause fewer encounters. Source: 2-opt (Croes 1958) from the
nearest-neighbour tour, by path lengths on the robot's map; otherwise as `chapter`. Limits: robots keep their
places, so two with places in each other's office still meet at the doors. Settings: `TourParameters`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

from actors.geometry import Point
from actors.robot.behaviour import Behaviour, FloorPlan, Start, from_settings, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import exchanges
from cleaning.parameters import AdaptationParameters
from cleaning.place import Assignment
from deeco import adaptation, component, periodic, replace, seconds

FAR: Final = 1000.0
"""Cost if there is no path, m: more than any real tour of a few places."""
_PASSES: Final = 20
"""Maximum number of passes of 2-opt; two or three are usual."""
_GAIN: Final = 1e-6
"""Minimum gain of a change, m: above the rounding error of sums of lengths."""


class PathCosts:
    """Path costs, m: length plus a charge for each door."""

    def __init__(self, floor: FloorPlan, door_charge: float = 0.0) -> None:
        self.floor = floor
        self._charge = door_charge
        self._known: dict[tuple[Point, Point], float] = {}

    def cost(self, start: Point, goal: Point) -> float:
        """Return the cost from any point to a place, m."""
        known = self._known.get((start, goal))
        if known is None:
            known = self._known[start, goal] = self._cost(start, goal)
        return known

    def tour(self, start: Point, route: Sequence[Assignment]) -> float:
        """Return the cost from `start` along all places in order, m."""
        cost, here = 0.0, start
        for place in route:
            cost += self.cost(here, place.point)
            here = place.point
        return cost

    def saving(self, start: Point, route: Sequence[Assignment], index: int) -> float:
        """Return the cost saved by removing a place from the tour, m, ≥ 0."""
        here = route[index].point
        before = route[index - 1].point if index else start
        if index + 1 == len(route):
            return self.cost(before, here)
        after = route[index + 1].point
        return max(0.0, self.cost(before, here) + self.cost(here, after) - self.cost(before, after))

    def insertion(self, start: Point, route: Sequence[Assignment], point: Point) -> tuple[float, int]:
        """Return the lowest cost of inserting a point, m, ≥ 0, and its index; the first of equal ones."""
        best, where = self.cost(route[-1].point if route else start, point), len(route)
        before = start
        for index, place in enumerate(route):
            after = place.point
            added = self.cost(before, point) + self.cost(point, after) - self.cost(before, after)
            if added < best - _GAIN or (index == 0 and added <= best):
                best, where = added, index
            before = after
        return max(0.0, best), where

    def two_opt(self, start: Point, route: Sequence[Assignment], fixed: int = 0) -> tuple[Assignment, ...]:
        """Return the places in a 2-opt tour (Croes 1958): no reversal of a part makes it shorter.

        The tour is open and begins at `start`; the first `fixed` places keep their positions. The initial
        tour is the better of the given order and the nearest-neighbour tour.
        """
        best = list(route[:fixed])
        left, here = list(route[fixed:]), best[-1].point if best else start
        while left:
            nearest = min(range(len(left)), key=lambda index: self.cost(here, left[index].point))
            here = left[nearest].point
            best.append(left.pop(nearest))
        if self.tour(start, route) <= self.tour(start, best):
            best = list(route)
        for _ in range(_PASSES):
            if not self._reverse_parts(start, best, fixed):
                break
        return tuple(best)

    def _reverse_parts(self, start: Point, tour: list[Assignment], fixed: int) -> bool:
        """Reverse each part whose reversal shortens the tour; return True if there was one."""
        changed = False
        for first in range(fixed, len(tour) - 1):
            for last in range(first + 1, len(tour)):
                before = tour[first - 1].point if first else start
                gain = self.cost(before, tour[first].point) - self.cost(before, tour[last].point)
                if last + 1 < len(tour):
                    after = tour[last + 1].point
                    gain += self.cost(tour[last].point, after) - self.cost(tour[first].point, after)
                if gain > _GAIN:
                    tour[first : last + 1] = reversed(tour[first : last + 1])
                    changed = True
        return changed

    def _cost(self, start: Point, goal: Point) -> float:
        length = self.floor.length(start, goal)
        if length is None:
            return FAR
        if not self._charge:
            return length
        return length + self._charge * len(self.floor.doors_between(start, goal) or ())


@dataclass(frozen=True)
class TourParameters(AdaptationParameters):
    """Parameters of the chapter and of the tour."""

    door_charge: float = 4.0
    """Additional cost of a door, m; as in `auction`."""


@component
class TouringRobot(AdaptiveCleaningRobot):
    """A robot that visits its places in a short tour."""

    parameters: TourParameters = TourParameters()

    @adaptation
    @periodic(every=seconds(5), order=0)
    def plan(self, floor: FloorPlan) -> Self:
        """Order the places in a short tour; the destination stays first."""
        if len(self.route) < 2:
            return self
        costs, mine = PathCosts(floor, self.parameters.door_charge), self.destination
        route = self.route if mine is None else (mine, *(one for one in self.route if one != mine))
        return replace(self, route=costs.two_opt(self.position, route, 0 if mine is None else 1))


def behaviour(start: Start) -> Behaviour:
    """Extend `chapter`: visit the robot's own places in a short tour (2-opt by path length)."""
    p = from_settings(TourParameters, start.settings)
    return host(start, TouringRobot.at_start(start, p), *exchanges(p))
