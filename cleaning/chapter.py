"""The example adaptation of the chapter, as its text has it and as the released code has it."""

from typing import Final

from actors.robot.behaviour import Behaviour, Start, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.making_way import MakingWay
from cleaning.parameters import AdaptationParameters, ReleasedParameters
from cleaning.peer_mask import PeerMask
from cleaning.place import assignments
from cleaning.settings import from_settings

_SENSOR_RANGE: Final = 6.5
"""How far the original's range sensor sees, m (d3scomp/ROSRemote, simulation/turtlebot.inc)."""


def behaviour(start: Start) -> Behaviour:
    """Turn elsewhere when stuck, and exchange destinations with whom one is stuck: the chapter's example."""
    return _adaptive(start, from_settings(AdaptationParameters, start.settings))


def released(start: Start) -> Behaviour:
    """The same with the thresholds and choices of the released code, without its defects."""
    return _adaptive(start, from_settings(ReleasedParameters, start.settings))


def _adaptive(start: Start, parameters: AdaptationParameters) -> Behaviour:
    p = parameters
    robot = AdaptiveCleaningRobot(
        id=start.robot, position=start.pose.point, route=assignments(start), parameters=p
    )
    adoption = DestinationAdoption(p.adoption_distance, p.adoption_checks, p.adoption_backoff)
    further: list[object] = [MakingWay(p.adoption_distance)] if p.make_way else []
    if p.peer_mask:
        further.append(PeerMask(_SENSOR_RANGE))
    return host(start, robot, adoption, AdoptedDestinationRemove(p.exchange), *further)
