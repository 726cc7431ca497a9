"""As the chapter's example, by robots that do not drive on while they know that they are lost.

Idea: a robot that is somewhere else than it believes plans ways that are none, visits places that it is not
at, and stands in doors. So it stops, goes back as it came, for that needs no map, and looks for itself.
Source: own. Limits: worth something only where robots get lost, as docs/navigation.md says; with the
odometry alone nobody knows. A robot that stands sees nothing new, so after a while it drives on. Settings:
`CarefulParameters`.
"""

from dataclasses import dataclass, field
from typing import Self

from actors.robot.behaviour import FARTHEST_BACK, Behaviour, Navigation, Positioning, Start, host
from actors.settings import check_range
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import exchanges
from cleaning.cleaner import State
from cleaning.parameters import AdaptationParameters
from cleaning.settings import from_settings
from deeco import Duration, Instant, adaptation, component, periodic, replace, seconds


@dataclass(frozen=True)
class CarefulParameters(AdaptationParameters):
    """The chapter's numbers, and when a robot waits because it is lost."""

    lost_above: float = 0.95
    """With a higher probability of being lost it stops: seldom wrong, says docs/navigation.md."""
    found_below: float = 0.5
    """With a lower one it goes on."""
    back_out: float = 1.0
    """So far it goes back along its trail, m, to see something else."""
    look_after: Duration = field(default=seconds(10))
    """Still lost after so long it forgets its pose, looks for itself everywhere, and goes back once more."""
    lost_patience: Duration = field(default=seconds(30))
    """After so long it drives on, and stops again no sooner than after as long."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("strategy.back_out", self.back_out, 0.0, FARTHEST_BACK)
        check_range("strategy.lost_above", self.lost_above, 0.0, 1.0)


@component
class CarefulRobot(AdaptiveCleaningRobot):
    """Waits while it is lost."""

    parameters: CarefulParameters = CarefulParameters()
    lost_since: Instant | None = None
    """Since when it has waited; None while it does not."""
    looked: bool = False
    """True once it has forgotten its pose meanwhile."""
    trusts_until: Instant = Instant(0)
    """Until then it drives whatever it thinks of its pose."""

    @adaptation
    @periodic(every=seconds(1), order=7)
    def mind_pose(self, positioning: Positioning, navigation: Navigation, now: Instant) -> Self:
        """Stop when lost, go back, look for itself; go on once it is found, or has waited for long enough."""
        p, since = self.parameters, self.lost_since
        if since is None:
            if positioning.is_lost <= p.lost_above or now < self.trusts_until:
                return self
            navigation.stop()
            navigation.back_out(p.back_out)
            return replace(self, lost_since=now, looked=False)
        if positioning.is_lost < p.found_below or now - since > p.lost_patience:
            again = Instant(now + p.lost_patience)
            return replace(self, lost_since=None, attempt=self.attempt + 1, trusts_until=again)
        if now - since > p.look_after and not self.looked:
            positioning.relocalise()
            navigation.back_out(p.back_out)
            return replace(self, looked=True)
        return replace(self, state=State.FREE, still_for=0, blocked_for=0)


def behaviour(start: Start) -> Behaviour:
    """As the chapter's, but who knows that it is lost stops, goes back as it came, and looks for itself."""
    p = from_settings(CarefulParameters, start.settings)
    return host(start, CarefulRobot.at_start(start, p), *exchanges(p))
