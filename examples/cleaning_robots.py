"""Cleaning robots: two robots that block each other in a corridor exchange their destinations.

`python -m examples.cleaning_robots` prints positions and destinations. After the cleaning robots of JDEECo:
the local adaptation detects blocking, and an ensemble lets blocked neighbours adopt a destination.
"""

from collections.abc import Iterator
from typing import Any, Self

from deeco import Knowledge, adaptation, component, ensemble, milliseconds, periodic, replace, role, seconds
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


class Corridor(dict[str, float]):
    """Physics, a port of all robots: their positions, m. Robots cannot pass and stay 1 m apart."""

    def move(self, robot: str, to: float) -> float:
        """Move a robot by at most 0.1 m; return its new position."""
        wanted = self[robot] + max(-0.1, min(to - self[robot], 0.1))
        if all(abs(wanted - one) > 1 for name, one in self.items() if name != robot):
            self[robot] = wanted
        return self[robot]


@role
class Cleaner(Knowledge):
    """Published state of a robot."""

    destination: float
    position: float = 0.0
    is_blocked: bool = False


@component
class CleaningRobot(Cleaner):
    """A robot with one destination."""

    still: int = 0
    """Steps without motion."""

    @periodic(every=milliseconds(100))
    def drive(self, corridor: Corridor) -> Self:
        """Drive towards the destination."""
        here = corridor.move(self.id, self.destination)
        return replace(self, position=here, still=self.still + 1 if here == self.position else 0)

    @adaptation
    @periodic(every=seconds(1))
    def check(self) -> Self:
        """Detect blocking: 3 s without motion, before the destination."""
        return replace(self, is_blocked=self.still > 30 and abs(self.position - self.destination) > 0.5)


@ensemble(every=seconds(3), max_age=seconds(5))
class DestinationAdoption:
    """A blocked robot adopts the destination of a blocked neighbour."""

    def membership(self, coordinator: Cleaner, member: Cleaner) -> bool:
        """Return whether both are blocked and near."""
        near = abs(coordinator.position - member.position) < 3
        return near and coordinator.is_blocked and member.is_blocked

    def at_member(self, coordinator: Cleaner, member: CleaningRobot) -> CleaningRobot:
        """Adopt the destination."""
        return replace(member, destination=coordinator.destination, is_blocked=False, still=0)


def clean(loss: float = 0.1) -> Iterator[list[tuple[float, float]]]:
    """Yield position and destination of both robots every 5 s."""
    robots = [CleaningRobot(id="r1", destination=9.0), CleaningRobot(id="r2", destination=-1.0)]
    ports = {Corridor: Corridor(r1=0.0, r2=8.0)}
    nodes = {one.id: Node([one], [DestinationAdoption()], ports=ports) for one in robots}
    network = VirtualNetwork(nodes, LossyMedium(loss))
    for _ in range(6):
        network.advance(seconds(5))
        known: list[Any] = [network[one.id].knowledge(one.id) for one in robots]
        yield [(one.position, one.destination) for one in known]


if __name__ == "__main__":
    for row, states in enumerate(clean(), start=1):
        print(f"{5 * row} s:", *(f"{here:5.1f} m → {goal:g} m" for here, goal in states))  # noqa: T201
