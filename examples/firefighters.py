"""Firefighters: a leader learns who is short of oxygen, where a flashover is near, and whom it lost.

`python -m examples.firefighters` simulates a minute with a lossy radio; bob leaves its range after 30 s.
After the firefighters of JDEECo, whose leader aggregates the state of its group.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Self

from deeco import (
    History,
    Instant,
    Knowledge,
    Past,
    component,
    ensemble,
    in_seconds,
    periodic,
    replace,
    role,
    seconds,
)
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


@role
class MemberStatus(Knowledge):
    """Published state of a firefighter; of the temperature, peers collect the last five publications."""

    oxygen: float = 1.0
    celsius: float = 40.0
    recent: Annotated[Past[float], History("celsius", 5)] = ()

    def report(self) -> str:
        """Return what the leader has to know."""
        rise = self.recent[-1][1] - self.recent[0][1] if self.recent else 0.0
        return "flashover" if rise > 20 else "low oxygen" if self.oxygen < 0.3 else "well"


@component
class CrewMember(MemberStatus):
    """A firefighter, who uses 1.5 % of the oxygen per second; `heating`: of the room, °C/s."""

    heating: float = 0.0

    @periodic(every=seconds(1))
    def sense(self) -> Self:
        """Read the sensors."""
        return replace(self, oxygen=self.oxygen - 0.015, celsius=self.celsius + self.heating)


@role
class GroupInfo(Knowledge):
    """Published state of a leader: its id."""


@component
class LeaderInfo(GroupInfo):
    """The leader, with the last report of each member."""

    reports: tuple[tuple[str, str], ...] = ()


@ensemble(every=seconds(1), max_age=seconds(5))
class FirefighterGroup:
    """Once a second, the leader updates its reports from what it received in the last 5 s."""

    def membership(self, coordinator: GroupInfo, member: MemberStatus) -> bool:
        """Return True: the radio limits the group."""
        return True

    def at_coordinator(self, coordinator: LeaderInfo, member: MemberStatus) -> LeaderInfo:
        """Update the report of a member."""
        reports = {**dict(coordinator.reports), member.id: member.report()}
        return replace(coordinator, reports=tuple(sorted(reports.items())))

    def at_coordinator_end(self, coordinator: LeaderInfo, member: MemberStatus, now: Instant) -> LeaderInfo:
        """Report a member that is not received any more."""
        reports = {**dict(coordinator.reports), member.id: f"lost at {in_seconds(now):g} s"}
        return replace(coordinator, reports=tuple(sorted(reports.items())))


def fight(loss: float = 0.3) -> Iterator[dict[str, str]]:
    """Yield the leader's reports every 10 s."""
    crew = [CrewMember(id=name, heating=6.0 if name == "eve" else 0.0) for name in ("ann", "bob", "eve")]
    nodes = {one.id: Node([one], [FirefighterGroup()]) for one in (LeaderInfo(id="leader"), *crew)}
    network = VirtualNetwork(nodes, LossyMedium(loss))
    for second in range(0, 60, 10):
        if second == 30:
            network.medium.reach = lambda *names: None if "bob" in names else -60.0
        network.advance(seconds(10))
        leader: Any = network["leader"].knowledge("leader")
        yield dict(leader.reports)


if __name__ == "__main__":
    for row, reports in enumerate(fight(), start=1):
        print(f"{10 * row} s:", reports)  # noqa: T201
