"""Own orders, nearest first; below a threshold the nearest charger that is not known to be busy.

Idea: charge in time, and spread over the chargers. Source: own choice. Limits: knowledge about chargers
arrives by radio only; orders are not traded; robots that meet in a narrow passage may stand until the end.
Settings: `ThresholdParameters`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Self

from actors.geometry import Point
from actors.robot.behaviour import Behaviour, Start, from_settings, host
from deeco import Duration, Instant, component, ensemble, periodic, replace, seconds
from logistics.robot import Carrier, DeliveryParameters, DeliveryRobot


@dataclass(frozen=True)
class ThresholdParameters(DeliveryParameters):
    """Parameters of the robots that charge below a threshold; own choices."""

    low: float = 0.04
    """Charge below which the robot drives to a charger."""
    memory: Duration = field(default=seconds(30))
    """Time for which the robot remembers the charger of another one."""


class ChargerUser(NamedTuple):
    """Another robot that uses or wants a charger."""

    id: str
    charger: int
    charge: float
    position: Point
    heard: Instant


@component
class ThresholdRobot(DeliveryRobot):
    """A robot that avoids chargers which others use."""

    parameters: ThresholdParameters = ThresholdParameters()
    users: tuple[ChargerUser, ...] = ()

    @periodic(every=seconds(1), order=0)
    def forget(self, now: Instant) -> Self:
        """Forget what is too old."""
        recent = tuple(one for one in self.users if now - one.heard <= self.parameters.memory)
        return self if recent == self.users else replace(self, users=recent)

    def rivals(self, charger: int) -> tuple[ChargerUser, ...]:
        """Return the robots that use or want a charger and are nearer to it."""
        here, mine = self.chargers[charger], self.position
        return tuple(
            one
            for one in self.users
            if one.charger == charger and one.position.distance_to(here) < mine.distance_to(here)
        )

    def charger_costs(self) -> Mapping[int, float]:
        """Return the chargers that are not known to be busy; all if there is none."""
        known = range(len(self.chargers))
        free = [charger for charger in known if charger not in self.failed and not self.rivals(charger)]
        return dict.fromkeys(free or known, 0.0)


@ensemble(every=seconds(1), max_age=seconds(5))
class ChargerExchange:
    """Robots remember which chargers others use."""

    def membership(self, coordinator: Carrier, member: ThresholdRobot) -> bool:
        """Return True for each pair."""
        return True

    def at_member(self, coordinator: Carrier, member: ThresholdRobot, now: Instant) -> ThresholdRobot:
        """Store the coordinator's charger."""
        others = tuple(one for one in member.users if one.id != coordinator.id)
        new = ChargerUser(coordinator.id, coordinator.charger, coordinator.charge, coordinator.position, now)
        return replace(member, users=(*others, new) if coordinator.charger >= 0 else others)


def behaviour(start: Start) -> Behaviour:
    """Carry the robot's own orders; charge below a threshold, at the nearest charger not known to be busy."""
    p = from_settings(ThresholdParameters, start.settings)
    return host(start, ThresholdRobot.at_start(start, p), ChargerExchange())
