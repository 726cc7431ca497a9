"""Parameters of the model problem's robots, as in the chapter's text and as in the released code.

Text: "Experimenting with Adaptation in Smart Cyber-Physical Systems: A Model Problem and Testbed" (2016),
7.4.1. Code: d3scomp/deeco-adaptation-testbed, CleanerRobot and the two ensembles.
"""

import math
from dataclasses import dataclass, field
from enum import Enum

from actors.settings import ParameterError, check_range
from deeco import Duration, seconds
from deeco.link import LinkParameters


class UnblockTarget(Enum):
    """Target of a robot that unblocks itself."""

    QUEUE = "queue"
    """Text: a random place of its route."""
    FLOOR = "floor"
    """Code: with n places in the route, a random point of the floor with probability n/(n+1), otherwise a
    random place of the route. With an empty route, where the code crashes, a random point of the floor."""


@dataclass(frozen=True)
class CleaningParameters:
    """Parameters of the adapted layer. Raises ParameterError, a ValueError, for an invalid value."""

    reach: float = 0.5
    """Distance at which a place counts as visited, m. Default: the code, REACHED_POS_THRESH_M."""
    retry: bool = True
    """Request an aborted goal again, every 2 s. The code never does; own default, so that robots continue
    when an obstacle has moved away."""
    no_plan_attempts: int = 0
    """Number of consecutive `no plan` aborts after which a place is given up; 0: never, as in the original.
    Values above 1 need `retry`."""
    aborted_attempts: int = 0
    """Number of consecutive aborts of any kind after which a place is given up; 0: never."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float) and not 0 < value < math.inf:
                raise ParameterError(f"strategy.{name}", value, "above 0")
            if isinstance(value, int) and value < 0:
                raise ParameterError(f"strategy.{name}", value, "at least 0")
            if name in {"no_plan_attempts", "aborted_attempts"} and value > 1 and not self.retry:
                raise ParameterError(f"strategy.{name}", value, "0 or 1 without retry")


@dataclass(frozen=True)
class AdaptationParameters(CleaningParameters):
    """Parameters of both layers; defaults from the chapter's text, otherwise from the code."""

    still: float = 0.01
    """Distance per second below which a robot stands still, m. Default: the code, SAME_POS_THRESH_M."""
    still_checks: int = 3
    """A robot with a target is blocked after standing still for more seconds than this. Default: the code,
    NOCHANGE_POS_THRESH_CNT."""
    blocked_checks: int = 6
    """A robot unblocks itself after being blocked for more seconds than this. Default: the code,
    BLOCKED_AUTORECOVERY_THRESHOLD_S."""
    unblock: UnblockTarget = UnblockTarget.QUEUE
    """Target chosen when a robot unblocks itself."""
    recount: bool = True
    """Reset the count of still seconds with a new destination. The text monitors the outcome of a new
    destination; the code continues to count, so that the robot is blocked again within a second."""
    attempts: int = 0
    """Number of unblockings on the way to the same place, without a visit in between, after which the place
    is given up; 0: never, as in the original."""
    adoption_distance: float = 1.5
    """Maximum distance between blocked robots for an adoption, m. Default: the text; the code has 3.0."""
    adoption_checks: int = 1
    """Minimum time of being blocked before an adoption, s. Default: the code,
    BLOCKED_REMOTERECOVERY_THRESHOLD_S."""
    adoption_backoff: Duration = field(default=seconds(10))
    """Minimum time between two adoptions, µs. Default: the code, REMOTE_RECOVERY_BACKOFF_MS."""
    exchange: bool = True
    """A robot that loses its destination adopts the other robot's former destination: the text's "and vice
    versa". In the code each robot adopts independently, and the later one receives its own destination."""
    make_way: bool = False
    """A robot without target drives to a random place if a blocked robot is within `adoption_distance`. Own
    addition: in text and code a finished robot stays in the way."""
    peer_mask: bool = False
    """The localiser ignores range readings at published positions of other robots. Own addition."""
    most_adopted: int = 10
    """Number of published adoptions, newest first: with ten, knowledge just exceeds one frame. The code
    publishes all."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("strategy.most_adopted", self.most_adopted, 1, LinkParameters().max_items)


@dataclass(frozen=True)
class ReleasedParameters(AdaptationParameters):
    """Parameters of the released code."""

    retry: bool = False
    """As in the code."""
    unblock: UnblockTarget = UnblockTarget.FLOOR
    """As in the code."""
    recount: bool = False
    """As in the code."""
    adoption_distance: float = 3.0
    """As in the code, m."""
    exchange: bool = False
    """As in the code."""
