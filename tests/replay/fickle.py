"""A nondeterministic behaviour: each robot depends on a different forbidden input."""

import random
import time
from collections.abc import Callable

from actors.instant import Instant, seconds
from actors.items import ItemGivenUp
from actors.robot.behaviour.ports import Behaviour, Decision, Start, View

LETTERS = [f"{letter}{letter}" for letter in "abcdefghijklmnopqrstuvwxyz"]
WAYS: dict[str, Callable[[], str]] = {
    "r1": lambda: str(random.random()),
    "r2": lambda: str(time.time_ns()),
    "r3": lambda: "".join(set(LETTERS)),
    "r4": lambda: str(id(object())),
    "r5": lambda: "nothing but what it is told",
}


class Fickle:
    """Stands, and after one second gives up its first place with a reason that varies."""

    def __init__(self, start: Start) -> None:
        self._start = start
        self._said = False

    def advance(self, view: View, until: Instant) -> Decision:
        if self._said or view.instant < seconds(1):
            return Decision()
        self._said = True
        robot = self._start.robot
        return Decision(given_up=(ItemGivenUp(robot, 0, view.instant, WAYS[robot]()),))


def behaviour(start: Start) -> Behaviour:
    return Fickle(start)
