"""Behaviours with something to say about their run, by entry string."""

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport

GIVES_UP = 30
"""The step in which r1 gives its places up and r2 claims one of its own."""


class Witness:
    """Stands still, counts its steps, and says what a node would."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._steps = 0

    def advance(self, view: View, until: Instant) -> Decision:
        self._steps += 1
        robot, step = self._start.robot, view.instant // (until - view.instant)
        if step != GIVES_UP:
            return Decision()
        keys = tuple(PlaceKey(robot, place) for place in range(len(self._start.places)))
        if robot == "r1":
            given_up = tuple(PlaceGivenUp(k.owner, k.place, view.instant, "only a witness") for k in keys)
            return Decision(given_up=given_up, route=())
        return Decision(reports=(PlaceReport(robot, 0, view.instant),), route=keys[1:-1])

    def outcome(self) -> dict[str, object]:
        counters = {"activations": self._steps, "published": 1}
        return {
            "deeco": {
                "counters": counters,
                "exchanges": {"Meeting": 2},
                "replica_age_ms": {"50": 1, "900": 1},
            },
            "witness": self._start.epoch,
        }


def behaviour(start: Start) -> Behaviour:
    return Witness(start)


class Liar(Witness):
    """Its node counts halves."""

    def outcome(self) -> dict[str, object]:
        return {"deeco": {"counters": {"activations": 0.5}, "exchanges": {}, "replica_age_ms": {}}}


def liar(start: Start) -> Behaviour:
    return Liar(start)
