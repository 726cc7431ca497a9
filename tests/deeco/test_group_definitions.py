"""Wrong definitions of groups: the sentence names class, field and fix."""

from typing import Any

import pytest

from deeco import (
    DefinitionError,
    ExecutionError,
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
from deeco.node import Node
from tests.deeco.refusals import refused


@role
class Leader(GroupCoordinator):
    """A coordinator's role."""


@component
class Chief(Leader):
    """A coordinator."""


@role
class Follower(GroupMember):
    """A member's role."""


@component
class Soldier(Follower):
    """A member."""


@role
class Stranger(Knowledge):
    """A role of neither."""


def define(coordinator: Any = Leader, **attributes: Any) -> type:
    kind = type("Squad", (), attributes)
    return group(coordinator=coordinator, every=seconds(1), max_age=seconds(3))(kind)


@pytest.mark.parametrize(
    ("member", "sentence"),
    [
        (some_of(Follower, 0, 0), "0 to 0 members"),
        (some_of(Follower, 2, 0), "2 to 0 members"),
        (some_of(Follower, 3, 2), "3 to 2 members"),
        (some_of(Follower, -1, 2), "-1 to 2 members"),
        (some_of(Follower, 0.5, 2), "0.5 to 2 members"),  # type: ignore[arg-type]
        (some_of(Follower, True, 2), "True to 2 members"),
        (all_of(Follower, 0), "0 to 0 members"),
    ],
)
def test_a_wrong_cardinality_is_refused(member: Any, sentence: str) -> None:
    fix = "use integers: the first from 0, the second from 1 and not below the first"
    with refused(f"Squad.crew has {sentence}; {fix}", DefinitionError):
        define(crew=member)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (Soldier, "Soldier is not a role; use a class with @role, as peers are known by it only"),
        (int, "int is not a role; use a class with @role, as peers are known by it only"),
        (3, "3 is not a role; use a class with @role, as peers are known by it only"),
        (Stranger, "derive Stranger from GroupMember"),
        (Leader, "derive Leader from GroupMember"),
    ],
)
def test_a_class_that_is_no_role_of_members_is_refused(kind: Any, sentence: str) -> None:
    with refused(f"Squad.crew: {sentence}", DefinitionError):
        define(crew=one_of(kind))


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (Chief, "Chief is not a role; use a class with @role, as peers are known by it only"),
        (Stranger, "derive Stranger from GroupCoordinator"),
    ],
)
def test_a_class_that_is_no_role_of_coordinators_is_refused(kind: Any, sentence: str) -> None:
    with refused(f"group Squad: coordinator: {sentence}", DefinitionError):
        define(kind, crew=one_of(Follower))


def test_a_group_has_members() -> None:
    with refused("group Squad has no member role; add one, such as one_of(Drone)", DefinitionError):
        define()


EXCHANGES = "at_coordinator, at_member, at_coordinator_end, at_member_end"
METHODS = f"priority, at_group, {EXCHANGES}, select_crew, utility_crew"


@pytest.mark.parametrize("method", ["select_team", "utility_team", "at_crew", "at_coordinators"])
def test_a_method_that_is_never_called_is_refused(method: str) -> None:
    def unused(self: Any, coordinator: Leader, member: Follower) -> bool:
        return True

    with refused(f"Squad.{method} is never called; use {METHODS}", DefinitionError):
        define(crew=one_of(Follower), **{method: unused})


def test_parameters_are_checked() -> None:
    def one(self: Any, coordinator: Leader, guards: tuple[Follower, ...]) -> Leader:
        return coordinator

    def two(self: Any, leader: Leader) -> float:
        return 0.0

    def three(self: Any, coordinator: Leader, member: Soldier) -> bool:
        return True

    expected = "its first parameters must be self, coordinator"
    with refused(f"Squad.at_group: {expected}, crew", DefinitionError):
        define(crew=one_of(Follower), at_group=one)
    with refused(f"Squad.priority: {expected}", DefinitionError):
        define(crew=one_of(Follower), priority=two)
    with pytest.raises(DefinitionError, match=r"Squad.select_crew: Soldier is a component, but the peer is"):
        define(crew=one_of(Follower), select_crew=three)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [("every", 3, "3 is 3 µs"), ("max_age", None, "None is not a duration"), ("offset", 0.5, "0.5 is not a")],
)
def test_durations_are_checked(name: str, value: Any, text: str) -> None:
    times = {"every": seconds(1), "max_age": seconds(3), name: value}
    with pytest.raises(DefinitionError, match=rf"@group: {name}={text}"):
        group(coordinator=Leader, **times)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 10**400, "much", None])
@pytest.mark.parametrize("method", ["utility_crew", "priority"])
def test_a_number_that_is_not_finite_ends_the_run_with_a_sentence(method: str, value: Any) -> None:
    def utility(self: Any, coordinator: Leader, member: Follower) -> Any:
        return value

    def priority(self: Any, coordinator: Leader) -> Any:
        return value

    of = define(crew=one_of(Follower), **{method: utility if method == "utility_crew" else priority})
    node = Node([Chief(id="c"), Soldier(id="s")], [of()])
    sentence = f"Squad.{method} returned {value!r}; return a finite number\nin group Squad of 'c' at 0 s"
    with refused(sentence, ExecutionError):
        node.advance(Instant(1))


def test_a_failure_of_a_method_names_the_group_and_the_coordinator() -> None:
    def select(self: Any, coordinator: Leader, member: Follower) -> bool:
        return bool(1 // 0)

    node = Node([Chief(id="c"), Soldier(id="s")], [define(crew=one_of(Follower), select_crew=select)()])
    with pytest.raises(ZeroDivisionError) as raised:
        node.advance(Instant(1))
    assert raised.value.__notes__ == ["in group Squad of 'c' at 0 s"]
