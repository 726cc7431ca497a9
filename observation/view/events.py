"""What happened in a run, in words: by what was recorded, and by what robots perceived and meant."""

from collections.abc import Iterator, Sequence

import numpy as np

from actors.observer.drawing.words import DrawnEvent
from actors.task.words import PlaceKey
from observation.evidence.said_places import Deed
from observation.trace.rows import Trace
from observation.view.story import Clock, Source, Story


class Firsts:
    """Who said so first of each place."""

    def __init__(self) -> None:
        self._known: set[PlaceKey] = set()

    def of(self, deeds: Sequence[Deed]) -> list[Deed]:
        """Those of which nobody has said so before."""
        found = []
        for deed in deeds:
            if deed.place not in self._known:
                self._known.add(deed.place)
                found.append(deed)
        return found


class Happenings:
    """Tells of a story piece by piece."""

    def __init__(self) -> None:
        self._firsts = Firsts()
        self._notes: set[str] = set()
        self._begun: set[str] = set()

    def of(self, story: Story) -> Iterator[DrawnEvent]:
        """What happened in it, by what was recorded."""
        for deed in self._firsts.of(story.reported):
            own = "" if deed.place.owner == deed.robot else f", adopted from {deed.place.owner}"
            yield DrawnEvent(deed.second, deed.robot, f"cleaned {name(deed.place)}{own}")
        for deed in story.given_up:
            yield DrawnEvent(deed.second, deed.robot, f"gives up {name(deed.place)}", "ERROR")
        for deed in story.taken_over:
            yield DrawnEvent(deed.second, deed.robot, f"adopts {name(deed.place)}", "WARN")
        for robot, track in story.tracks.items():
            for second, state in track.acts:
                if state or robot in self._begun:
                    yield DrawnEvent(second, robot, f"is {state}" if state else "acts again", "WARN")
                self._begun.add(robot)
        for change in story.ordered:
            yield DrawnEvent(change.second, change.robot, change.words, "WARN")
        for note in story.notes:
            if note not in self._notes:
                self._notes.add(note)
                yield DrawnEvent(story.since, "", note, "WARN")


class InnerHappenings:
    """Tells of one process of a robot."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._blocked: float | None = None
        self._activity = ""

    def of(self, inside: Trace) -> Iterator[DrawnEvent]:
        """What happened in it since the last time."""
        source = self._source
        for one in inside.doings:
            second = at(source.clock, one.instant)
            if one.activity == "blocked" and self._blocked is None:
                self._blocked = second
                yield DrawnEvent(second, source.robot, "is blocked", "WARN")
            elif one.activity != "blocked" and self._blocked is not None:
                yield DrawnEvent(second, source.robot, f"free again after {second - self._blocked:.0f} s")
                self._blocked = None
            if one.activity == "aborted" and self._activity != "aborted":
                yield DrawnEvent(second, source.robot, "navigation gives its goal up", "ERROR")
            self._activity = one.activity
        for change, decision in inside.decisions():
            by = change.by.partition(".")[0]
            told = f" from {change.peer}, {change.age / 1e6:.1f} s old" if change.peer else ""
            words = f"{decision.words} ({by}{told})"
            yield DrawnEvent(at(source.clock, change.instant), source.robot, words, "WARN")
        if inside.fault is not None:
            last = at(source.clock, int(inside.instants[-1])) if len(inside.instants) else 0.0
            yield DrawnEvent(last, source.robot, inside.fault, "ERROR")


def name(place: PlaceKey) -> str:
    """As in "r1/3"."""
    return f"{place.owner}/{place.place}"


def at(clock: Clock, instant: int) -> float:
    """One instant in the run's seconds."""
    return float(clock(np.array([instant], np.int64))[0])
