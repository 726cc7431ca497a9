"""The problem and its cure: the same meeting of two robots, without adaptation and with it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from acrc_testbed.results.result import RunResult
from actors.installation.repository import SHIPPED
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

SCENARIO: Final = SHIPPED / "scenarios" / "head_on.toml"
_STRATEGIES: Final = ("none", "chapter")
_DURATION_S: Final = 150.0
"""Half as long again as it takes with adaptation; without, more time changes nothing."""


class Shown(NamedTuple):
    """One of the runs, by its strategy."""

    strategy: str
    result: RunResult


def demonstrate(options: RunOptions) -> Iterator[Shown]:
    """Run both, each into a folder of its strategy's name in `options.out`. Raises an AcrcError."""
    for strategy in _STRATEGIES:
        scenario = load_scenario(SCENARIO, Overrides(strategy=strategy, duration=_DURATION_S))
        folder = options.out / strategy
        yield Shown(strategy, swarm.run(scenario, replace(options, out=folder, scenario=SCENARIO.name)))


def sentences(shown: Sequence[Shown], taken_over: int, pictures: Sequence[Path]) -> Iterator[str]:
    """What one sees, in three lines; `taken_over`: places, with adaptation."""
    without, adapted = (one.result for one in shown)
    yield (
        f"Without adaptation: {_cleaned(without)} by {without.simulated_s:g} s. One robot wants out of the "
        "office, one wants in, and neither gives way."
    )
    yield (
        f"With the chapter's adaptation: {_cleaned(adapted)} by {adapted.simulated_s:g} s. Who is blocked "
        f"tells the other by radio, and they exchange where they go: {taken_over} places changed hands."
    )
    yield f"Both side by side: {', '.join(map(str, pictures))}"


def _cleaned(result: RunResult) -> str:
    return f"{result.places_done} of {result.places_total} places are clean"
