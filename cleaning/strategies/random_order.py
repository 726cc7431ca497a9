"""Places in random order: what chance alone is worth.

Idea: who is stuck and picks anything else is often no longer stuck; a strategy that beats `none` should
beat this, too. Source: own, after the pseudo-goals of arXiv 2407.17766. Limits: takes no notice of others,
drives farther than in the order given. Settings: `CleaningParameters`.
"""

from typing import Self

from numpy.random import Generator

from actors.robot.behaviour import Behaviour, GoalStatus, Navigation, Start, host
from cleaning.parameters import CleaningParameters
from cleaning.robot import CleaningRobot
from cleaning.settings import from_settings
from deeco import component, periodic, replace, seconds


@component
class RandomRobot(CleaningRobot):
    """Heads for any place of its route, and for any again whenever navigation has given one up."""

    @periodic(every=seconds(2), order=3)
    def turn(self, navigation: Navigation, generator: Generator) -> Self:
        """Once navigation has given up, head for any place: `drive` sends it there."""
        goal = navigation.goal
        if goal is None or goal.status is not GoalStatus.ABORTED or not self.route:
            return self
        return self.heading_for(self.route[int(generator.integers(len(self.route)))])


def behaviour(start: Start) -> Behaviour:
    """Visit the own places in an order that is drawn: what chance alone is worth."""
    robot = RandomRobot.at_start(start, from_settings(CleaningParameters, start.settings))
    order = start.generator.permutation(len(robot.route)).tolist()
    return host(start, replace(robot, route=tuple(robot.route[index] for index in order)))
