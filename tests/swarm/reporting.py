"""Behaviours that report places and counters, for strategies by entry string."""

from actors.instant import Instant
from actors.items import ItemGivenUp, ItemKey
from actors.robot.behaviour import Behaviour, Decision, Start, View
from cleaning.place import VisitReport

REPORT_STEP = 30
"""Step in which r1 gives up its places and r2 reports one of its own."""


class ReportingRobot:
    """Robot that stands still, counts its steps, and reports like a node."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._steps = 0

    def advance(self, view: View, until: Instant) -> Decision:
        self._steps += 1
        robot, step = self._start.robot, view.instant // (until - view.instant)
        if step != REPORT_STEP:
            return Decision()
        keys = tuple(ItemKey(robot, number) for number in range(len(self._start.items)))
        if robot == "r1":
            given_up = tuple(ItemGivenUp(k.owner, k.number, view.instant, "stands still") for k in keys)
            return Decision(given_up=given_up, route=())
        return Decision(reports=(VisitReport(robot, 0, view.instant),), route=keys[1:-1])

    def outcome(self) -> dict[str, object]:
        counters = {"activations": self._steps, "published": 1}
        return {
            "deeco": {
                "counters": counters,
                "exchanges": {"Meeting": 2},
                "replica_age_ms": {"50": 1, "900": 1},
            },
            "epoch": self._start.epoch,
        }


def behaviour(start: Start) -> Behaviour:
    return ReportingRobot(start)


class MalformedReport(ReportingRobot):
    """Robot whose node reports a counter that is not an integer."""

    def outcome(self) -> dict[str, object]:
        return {"deeco": {"counters": {"activations": 0.5}, "exchanges": {}, "replica_age_ms": {}}}


def malformed(start: Start) -> Behaviour:
    return MalformedReport(start)
