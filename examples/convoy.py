"""A convoy: vehicles that receive the position of the vehicle ahead close up to 20 m.

`python -m examples.convoy` simulates four vehicles for two minutes and prints the gaps between them;
`python -m deeco.explain examples.convoy` shows which knowledge each process reads and writes.
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
    """Physics of a vehicle; a port of the component, like an odometer and a motor."""

    position: float
    speed: float = 0.0
    wanted_speed: float = 0.0

    def advance(self, time: float) -> None:
        """Simulate some time, s; the acceleration is at most 2 m/s²."""
        self.speed += max(-2.0 * time, min(self.wanted_speed - self.speed, 2.0 * time))
        self.position += self.speed * time


@role
class Vehicle(Knowledge):
    """Published state of a vehicle, in m along the road and m/s; once a second."""

    position: float
    speed: float = 0.0


@component
class Car(Vehicle):
    """A vehicle at constant speed. Fields that are not in the role are private."""

    cruise: float = 10.0

    @periodic(every=seconds(0.1))
    def drive(self, motion: Motion, now: Instant) -> Self:
        """Return the next knowledge. The parameters of a process are ports, selected by type."""
        here = replace(self, position=motion.position, speed=motion.speed)
        motion.wanted_speed = here.wanted_speed(now)
        return here

    def wanted_speed(self, now: Instant) -> float:
        """Return the wanted speed, m/s: an ordinary method, not a process."""
        return self.cruise


class Sighting(NamedTuple):
    """Last received state of a vehicle."""

    id: str
    position: float
    speed: float
    heard: Instant

    def place(self, now: Instant) -> float:
        """Return the extrapolated position, m."""
        return self.position + self.speed * (now - self.heard) / seconds(1)


@component
class Follower(Car):
    """A vehicle that keeps its distance by overriding a method that the process `drive` calls."""

    gap: float = 20.0
    ahead: Sighting | None = None

    def wanted_speed(self, now: Instant) -> float:
        """Return the speed of the vehicle ahead plus up to 5 m/s; `cruise` without news for 10 s."""
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
        """Update the member, on its own node; the coordinator is a replica received by radio."""
        seen = Sighting(coordinator.id, coordinator.position, coordinator.speed, contact.heard)
        known = member.ahead
        nearer = known is None or known.id == seen.id or seen.place(now) < known.place(now)
        return replace(member, ahead=seen) if nearer else member


def drive(*, loss: float = 0.2, reach: float = 150.0, seed: int = 1) -> Iterator[list[float]]:
    """Yield the gaps, m, front to back, every 10 s. `loss`: share of lost frames; `reach`: radio range, m."""
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
