"""Exhaustive check of the protocol of groups: all states of three nodes with at most six publications."""

from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, NamedTuple

import pytest

from deeco import (
    Contact,
    GroupCoordinator,
    GroupMember,
    Instant,
    component,
    group,
    group_evaluation,
    role,
    seconds,
    some_of,
)
from deeco.ensemble import Binding
from deeco.group_evaluation import BoundGroup
from deeco.group_protocol import GroupOffer, choose
from deeco.knowledge import role_view
from deeco.local import LocalComponent
from deeco.network import Replica
from deeco.packet import Version
from deeco.statistics import Statistics


@role
class Base(GroupCoordinator):
    """A coordinator's role."""


@component
class Camp(Base):
    """A coordinator."""


@role
class Scout(GroupMember):
    """A member's role."""


@component
class Ranger(Scout):
    """A member."""


@group(coordinator=Base, every=seconds(1), max_age=seconds(3))
class Single:
    scouts = some_of(Scout, 1, 1)


@group(coordinator=Base, every=seconds(1), max_age=seconds(3))
class Double:
    scouts = some_of(Scout, 2, 2)


class Channel(NamedTuple):
    """Messages from one node to another."""

    replica: Any = None
    """Received knowledge; None if it is too old, or nothing has been received."""
    in_flight: tuple[Any, ...] = ()
    """Knowledge that was sent later, oldest first, and may still be received."""


class State(NamedTuple):
    """Knowledge of the nodes and the channels to each, by number of receiver and sender."""

    sent: int
    values: tuple[Any, ...]
    channels: tuple[tuple[Channel, ...], ...]


class Model:
    """Nodes of one component each, whose messages are received in any order, also repeatedly or never.

    A message that is older than the replica changes nothing, so it is no longer in flight. A node evaluates
    the group when it receives a message, and when a replica becomes too old, which may happen at any time.
    """

    def __init__(self, of: type, *components: Any, most: int = 6) -> None:
        self.name = of.__name__
        self._start = components
        self._most = most
        self._bound = BoundGroup(of(), Binding({}), Statistics())
        self._evaluate = cache(self._evaluated)

    def _evaluated(self, value: Any, peers: tuple[Any, ...], now: int) -> Any:
        local = LocalComponent(value, Binding({}))
        contact = Contact(Instant(now), None, 0)
        replicas = [Replica(one.id, Version(0, 0), (one,), contact) for one in peers]
        self._bound.evaluate((local,), replicas, Instant(now))
        return local.value

    def states(self) -> int:
        """Check the invariants in all reachable states, breadth first; return their number."""
        nodes = len(self._start)
        front = [State(0, self._start, ((Channel(),) * nodes,) * nodes)]
        seen = set(front)
        while front:
            reached = {after for state in front for after in self._next(state)}
            front = [*(reached - seen)]
            for one in front:
                self.check(one)
            seen.update(front)
        return len(seen)

    def _next(self, state: State) -> Iterator[State]:
        coordinators = [isinstance(one, Camp) for one in state.values]
        for receiver, row in enumerate(state.channels):
            for sender, (replica, in_flight) in enumerate(row):
                if coordinators[receiver] == coordinators[sender]:
                    continue  # it does not use this knowledge
                if state.sent < self._most:
                    message = role_view(state.values[sender], Base if coordinators[sender] else Scout)
                    sent = Channel(replica, (*in_flight, message))
                    yield self._with(state._replace(sent=state.sent + 1), receiver, sender, sent)
                for number, message in enumerate(in_flight):
                    yield self._received(state, receiver, sender, Channel(message, in_flight[number + 1 :]))
                if replica is not None:
                    yield self._received(state, receiver, sender, Channel(None, in_flight))

    def _with(self, state: State, receiver: int, sender: int, channel: Channel) -> State:
        return state._replace(
            channels=put(state.channels, receiver, put(state.channels[receiver], sender, channel))
        )

    def _received(self, state: State, receiver: int, sender: int, channel: Channel) -> State:
        after = self._with(state, receiver, sender, channel)
        peers = tuple(one.replica for one in after.channels[receiver] if one.replica is not None)
        value = self._evaluate(after.values[receiver], peers, after.sent)
        return after._replace(values=put(after.values, receiver, value))

    def check(self, state: State) -> None:
        """Assert the invariants."""
        members = {one.id: one for one in state.values if isinstance(one, Ranger)}
        holders = dict.fromkeys(members, 0)
        for value, row in zip(state.values, state.channels, strict=True):
            if isinstance(value, Ranger):
                assert len(value.group_confirmations) <= 1, "a member confirms one coordinator"
                continue
            replicas = {one.replica.id: one.replica for one in row if one.replica is not None}
            for offer in value.held_offers(self.name):
                replica = replicas[offer.member]
                assert offer.key in [one.key for one in replica.group_confirmations], "a replica confirms it"
                holders[offer.member] += keys(replica) == keys(members[offer.member])
            least = self._bound.type.members["scouts"].least
            assert len(value.held_offers(self.name)) in (0, least), "a group holds with its minimum"
            assert len(value.group_offers) in (0, least), "a group that cannot be filled is not formed"
        assert max(holders.values()) <= 1, "coordinators with the newest knowledge do not share a member"


def put(values: tuple[Any, ...], index: int, value: Any) -> tuple[Any, ...]:
    """Return a tuple with one value replaced."""
    return (*values[:index], value, *values[index + 1 :])


def keys(member: Any) -> list[Any]:
    """Return the offers that a member confirms."""
    return [one.key for one in member.group_confirmations]


def model(of: type, **limits: int) -> Model:
    """Return two coordinators and a member, or a coordinator and two members."""
    last = Camp(id="g") if of is Single else Ranger(id="b")
    return Model(of, Camp(id="f"), Ranger(id="a"), last, **limits)


@pytest.mark.parametrize(
    ("of", "most", "least"),
    [
        (Single, 5, 25_000),
        (Double, 6, 18_000),
        pytest.param(Single, 6, 175_000, marks=pytest.mark.nightly),
    ],
)
def test_the_invariants_hold_in_all_states(of: type, most: int, least: int) -> None:
    assert model(of, most=most).states() >= least


def confirm_all(current: Any, offers: Iterable[GroupOffer], exclusive: Any) -> tuple[GroupOffer, ...]:
    return tuple(offers)


def choose_as_confirmed(roles: Any, candidates: Iterable[GroupOffer]) -> tuple[GroupOffer, ...]:
    return tuple(one._replace(confirmed=True, holds=True) for one in choose(roles, candidates))


@pytest.mark.parametrize(
    ("function", "mistake", "found"),
    [
        ("confirm", confirm_all, "a member confirms one coordinator"),
        ("choose", choose_as_confirmed, "a replica confirms it"),
    ],
)
def test_a_mistake_in_the_protocol_is_found(
    monkeypatch: pytest.MonkeyPatch, function: str, mistake: Any, found: str
) -> None:
    monkeypatch.setattr(group_evaluation, function, mistake)
    with pytest.raises(AssertionError, match=found):
        model(Single, most=4).states()
