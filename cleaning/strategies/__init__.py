"""Shipped strategies, one per module with idea, source, limits and settings; and their registry."""

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
