"""Strategies by name or by entry string."""

import pytest

from cleaning.strategies import STRATEGIES, StrategyError, entry


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
