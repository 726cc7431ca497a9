"""The naive strategy with a breakpoint at 1 s."""

from dataclasses import replace
from typing import Self

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Start, host
from cleaning.place import assignments
from cleaning.robot import CleaningRobot
from deeco import component, periodic, seconds


@component
class StoppingRobot(CleaningRobot):
    """Stops at a breakpoint."""

    looked: bool = False

    @periodic(every=seconds(1), order=9)
    def look(self, now: Instant) -> Self:
        """Stop at 1 s."""
        if now == Instant(seconds(1)):
            breakpoint()
        return replace(self, looked=True)


def behaviour(start: Start) -> Behaviour:
    """Return the naive strategy with a breakpoint."""
    return host(start, StoppingRobot(id=start.robot, position=start.pose.point, route=assignments(start)))
