"""Parking: cars choose the nearest car park with a free place; car parks assign places and free them again.

`python -m examples.parking` prints the cars in each car park; every 20 s the car in the near one leaves.
After the parking of JDEECo's electric cars.
"""

from collections.abc import Iterator
from typing import Any

from deeco import Knowledge, component, ensemble, replace, role, seconds
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


@role
class Vehicle(Knowledge):
    """Published state of a car: the car park that it has chosen."""

    chosen: str = ""


@component
class Car(Vehicle):
    """A car with the distance of the car park that it has chosen."""

    distance: float = 0.0


@role
class ParkingArea(Knowledge):
    """Published state of a car park; `distance`: from the cars, m."""

    distance: float
    places: int
    cars: tuple[str, ...] = ()

    def accepts(self, car: str) -> bool:
        """Return whether a car has a place or can have one."""
        return car in self.cars or len(self.cars) < self.places


@component
class CarPark(ParkingArea):
    """A car park, which assigns its places."""


@ensemble(every=seconds(1), max_age=seconds(5))
class ParkingOffer:
    """Cars choose the nearest car park that accepts them."""

    def membership(self, coordinator: ParkingArea, member: Vehicle) -> bool:
        """Return whether the car park accepts the car."""
        return coordinator.accepts(member.id)

    def at_member(self, coordinator: ParkingArea, member: Car) -> Car:
        """Choose it if it is the first one, or nearer."""
        is_worse = member.chosen and coordinator.distance >= member.distance
        return member if is_worse else replace(member, chosen=coordinator.id, distance=coordinator.distance)

    def at_member_end(self, coordinator: ParkingArea, member: Car) -> Car:
        """Choose again: it is full, or not received any more."""
        return replace(member, chosen="") if member.chosen == coordinator.id else member


@ensemble(every=seconds(1), max_age=seconds(5))
class ParkingAssignment:
    """Car parks assign places to the cars that have chosen them."""

    def membership(self, coordinator: ParkingArea, member: Vehicle) -> bool:
        """Return whether the car has chosen this car park and is accepted."""
        return member.chosen == coordinator.id and coordinator.accepts(member.id)

    def at_coordinator(self, coordinator: CarPark, member: Vehicle) -> CarPark:
        """Assign a place."""
        return replace(coordinator, cars=tuple(sorted({*coordinator.cars, member.id})))

    def at_coordinator_end(self, coordinator: CarPark, member: Vehicle) -> CarPark:
        """Free the place: the car has chosen another one, or is not received any more."""
        return replace(coordinator, cars=tuple(sorted({*coordinator.cars} - {member.id})))


def park(loss: float = 0.2) -> Iterator[dict[str, tuple[str, ...]]]:
    """Yield the cars of each car park every 20 s."""
    parks = [CarPark(id="near", distance=100, places=1), CarPark(id="far", distance=400, places=5)]
    everybody = [*parks, Car(id="a"), Car(id="b"), Car(id="c")]
    nodes = {one.id: Node([one], [ParkingOffer(), ParkingAssignment()]) for one in everybody}
    left = set[str]()
    medium = LossyMedium(loss, reach=lambda *names: None if left.intersection(names) else -60.0)
    network = VirtualNetwork(nodes, medium)
    for _ in range(3):
        network.advance(seconds(20))
        areas: list[Any] = [network[one.id].knowledge(one.id) for one in parks]
        yield {area.id: area.cars for area in areas}
        left.update(areas[0].cars)


if __name__ == "__main__":
    for row, cars in enumerate(park(), start=1):
        print(f"{20 * row} s:", cars)  # noqa: T201
