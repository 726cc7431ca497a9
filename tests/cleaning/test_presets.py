"""Shipped strategies, their settings and presets, and the log of decisions."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from acrc_testbed.testing import VirtualSwarm
from actors.geometry import Point
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.robot.behaviour import Setting, SettingsError, from_settings, host
from actors.robot.behaviour.decisions import AdaptationDecision, DecisionLog
from actors.robot.behaviour.loading import load_behaviour
from actors.runtime.errors import AcrcError
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import State
from cleaning.parameters import AdaptationParameters, CleaningParameters, ReleasedParameters, UnblockTarget
from cleaning.place import RESTART_TERM, Assignment, assignments
from cleaning.robot import CleaningRobot
from cleaning.strategies import STRATEGIES, StrategyError, entry
from deeco import component
from deeco.local import Commit
from tests.cleaning.fakes import OPEN

PLACES = [Point(1.0, 2.0), Point(5.0, 0.0), Point(9.0, 0.0)]
START = VirtualSwarm(partial(load_behaviour, entry("none")), OPEN, {"r1": PLACES})["r1"].start


@pytest.mark.parametrize("name", STRATEGIES)
def test_each_shipped_strategy_can_be_created_and_has_a_short_description(name: str) -> None:
    made = load_behaviour(entry(name), replace(START, items=()))
    if name == "chapter-giving-up":
        assert made._component.parameters.attempts == 5  # type: ignore[attr-defined]
    if name == "make-way":
        assert made._component.parameters.make_way  # type: ignore[attr-defined]
    module, function = STRATEGIES[name].split(":")
    first = getattr(__import__(module, fromlist=[function]), function).__doc__.splitlines()[0]
    assert first.endswith(".") and len(first) < 110


def test_presets_differ_as_text_and_code_do() -> None:
    text, code = AdaptationParameters(), ReleasedParameters()
    differing = {
        one.name: (getattr(text, one.name), getattr(code, one.name))
        for one in fields(text)
        if getattr(text, one.name) != getattr(code, one.name)
    }
    assert differing == {
        "retry": (True, False),
        "unblock": (UnblockTarget.QUEUE, UnblockTarget.FLOOR),
        "recount": (True, False),
        "adoption_distance": (1.5, 3.0),
        "exchange": (True, False),
    }


@pytest.mark.parametrize(
    ("kind", "name", "value", "wanted"),
    [
        (CleaningParameters, "reach", 0, "above 0"),
        (AdaptationParameters, "adoption_backoff", -1, "at least 0"),
        (AdaptationParameters, "most_adopted", 65, "from 1 to 64"),
        (ReleasedParameters, "no_plan_attempts", 2, "0 or 1 without retry"),
    ],
)
def test_wrong_settings(kind: type[CleaningParameters], name: str, value: int, wanted: str) -> None:
    with pytest.raises(SettingsError, match=f"strategy.{name} is {value}, but must be {wanted}"):
        from_settings(kind, {name: value})


def test_a_restarted_robot_claims_its_places_with_a_higher_term() -> None:
    assert assignments(START) == (
        Assignment("r1", 0, Point(5.0, 0.0), 0),
        Assignment("r1", 1, Point(9.0, 0.0), 0),
    )
    assert [assignment.term for assignment in assignments(replace(START, epoch=2))] == [2 * RESTART_TERM] * 2
    assert RESTART_TERM > 24 * 3600 // 3, "more than the adoptions of a day"


@pytest.mark.parametrize("name", ["none", "none-original", "none-giving-up", "random"])
def test_baselines_differ_after_an_aborted_goal(name: str) -> None:
    """Navigation aborts each goal; strategies check every 2 s."""
    swarm = VirtualSwarm(partial(load_behaviour, entry(name)), OPEN, {"r1": PLACES})
    robot = swarm["r1"]
    for _ in range(500):
        if robot.navigation.goal is not None:
            robot.navigation.abort()
        swarm.advance(milliseconds(100))
    expected = {"none": (25, 0), "none-original": (1, 0), "none-giving-up": (20, 2), "random": (25, 0)}
    assert (len(robot.navigation.goals), len(robot.given_up)) == expected[name]


def test_a_robot_without_radio_neither_sends_nor_receives() -> None:
    strategies = {"r1": "chapter", "r2": "chapter-mute"}
    swarm = VirtualSwarm(
        lambda start: load_behaviour(entry(strategies[start.robot]), start),
        OPEN,
        {"r1": PLACES, "r2": PLACES},
    )
    swarm.advance(seconds(3))
    assert {sender for sender, _ in swarm.medium.sent} == {"r1"}


def test_an_unknown_strategy_gives_one_sentence() -> None:
    assert entry("my_study.adoption:behaviour") == "my_study.adoption:behaviour"
    with pytest.raises(StrategyError, match="unknown strategy 'barter'; choose from auction, "):
        entry("barter")


class Mode(Enum):
    BOLD = "bold"
    SHY = "shy"
    SILENT = 1


@dataclass(frozen=True)
class Parameters:
    reach: float = 0.5
    tries: int = 3
    fair: bool = False
    title: str = "none"
    mode: Mode = Mode.SHY
    lease: Duration = field(default=seconds(2))
    points: tuple[float, ...] = ()
    fixed: int = field(default=7, init=False)

    def __post_init__(self) -> None:
        if self.lease < 0:
            raise ValueError("a lease should be at least 0 s")
        if self.fair and self.mode is Mode.BOLD:
            raise AcrcError("who is fair should not be bold")


@dataclass(frozen=True)
class RequiredParameters:
    deadline: Duration
    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise ValueError("it should be above 0 and at most 1")


@dataclass(frozen=True)
class NestedParameters:
    points: tuple[tuple[float, float], ...] = ()


def refusal(
    kind: type[Parameters | RequiredParameters | NestedParameters], settings: Mapping[str, Setting]
) -> str:
    with pytest.raises(SettingsError) as caught:
        from_settings(kind, settings)
    return str(caught.value)


def test_each_kind_of_field_is_set() -> None:
    given_ones: dict[str, Setting] = {
        "reach": 1, "tries": 4, "fair": True, "title": "x", "mode": "shy", "lease": 0.25
    }  # fmt: skip
    made = from_settings(Parameters, given_ones)
    assert made == Parameters(1.0, 4, True, "x", Mode.SHY, milliseconds(250))
    assert type(made.reach) is float
    assert from_settings(Parameters, {"mode": 1}).mode is Mode.SILENT
    assert from_settings(Parameters, {"lease": 3}).lease == seconds(3)

    assert from_settings(Parameters, {}) == Parameters()
    assert from_settings(RequiredParameters, {"deadline": 1}) == RequiredParameters(seconds(1))


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"leese": 1}, "unknown key strategy.leese; did you mean strategy.lease?"),
        (
            {"xyz": 1},
            "unknown key strategy.xyz; known keys of strategy: reach, tries, fair, title, mode, lease, "
            "points",
        ),
        (
            {"points": (1, "2")},
            'strategy.points is [1, "2"], but must be a list, each item a finite number',
        ),
        ({"reach": math.nan}, "strategy.reach is NaN, but must be a finite number"),
        ({"tries": 2.0}, "strategy.tries is 2.0, but must be a whole number"),
        ({"fair": 1}, "strategy.fair is 1, but must be true or false"),
        ({"mode": "brave"}, 'strategy.mode is "brave", but must be "bold", "shy" or 1'),
        ({"lease": 1e7}, "strategy.lease is 10000000.0, but must be a number of seconds, at most 1000000"),
        ({"reach": 2, "lease": -1}, "strategy.lease is -1: a lease should be at least 0 s"),
        (
            {"fair": True, "mode": "bold"},
            'strategy.fair is true, strategy.mode is "bold": who is fair should not be bold',
        ),
    ],
)
def test_an_invalid_setting_gives_one_sentence(settings: Mapping[str, Setting], sentence: str) -> None:
    assert refusal(Parameters, settings) == sentence


def test_a_field_without_default_is_required() -> None:
    assert refusal(RequiredParameters, {}).startswith(
        "strategy.deadline is missing, but must be a number of seconds, at "
    )
    assert refusal(RequiredParameters, {"share": 2.0, "deadline": 1}).endswith(
        "is 2.0: it should be above 0 and at most 1"
    )
    assert refusal(Parameters, {"reach": 10**400}).endswith("…, but must be a finite number")
    assert (
        refusal(NestedParameters, {"lease": 1}) == "unknown key strategy.lease; this strategy has no settings"
    )


@given(some.dictionaries(some.sampled_from(["reach", "tries", "mode", "lease", "odd"]), some.one_of(
    some.booleans(), some.integers(), some.floats(), some.text(max_size=5)
)))  # fmt: skip
@settings(deadline=None, derandomize=True)
def test_settings_give_parameters_or_one_sentence(wanted: Mapping[str, Setting]) -> None:
    try:
        made = from_settings(Parameters, wanted)
    except SettingsError as error:
        assert str(error).startswith(("strategy.", "unknown key strategy.")) and "\n" not in str(error)
    else:
        assert isinstance(made.reach, float) and math.isfinite(made.reach)
        assert type(made.tries) is type(made.lease) is int


HERE, THERE = Point(1.0, 2.0), Point(5.0, 2.0)
OWN = Assignment("r1", 0, HERE)
OTHERS = Assignment("r2", 3, THERE)
ROBOT = AdaptiveCleaningRobot(id="r1", position=Point(0.0, 0.0), route=(OWN,), destination=OWN)
NOW = Instant(seconds(10))


def commit(
    after: CleaningRobot, before: CleaningRobot = ROBOT, *, adaptation: bool = True, at: Instant = NOW
) -> Commit:
    return Commit("AdaptiveCleaningRobot.auto_unblock", at, before, after, adaptation)


def test_a_decision_is_logged_with_cause_and_targets() -> None:
    log = DecisionLog(ROBOT)
    log.take(commit(ROBOT.adopting(OTHERS, NOW))._replace(peer="r2", heard=Instant(seconds(9))))
    log.take(commit(ROBOT.sent_to(THERE), adaptation=False))  # not a decision of the adaptation
    log.take(commit(replace(ROBOT, blocked_for=2)))
    by, goals = "AdaptiveCleaningRobot.auto_unblock", ((1.0, 2.0), (5.0, 2.0))
    assert log.report().decisions == [
        AdaptationDecision(NOW, by, "takes over r2/3", "r2", seconds(1), *goals)
    ]


def test_every_kind_of_decision_has_a_description() -> None:
    both = ROBOT.adopting(OTHERS, NOW)
    cases = {
        "changes destination": (ROBOT, ROBOT.sent_to(THERE)),
        "stops": (ROBOT, replace(ROBOT, destination=None, attempt=1)),
        "hands over r2/3": (both, both.without({OTHERS.key}, settled=False)),
        "gives up r2/3": (both, both.without({OTHERS.key}, settled=True)),
        "": (ROBOT, replace(ROBOT, blocked_for=3)),
    }
    for words, (before, after) in cases.items():
        assert after.decided_since(before) == words


def test_blocked_intervals_are_logged_and_the_last_may_be_open() -> None:
    log, blocked = DecisionLog(ROBOT), replace(ROBOT, state=State.BLOCKED)
    for at_s, robot in ((1, ROBOT), (4, blocked), (5, blocked), (7, ROBOT), (9, blocked)):
        log.take(commit(robot, at=Instant(seconds(at_s))))
    assert log.report().blocked == [(seconds(4), seconds(7)), (seconds(9), None)]


def test_the_list_is_bounded_and_counts_omitted_decisions() -> None:
    log = DecisionLog(ROBOT)
    for _ in range(1002):
        log.take(commit(ROBOT.sent_to(THERE)))
    assert len(log.report().decisions) == 1000 and log.report().decisions_unlisted == 2


@component
class RobotWithOutcome(CleaningRobot):
    def outcome(self) -> dict[str, object]:
        return {"held": len(self.route), "deeco": "not mine"}


def test_a_component_may_have_an_outcome() -> None:
    made = host(START, RobotWithOutcome(id="r1", position=START.pose.point, route=assignments(START)))
    told = made.outcome()  # type: ignore[attr-defined]
    assert told["held"] == 2 and list(told) == ["held", "deeco", "adaptation"]
    assert told["deeco"].counters
