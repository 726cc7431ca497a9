"""What comes of a scenario, by strategy and seed: places done, given up and lost, when, and contacts."""

import json
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

ROBOTS: Final = (1, 4)
SEEDS: Final = 10
STRATEGIES: Final = ("none",)


@dataclass(frozen=True)
class SeedOutcome:
    """One run; the fields from `places_done` to `contacts` are those of its RunResult."""

    strategy: str
    robots: int
    seed: int
    places_total: int
    places_done: int
    places_given_up: int
    places_lost: int
    completion_s: float | None
    settled_s: float | None
    contacts: int
    digest: str

    @property
    def complete(self) -> bool:
        """True if every place is done."""
        return self.completion_s is not None


def run(
    robots: Sequence[int] = (),
    seeds: int = SEEDS,
    json_output: bool = False,
    duration: float | None = None,
    strategies: Sequence[str] = STRATEGIES,
    scenario: Path | None = None,
) -> list[SeedOutcome]:
    """Run a scenario in memory from each of the seeds 1 to `seeds`; print and give what came of it.

    `robots`: numbers of robots; none: as many as the scenario has, or ROBOTS of the shipped one. `duration`:
    simulated s of each run; None: as in the scenario. `scenario`: None: the shipped one.
    """
    robots = robots or ((load_scenario(scenario).robots.count,) if scenario else ROBOTS)
    console = Console(stderr=True)
    outcomes = []
    for strategy in strategies:
        for count in robots:
            console.print(f"strategy {strategy}, robots {count}, seeds 1 to {seeds} …", highlight=False)
            outcomes += [_outcome(scenario, strategy, count, seed, duration) for seed in range(1, seeds + 1)]
    if json_output:
        sys.stdout.write(json.dumps([asdict(outcome) for outcome in outcomes]) + "\n")
    else:
        _print(outcomes)
    return outcomes


def _outcome(
    scenario: Path | None, strategy: str, robots: int, seed: int, duration: float | None
) -> SeedOutcome:
    overrides = Overrides(robots=robots, seed=seed, duration=duration, strategy=strategy)
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus="memory", json=True)
        plan = swarm.plan(load_scenario(scenario, overrides), options)
        result = swarm.run_in_memory(plan, lambda progress: None)
    return SeedOutcome(
        strategy,
        robots,
        seed,
        result.places_total,
        result.places_done,
        result.places_given_up,
        result.places_lost,
        result.completion_s,
        result.settled_s,
        result.contacts,
        result.digest,
    )


def _print(outcomes: Sequence[SeedOutcome]) -> None:
    console = Console()
    for runs in _by_setting(outcomes):
        console.print(_table(runs))
    for runs in _by_setting(outcomes):
        console.print(_summary(runs), highlight=False, soft_wrap=True)


def _table(runs: Sequence[SeedOutcome]) -> Table:
    """One strategy with one number of robots, a row per seed."""
    title = f"strategy {runs[0].strategy}, robots {runs[0].robots}"
    table = Table(
        *("seed", "places done", "given up", "lost", "done at", "settled at", "contacts"), title=title
    )
    for one in runs:
        done = f"{one.places_done} of {one.places_total}"
        numbers = (one.seed, done, one.places_given_up, one.places_lost)
        instants = (_instant(one.completion_s), _instant(one.settled_s))
        table.add_row(*map(str, numbers), *instants, str(one.contacts))
    return table


def _by_setting(outcomes: Iterable[SeedOutcome]) -> Iterable[Sequence[SeedOutcome]]:
    """The runs of each strategy with each number of robots."""
    groups: dict[tuple[str, int], list[SeedOutcome]] = {}
    for outcome in outcomes:
        groups.setdefault((outcome.strategy, outcome.robots), []).append(outcome)
    return groups.values()


def _instant(instant_s: float | None) -> str:
    return "not all" if instant_s is None else f"{instant_s:.1f} s"


def _median(runs: Sequence[SeedOutcome]) -> str:
    """When half of the runs were settled; nothing where fewer ever were, which no median can tell."""
    settled = sorted(one.settled_s for one in runs if one.settled_s is not None)
    half = (len(runs) + 1) // 2
    return f", half of the seeds settled by {settled[half - 1]:.1f} s" if len(settled) >= half else ""


def _summary(runs: Sequence[SeedOutcome]) -> str:
    """What all runs of one strategy with so many robots come to; for one robot, beside the goal."""
    complete = sum(one.complete for one in runs)
    sentence = (
        f"{runs[0].strategy}, robots {runs[0].robots}: all places in {complete} of {len(runs)} seeds,"
        f" {sum(one.places_done for one in runs)} of {sum(one.places_total for one in runs)} places,"
        f" {sum(one.places_given_up for one in runs)} given up, {sum(one.places_lost for one in runs)} lost,"
        f" {sum(one.contacts for one in runs)} contacts{_median(runs)}"
    )
    if runs[0].robots > 1:
        return sentence
    return f"{sentence}; goal, all places in every seed: {'met' if complete == len(runs) else 'MISSED'}"
