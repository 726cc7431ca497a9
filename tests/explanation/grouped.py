"""A strategy with a group: r1 meets the two robots that are nearest to its meeting point."""

from typing import Self

from actors.geometry import Point
from actors.robot.behaviour import Behaviour, Navigation, Positioning, Start, host
from deeco import (
    GroupCoordinator,
    GroupMember,
    Instant,
    component,
    group,
    milliseconds,
    periodic,
    replace,
    role,
    seconds,
    some_of,
)

MEETING = Point(13.0, 11.8)


@role
class Host(GroupCoordinator):
    meeting: Point | None = None


@role
class Guest(GroupMember):
    position: Point | None = None


@component
class Meeter(Host, Guest):
    wish: Point | None = None
    going: Point | None = None

    @periodic(every=seconds(1))
    def sense(self, positioning: Positioning) -> Self:
        return replace(self, position=positioning.pose.point)

    @periodic(every=milliseconds(500), order=1)
    def go(self, navigation: Navigation) -> Self:
        if self.wish is None or self.wish == self.going:
            return self
        navigation.go_to(self.wish)
        return replace(self, going=self.wish)


@group(coordinator=Host, every=seconds(1), max_age=seconds(5))
class Meeting:
    guests = some_of(Guest, 1, 2)

    def select_guests(self, coordinator: Host, member: Guest) -> bool:
        return coordinator.id == "r1" and member.position is not None

    def utility_guests(self, coordinator: Host, member: Guest, now: Instant) -> float:
        return 0.0 if member.position is None else -member.position.distance_to(MEETING)

    def at_group(self, coordinator: Meeter, guests: tuple[Guest, ...]) -> Meeter:
        return replace(coordinator, meeting=MEETING, wish=MEETING)

    def at_member(self, coordinator: Host, member: Meeter) -> Meeter:
        return replace(member, wish=coordinator.meeting)


def behaviour(start: Start) -> Behaviour:
    return host(start, Meeter(id=start.robot), Meeting())
