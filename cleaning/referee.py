"""Judge of the cleaning task: compares robots' reports of visited places with ground truth."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Any, Final

import msgspec
import numpy as np

from actors.array_types import Floats, Int64s
from actors.geometry import Point
from actors.instant import Instant, in_seconds
from actors.items import ItemGivenUp, ItemKey, TaskReports
from actors.task.task import Column, Judge, JudgeSetup, TaskOutcome, TaskProgress, Value
from actors.wording import seconds_text, short_repr
from cleaning.place import VisitReport
from cleaning.visits import find_visits

REACH: Final = 0.7
"""A place counts as visited if ground truth was this near, m: the 0.5 m at which robots report it (d3scomp's
testbed) plus 0.2 m of localisation error."""
COLUMNS: Final = (
    Column("owner", "text", "robot to which the place was assigned"),
    Column("place", "integer", "number in the owner's list, from 0"),
    Column("x", "number", "x of the place, m, map frame"),
    Column("y", "number", "y of the place, m, map frame"),
    Column("verdict", "text", "outcome by the referee; null for a run that was cut off"),
    Column("reached_s", "number", "when a robot truly was there first, simulated s; null: never", "reached"),
    Column("reached_by", "text", "that robot; null: none"),
    Column(
        "reported_s", "number", "when a robot first reported a visit, simulated s; null: never", "reported"
    ),
    Column("reported_by", "text", "that robot; null: none"),
    Column("given_up_s", "number", "when a robot first gave it up, simulated s; null: never", "given_up"),
    Column("given_up_by", "text", "that robot; null: none"),
    Column("reason", "text", "reason that the robot reported; null: not given up"),
    Column("in_route_of", "text", "robots with a process that had it in their route at the end"),
    Column("given_s", "number", "when it was assigned, simulated s; 0: at the start", "given"),
)


class PlaceVerdict(Enum):
    """Final state of a place; a report overrides giving up, whichever came first."""

    DONE = "done"
    """Reported after a robot had been within reach."""
    CLAIMED = "claimed"
    """Reported, without ground truth; not in simulation."""
    MISTAKEN = "mistaken"
    """Reported before any robot had been within reach."""
    GIVEN_UP = "given up"
    """Given up and never reported."""
    LOST = "lost"
    """Neither, and at the end in no route of a robot with a process."""
    OPEN = "open"
    """Neither, and at the end in the route of a robot with a process."""


class PlaceOutcome(msgspec.Struct):
    """State of one place; instants in µs, None = never."""

    owner: str
    number: int
    x: float
    y: float
    reached_at: int | None = None
    """First true visit."""
    reached_by: str | None = None
    reported_at: int | None = None
    """First report of a visit."""
    reported_by: str | None = None
    given_up_at: int | None = None
    """First time it was given up; it may have been reported before or after."""
    given_up_by: str | None = None
    reason: str | None = None
    """Reason given by `given_up_by`."""
    in_route_of: tuple[str, ...] = ()
    """Robots with a process and with this place in their route at the end, in scenario order."""
    given_at: int = 0
    """Instant at which it was given to its owner; 0: at the start."""
    has_truth: bool = True
    """False: reports are unverified."""

    @property
    def key(self) -> ItemKey:
        """Key of the place."""
        return ItemKey(self.owner, self.number)

    @property
    def verdict(self) -> PlaceVerdict:
        """Final state of the place."""
        if self.reported_at is not None:
            if not self.has_truth:
                return PlaceVerdict.CLAIMED
            return PlaceVerdict.DONE if self.done else PlaceVerdict.MISTAKEN
        if self.given_up_at is not None:
            return PlaceVerdict.GIVEN_UP
        return PlaceVerdict.OPEN if self.in_route_of else PlaceVerdict.LOST

    @property
    def done(self) -> bool:
        """True if reported after a robot had been within reach."""
        return (
            self.reported_at is not None
            and self.reached_at is not None
            and self.reached_at <= self.reported_at
        )

    @property
    def settled_at(self) -> int | None:
        """First report or giving up, µs; None: neither."""
        instants = [instant for instant in (self.reported_at, self.given_up_at) if instant is not None]
        return min(instants, default=None)

    def row(self) -> dict[str, Value]:
        """Return the row of the table of places, by column of COLUMNS."""
        values = (
            *(self.owner, self.number, self.x, self.y, self.verdict.value),
            *(_seconds(self.reached_at), self.reached_by),
            *(_seconds(self.reported_at), self.reported_by),
            *(_seconds(self.given_up_at), self.given_up_by, self.reason),
            " ".join(self.in_route_of),
            _seconds(self.given_at),
        )
        return {column.name: value for column, value in zip(COLUMNS, values, strict=True)}


def _seconds(instant: int | None) -> float | None:
    return None if instant is None else in_seconds(instant)


class Referee(Judge):
    """Judge of visits, from true positions and robots' reports."""

    def __init__(self, setup: JudgeSetup, reach: float = REACH) -> None:
        super().__init__()
        self._ids = setup.robots
        self._grid = setup.grid
        self._has_truth = setup.has_truth
        self._in_simulation = setup.world is not None
        self._reach = reach
        self._places: dict[ItemKey, PlaceOutcome] = {}
        """All places; their order is that of the points."""
        self._keys: list[ItemKey] = []
        self._points: Floats = np.empty((0, 2))
        self._unreached: Int64s = np.arange(0)
        """Indices of the places that no robot has reached."""
        self._unsettled: set[ItemKey] = set()
        self._assigned: dict[str, tuple[ItemKey, ...]] = dict.fromkeys(setup.robots, ())
        for robot in setup.robots:
            self._assign(robot, setup.items[robot], "open")
        self._routes = dict(self._assigned)

    def _assign(
        self, robot: str, points: Sequence[tuple[float, float]], state: str, instant: int = 0
    ) -> None:
        """Add places of a robot, shown in a state."""
        first, count = len(self._keys), len(self._assigned[robot])
        for number, (x, y) in enumerate(points, start=count):
            place = PlaceOutcome(robot, number, x, y, given_at=instant, has_truth=self._has_truth)
            self._places[place.key] = place
            self._keys.append(place.key)
            self._show(place, state)
        new = self._keys[first:]
        self._points = np.concatenate([self._points, np.array(points, np.float64).reshape(-1, 2)])
        self._unreached = np.concatenate([self._unreached, np.arange(first, len(self._keys))])
        self._unsettled.update(new)
        self._assigned[robot] += tuple(new)

    @property
    def settled(self) -> bool:
        """True once every place was reported or given up; False without places."""
        return bool(self._keys) and not self._unsettled

    def watch(self, instant: Instant, positions: Floats) -> None:
        """Process the robots' true positions, (n, 2) m, in the order of the set-up."""
        if not self._unreached.size:
            return
        found = find_visits(self._points, self._unreached, positions, self._reach)
        if len(found):
            for number, robot in found.tolist():
                place = self._places[self._keys[number]]
                place.reached_at, place.reached_by = instant, self._ids[robot]
            self._unreached = np.setdiff1d(self._unreached, found[:, 0], assume_unique=True)

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Process a robot's reports of a step; return an error for an unknown place, else None."""
        for report in answer.reports:
            if report_fault := self._report(robot, report):
                return report_fault
        for given_up in answer.given_up:
            if given_up.key not in self._places:
                return _unknown_place("gives up", given_up.key)
            self._give_up(robot, given_up)
        if answer.route is not None:
            for key in answer.route:
                if key not in self._places:
                    return _unknown_place("has in its route", key)
            self._routes[robot] = answer.route
        return None

    def _report(self, robot: str, report: VisitReport) -> str | None:
        """Record a robot's report; the first report of a place counts."""
        place = self._places.get(report.key)
        if place is None:
            return _unknown_place("reports", report.key)
        self.note(robot, report.instant, "cleaned", report.key)
        if place.reported_at is None:
            place.reported_at, place.reported_by = report.instant, robot
            self._show(place, "done", robot)
        self._unsettled.discard(report.key)
        return None

    def _give_up(self, robot: str, given_up: ItemGivenUp) -> None:
        """Record that a robot gives up an existing place; the first time counts."""
        place = self._places[given_up.key]
        if place.given_up_at is None:
            place.given_up_at, place.given_up_by, place.reason = given_up.instant, robot, given_up.reason
        if place.reported_at is None:
            self._show(place, "given up", robot)
        self._unsettled.discard(given_up.key)

    def _show(self, place: PlaceOutcome, state: str, by: str = "") -> None:
        self.mark(place.key, (place.x, place.y), state, by)

    def restart(self, robot: str) -> None:
        """Reset the route of a restarted robot to the places that it was given."""
        self._routes[robot] = self._assigned[robot]

    def give(self, instant: Instant, robot: str, items: Sequence[Any]) -> str | None:
        """Give further places to a robot and append them to its route."""
        for x, y in items:
            if self._grid is not None and not self._grid.is_free(Point(x, y)):
                return f"({x:g}, {y:g}) is not on free floor; choose another place"
        count = len(self._assigned[robot])
        self._assign(robot, items, "given", int(instant))
        self._routes[robot] = (*self._routes[robot], *self._assigned[robot][count:])
        return None

    def progress(self, present: Collection[str]) -> TaskProgress:
        """Count places in routes of the robots in `present`, and reported places."""
        open_places = {key for robot in present for key in self._routes[robot]}
        reported = sum(place.reported_at is not None for place in self._places.values())
        return TaskProgress(len(open_places), reported)

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        """Return the state of all places, in the order of the robots and their lists."""
        places = tuple(self.places(present))
        for place in places:
            if place.verdict is PlaceVerdict.MISTAKEN:
                self._show(place, "given up", place.reported_by or "")
        values = place_values(places, has_truth=self._has_truth)
        robots = {
            robot: robot_values((one for one in places if one.owner == robot), has_truth=self._has_truth)
            for robot in self._ids
        }
        rows = tuple(place.row() for place in places)
        clock = " of simulated time" if self._in_simulation else ""
        return TaskOutcome(_summary(values, end, clock), values, robots, rows, tuple(_notes(values)))

    def places(self, present: Collection[str]) -> Iterator[PlaceOutcome]:
        """Yield the current state of every place, in the order of the robots and their lists."""
        holders: dict[ItemKey, list[str]] = {}
        for robot in self._ids:
            for key in self._routes[robot] if robot in present else ():
                holders.setdefault(key, []).append(robot)
        for keys in self._assigned.values():
            for key in keys:
                in_route_of = tuple(holders.get(key, ()))
                yield msgspec.structs.replace(self._places[key], in_route_of=in_route_of)


def _unknown_place(verb: str, key: ItemKey) -> str:
    return f"{verb} place {key.number} of {short_repr(key.owner)}, which does not exist"


_ROBOT_VALUES: Final = ("places_total", "places_done", "places_claimed", "places_given_up", "completion_s")


def place_values(places: Sequence[PlaceOutcome], *, has_truth: bool = True) -> dict[str, Value]:
    """Count places by their final state; instants in simulated s.

    `has_truth`: ground truth is available.
    """
    verdicts = Counter(place.verdict for place in places)
    reported = [place.reported_at for place in places if place.reported_at is not None]
    settled = [place.settled_at for place in places if place.settled_at is not None]
    done = verdicts[PlaceVerdict.DONE] if has_truth else len(reported)
    last = in_seconds(max(reported, default=0))
    return {
        "places_total": len(places),
        "places_done": done if has_truth else None,
        "places_claimed": len(reported),
        "places_given_up": verdicts[PlaceVerdict.GIVEN_UP],
        "places_lost": verdicts[PlaceVerdict.LOST],
        "completion_s": last if done == len(places) else None,
        "settled_s": in_seconds(max(settled, default=0)) if len(settled) == len(places) else None,
        "last_reached_s": last if reported else None,
        **({} if has_truth else {"places_reported": len(reported)}),
    }


def robot_values(places: Iterable[PlaceOutcome], *, has_truth: bool) -> dict[str, Value]:
    """Count the places of one robot."""
    counts = place_values([*places], has_truth=has_truth)
    return {name: counts[name] for name in (*_ROBOT_VALUES, "places_reported") if name in counts}


def _summary(values: Mapping[str, Any], end: Instant, clock: str) -> str:
    total, done = values["places_total"], values["places_done"]
    if not total:
        return "had no places to clean"
    if done is None:
        return f"reported {values['places_claimed']} of {total} places as cleaned"
    if values["completion_s"] is not None:
        return f"cleaned all {total} places in {seconds_text(values['completion_s'])} s{clock}"
    left = total - done
    return (
        f"cleaned {done} of {total} places in {seconds_text(in_seconds(end))} s{clock}; "
        f"{left} {'is' if left == 1 else 'are'} left"
    )


def _notes(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield sentences on settled, falsely reported and lost places."""
    done, settled, lost = values["places_done"], values["settled_s"], values["places_lost"]
    if values["completion_s"] is None and settled is not None:
        yield f"Every place was reported or given up by {seconds_text(settled)} s."
    if done is not None and values["places_claimed"] > done:
        false = values["places_claimed"] - done
        yield f"{_places(false)} reported although no robot had visited {'it' if false == 1 else 'them'}."
        if settled is not None:
            yield "False reports ended the run."
    if lost:
        yield f"{_places(lost)} lost: neither reported nor given up, and on no robot's route."


def _places(count: int) -> str:
    return "1 place was" if count == 1 else f"{count} places were"
