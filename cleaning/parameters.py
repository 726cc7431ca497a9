"""The numbers of the model problem's robots: where the chapter's text and the released code differ, both.

Text: "Experimenting with Adaptation in Smart Cyber-Physical Systems: A Model Problem and Testbed" (2016),
7.4.1. Code: d3scomp/deeco-adaptation-testbed, CleanerRobot and the two ensembles.
"""

import math
from dataclasses import dataclass, field, fields
from enum import Enum

from actors.settings import ParameterError, check_range
from deeco import Duration, seconds
from deeco.link import LinkParameters


class Unblock(Enum):
    """Where a robot turns to when it unblocks itself."""

    QUEUE = "queue"
    """The text: to any place in its route."""
    FLOOR = "floor"
    """The code: with n places in the route, to any point of the floor with probability n/(n+1), else to any
    place in the route. With no place left, where the code crashes, to any point of the floor."""


@dataclass(frozen=True)
class CleaningParameters:
    """The adapted layer. Raises ParameterError, a ValueError, for a number that makes no sense."""

    reach: float = 0.5
    """A place nearer than this is visited, m. Default: the code, REACHED_POS_THRESH_M."""
    retry: bool = True
    """A goal that navigation gave up is asked for again, every 2 s. The code never does; the default is own:
    a robot should not stand for ever because of what has gone meanwhile."""
    no_plan_attempts: int = 0
    """So often in a row navigation may find no way to a place before the robot gives the place up; 0: it
    never does. Default: as in the original, which never gives up. From 2 on it needs `retry`."""
    aborted_attempts: int = 0
    """The same for whatever reason navigation may have to give the place up."""

    def __post_init__(self) -> None:
        for name in (one.name for one in fields(self)):
            value = getattr(self, name)
            if isinstance(value, float) and not 0 < value < math.inf:
                raise ParameterError(f"strategy.{name}", value, "above 0")
            if isinstance(value, int) and value < 0:
                raise ParameterError(f"strategy.{name}", value, "at least 0")
            if name in {"no_plan_attempts", "aborted_attempts"} and value > 1 and not self.retry:
                raise ParameterError(f"strategy.{name}", value, "0 or 1 without retry")


@dataclass(frozen=True)
class AdaptationParameters(CleaningParameters):
    """Both layers; the defaults are the chapter's text, and the code where the text is silent."""

    still: float = 0.01
    """A robot that moves less than this within a second stands still, m. Default: the code,
    SAME_POS_THRESH_M."""
    still_checks: int = 3
    """After more still seconds than this in a row, a robot that wants to move is blocked. Default: the code,
    NOCHANGE_POS_THRESH_CNT."""
    blocked_checks: int = 6
    """After more blocked seconds than this in a row it unblocks itself. Default: the code,
    BLOCKED_AUTORECOVERY_THRESHOLD_S."""
    unblock: Unblock = Unblock.QUEUE
    """Where it turns to then."""
    recount: bool = True
    """With a new destination the count of still seconds begins anew. The text monitors the outcome of a new
    destination; the code goes on counting, so that the robot is blocked again within a second."""
    attempts: int = 0
    """So often a robot that heads for the same place unblocks itself before it gives the place up, unless it
    visits any meanwhile; 0: it never gives up. Default: as in the original."""
    adoption_distance: float = 1.5
    """Blocked robots nearer to one another than this adopt, m. Default: the text; the code has 3.0."""
    adoption_checks: int = 1
    """A robot adopts once it has been blocked for so many seconds. Default: the code,
    BLOCKED_REMOTERECOVERY_THRESHOLD_S."""
    adoption_backoff: Duration = field(default=seconds(10))
    """So long it waits from one adoption to the next, µs. Default: the code, REMOTE_RECOVERY_BACKOFF_MS."""
    exchange: bool = True
    """Who loses its destination to a robot takes the one which that robot left for it: the text's "and vice
    versa". In the code each side adopts for itself, and whoever is later finds its own destination."""
    make_way: bool = False
    """Who wants nowhere any more goes to some random place when a blocked robot is near, as near as for an
    adoption. Own addition: in text and code a robot that is done stands in the way for good."""
    peer_mask: bool = False
    """The localiser disregards range readings that end where other robots say they are. Own addition: neither
    text nor code has it."""
    most_adopted: int = 10
    """So many adoptions are published, the newest: with ten, knowledge fills a frame and begins a second. The
    code publishes all."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("strategy.most_adopted", self.most_adopted, 1, LinkParameters().max_items)


@dataclass(frozen=True)
class ReleasedParameters(AdaptationParameters):
    """The example adaptation as the released code has it, without its defects."""

    retry: bool = False
    """As in the code."""
    unblock: Unblock = Unblock.FLOOR
    """As in the code."""
    recount: bool = False
    """As in the code."""
    adoption_distance: float = 3.0
    """As in the code, m."""
    exchange: bool = False
    """As in the code."""
