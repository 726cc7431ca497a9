"""The strategy `auction` with counters of its decisions; r2 pauses for a while."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from actors.geometry import Point
from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from cleaning.strategies.auction import behaviour as auction
from deeco import replace

PAUSE = (Instant(seconds(8)), Instant(seconds(15)))


class Counting:
    """Wraps a behaviour and counts its inputs and outputs."""

    def __init__(self, start: Start) -> None:
        self.robot = start.robot
        self.hosted: Any = auction(start)
        self.counts: Counter[str] = Counter(goals=0)

    def advance(self, view: View, until: Instant) -> Decision:
        decision: Decision = self.hosted.advance(view, until)
        self.counts["steps"] += 1
        self.counts["goals"] += isinstance(decision.goal, Point)
        self.counts["frames"] += len(decision.frames)
        if self.robot == "r2":
            if view.instant == PAUSE[0]:
                decision = replace(decision, paused=True)
            if view.instant == PAUSE[1]:
                decision = replace(decision, paused=False)
        return decision

    def outcome(self) -> Mapping[str, object]:
        return {**self.hosted.outcome(), "counted": dict(self.counts), "robot": self.robot}


def behaviour(start: Start) -> Behaviour:
    return Counting(start)
