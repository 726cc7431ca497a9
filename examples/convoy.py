"""A convoy: vehicles that receive the position of the vehicle ahead close up to 20 m.

`python -m examples.convoy` simulates four vehicles for two minutes and prints the gaps between them;
`python -m deeco.explain examples.convoy` shows which knowledge each process reads and writes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

from deeco import (
    Contact,
    Instant,
    Knowledge,
    component,
    ensemble,
    milliseconds,
    periodic,
    replace,
    role,
    seconds,
)
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


@dataclass
class Motion:
    """Physics of a vehicle; a port of the component, like an odometer and a motor."""

    position: float
    speed: float = 0.0
    wanted_speed: float = 0.0

    def advance(self) -> None:
        """Simulate 0.1 s; the acceleration is at most 2 m/s²."""
        self.speed += max(-0.2, min(self.wanted_speed - self.speed, 0.2))
        self.position += self.speed * 0.1


@role
class Vehicle(Knowledge):
    """Published state of a vehicle, in m along the road and m/s; once a second."""

    position: float
    speed: float = 0.0

    def place(self, age: int) -> float:
        """Return the position extrapolated by `age`, µs."""
        return self.position + self.speed * age / seconds(1)


@component
class Follower(Vehicle):
    """A vehicle that keeps its distance. Fields that are not in the role are private."""

    cruise: float
    ahead: Vehicle | None = None
    heard: Instant = Instant(0)

    @periodic(every=milliseconds(100))
    def drive(self, motion: Motion, now: Instant) -> Self:
        """Return the next knowledge. The parameters of a process are ports, selected by type."""
        motion.wanted_speed = self.cruise
        if self.ahead is not None:
            excess = self.ahead.place(now - self.heard) - motion.position - 20
            motion.wanted_speed = max(0.0, self.ahead.speed + min(0.1 * excess, 5.0))
        return replace(self, position=motion.position, speed=motion.speed)


@ensemble(every=seconds(0.5), max_age=seconds(10))
class Convoy:
    """Twice a second, each vehicle watches the nearest one ahead, with replicas of at most 10 s."""

    reach: float = 100.0

    def membership(self, coordinator: Vehicle, member: Vehicle, now: Instant, contact: Contact) -> bool:
        """Return whether the coordinator is ahead of the member, within reach, by now."""
        return 0 < coordinator.place(now - contact.heard) - member.position < self.reach

    def at_member(self, coordinator: Vehicle, member: Follower, now: Instant, contact: Contact) -> Follower:
        """Update the member, on its own node; the coordinator is a replica received by radio."""
        place, known = coordinator.place(now - contact.heard), member.ahead
        if known is None or known.id == coordinator.id or place < known.place(now - member.heard):
            return replace(member, ahead=coordinator, heard=contact.heard)
        return member

    def at_member_end(self, coordinator: Vehicle, member: Follower) -> Follower:
        """Cruise again: the vehicle ahead is not received any more, or not within reach."""
        is_ahead = member.ahead is not None and member.ahead.id == coordinator.id
        return replace(member, ahead=None) if is_ahead else member


def drive(*, loss: float = 0.2, reach: float = 150.0, seed: int = 1) -> Iterator[list[float]]:
    """Yield the gaps, m, front to back, every 10 s. `loss`: share of lost frames; `reach`: radio range, m."""
    motions = {"leader": Motion(200.0), "a": Motion(140.0), "b": Motion(95.0), "c": Motion(0.0)}
    nodes = {}
    for name, motion in motions.items():
        car = Follower(id=name, position=motion.position, cruise=10.0 if name == "leader" else 8.0)
        nodes[name] = Node([car], [Convoy()], ports={Motion: motion})

    def rssi_dbm(sender: str, receiver: str) -> float | None:
        return -60.0 if abs(motions[sender].position - motions[receiver].position) < reach else None

    network = VirtualNetwork(nodes, LossyMedium(loss, reach=rssi_dbm, seed=seed))
    for step in range(1, 1201):
        network.advance(milliseconds(100))
        for motion in motions.values():
            motion.advance()
        if step % 100 == 0:
            yield [front.position - back.position for front, back in pairwise(motions.values())]


if __name__ == "__main__":
    for row, gaps in enumerate(drive(), start=1):
        print(f"{10 * row:4} s", *(f"{gap:8.1f} m" for gap in gaps))  # noqa: T201
