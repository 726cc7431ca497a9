"""Groups: choice of members, confirmation, exchanges and ends, on nodes in virtual time."""

from dataclasses import replace
from typing import Any

from deeco import (
    EndReason,
    GroupCoordinator,
    GroupMember,
    Instant,
    Knowledge,
    all_of,
    component,
    group,
    one_of,
    role,
    seconds,
    some_of,
)
from deeco.group_protocol import GroupOffer
from deeco.local import Commit
from deeco.node import Node
from deeco.virtual_network import LossyMedium, VirtualNetwork


@role
class Field(GroupCoordinator):
    value: float = 1.0


@component
class Station(Field):
    drones: tuple[str, ...] = ()
    log: tuple[str, ...] = ()


@role
class Drone(GroupMember):
    position: float = 0.0


@component
class Quadcopter(Drone):
    field: str = ""
    log: tuple[str, ...] = ()


class Protection:
    drones = some_of(Drone, 1, 2)

    def priority(self, coordinator: Field) -> float:
        return coordinator.value

    def utility_drones(self, coordinator: Field, member: Drone) -> float:
        return -abs(member.position)

    def at_group(self, coordinator: Station, drones: tuple[Drone, ...]) -> Station:
        return replace(coordinator, drones=tuple(one.id for one in drones))

    def at_coordinator_end(self, coordinator: Station, member: Drone, reason: EndReason) -> Station:
        left = tuple(one for one in coordinator.drones if one != member.id)
        return replace(coordinator, drones=left, log=(*coordinator.log, f"{member.id} {reason.value}"))

    def at_member(self, coordinator: Field, member: Quadcopter) -> Quadcopter:
        return replace(member, field=coordinator.id)

    def at_member_end(self, coordinator: Field, member: Quadcopter, reason: EndReason) -> Quadcopter:
        return replace(member, field="", log=(*member.log, f"{coordinator.id} {reason.value}"))


PROTECTION = group(coordinator=Field, every=seconds(1), max_age=seconds(3))(Protection)


def network(
    *components: Knowledge, of: object = None, loss: float = 0.0, on_commit: Any = None
) -> VirtualNetwork[Node]:
    ensembles = [of or PROTECTION()]
    nodes = {
        one.id: Node([one], ensembles, address=number, on_commit=on_commit)
        for number, one in enumerate(components, start=1)
    }
    return VirtualNetwork(nodes, LossyMedium(loss))


def value(of: VirtualNetwork[Node], name: str) -> Any:
    return of[name].knowledge(name)


def test_a_coordinator_gets_the_best_members_and_they_get_it() -> None:
    net = network(
        Station(id="f"), Quadcopter(id="a", position=3), Quadcopter(id="b", position=2), Quadcopter(id="c")
    )
    net.advance(seconds(5))
    assert value(net, "f").drones == ("b", "c")
    assert [value(net, one).field for one in "abc"] == ["", "f", "f"]
    assert [one.member for one in value(net, "f").held_offers("Protection")] == ["b", "c"]


def test_a_free_drone_is_held_by_one_field_only_and_the_more_important_one() -> None:
    net = network(Station(id="f"), Station(id="g", value=2.0), Quadcopter(id="a"))
    net.advance(seconds(9))
    assert (value(net, "f").drones, value(net, "g").drones) == ((), ("a",))
    assert value(net, "a").field == "g"
    net.medium.reach = lambda *names: None if "g" in names else -60.0
    net.advance(seconds(9))
    assert (value(net, "f").drones, value(net, "g").drones) == (("a",), ())
    assert value(net, "g").log == ("a age",) and value(net, "a").log == ("g age",)


def test_several_components_of_one_node_form_a_group() -> None:
    node = Node([Quadcopter(id="a"), Station(id="f"), Quadcopter(id="b")], [PROTECTION()])
    node.advance(Instant(seconds(3)))
    station: Any = node.knowledge("f")
    assert station.drones == ("a", "b")


def test_present_members_stay_if_utilities_are_equal_and_a_better_one_replaces_one() -> None:
    net = network(Station(id="f"), Quadcopter(id="b", position=1), Quadcopter(id="c", position=1))
    net.advance(seconds(9))
    assert value(net, "f").drones == ("b", "c")
    for one in (Quadcopter(id="a", position=1), Quadcopter(id="d")):
        net.participants = {**net.participants, one.id: Node([one], [PROTECTION()], address=9)}
        net.advance(seconds(9))
        assert value(net, "f").drones == (("b", "c") if one.id == "a" else ("b", "d"))
    assert value(net, "f").log == ("c condition",) and value(net, "c").log == ("f condition",)


def test_a_member_of_equal_offers_stays_and_moves_only_for_a_better_one() -> None:
    net = network(Station(id="g"), Quadcopter(id="a"))
    net.advance(seconds(9))
    net.participants = {**net.participants, "f": Node([Station(id="f")], [PROTECTION()], address=9)}
    net.advance(seconds(9))
    assert value(net, "a").field == "g" and value(net, "f").group_offers == ()
    net.participants = {
        **net.participants,
        "h": Node([Station(id="h", value=9.0)], [PROTECTION()], address=8),
    }
    net.advance(seconds(9))
    assert value(net, "a").field == "h" and value(net, "a").log == ("g condition",)
    assert value(net, "g").log == ("a condition",)


def test_a_group_below_its_minimum_is_not_formed_and_releases_its_members() -> None:
    @group(coordinator=Field, every=seconds(1), max_age=seconds(3))
    class Guard(Protection):
        drones = some_of(Drone, 2, 3)

    net = network(Station(id="f"), Quadcopter(id="a"), Quadcopter(id="b"), of=Guard())
    net.advance(seconds(9))
    assert value(net, "f").drones == ("a", "b")
    net.medium.reach = lambda *names: None if "b" in names else -60.0
    net.advance(seconds(9))
    assert value(net, "f").drones == () and value(net, "f").group_offers == ()
    assert {*value(net, "f").log} == {"a condition", "b age"}
    assert value(net, "a").log == ("f condition",) and value(net, "b").log == ("f age",)


def test_of_two_groups_that_wait_for_each_other_one_is_formed() -> None:
    """f prefers a and g prefers b, but each needs both."""

    @group(coordinator=Field, every=seconds(1), max_age=seconds(3))
    class Guard(Protection):
        drones = some_of(Drone, 2, 2)

        def priority(self, coordinator: Field) -> float:
            return 0.0

        def utility_drones(self, coordinator: Field, member: Drone) -> float:
            return -abs(member.position - coordinator.value)

    net = network(
        Station(id="f", value=0),
        Station(id="g", value=9),
        Quadcopter(id="a"),
        Quadcopter(id="b", position=9),
        of=Guard(),
    )
    net.advance(seconds(15))
    assert (value(net, "f").drones, value(net, "g").drones) == (("a", "b"), ())


def test_roles_that_are_not_exclusive_are_shared() -> None:
    @group(coordinator=Field, every=seconds(1), max_age=seconds(3))
    class Watch(Protection):
        drones = all_of(Drone, exclusive=False)

    net = network(Station(id="f"), Station(id="g"), Quadcopter(id="a"), Quadcopter(id="b"), of=Watch())
    net.advance(seconds(9))
    assert value(net, "f").drones == value(net, "g").drones == ("a", "b")
    assert [one.coordinator for one in value(net, "a").group_confirmations] == ["f", "g"]


@role
class Wagon(GroupMember):
    load: int = 0


@role
class Pilot(GroupMember):
    skill: int = 0


@component
class Driver(Pilot, Wagon):
    """A component that plays both member roles."""


@role
class Train(GroupCoordinator, GroupMember):
    """Coordinator of a train, and member of a line."""


@component
class Engine(Train):
    seen: tuple[str, ...] = ()


@group(coordinator=Train, every=seconds(1), max_age=seconds(3))
class Convoy:
    pilot = one_of(Pilot)
    wagons = some_of(Wagon, 1, 4)

    def utility_pilot(self, coordinator: Train, member: Pilot) -> float:
        return member.skill

    def at_group(self, coordinator: Engine, pilot: tuple[Pilot, ...], wagons: tuple[Wagon, ...]) -> Engine:
        return replace(coordinator, seen=tuple(one.id for one in (*pilot, *wagons)))


@role
class Office(GroupCoordinator):
    """Coordinator of a line."""


@component
class Dispatcher(Office):
    trains: tuple[str, ...] = ()


@group(coordinator=Office, every=seconds(1), max_age=seconds(3))
class Line:
    """Nested: a line of trains with at least two wagons."""

    trains = some_of(Train, 1, 9)

    def select_trains(self, coordinator: Office, member: Train) -> bool:
        return sum(one.role == "wagons" for one in member.held_offers("Convoy")) >= 2

    def at_group(self, coordinator: Dispatcher, trains: tuple[Train, ...]) -> Dispatcher:
        return replace(coordinator, trains=tuple(one.id for one in trains))


def test_a_component_fills_one_role_and_an_outer_group_chooses_by_the_content_of_inner_ones() -> None:
    components = [
        Dispatcher(id="office"), Engine(id="t1"), Engine(id="t2"),
        Driver(id="p1", skill=1), Driver(id="p2", skill=2), Driver(id="p3"),
    ]  # fmt: skip
    commits: list[Commit] = []
    nodes = {one.id: Node([one], [Convoy(), Line()], on_commit=commits.append) for one in components}
    net = VirtualNetwork(nodes)
    net.advance(seconds(12))
    assert value(net, "t1").seen == ("p2", "p1", "p3") and value(net, "t2").seen == ()
    assert value(net, "office").trains == ("t1",)
    assert {one.by for one in commits} == {
        "Convoy.offer", "Convoy.confirm", "Convoy.at_group", "Line.offer", "Line.confirm", "Line.at_group"
    }  # fmt: skip
    assert all(one.adaptation and one.heard is not None for one in commits)
    assert {one.peer for one in commits if one.by == "Convoy.confirm"} == {"t1"}
    net.medium.reach = lambda *names: None if "p3" in names else -60.0
    net.advance(seconds(9))
    assert value(net, "office").group_offers == ()


def test_forged_and_foreign_offers_and_confirmations_are_ignored() -> None:
    forged = GroupOffer("Protection", "drones", "x", "a", Instant(0), 99.0, 9.0, True, True)
    wrong = [
        forged, forged._replace(coordinator="f", member="z"), forged._replace(coordinator="f", role="pilots"),
        forged._replace(coordinator="f", group="Other"),
    ]  # fmt: skip
    field = Station(id="f", group_offers=tuple(wrong))
    robot = Quadcopter(id="b", group_confirmations=tuple(wrong))
    nodes = {
        "f": Node([field], []), "a": Node([Quadcopter(id="a")], [PROTECTION()]),
        "b": Node([robot], []), "g": Node([Station(id="g")], [PROTECTION()]),
    }  # fmt: skip
    net = VirtualNetwork(nodes)
    net.advance(seconds(9))
    assert value(net, "a").group_confirmations[0].coordinator == "g" and value(net, "a").field == "g"
    assert value(net, "g").drones == ("a",)
