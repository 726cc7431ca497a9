"""The behaviour of a robot that does nothing, for ever."""

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View

NOTHING = Decision()


class Idle:
    """Has places to clean and never does it."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Nothing."""
        return NOTHING


def behaviour(start: Start) -> Behaviour:
    """Entry `benchmarks.swarm.idle:behaviour`."""
    return Idle()
