"""The chapter's example with places in a short order.

Idea: shorter ways, and fewer through doors, meet fewer robots. Source: 2-opt (Croes 1958) on nearest first,
by the length of ways on the robot's map; everything else as `chapter`. Limits: each robot keeps its own
places, so two that have places in each other's office still meet at the doors. Settings: `TourParameters`.
"""

from dataclasses import dataclass
from typing import Self

from actors.robot.behaviour import Behaviour, FloorPlan, Start, host
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.parameters import AdaptationParameters
from cleaning.place import assignments
from cleaning.settings import from_settings
from cleaning.tours import Ways
from deeco import adaptation, component, periodic, replace, seconds


@dataclass(frozen=True)
class TourParameters(AdaptationParameters):
    """The chapter's numbers, and what a door counts for."""

    door_charge: float = 4.0
    """What going through a door counts for beside its length, m; as in `auction`."""


@component
class TouringRobot(AdaptiveCleaningRobot):
    """Visits its places in a short order."""

    parameters: TourParameters = TourParameters()

    @adaptation
    @periodic(every=seconds(5), order=0)
    def plan(self, floor: FloorPlan) -> Self:
        """Put the places in a short order; what it is on the way to stays first."""
        if len(self.route) < 2:
            return self
        ways, mine = Ways(floor, self.parameters.door_charge), self.destination
        route = self.route if mine is None else (mine, *(one for one in self.route if one != mine))
        return replace(self, route=ways.shortened(self.position, route, 0 if mine is None else 1))


def behaviour(start: Start) -> Behaviour:
    """As the chapter's, with the own places in a short order by the length of ways."""
    p = from_settings(TourParameters, start.settings)
    robot = TouringRobot(id=start.robot, position=start.pose.point, route=assignments(start), parameters=p)
    adoption = DestinationAdoption(p.adoption_distance, p.adoption_checks, p.adoption_backoff)
    return host(start, robot, adoption, AdoptedDestinationRemove(p.exchange))
