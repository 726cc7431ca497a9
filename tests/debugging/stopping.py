"""A strategy with a breakpoint in it: the naive one, stopped once, at 1 s."""

from dataclasses import replace
from typing import Self

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Start, host
from cleaning.place import assignments
from cleaning.robot import CleaningRobot
from deeco import component, periodic, seconds


@component
class StoppingRobot(CleaningRobot):
    """Stops where somebody is to look at it."""

    looked: bool = False

    @periodic(every=seconds(1), order=9)
    def look(self, now: Instant) -> Self:
        """Stop at 1 s."""
        if now == Instant(seconds(1)):
            breakpoint()
        return replace(self, looked=True)


def behaviour(start: Start) -> Behaviour:
    """The naive strategy, and a look at it."""
    return host(start, StoppingRobot(id=start.robot, position=start.pose.point, route=assignments(start)))
