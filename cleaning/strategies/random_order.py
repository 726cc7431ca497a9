"""Places in random order: the value of chance.

Idea: a blocked robot that chooses any other place is often no longer blocked; a strategy that beats `none`
should also beat this. Source: own, after the pseudo-goals of arXiv 2407.17766. Limits: ignores other robots,
drives longer than in the given order. Settings: `CleaningParameters`.
"""

from typing import Self

from numpy.random import Generator

from actors.robot.behaviour import Behaviour, GoalStatus, Navigation, Start, from_settings, host
from cleaning.parameters import CleaningParameters
from cleaning.robot import CleaningRobot
from deeco import component, periodic, replace, seconds


@component
class RandomRobot(CleaningRobot):
    """A robot that visits its places in random order, and chooses another one after an abort."""

    @periodic(every=seconds(2), order=3)
    def turn(self, navigation: Navigation, generator: Generator) -> Self:
        """Choose a random destination after an aborted goal; `drive` sends it to navigation."""
        goal = navigation.goal
        if goal is None or goal.status is not GoalStatus.ABORTED or not self.route:
            return self
        return self.heading_for(self.route[int(generator.integers(len(self.route)))])


def behaviour(start: Start) -> Behaviour:
    """Visit places in random order, another one after an abort: the value of chance."""
    robot = RandomRobot.at_start(start, from_settings(CleaningParameters, start.settings))
    order = start.generator.permutation(len(robot.route)).tolist()
    return host(start, replace(robot, route=tuple(robot.route[index] for index in order)))
