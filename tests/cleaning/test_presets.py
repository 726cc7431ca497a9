"""The shipped strategies: what they are made of, and what a scenario may set in them."""

from dataclasses import fields, replace

import pytest

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Heard
from actors.randomness import generator
from actors.robot.behaviour import AbortReason, Goal, GoalStatus, Setting, Start, View
from actors.robot.behaviour.entry import load_behaviour
from cleaning.parameters import AdaptationParameters, CleaningParameters, ReleasedParameters, Unblock
from cleaning.place import RESTART_TERM, Assignment, assignments
from cleaning.settings import SettingsError, from_settings
from cleaning.strategies import STRATEGIES, StrategyError, entry

START = Start(
    "r1", 1, 0, Pose(1.0, 2.0, 0.0), (Point(5.0, 0.0), Point(9.0, 0.0)), generator(3, "behaviour", "r1", 0)
)


@pytest.mark.parametrize("name", STRATEGIES)
def test_each_shipped_strategy_can_be_made_and_says_in_a_line_what_it_does(name: str) -> None:
    load_behaviour(entry(name), START)
    module, function = STRATEGIES[name].split(":")
    made = getattr(__import__(module, fromlist=[function]), function)
    first = made.__doc__.splitlines()[0]
    assert first.endswith(".") and len(first) < 110


def test_the_presets_differ_in_what_text_and_code_differ_in() -> None:
    text, code = AdaptationParameters(), ReleasedParameters()
    differing = {
        one.name: (getattr(text, one.name), getattr(code, one.name))
        for one in fields(text)
        if getattr(text, one.name) != getattr(code, one.name)
    }
    assert differing == {
        "retry": (True, False),
        "unblock": (Unblock.QUEUE, Unblock.FLOOR),
        "recount": (True, False),
        "adoption_distance": (1.5, 3.0),
        "exchange": (True, False),
    }


@pytest.mark.parametrize(
    ("kind", "settings", "sentence"),
    [
        (CleaningParameters, {"reach": 0}, "strategy.reach is 0, but must be above 0"),
        (
            AdaptationParameters,
            {"adoption_backoff": -1},
            "strategy.adoption_backoff is -1, but must be at least 0",
        ),
        (AdaptationParameters, {"most_adopted": 65}, "strategy.most_adopted is 65, but must be from 1 to 64"),
        (AdaptationParameters, {"unblock": "x"}, 'strategy.unblock is "x", but must be "queue" or "floor"'),
        (
            ReleasedParameters,
            {"no_plan_attempts": 2},
            "strategy.no_plan_attempts is 2, but must be 0 or 1 without retry",
        ),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_said_in_a_sentence(
    kind: type[CleaningParameters], settings: dict[str, Setting], sentence: str
) -> None:
    with pytest.raises(SettingsError) as caught:
        from_settings(kind, settings)
    assert str(caught.value) == sentence


def test_a_restarted_robot_takes_its_places_anew_with_a_word_later_than_all_before() -> None:
    assert assignments(START) == (
        Assignment("r1", 0, Point(5.0, 0.0), 0),
        Assignment("r1", 1, Point(9.0, 0.0), 0),
    )
    assert [assignment.term for assignment in assignments(replace(START, epoch=2))] == [2 * RESTART_TERM] * 2
    a_day_of_exchanges = 24 * 3600 // 3
    assert a_day_of_exchanges < RESTART_TERM


@pytest.mark.parametrize("name", ["none", "none-original", "none-giving-up", "random"])
def test_the_baselines_differ_in_what_follows_once_navigation_has_given_up(name: str) -> None:
    """Ten times in a row, and every two seconds they see it."""
    hosted, start = load_behaviour(entry(name), START), Pose(1.0, 2.0, 0.0)
    orders, given_up = 0, 0
    goal: Goal | None = None
    for step in range(500):
        view = View(Instant(step * 100_000), start, False, goal, ())
        decision = hosted.advance(view, Instant((step + 1) * 100_000))
        if isinstance(decision.goal, Point):
            orders += 1
            goal = Goal(decision.goal, GoalStatus.ABORTED, AbortReason.BLOCKED)
        given_up += len(decision.given_up)
    expected = {"none": (25, 0), "none-original": (1, 0), "none-giving-up": (20, 2), "random": (25, 0)}
    assert (orders, given_up) == expected[name]


def test_a_mute_robot_sends_nothing_and_hears_nothing() -> None:
    loud, mute = (load_behaviour(entry(name), START) for name in ("chapter", "chapter-mute"))
    view, until = View(Instant(0), Pose(1.0, 2.0, 0.0), False, None, ()), Instant(2_000_000)
    frames = loud.advance(view, until).frames
    assert frames and not mute.advance(view, until).frames
    heard = tuple(Heard(1_000_000, 7, -60.0, 200, frame.data) for frame in frames)
    later = view._replace(instant=until, radio=heard)
    assert mute.advance(later, Instant(3_000_000)).frames == ()


def test_who_gives_up_in_the_chapters_way_does_so_after_some_attempts() -> None:
    chosen = load_behaviour(entry("chapter-giving-up"), START)
    assert chosen._component.parameters.attempts == 5  # type: ignore[attr-defined]
    made = load_behaviour(entry("make-way"), START)
    assert made._component.parameters.make_way  # type: ignore[attr-defined]


def test_a_strategy_is_known_by_its_name_or_by_its_own_entry() -> None:
    assert entry("none") == "cleaning.strategies.none:behaviour"
    assert entry("my_study.adoption:behaviour") == "my_study.adoption:behaviour"


def test_an_unknown_strategy_is_one_sentence() -> None:
    with pytest.raises(StrategyError) as caught:
        entry("barter")
    assert str(caught.value) == (
        f"strategy 'barter' is not known; it should be one of {', '.join(sorted(STRATEGIES))},"
        " or the entry 'module:function' of your own"
    )
