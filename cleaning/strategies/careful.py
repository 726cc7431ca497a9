"""The chapter's example with robots that stop when they detect that they are lost.

Idea: a lost robot plans wrong paths, reports wrong places, and stands in doors. It stops, backs out along its
trail, which needs no map, and localises itself again. Source: own. Limits: useful only where robots get lost
(docs/navigation.md); no effect with odometry alone. A standing robot receives no new information, so it
drives on after a timeout. Settings: `CarefulParameters`.
"""

from dataclasses import dataclass, field
from typing import Self

from actors.robot.behaviour import (
    MAX_BACK_OUT,
    Behaviour,
    Navigation,
    Positioning,
    Start,
    from_settings,
    host,
)
from actors.settings import check_range
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import exchanges
from cleaning.parameters import AdaptationParameters
from deeco import Duration, Instant, adaptation, component, periodic, replace, seconds


@dataclass(frozen=True)
class CarefulParameters(AdaptationParameters):
    """Parameters of the chapter and of waiting while lost."""

    lost_above: float = 0.95
    """Probability of being lost above which the robot stops; seldom wrong (docs/navigation.md)."""
    found_below: float = 0.5
    """Probability of being lost below which it continues."""
    back_out: float = 1.0
    """Distance of backing out, m, for scans from another position."""
    look_after: Duration = field(default=seconds(10))
    """Time after which a lost robot searches the whole map for its pose and backs out again."""
    lost_patience: Duration = field(default=seconds(30))
    """Timeout of waiting, and minimum time until the robot stops again."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("strategy.back_out", self.back_out, 0.0, MAX_BACK_OUT)
        check_range("strategy.lost_above", self.lost_above, 0.0, 1.0)


@component
class CarefulRobot(AdaptiveCleaningRobot):
    """A robot that waits while it is lost."""

    parameters: CarefulParameters = CarefulParameters()
    lost_since: Instant | None = None
    """Start of waiting; None if it does not wait."""
    looked: bool = False
    """True if it has searched the whole map since then."""
    trusts_until: Instant = Instant(0)
    """Time until which it drives even if lost."""

    @adaptation
    @periodic(every=seconds(1), order=7)
    def mind_pose(self, positioning: Positioning, navigation: Navigation, now: Instant) -> Self:
        """Stop, back out and relocalise when lost; continue when located or after the timeout."""
        p, since = self.parameters, self.lost_since
        if since is None:
            if positioning.lost_probability <= p.lost_above or now < self.trusts_until:
                return self
            navigation.stop()
            navigation.back_out(p.back_out)
            return replace(self, lost_since=now, looked=False)
        if positioning.lost_probability < p.found_below or now - since > p.lost_patience:
            again = Instant(now + p.lost_patience)
            return replace(self, lost_since=None, attempt=self.attempt + 1, trusts_until=again)
        if now - since > p.look_after and not self.looked:
            positioning.relocalise()
            navigation.back_out(p.back_out)
            return replace(self, looked=True)
        return self.unblocked()


def behaviour(start: Start) -> Behaviour:
    """Extend `chapter`: a robot that detects that it is lost stops, backs out and localises itself."""
    p = from_settings(CarefulParameters, start.settings)
    return host(start, CarefulRobot.at_start(start, p), *exchanges(p))
