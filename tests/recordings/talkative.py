"""A behaviour that prints and logs; one robot prints far too much."""

import logging

from actors.instant import Instant
from actors.robot.behaviour.ports import Behaviour, Decision, Start, View

log = logging.getLogger(__name__)
log.propagate = False
log.addHandler(logging.StreamHandler())  # it keeps hold of what standard error is now


class Talkative:
    def __init__(self, start: Start) -> None:
        self.id = start.robot
        print(f"made {self.id}")

    def advance(self, view: View, until: Instant) -> Decision:
        if view.instant == 1_000_000:
            print("half of a line", end=" ")
            print("and the rest\x1b[31m")
            log.warning("%s warns", self.id)
        if view.instant == 2_000_000 and self.id == "r2":
            print("x" * 10_000)
            for _ in range(5000):
                print("y" * 1000)
        return Decision()


def behaviour(start: Start) -> Behaviour:
    return Talkative(start)
