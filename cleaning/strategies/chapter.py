"""The example adaptation of the chapter, as its text has it and as the released code has it.

Idea: a robot finds out that it is stuck, turns to another place of its queue, and exchanges destinations
with whom it is stuck. Source: the chapter, 7.4.1 and Fig. 7.12; d3scomp/deeco-adaptation-testbed. Limits:
it cures and does not prevent, ignores the map, and never lowers the number of ways through a door.
Settings: `AdaptationParameters`; for `released`, `make-way` and `chapter-giving-up` the classes named after
them.
"""

from dataclasses import dataclass, replace
from typing import Final

from actors.instant import Instant
from actors.robot.behaviour import Behaviour, Decision, Start, View, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import MakingWay, PeerMask, exchanges
from cleaning.parameters import AdaptationParameters, ReleasedParameters
from cleaning.settings import from_settings

_SENSOR_RANGE: Final = 6.5
"""How far the original's range sensor sees, m (d3scomp/ROSRemote, simulation/turtlebot.inc)."""


@dataclass(frozen=True)
class MakeWayParameters(AdaptationParameters):
    """The text, and beyond it: who is done does not stand in the way."""

    make_way: bool = True
    """Own addition."""


@dataclass(frozen=True)
class GivingUpParameters(AdaptationParameters):
    """What is tried in vain often enough is given up, so that "done or given up" happens (chapter, 7.2.2)."""

    attempts: int = 5
    """Own choice: about a minute without a visit to any place."""
    no_plan_attempts: int = 3
    """Own choice: the map does not change."""


def behaviour(start: Start) -> Behaviour:
    """Turn elsewhere when stuck, and exchange destinations with whom one is stuck: the chapter's example."""
    return _adaptive(start, AdaptationParameters)


def released(start: Start) -> Behaviour:
    """The same with the thresholds and choices of the released code, without its defects."""
    return _adaptive(start, ReleasedParameters)


def make_way(start: Start) -> Behaviour:
    """As the chapter's, and who is done goes out of the way of who is blocked."""
    return _adaptive(start, MakeWayParameters)


def giving_up(start: Start) -> Behaviour:
    """As the chapter's, but a place is given up after five attempts at it in vain."""
    return _adaptive(start, GivingUpParameters)


def mute(start: Start) -> Behaviour:
    """As the chapter's without any radio, to see what that is worth: nothing is sent, and nothing heard."""
    return Mute(behaviour(start))


def _adaptive(start: Start, kind: type[AdaptationParameters]) -> Behaviour:
    p = from_settings(kind, start.settings)
    further: list[object] = [MakingWay(p.adoption_distance)] if p.make_way else []
    if p.peer_mask:
        further.append(PeerMask(_SENSOR_RANGE))
    return host(start, AdaptiveCleaningRobot.at_start(start, p), *exchanges(p), *further)


class Mute:
    """A behaviour whose transceiver is switched off."""

    def __init__(self, hosted: Behaviour) -> None:
        self.hosted = hosted

    def advance(self, view: View, until: Instant) -> Decision:
        """As ever, but for frames."""
        return replace(self.hosted.advance(view._replace(radio=()), until), frames=())
