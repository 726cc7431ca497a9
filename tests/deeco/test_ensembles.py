"""Ensembles: membership, exchange and schedule."""

from dataclasses import replace
from typing import Self

import pytest

from deeco import Contact, Instant, Knowledge, component, ensemble, milliseconds, periodic, role, seconds
from deeco.link import Reception
from deeco.network import NetworkParameters
from deeco.node import Node
from deeco.virtual_network import VirtualNetwork


@role
class Vehicle(Knowledge):
    position: float = 0.0
    speed: float = 0.0

    def stands(self) -> bool:
        return self.speed == 0.0


@role
class Loader(Knowledge):
    load: int = 0


@component
class Truck(Vehicle, Loader):
    followed: tuple[str, ...] = ()
    led: tuple[str, ...] = ()


@component
class Car(Vehicle):
    followed: tuple[str, ...] = ()


@role
class Lorry(Vehicle):
    axles: int = 2


@component
class Tanker(Lorry):
    """Plays Vehicle through Lorry."""


@ensemble(every=seconds(1), offset=milliseconds(500))
class Convoy:
    gap: float = 10.0

    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        return 0 < coordinator.position - member.position < self.gap

    def at_member(self, coordinator: Vehicle, member: Car) -> Car:
        return replace(member, followed=(*member.followed, coordinator.id))


@ensemble(every=seconds(1), offset=milliseconds(500))
class Both:
    def membership(self, coordinator: Loader, member: Vehicle) -> bool:
        return coordinator.id != member.id

    def at_coordinator(self, coordinator: Truck, member: Vehicle) -> Truck:
        return replace(coordinator, led=(*coordinator.led, member.id))

    def at_member(self, coordinator: Loader, member: Truck) -> Truck:
        return replace(member, followed=(*member.followed, coordinator.id))


def nodes(*components: Knowledge, ensembles: tuple[object, ...]) -> dict[str, Node]:
    return {
        one.id: Node([one], ensembles, address=number, publish_phase=milliseconds(7 * number))
        for number, one in enumerate(components, start=1)
    }


def test_only_the_local_side_changes_and_only_for_members() -> None:
    swarm = nodes(
        Tanker(id="a", position=9), Car(id="b", position=4), Car(id="c", position=-3), ensembles=(Convoy(),)
    )
    VirtualNetwork(swarm).advance(seconds(1))
    known = {name: node.knowledge(name) for name, node in swarm.items()}
    assert known == {
        "a": Tanker(id="a", position=9),
        "b": Car(id="b", position=4, followed=("a",)),
        "c": Car(id="c", position=-3, followed=("b",)),
    }
    assert swarm["b"].outcome()["exchanges"] == {"Convoy": 1}


def test_components_of_one_node_are_paired_on_both_sides() -> None:
    node = Node([Truck(id="t"), Car(id="c"), Truck(id="u")], [Both()])
    node.advance(Instant(seconds(1)))
    assert node.knowledge("t") == Truck(id="t", led=("c", "u"), followed=("u",))
    assert node.knowledge("u") == Truck(id="u", led=("t", "c"), followed=("t",))
    assert node.knowledge("c") == Car(id="c")


def test_a_component_without_the_role_is_not_a_member() -> None:
    swarm = nodes(Car(id="a"), Truck(id="b"), ensembles=(Both(),))
    VirtualNetwork(swarm).advance(seconds(1))
    assert swarm["a"].outcome()["counters"]["memberships"] == 1, "as the member of b; a cannot coordinate"
    assert swarm["b"].knowledge("b") == Truck(id="b", led=("a",))


def test_only_the_role_of_a_peer_is_visible() -> None:
    seen: list[object] = []

    @ensemble(every=seconds(1))
    class Watch:
        def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
            seen.append(coordinator if coordinator.id == "peer" else member)
            return False

        def at_member(self, coordinator: Vehicle, member: Car) -> Car:
            return member

    node = Node([Car(id="own"), Truck(id="peer", load=3)], [Watch()])
    node.advance(Instant(1))
    assert {type(one) for one in seen} == {Vehicle, Truck}, "Truck where it is the local side"
    assert seen[0] == Vehicle(id="peer")


@ensemble(every=seconds(1), offset=milliseconds(500))
class Local:
    def membership(self, coordinator: Vehicle, member: Truck) -> bool:
        return not member.led and coordinator.id != member.id

    def at_member(self, coordinator: Vehicle, member: Truck) -> Truck:
        return replace(member, followed=(*member.followed, coordinator.id))


def test_membership_with_local_knowledge_is_evaluated_on_its_node() -> None:
    swarm = nodes(Truck(id="a"), Truck(id="b", led=("x",)), ensembles=(Local(),))
    VirtualNetwork(swarm).advance(seconds(1))
    assert swarm["a"].knowledge("a") == Truck(id="a", followed=("b",))
    assert swarm["b"].knowledge("b") == Truck(id="b", led=("x",))
    assert [node.outcome()["counters"]["memberships"] for node in swarm.values()] == [1, 1]


@ensemble(every=seconds(1))
class Failing:
    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        return 1 / 0 > 0

    def at_member(self, coordinator: Vehicle, member: Car) -> Car:
        return member


def test_an_exception_in_membership_propagates() -> None:
    swarm = nodes(Car(id="a"), Car(id="b"), ensembles=(Failing(),))
    with pytest.raises(ZeroDivisionError) as caught:
        VirtualNetwork(swarm).advance(seconds(2))
    assert caught.value.__notes__ == ["in ensemble Failing of 'a' and 'b' at 1 s"]


def test_a_local_field_of_a_peer_is_missing_and_the_note_says_why() -> None:
    @ensemble(every=seconds(1))
    class Curious:
        def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
            return bool(coordinator.followed)  # type: ignore[attr-defined]

    swarm = nodes(Car(id="a"), Car(id="b"), ensembles=(Curious(),))
    with pytest.raises(AttributeError, match="'Vehicle' object has no attribute 'followed'") as caught:
        VirtualNetwork(swarm).advance(seconds(2))
    (note,) = caught.value.__notes__
    assert note.endswith("at 1 s; a peer has the fields of its role only")


def test_old_replicas_are_excluded_and_dropped() -> None:
    @ensemble(every=seconds(1), max_age=seconds(2))
    class Fresh:
        def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
            return True

        def at_member(self, coordinator: Vehicle, member: Car) -> Car:
            return replace(member, followed=(*member.followed, coordinator.id))

    parameters = NetworkParameters(forget_after=seconds(5))
    a = Node([Car(id="a")], parameters=parameters, address=1)
    b = Node([Car(id="b")], [Fresh()], parameters=parameters, address=2)
    (frame,) = a.advance(Instant(seconds(0.1)))
    air = VirtualNetwork({"b": b})
    b.advance(Instant(seconds(0.1)))
    b.advance(Instant(seconds(0.2)), [Reception(Instant(150_000), 1, frame.data, -70.0)])
    air.now = Instant(seconds(0.2))
    air.advance(seconds(4.8))
    assert b.knowledge("b") == Car(id="b", followed=("a", "a")), "at 1 and 2 s, and no more"
    assert [replica.id for replica in b.replicas] == ["a"]
    air.advance(seconds(0.3))
    assert not b.replicas
    assert b.outcome()["counters"]["replicas_forgotten"] == 1


@ensemble(on_change=Vehicle.stands)
class Jam:
    def membership(self, coordinator: Vehicle, member: Vehicle, now: Instant) -> bool:
        return coordinator.stands()

    def at_member(self, coordinator: Vehicle, member: Car, now: Instant, contact: Contact) -> Car:
        how = f"heard {contact.heard // 1000} {contact.rssi_dbm} {contact.hops}"
        note = f"{coordinator.id} at {now // 1000} {how}"
        return replace(member, followed=(*member.followed, note))


@component
class Stopping(Vehicle):
    @periodic(every=seconds(1))
    def drive(self, now: Instant) -> Self:
        return replace(self, speed=0.0 if now >= seconds(2) else 1.0)


def test_an_ensemble_runs_when_a_fact_of_a_peer_changes() -> None:
    a = Node([Stopping(id="a", speed=1.0)], address=1, publish_phase=milliseconds(10))
    b = Node([Car(id="b", speed=1.0)], [Jam()], address=2)
    VirtualNetwork({"a": a, "b": b}).advance(seconds(4))
    assert b.knowledge("b") == Car(id="b", speed=1.0, followed=("a at 2100 heard 2010 -60.0 0",))
    assert b.outcome()["counters"]["memberships"] == 2 * 2, "at the first news and at the change, both roles"


def test_an_ensemble_runs_when_a_local_fact_changes() -> None:
    node = Node([Stopping(id="a", speed=1.0), Car(id="b", speed=1.0)], [Jam()])
    node.advance(Instant(seconds(3)))
    assert node.knowledge("b") == Car(id="b", speed=1.0, followed=("a at 2000 heard 2000 None 0",))
