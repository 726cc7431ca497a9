"""A strategy that does nothing: the baseline of `acrc bench swarm`; not registered under a name."""

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View


class IdleBehaviour:
    """A behaviour that does nothing."""

    def advance(self, view: View, until: Instant) -> Decision:
        """Return an empty decision."""
        return Decision()


def behaviour(start: Start) -> Behaviour:
    """Return the behaviour."""
    return IdleBehaviour()
