"""The chapter's example adaptation, by its text and by the released code.

Idea: a blocked robot turns to another place of its queue, and exchanges destinations with the robot that it
is blocked with. Source: the chapter, 7.4.1 and Fig. 7.12; d3scomp/deeco-adaptation-testbed. Limits: reacts to
blocking without preventing it, ignores the map, and does not reduce the number of passages through doors.
Settings: `AdaptationParameters`; `ReleasedParameters`, `MakeWayParameters` and `GivingUpParameters` for
`released`, `make-way` and `chapter-giving-up`.
"""

from dataclasses import dataclass
from typing import Final

from actors.robot.behaviour import Behaviour, SilentBehaviour, Start, from_settings, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import MakingWay, PeerMask, exchanges
from cleaning.parameters import AdaptationParameters, ReleasedParameters

_SENSOR_RANGE: Final = 6.5
"""Range of the original's sensor, m (d3scomp/ROSRemote, simulation/turtlebot.inc)."""


@dataclass(frozen=True)
class MakeWayParameters(AdaptationParameters):
    """Parameters of the text, with `make_way`."""

    make_way: bool = True
    """Own addition."""


@dataclass(frozen=True)
class GivingUpParameters(AdaptationParameters):
    """Parameters with limited attempts, so that all places are "done or given up" (chapter, 7.2.2)."""

    attempts: int = 5
    """Own choice: about a minute without visiting a place."""
    no_plan_attempts: int = 3
    """Own choice: the map does not change."""


def behaviour(start: Start) -> Behaviour:
    """Turn to another place when blocked, and exchange destinations: the chapter's example adaptation."""
    return _adaptive(start, AdaptationParameters)


def released(start: Start) -> Behaviour:
    """Use the thresholds and choices of the chapter's released code, without its defects."""
    return _adaptive(start, ReleasedParameters)


def make_way(start: Start) -> Behaviour:
    """Extend `chapter`: a finished robot moves away if a blocked robot is near."""
    return _adaptive(start, MakeWayParameters)


def giving_up(start: Start) -> Behaviour:
    """Extend `chapter`: give a place up after five failed attempts."""
    return _adaptive(start, GivingUpParameters)


def mute(start: Start) -> Behaviour:
    """Run `chapter` without radio, to measure the value of communication."""
    return SilentBehaviour(behaviour(start), start)


def _adaptive(start: Start, kind: type[AdaptationParameters]) -> Behaviour:
    p = from_settings(kind, start.settings)
    further: list[object] = [MakingWay(p.adoption_distance)] if p.make_way else []
    if p.peer_mask:
        further.append(PeerMask(_SENSOR_RANGE))
    return host(start, AdaptiveCleaningRobot.at_start(start, p), *exchanges(p), *further)
