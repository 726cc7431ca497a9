"""The strategies that can be named on the command line."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from actors.runtime.errors import AcrcError

STRATEGIES: Final[Mapping[str, str]] = MappingProxyType({"none": "cleaning.baseline:behaviour"})
"""Entry string of each strategy's behaviour, by the strategy's name; "none" is the naive solution."""


class StrategyError(AcrcError):
    """A strategy that nobody knows."""


def entry(strategy: str) -> str:
    """The entry string of a strategy, given by its name or as an entry string of one's own."""
    if ":" in strategy:
        return strategy
    if strategy not in STRATEGIES:
        raise StrategyError(
            f"strategy {strategy!r} is not known; it should be one of {', '.join(sorted(STRATEGIES))}, "
            "or the entry 'module:function' of your own"
        )
    return STRATEGIES[strategy]
