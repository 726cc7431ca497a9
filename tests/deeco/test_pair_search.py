"""Declared conditions of pairs: results as without them, but fewer evaluations of membership."""

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco import (
    DefinitionError,
    EndReason,
    Instant,
    Knowledge,
    component,
    ensemble,
    replace,
    role,
    seconds,
)
from deeco.link import Reception
from deeco.local import Commit
from deeco.node import Node


class Point(NamedTuple):
    x: float
    y: float


@role
class Worker(Knowledge):
    position: Point
    room: int = 0
    office: int | None = 0
    height: float = 0.0


@component
class Clerk(Worker):
    met: tuple[str, ...] = ()


@role
class Guest(Knowledge):
    name: str = ""


@component
class Visitor(Guest):
    """Does not have the fields of the conditions."""


def moved(own: Clerk, peer: Worker, text: str) -> Clerk:
    """Return the clerk after a meeting; some meetings change the fields of the conditions."""
    number = len(own.met) % 7
    position = peer.position if number == 3 else own.position
    room = peer.room if number == 5 else own.room
    return replace(own, met=(*own.met, f"{text} {peer.id}"), position=position, room=room)


class Meeting:
    """Membership by distance, room or both, with exchanges and ends on both sides."""

    limit: float
    by_distance: bool
    by_room: bool

    def membership(self, coordinator: Worker, member: Worker) -> bool:
        x, y = coordinator.position.x - member.position.x, coordinator.position.y - member.position.y
        is_near = (x * x + y * y) ** 0.5 <= self.limit
        return (is_near or not self.by_distance) and (coordinator.room == member.office or not self.by_room)

    def at_member(self, coordinator: Worker, member: Clerk) -> Clerk:
        return moved(member, coordinator, "follows")

    def at_coordinator(self, coordinator: Clerk, member: Worker) -> Clerk:
        return moved(coordinator, member, "leads")

    def at_member_end(self, coordinator: Worker, member: Clerk, reason: EndReason) -> Clerk:
        return moved(member, coordinator, f"leaves ({reason.value})")


def meeting(**conditions: Any) -> Any:
    """Return a class of ensembles with these conditions."""

    @ensemble(every=seconds(1), max_age=seconds(3), **conditions)
    class Declared(Meeting):
        limit: float = 1.0
        by_distance: bool = True
        by_room: bool = True

    return Declared


UNDECLARED = meeting()
DECLARED = {
    (True, False): meeting(near=("position", "limit")),
    (False, True): meeting(equal=("room", "office")),
    (True, True): meeting(near=("position", "limit"), equal=("room", "office")),
}
# Multiples of 0.1: many distances are equal to a limit, or differ from it by rounding only.
COORDINATES = st.integers(-12, 12).map(lambda number: number / 10) | st.sampled_from([1e300, -1e16])
WORKERS = st.builds(
    Clerk,
    id=st.just(""),
    position=st.builds(Point, COORDINATES, COORDINATES),
    room=st.integers(0, 2),
    office=st.none() | st.integers(0, 2),
)


def run(
    kind: Any, values: Sequence[Clerk], heard: Sequence[Sequence[Clerk]], parameters: dict[str, Any]
) -> tuple[list[Commit], int]:
    """Return all commits of a node that receives other knowledge in each second, and its evaluations."""
    commits: list[Commit] = []
    own = [replace(value, id=f"own{number}") for number, value in enumerate(values)]
    node = Node([*own, Visitor(id="visitor")], [kind(**parameters)], on_commit=commits.append, address=1)
    for second, others in enumerate(heard):
        node.advance(
            Instant(seconds(second + 1)),
            [
                Reception(node.now, 2, frame.data)
                for number, value in enumerate(others)
                for frame in Node([replace(value, id=f"peer{number}")], address=2, epoch=second).advance(
                    Instant(1)
                )
            ],
        )
    node.advance(Instant(seconds(len(heard) + 5)))
    return commits, node.outcome()["counters"]["memberships"]


@pytest.fixture(autouse=True, scope="module")
def few_searched_pairs() -> Iterator[None]:
    """Search also among few pairs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("deeco.local.MIN_SEARCHED_PAIRS", 0)
        yield


@settings(max_examples=100)
@given(
    conditions=st.sampled_from(sorted(DECLARED)),
    values=st.lists(WORKERS, min_size=1, max_size=6),
    heard=st.lists(st.lists(WORKERS, max_size=4), max_size=4),
    limit=st.sampled_from([0.1, 0.3, 0.7, 1.0, 1e9]),
)
def test_commits_are_those_without_conditions(
    conditions: tuple[bool, bool], values: list[Clerk], heard: list[list[Clerk]], limit: float
) -> None:
    parameters = {"limit": limit, "by_distance": conditions[0], "by_room": conditions[1]}
    expected, all_pairs = run(UNDECLARED, values, heard, parameters)
    commits, pairs = run(DECLARED[conditions], values, heard, parameters)
    assert commits == expected
    assert pairs <= all_pairs


def clerks(side: int, **changes: Any) -> list[Clerk]:
    """Return clerks in a square, 2 m apart."""
    places = [Point(2.0 * x, 2.0 * y) for x in range(side) for y in range(side)]
    return [replace(Clerk(id=f"c{number}", position=place), **changes) for number, place in enumerate(places)]


@pytest.mark.parametrize("side", [10, 20])
def test_evaluations_grow_linearly_with_the_components_of_a_node(side: int) -> None:
    _, pairs = run(meeting(near=("position", 2.0)), clerks(side), [], {"limit": 2.0, "by_room": False})
    evaluations = 5 * 2 * side**2 * 9  # seconds, sides, components, cells with one component each
    assert pairs <= evaluations


def test_a_float_is_a_position_on_a_line() -> None:
    levels = [replace(one, height=float(one.position.x)) for one in clerks(4)]
    _, pairs = run(meeting(near=("height", 0.5)), levels, [], {"limit": 1e9, "by_room": False})
    assert pairs == 5 * 2 * 16 * 3  # only the others on the same level


def test_rounded_distances_are_distances() -> None:
    values = [Clerk(id="", position=Point(x, 0.0)) for x in (-1e-17, 0.3)]
    assert values[1].position.x - values[0].position.x == 0.3, "rounded: the difference is larger"
    commits, _ = run(DECLARED[True, False], values, [], {"limit": 0.3, "by_room": False})
    assert len(commits) > 2


@pytest.mark.parametrize(
    ("conditions", "fault"),
    [
        ({"equal": ("room", "desk")}, "equal=('room', 'desk'), but Worker has no field 'desk'"),
        (
            {"near": ("place", 1.0)},
            "near=('place', 1.0), but Worker has no such field with a float or a tuple",
        ),
        ({"near": ("office", 1.0)}, "near=('office', 1.0), but Worker has no such field"),
    ],
)
def test_wrong_fields_are_refused_at_import(conditions: dict[str, Any], fault: str) -> None:
    with pytest.raises(DefinitionError, match=re.escape(f"ensemble Declared: {fault}")):
        meeting(**conditions)


@pytest.mark.parametrize(("near", "limit"), [(("position", "limit"), -1.0), (("position", "gap"), 1.0)])
def test_wrong_distances_are_refused_at_deployment(near: tuple[str, str], limit: float) -> None:
    text = (
        f"near has the distance {-1.0 if near[1] == 'limit' else 'gap'!r}; use a positive number or a field"
    )
    with pytest.raises(DefinitionError, match=re.escape(text)):
        Node([], [meeting(near=near)(limit=limit)])
