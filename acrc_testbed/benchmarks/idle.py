"""A behaviour that does nothing."""

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View

NOTHING = Decision()


class Idle:
    """Cleans no place."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Return an empty decision."""
        return NOTHING


def behaviour(start: Start) -> Behaviour:
    """Return the behaviour; entry `acrc_testbed.benchmarks.idle:behaviour`."""
    return Idle()
