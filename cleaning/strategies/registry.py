"""Registry of strategies by name."""

import importlib
import importlib.metadata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType, ModuleType
from typing import Final

from actors.robot.behaviour import handover
from actors.robot.behaviour.loading import BehaviourError
from actors.runtime.errors import AcrcError

STRATEGIES: Final = MappingProxyType(
    {
        "none": "cleaning.strategies.none:behaviour",
        "none-original": "cleaning.strategies.none:original",
        "none-giving-up": "cleaning.strategies.none:giving_up",
        "random": "cleaning.strategies.random_order:behaviour",
        "chapter": "cleaning.strategies.chapter:behaviour",
        "chapter-mute": "cleaning.strategies.chapter:mute",
        "chapter-giving-up": "cleaning.strategies.chapter:giving_up",
        "chapter-careful": "cleaning.strategies.careful:behaviour",
        "released": "cleaning.strategies.chapter:released",
        "make-way": "cleaning.strategies.chapter:make_way",
        "tour": "cleaning.strategies.tour:behaviour",
        "swap": "cleaning.strategies.swap:behaviour",
        "lease": "cleaning.strategies.lease:behaviour",
        "auction": "cleaning.strategies.auction:behaviour",
        "offices": "cleaning.strategies.offices:behaviour",
        "oracle": "cleaning.strategies.oracle:behaviour",
        "logistics-greedy": "logistics.strategies.greedy:behaviour",
        "logistics-threshold": "logistics.strategies.threshold:behaviour",
        "logistics-auction": "logistics.strategies.auction:behaviour",
    }
)
"""Entry strings of the shipped strategies by name; "none" is the naive solution."""
GROUP: Final = "acrc.strategies"
"""Entry point group in which an installed distribution registers strategies: name = "module:function"."""
SHIPPED: Final = "shipped"
"""Source of the strategies above."""


class StrategyError(AcrcError):
    """An unknown strategy, or a name used twice."""


@dataclass(frozen=True)
class Strategy:
    """A registered strategy."""

    name: str
    entry: str
    """Entry string `module:function`."""
    source: str
    """Name and version of the distribution that registers it; SHIPPED for those of this project."""
    fault: str = ""
    """Reason why the name cannot be used; empty if it can."""


def entry(strategy: str) -> str:
    """Return the entry string of a strategy given by name or entry string. Raises StrategyError.

    In a sequence such as `none>chapter@60`, all names are replaced.
    """
    try:
        first, turns = handover.split(strategy)
    except BehaviourError as error:
        raise StrategyError(str(error)) from None
    return handover.join(_entry(first), [turn._replace(name=_entry(turn.name)) for turn in turns])


def _entry(strategy: str) -> str:
    if ":" in strategy:
        return strategy
    known = {one.name: one for one in strategies()}
    if strategy not in known:
        raise StrategyError(
            f"unknown strategy {strategy!r}; choose from {', '.join(sorted(known))}, "
            f"or give module:function of your own, such as {strategy.removesuffix('.py')}:behaviour"
        )
    if known[strategy].fault:
        raise StrategyError(f"strategy {known[strategy].fault}")
    return known[strategy].entry


def strategies() -> tuple[Strategy, ...]:
    """Return the shipped strategies and those of installed distributions (entry point group GROUP).

    Names used twice have a `fault`. Imports nothing.
    """
    shipped = [Strategy(name, entry, SHIPPED) for name, entry in STRATEGIES.items()]
    installed = sorted(
        {
            Strategy(point.name, point.value, _title(point.dist))
            for point in importlib.metadata.entry_points(group=GROUP)
        },
        key=lambda one: (one.name, one.source, one.entry),
    )
    everyone = [*shipped, *installed]
    return tuple(replace(one, fault=_conflict(one, everyone)) for one in everyone)


def share(behaviour: str) -> list[ModuleType]:
    """Import the shipped strategies of an entry string or a sequence of them, for forks of this process."""
    entries = [name for name in handover.names(behaviour) if name in STRATEGIES.values()]
    return [importlib.import_module(entry.partition(":")[0]) for entry in entries]


def _title(distribution: importlib.metadata.Distribution | None) -> str:
    if distribution is None:
        return "an unknown distribution"
    return f"{distribution.name} {distribution.version}"


def _conflict(strategy: Strategy, everyone: Sequence[Strategy]) -> str:
    """Return an error if other strategies have the same name; empty if none has."""
    sources = [one.source for one in everyone if one.name == strategy.name]
    if len(sources) == 1:
        return ""
    registered = " and ".join(source for source in sources if source != SHIPPED)
    owned = "is the name of a shipped strategy, but " if SHIPPED in sources else ""
    return f"{strategy.name!r} {owned}is registered by {registered}, too; names must be unique"
