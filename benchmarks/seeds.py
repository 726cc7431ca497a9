"""What comes of the shipped scenario from one seed to the next: places done, when, and contacts."""

import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from deploy import swarm
from deploy.options import RunOptions
from deploy.scenario_file import Overrides, load_scenario

ROBOTS: Final = (1, 4)
SEEDS: Final = 10


@dataclass(frozen=True)
class Outcome:
    """One run."""

    robots: int
    seed: int
    places_done: int
    places_total: int
    completion_s: float | None
    """When the last place was reported, simulated s; None if not all are done."""
    contacts: int
    digest: str

    @property
    def complete(self) -> bool:
        """True if every place is done."""
        return self.completion_s is not None


def run(
    robots: Sequence[int] = ROBOTS,
    seeds: int = SEEDS,
    json_output: bool = False,
    duration: float | None = None,
) -> list[Outcome]:
    """Run the shipped scenario in memory from each of the seeds 1 to `seeds`; print and give what came of it.

    `duration`: simulated s of each run; None: as in the scenario.
    """
    console = Console(stderr=True)
    outcomes = []
    for count in robots:
        console.print(f"robots {count}, seeds 1 to {seeds} …", highlight=False)
        outcomes += [_outcome(count, seed, duration) for seed in range(1, seeds + 1)]
    if json_output:
        sys.stdout.write(json.dumps([asdict(outcome) for outcome in outcomes]) + "\n")
    else:
        _print(outcomes)
    return outcomes


def _outcome(robots: int, seed: int, duration: float | None) -> Outcome:
    scenario = load_scenario(None, Overrides(robots=robots, seed=seed, duration=duration))
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        plan = swarm.plan(scenario, RunOptions(Path(folder) / "out", bus="memory", json=True))
        result = swarm.run_in_memory(plan, lambda progress: None)
    return Outcome(
        robots,
        seed,
        result.places_done,
        result.places_total,
        result.completion_s,
        result.contacts,
        result.digest,
    )


def _print(outcomes: Sequence[Outcome]) -> None:
    table = Table("robots", "seed", "places", "done at", "contacts", title="The shipped scenario, by seed")
    for before, outcome in zip((None, *outcomes), outcomes, strict=False):
        if before is not None and before.robots != outcome.robots:
            table.add_section()
        table.add_row(
            str(outcome.robots),
            str(outcome.seed),
            f"{outcome.places_done} of {outcome.places_total}",
            "not all" if outcome.completion_s is None else f"{outcome.completion_s:.1f} s",
            str(outcome.contacts),
        )
    console = Console()
    console.print(table)
    for count in dict.fromkeys(outcome.robots for outcome in outcomes):
        runs = [outcome for outcome in outcomes if outcome.robots == count]
        console.print(_summary(count, runs), highlight=False, soft_wrap=True)


def _summary(robots: int, runs: Sequence[Outcome]) -> str:
    """What all runs with so many robots come to; for one robot, beside the goal."""
    complete = sum(one.complete for one in runs)
    done, total = sum(one.places_done for one in runs), sum(one.places_total for one in runs)
    contacts = sum(one.contacts for one in runs)
    sentence = (
        f"robots {robots}: all places in {complete} of {len(runs)} seeds,"
        f" {done} of {total} places, {contacts} contacts"
    )
    if robots > 1:
        return sentence
    return f"{sentence}; goal, all places in every seed: {'met' if complete == len(runs) else 'MISSED'}"
