"""What robots say about their navigation, added up."""

from pathlib import Path

import msgspec
import pytest

from observation.results.outcome import (
    NavigationOutcome,
    OutcomeError,
    navigation_outcome,
    navigation_result,
)

FIRST = NavigationOutcome(
    5, 2, 1, 3, 0, {"blocked": 2, "no plan": 0}, ((0, 500_000, "itself"), (10, 1_000_010, "abort")), 4
)
SECOND = NavigationOutcome(1, 1, 0, 0, 1, {"blocked": 0, "no plan": 1}, ((7, 250_007, "itself"),), 0)


def test_outcomes_add_up() -> None:
    both = navigation_result((FIRST, SECOND))
    assert (both.goals, both.succeeded, both.recoveries, both.retreats) == (6, 3, 3, 1)
    assert both.aborted == {"blocked": 2, "no plan": 1}
    assert both.no_valid_trajectory == {"abort": 1, "itself": 2, "unlisted": 4}
    assert both.no_valid_trajectory_s == pytest.approx(1.75)


def test_without_robots_all_is_nothing() -> None:
    none = navigation_result(())
    assert (none.goals, none.aborted, none.no_valid_trajectory, none.no_valid_trajectory_s) == (
        0,
        {},
        {},
        0.0,
    )


def test_an_outcome_survives_its_record() -> None:
    raw = msgspec.Raw(msgspec.json.encode(FIRST))
    assert navigation_outcome(Path("r1.mcap"), {"navigation": raw}) == FIRST
    assert navigation_outcome(Path("r1.mcap"), {}) is None


def test_another_form_is_refused() -> None:
    with pytest.raises(OutcomeError) as raised:
        navigation_outcome(Path("r1.mcap"), {"navigation": msgspec.Raw(b'{"goals": -1}')})
    assert str(raised.value) == (
        "r1.mcap: the outcome 'navigation' is not that of a robot's navigation: "
        "goals is -1, but must be a whole number of at least 0"
    )
