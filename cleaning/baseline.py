"""The naive solution: every robot visits its places in the order given, and takes no notice of the others."""

from actors.robot.behaviour import Behaviour, Start, host
from cleaning.parameters import CleaningParameters
from cleaning.place import assignments
from cleaning.robot import CleaningRobot
from cleaning.settings import from_settings


def behaviour(start: Start) -> Behaviour:
    """Visit the own places in their order, whatever the others do: the chapter's baseline."""
    parameters = from_settings(CleaningParameters, start.settings)
    robot = CleaningRobot(
        id=start.robot, position=start.pose.point, route=assignments(start), parameters=parameters
    )
    return host(start, robot)
