"""Drones protect fields and share a charger: two groups choose among the same drones.

`python -m examples.drones` prints who protects and who charges. After the example of ML-DEECo, where
one process forms all groups; here fields, chargers and drones agree over a lossy radio.
"""

from collections.abc import Iterator
from typing import Any, Self

from deeco import (
    GroupCoordinator,
    GroupMember,
    component,
    group,
    one_of,
    periodic,
    replace,
    role,
    seconds,
    some_of,
)
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


@role
class DroneStatus(GroupMember):
    """Published state of a drone: position along the field, m, and charge of its battery."""

    position: float = 0.0
    battery: float = 1.0
    is_charging: bool = False


@component
class Drone(DroneStatus):
    """A drone, which uses 1 % of its battery per second and gains 10 % in a charger."""

    @periodic(every=seconds(1))
    def fly(self) -> Self:
        """Use or charge the battery."""
        return replace(self, battery=self.battery + (0.1 if self.is_charging else -0.01))


@role
class FieldStatus(GroupCoordinator):
    """Published position of a field, m."""

    position: float = 0.0


@component
class Field(FieldStatus):
    """A field; `birds`: its value to birds."""

    birds: float = 1.0


@role
class ChargerStatus(GroupCoordinator):
    """Published state of a charger: its id."""


@component
class Charger(ChargerStatus):
    """A charger for one drone."""


@group(coordinator=FieldStatus, every=seconds(1), max_age=seconds(5))
class ProtectionGroup:
    """The nearest charged drones protect a field, first the one with the most birds."""

    drones = some_of(DroneStatus, 1, 2)

    def priority(self, coordinator: Field) -> float:
        """Return the number of birds."""
        return coordinator.birds

    def select_drones(self, coordinator: Field, member: DroneStatus) -> bool:
        """Return whether the drone can fly."""
        return member.battery > 0.3 and not member.is_charging

    def utility_drones(self, coordinator: Field, member: DroneStatus) -> float:
        """Prefer the nearest drone."""
        return -abs(coordinator.position - member.position)

    def at_member(self, coordinator: FieldStatus, member: Drone) -> Drone:
        """Fly to the field."""
        return replace(member, position=coordinator.position)


@group(coordinator=ChargerStatus, every=seconds(1), max_age=seconds(5))
class ChargingGroup:
    """A drone charges until its battery is full: the others have equal utility, so it stays."""

    drone = one_of(DroneStatus)

    def select_drone(self, coordinator: ChargerStatus, member: DroneStatus) -> bool:
        """Return whether the drone needs the charger."""
        return member.battery < (0.9 if member.is_charging else 0.5)

    def at_member(self, coordinator: ChargerStatus, member: Drone) -> Drone:
        """Charge."""
        return replace(member, is_charging=True)

    def at_member_end(self, coordinator: ChargerStatus, member: Drone) -> Drone:
        """Leave the charger."""
        return replace(member, is_charging=False)


def members(place: Any) -> list[str]:
    """Return the drones that have confirmed the offer of a place."""
    return [one.member for one in place.group_offers if one.confirmed]


def protect(loss: float = 0.2) -> Iterator[dict[str, list[str]]]:
    """Yield the drones at each place every 20 s."""
    places = [
        Field(id="corn", birds=2.0),
        Field(id="wheat", position=90.0),
        Charger(id="charger"),
    ]
    drones = [Drone(id=f"d{one}", position=30.0 * one, battery=1 - 0.2 * one) for one in range(4)]
    groups = [ProtectionGroup(), ChargingGroup()]
    network = VirtualNetwork({one.id: Node([one], groups) for one in (*places, *drones)}, LossyMedium(loss))
    for _ in range(5):
        network.advance(seconds(20))
        yield {one.id: members(network[one.id].knowledge(one.id)) for one in places}


if __name__ == "__main__":
    for row, state in enumerate(protect(), start=1):
        print(f"{20 * row} s:", state)  # noqa: T201
