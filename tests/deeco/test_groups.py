"""Groups: choice of members, confirmation, exchanges and ends, on nodes in virtual time."""

from dataclasses import replace
from typing import Any

from deeco import (
    EndReason,
    GroupCoordinator,
    GroupMember,
    Instant,
    Knowledge,
    component,
    group,
    role,
    seconds,
    some_of,
)
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
