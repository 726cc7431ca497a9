"""What robots say of places, step by step: what each means to visit, has cleaned, takes over, gives up."""

from collections.abc import Mapping
from typing import NamedTuple

from actors.instant import in_seconds
from actors.messages import Drive
from actors.task.words import PlaceKey


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
