"""What became of the places of a field trial, from what its robots said."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.field_trial.clocks import AlignedClocks
from acrc_testbed.field_trial.recordings import FieldTrial, Moment, RobotLog
from actors.instant import Duration, seconds
from actors.task.referee import PlaceOutcome, Referee, Verdict
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport

_TOGETHER: Final[Duration] = seconds(30)
"""A robot whose last step lies so much before the last one of all still takes part at the end: people switch
one off after the other."""
_MOST_PLACES: Final = 10_000
"""Of a robot whose list is not known."""


class ClaimedPlace(PlaceOutcome, frozen=True):
    """What became of a place where nobody watched: a report is neither true nor mistaken."""

    @property
    def verdict(self) -> Verdict:
        """What has become of it, in one word."""
        return Verdict.CLAIMED if self.reported_at is not None else super().verdict


class ReportedPlaces(NamedTuple):
    """All places, and what they are taken from."""

    places: tuple[PlaceOutcome, ...]
    """In the order of robots and lists; x and y are NaN where only the place's number is known."""
    notes: tuple[str, ...]
    """What is not known, a sentence each."""
    contacts: int | None = None
    """Contacts that truly began; None: nobody watched, and so not where the robots were either."""


@dataclass(frozen=True)
class _Owner:
    """A robot and its list."""

    id: str
    places: tuple[tuple[float, float], ...]


class _ReportedWord(NamedTuple):
    """What one robot said of one place; `instant` is the field trial's."""

    instant: int
    robot: str
    said: PlaceReport | PlaceGivenUp


def reported_places(trial: FieldTrial, clocks: AlignedClocks) -> ReportedPlaces:
    """What became of every place that a robot was given or spoke of; instants since the trial's begin."""
    words = _words(trial, clocks)
    lists = {robot: logs[0].identity.places for robot, logs in trial.logs.items()}
    known = {robot: places for robot, places in lists.items() if places is not None}
    unknown = _unknown(words, known)
    owners = [_Owner(robot, places) for robot, places in (known | unknown).items()]
    referee = Referee(owners, reach=0.0)
    outside = 0
    for word in words:
        if not referee.knows(word.said):
            outside += 1
        elif isinstance(word.said, PlaceReport):
            referee.report(word.robot, word.said)
        else:
            referee.give_up(word.robot, word.said)
    spoken = {(word.said.owner, word.said.place) for word in words}
    places = [
        ClaimedPlace(**msgspec.structs.asdict(place))
        for place in referee.outcomes(_routes(trial, clocks))
        if place.owner in known or (place.owner, place.place) in spoken
    ]
    return ReportedPlaces(tuple(places), tuple(_notes(unknown, outside)))


def _words(trial: FieldTrial, clocks: AlignedClocks) -> list[_ReportedWord]:
    """Everything said of places, in the order of time."""
    begin = clocks.begin
    words = []
    for robot, logs in trial.logs.items():
        for log in logs:
            for tick, drive in log.drives:
                said: tuple[PlaceReport | PlaceGivenUp, ...] = (*drive.reports, *drive.given_up)
                for word in said:
                    instant = clocks.instant(log, Moment(tick, word.instant)) - begin
                    words.append(
                        _ReportedWord(instant, robot, msgspec.structs.replace(word, instant=instant))
                    )
    return sorted(words, key=lambda word: word.instant)


def _unknown(
    words: Sequence[_ReportedWord], known: dict[str, tuple[tuple[float, float], ...]]
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Lists without positions for the owners whose own are not known, as long as what was said needs."""
    most: dict[str, int] = {}
    for word in words:
        if word.said.owner not in known and 0 <= word.said.place < _MOST_PLACES:
            most[word.said.owner] = max(most.get(word.said.owner, 0), word.said.place + 1)
    return {owner: ((math.nan, math.nan),) * number for owner, number in sorted(most.items())}


def _routes(trial: FieldTrial, clocks: AlignedClocks) -> dict[str, tuple[PlaceKey, ...]]:
    """Where the robots that take part at the end still mean to go."""
    last = {
        robot: steps[-1]
        for robot, logs in trial.logs.items()
        if (steps := [log for log in logs if log.ticks])
    }
    ends = {robot: _end(log, clocks) for robot, log in last.items()}
    latest = max(ends.values())
    return {robot: _route(log) for robot, log in last.items() if latest - ends[robot] <= _TOGETHER}


def _end(log: RobotLog, clocks: AlignedClocks) -> int:
    return clocks.instant(log, Moment(len(log.ticks) - 1, log.ticks[-1].instant))


def _route(log: RobotLog) -> tuple[PlaceKey, ...]:
    said = [drive.route for _, drive in log.drives if drive.route is not None]
    places = log.identity.places or ()
    given = tuple(PlaceKey(log.identity.id, number) for number in range(len(places)))
    return said[-1] if said else given


def _notes(unknown: dict[str, tuple[tuple[float, float], ...]], outside: int) -> Iterator[str]:
    for owner in unknown:
        yield (
            f"{owner}: its list of places is not known, so the table has those that others spoke of, without "
            "where they are"
        )
    if outside:
        yield f"{outside} words were about places that there are not, and are left out"
