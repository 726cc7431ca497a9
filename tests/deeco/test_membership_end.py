"""Ends of memberships: by condition, by age and by a dropped replica, once each and in a fixed order."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco import (
    Contact,
    EndReason,
    ExecutionError,
    Instant,
    Knowledge,
    component,
    ensemble,
    milliseconds,
    role,
    seconds,
)
from deeco.link import Reception
from deeco.local import Commit
from deeco.network import NetworkParameters
from deeco.node import Node
from tests.deeco.refusals import refused


@role
class Room(Knowledge):
    celsius: float = 20.0


@component
class Hall(Room):
    cooled: tuple[str, ...] = ()


@role
class Cooling(Knowledge):
    level: int = 0


@component
class Fan(Cooling):
    log: tuple[str, ...] = ()


@ensemble(every=seconds(1), max_age=seconds(3))
class Ventilation:
    limit: float = 28.0

    def membership(self, coordinator: Room, member: Cooling) -> bool:
        return coordinator.celsius > self.limit

    def at_member(self, coordinator: Room, member: Fan) -> Fan:
        return replace(member, log=(*member.log, f"+{coordinator.id}"))

    def at_member_end(
        self, coordinator: Room, member: Fan, now: Instant, reason: EndReason, contact: Contact
    ) -> Fan:
        text = (
            f"-{coordinator.id} {coordinator.celsius:g} {reason.value} "
            f"at {now / 1e6:g} heard {contact.heard / 1e6:g}"
        )
        return replace(member, log=(*member.log, text))

    def at_coordinator_end(self, coordinator: Hall, member: Cooling) -> Hall:
        return replace(coordinator, cooled=(*coordinator.cooled, member.id))


def frames(number: int, *values: float, name: str = "hall") -> list[bytes]:
    """Return the publications of a room with these temperatures, one node for all."""
    node, sent = None, []
    for count, celsius in enumerate(values):
        node = Node(
            [Hall(id=name, celsius=celsius)], address=number, epoch=count, start=Instant(0), previous=node
        )
        sent += [frame.data for frame in node.advance(Instant(1))]
    return sent


def fan(**parameters: object) -> Node:
    network = NetworkParameters(**parameters)  # type: ignore[arg-type]
    return Node([Fan(id="fan")], [Ventilation()], parameters=network, address=9)


def advance(node: Node, until: float, *received: bytes) -> tuple[str, ...]:
    """Deliver frames now; return what the fan has logged since."""
    before = node.knowledge("fan")
    assert isinstance(before, Fan)
    node.advance(Instant(seconds(until)), [Reception(node.now, 1, one) for one in received])
    after = node.knowledge("fan")
    assert isinstance(after, Fan)
    return after.log[len(before.log) :]


def test_a_membership_ends_once_by_its_condition() -> None:
    hot, hotter, cool, mild = frames(1, 30.0, 31.0, 25.0, 24.0)
    node = fan()
    assert advance(node, 0.5, hot) == ("+hall",)
    assert advance(node, 1.5, hotter) == ("+hall",)
    assert advance(node, 2.5, cool) == ("-hall 25 condition at 2 heard 1.5",)
    assert advance(node, 5.5, mild) == ()
    assert node.outcome()["exchanges"] == {"Ventilation": 3}


def test_a_membership_ends_by_age_and_begins_again() -> None:
    hot, again = frames(1, 30.0, 31.0)
    node = fan()
    assert advance(node, 0.5, hot) == ("+hall",)
    assert advance(node, 3.5) == ("+hall",) * 3
    assert advance(node, 9.5) == ("-hall 30 age at 4 heard 0",), "with the last knowledge that it had"
    assert advance(node, 10.5, again) == ("+hall",)


def test_a_membership_ends_when_the_replica_is_dropped() -> None:
    (hot,), (other,) = frames(1, 30.0), frames(2, 35.0, name="attic")
    node = fan(max_replicas=1)
    assert advance(node, 0.5, hot) == ("+hall",)
    assert advance(node, 1.5, other) == ("-hall 30 forgotten at 1 heard 0", "+attic")


def test_ends_of_absent_peers_come_first_and_in_order_of_id() -> None:
    rooms = [frames(number, 30.0, name=name)[0] for number, name in enumerate(("c", "a", "b"), start=1)]
    (cool,) = frames(4, 20.0, name="b")
    hot, cold = frames(5, 40.0, 20.0, name="d")
    node = fan()
    assert advance(node, 0.5, *rooms) == ("+a", "+b", "+c")
    assert advance(node, 3.5, hot)[-4:] == ("+a", "+b", "+c", "+d")
    ended = advance(node, 4.5, cold)
    assert [one.split()[0] for one in ended] == ["-a", "-b", "-c", "-d"]
    assert [one.split()[2] for one in ended] == ["age", "age", "age", "condition"]
    assert advance(node, 5.5, cool) == ()


def test_both_sides_on_one_node_end_and_commits_name_the_method() -> None:
    commits: list[Commit] = []

    @ensemble(every=seconds(1))
    class Early(Ventilation):
        def membership(  # type: ignore[override]
            self, coordinator: Room, member: Cooling, now: Instant
        ) -> bool:
            return now < seconds(2)

    node = Node([Hall(id="hall"), Fan(id="fan")], [Early()], on_commit=commits.append)
    node.advance(Instant(seconds(5)))
    assert [(one.by, one.peer, one.instant // 1_000_000) for one in commits] == [
        ("Early.at_member", "hall", 0),
        ("Early.at_member", "hall", 1),
        ("Early.at_coordinator_end", "fan", 2),
        ("Early.at_member_end", "hall", 2),
    ]
    assert all(one.adaptation for one in commits)


def test_a_role_that_is_no_longer_played_ends_the_membership() -> None:
    @role
    class Shelf(Knowledge):
        books: int = 0

    @component
    class Library(Shelf):
        """The hall after its program was replaced."""

    (hot,) = frames(1, 30.0)
    library = Node([Library(id="hall")], address=1, epoch=7)
    (frame,) = library.advance(Instant(1))
    node = fan()
    assert advance(node, 0.5, hot) == ("+hall",)
    assert advance(node, 1.5, frame.data) == ("-hall 30 condition at 1 heard 0",)


def test_a_wrong_result_names_the_method_and_a_failure_the_pair() -> None:
    @ensemble(every=seconds(1))
    class Wrong(Ventilation):
        def at_member_end(self, coordinator: Room, member: Fan) -> Fan:  # type: ignore[override]
            return None  # type: ignore[return-value]

    hot, cool = frames(1, 30.0, 20.0)
    node = Node([Fan(id="fan")], [Wrong()], address=9)
    advance(node, 0.5, hot)
    sentence = (
        "Wrong.at_member_end of 'fan' at 1 s returned a NoneType; return the next Fan"
        "\nin ensemble Wrong of 'hall' and 'fan' at 1 s"
    )
    with refused(sentence, ExecutionError):
        advance(node, 1.5, cool)


SENT = frames(1, *((20.0, 30.0)[number % 3 > 0] for number in range(12)))
"""Publications of a room, every third one of them cool, each after a restart of its node."""
Delivery = tuple[int, int]
"""Number of a publication, which may be lost, late, repeated or out of order; seconds until the next one."""


def check_history(history: list[Delivery]) -> None:
    """Compare the log with a direct calculation from the newest received value and its age."""
    node, now, expected = fan(forget_after=seconds(7)), 0.5, list[str]()
    newest, heard, holds = 0, -99.0, False
    node.advance(Instant(seconds(0.5)))
    for number, pause in history:
        advance(node, now + pause, SENT[number])
        if number > newest or heard < 0:
            newest, heard = number, now
        for second in range(int(now + 0.5), int(now + pause + 0.5)):
            held, holds = holds, newest % 3 > 0 and second - heard <= 3
            expected += ["+hall"] if holds else ["-hall"] if held else []
        now += pause
    after = node.knowledge("fan")
    assert isinstance(after, Fan)
    assert [one.split()[0] for one in after.log] == expected


HISTORIES = st.lists(st.tuples(st.integers(0, 11), st.integers(1, 9)), max_size=15)


@settings(max_examples=300, deadline=None)
@given(HISTORIES)
def test_a_membership_ends_once_in_every_history(history: list[Delivery]) -> None:
    check_history(history)


@pytest.mark.nightly
@settings(max_examples=10_000, deadline=None)
@given(HISTORIES)
def test_a_membership_ends_once_in_10_000_histories(history: list[Delivery]) -> None:
    check_history(history)


def test_an_ensemble_without_ends_keeps_no_members() -> None:
    class Plain:
        def membership(self, coordinator: Room, member: Cooling) -> bool:
            return True

    node = Node([Fan(id="fan")], [ensemble(every=milliseconds(100))(Plain)()])
    advance(node, 1.0, *frames(1, 30.0))
    assert all(not side.members for bound in node._ensembles for side in bound._sides)
