"""A convoy: vehicles that hear the one ahead of them by radio close up to 20 m.

`python -m examples.convoy` drives four vehicles for two minutes and prints the gaps between them;
`python -m deeco.explain examples.convoy` shows who reads and writes what.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from random import Random
from typing import NamedTuple, Self

from deeco import Contact, Instant, Knowledge, component, ensemble, periodic, replace, role, seconds
from deeco.link import Reception, Transmission
from deeco.node import Node


@dataclass
class Motion:
    """The physics of one vehicle; for the component it is a port: its odometer and its motor."""

    position: float
    speed: float = 0.0
    wanted_speed: float = 0.0

    def advance(self, time: float) -> None:
        """Let some time pass, s; the motor changes the speed by 2 m/s² at most."""
        self.speed += max(-2.0 * time, min(self.wanted_speed - self.speed, 2.0 * time))
        self.position += self.speed * time


@role
class Vehicle(Knowledge):
    """What others may know of a vehicle, in m along the road and m/s; published once a second."""

    position: float
    speed: float = 0.0


@component
class Car(Vehicle):
    """Drives at its own speed. What it adds to its role stays with it."""

    cruise: float = 10.0

    @periodic(every=seconds(0.1))
    def drive(self, motion: Motion, now: Instant) -> Self:
        """A process gives the next knowledge. Its parameters are ports: the node has one of each type."""
        here = replace(self, position=motion.position, speed=motion.speed)
        motion.wanted_speed = here.wanted_speed(now)
        return here

    def wanted_speed(self, now: Instant) -> float:
        """No process, just a method."""
        return self.cruise


class Sighting(NamedTuple):
    """Where a vehicle was, and how fast, when it was last heard."""

    id: str
    position: float
    speed: float
    heard: Instant

    def place(self, now: Instant) -> float:
        """Where it should be now, m."""
        return self.position + self.speed * (now - self.heard) / seconds(1)


@component
class Follower(Car):
    """Keeps its distance from the vehicle ahead. It overrides a method that the process `drive` calls."""

    gap: float = 20.0
    ahead: Sighting | None = None

    def wanted_speed(self, now: Instant) -> float:
        """That of the vehicle ahead, and up to 5 m/s more to catch up; without news for 10 s the own."""
        if self.ahead is None or now - self.ahead.heard > seconds(10):
            return self.cruise
        excess = self.ahead.place(now) - self.position - self.gap
        return max(0.0, self.ahead.speed + min(0.1 * excess, 5.0))


@ensemble(every=seconds(0.5), max_age=seconds(10))
class Convoy:
    """Twice a second, each vehicle watches the nearest one ahead, with replicas of at most 10 s."""

    reach: float = 100.0

    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        """Return whether the coordinator is ahead of the member, within reach."""
        return 0 < coordinator.position - member.position < self.reach

    def at_member(self, coordinator: Vehicle, member: Follower, now: Instant, contact: Contact) -> Follower:
        """On the member's node, where the coordinator is a replica that came by radio."""
        seen = Sighting(coordinator.id, coordinator.position, coordinator.speed, contact.heard)
        known = member.ahead
        nearer = known is None or known.id == seen.id or seen.place(now) < known.place(now)
        return replace(member, ahead=seen) if nearer else member


def drive(*, loss: float = 0.2, reach: float = 150.0, seed: int = 1) -> Iterator[list[float]]:
    """The gaps, m, front to back, every 10 s. `loss`: share of frames lost; `reach`: of the radio, m."""
    random = Random(seed)
    motions = [Motion(position) for position in (200.0, 140.0, 95.0, 0.0)]
    cars = [Car(id="leader", position=200.0)]
    cars += [Follower(id=f"follower {n}", position=motions[n].position, cruise=8.0) for n in (1, 2, 3)]
    nodes = [Node([cars[n]], [Convoy()], ports={Motion: motions[n]}, address=n) for n in range(4)]
    sent: list[tuple[int, Transmission]] = []
    for step in range(1, 1201):
        heard: list[list[Reception]] = [[] for _ in nodes]
        for n, frame in sent:
            for m, motion in enumerate(motions):
                if n != m and abs(motion.position - motions[n].position) < reach and random.random() >= loss:
                    heard[m].append(Reception(frame.instant, n, frame.data))
        now = Instant(seconds(step / 10))
        sent = [(n, frame) for n, node in enumerate(nodes) for frame in node.advance(now, heard[n])]
        for motion in motions:
            motion.advance(0.1)
        if step % 100 == 0:
            yield [front.position - back.position for front, back in pairwise(motions)]


if __name__ == "__main__":
    for row, gaps in enumerate(drive(), start=1):
        print(f"{10 * row:4} s", *(f"{gap:8.1f} m" for gap in gaps))  # noqa: T201
