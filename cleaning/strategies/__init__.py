"""The strategies, a file each: idea, source, limits, settings; and all their names."""

from cleaning.strategies.registry import (
    GROUP,
    SHIPPED,
    STRATEGIES,
    Strategy,
    StrategyError,
    entry,
    strategies,
)

__all__ = ["GROUP", "SHIPPED", "STRATEGIES", "Strategy", "StrategyError", "entry", "strategies"]
