"""The behaviour of a robot that does nothing, for ever."""

from actors.instant import Instant
from actors.robot.ports import Behaviour, Decision, Start, View

NOTHING = Decision(tasks_left=1)


class Idle:
    """Has a task and never does it."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Nothing."""
        return NOTHING


def behaviour(start: Start) -> Behaviour:
    """Entry `benchmarks.idle:behaviour`."""
    return Idle()
