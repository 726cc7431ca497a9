"""Rules of relaying side by side: what they have robots send and hear, and how old what robots know is."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import mean
from typing import Final

from rich.console import Console
from rich.table import Table

from actors.installation.repository import SHIPPED
from actors.installation.usage import wrong_value
from actors.robot.behaviour.ports import EVERYBODY_DBM
from benchmarks.statistics.confidence import Interval, average
from benchmarks.statistics.measured import Measured
from benchmarks.statistics.pool import in_order
from benchmarks.swarm.relay_run import OLD_S, UNKNOWN_S, RelayFigures, RelayTask, examine
from deploy.scenario.scenario_file import load_scenario

SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"
ROBOTS: Final = (4, 10, 20, 50, 100)
_LEAST_ROBOTS: Final = 2
_LEAST_S: Final = 15.0
"""Simulated; knowledge is as old as it gets by then."""
BELOW_DBM: Final = (-75.0, -80.0, -82.0, -85.0)


def measure(
    robots: Sequence[int] = ROBOTS,
    duration: float = 20.0,
    below: Sequence[float] = BELOW_DBM,
    seeds: int = 2,
    seed: int = 1,
    scenario: Path = SCENARIO,
) -> Measured:
    """Run the scenario's own rule, everybody's, and each threshold, from so many seeds, `seed` first.

    `duration`: simulated s of each run. `below`: thresholds, dBm.
    """
    if min(robots) < _LEAST_ROBOTS:
        raise wrong_value("--robots", min(robots), f"at least {_LEAST_ROBOTS} for relays")
    if duration < _LEAST_S:
        raise wrong_value("--duration", f"{duration:g}", f"at least {_LEAST_S:g} for relays")
    own_dbm = load_scenario(scenario).deeco.relay_below
    rules = sorted({EVERYBODY_DBM, own_dbm, *below}, reverse=True)
    tasks = [
        RelayTask(scenario, count, one, duration, below_dbm)
        for count in sorted(set(robots), reverse=True)  # those that take longest first
        for one in range(seed, seed + seeds)
        for below_dbm in rules
    ]
    Console(stderr=True).print(f"{len(tasks)} runs …", highlight=False)
    found = list(in_order(examine, tasks))
    of_each = [[one for one in found if one.robots == count] for count in sorted(set(robots))]
    shown: list[Table | str] = [_figures(runs, own_dbm) for runs in of_each]
    changes = [sentence for runs in of_each for sentence in _changes(runs)]
    return Measured([asdict(one) for one in found], [*shown, _LEGEND, *changes])


def _figures(runs: Sequence[RelayFigures], own_dbm: float) -> Table:
    """One number of robots, a row per rule; means over the seeds."""
    title = f"{runs[0].robots} robots, means over {len(_of_each(runs)[EVERYBODY_DBM])} seeds"
    table = Table("relay", *(name for name, *_ in _COLUMNS), title=title, pad_edge=False)
    for below_dbm, of_rule in _of_each(runs).items():
        values = (f"{mean(map(value, of_rule)):.{digits}f}" for _, value, digits in _COLUMNS)
        table.add_row(_name(below_dbm) + " *" * (below_dbm == own_dbm), *values)
    return table


def _changes(runs: Sequence[RelayFigures]) -> Iterator[str]:
    """What each rule changes, seed by seed against everybody's relaying, with 95 % intervals."""
    by_rule = _of_each(runs)
    plain = by_rule.pop(EVERYBODY_DBM)
    for below_dbm, of_rule in by_rule.items():
        pairs = list(zip(of_rule, plain, strict=True))
        relays = average([one.relays / other.relays - 1 for one, other in pairs])
        age = average([one.capped_age_s / other.capped_age_s - 1 for one, other in pairs])
        yield f"{runs[0].robots} robots, {_name(below_dbm)}: relays {_percent(relays)}, age {_percent(age)}"


def _of_each(runs: Sequence[RelayFigures]) -> dict[float, list[RelayFigures]]:
    """By rule, everybody's first."""
    by_rule: dict[float, list[RelayFigures]] = {}
    for one in runs:
        by_rule.setdefault(one.below_dbm, []).append(one)
    return by_rule


def _name(below_dbm: float) -> str:
    return "everybody" if below_dbm == EVERYBODY_DBM else f"≤ {below_dbm:g} dBm"


def _percent(change: Interval) -> str:
    return f"{change.value:+.1%} ({change.low:+.1%} to {change.high:+.1%})"


_COLUMNS: Final[Sequence[tuple[str, Callable[[RelayFigures], float], int]]] = (
    ("relays", lambda one: one.relays, 2),
    ("frames", lambda one: one.frames, 2),
    ("heard", lambda one: one.packets, 1),
    ("old", lambda one: one.packets_old, 1),
    ("age", lambda one: one.age_s, 3),
    ("95 %", lambda one: one.age_95_s, 2),
    ("all", lambda one: one.capped_age_s, 3),
    (f"> {OLD_S:g} s", lambda one: one.old, 3),
)
_LEGEND: Final = (
    "relays per publication; frames sent, packets heard and old ones among them per robot and second; age of"
    f" what is known, s; all: with who is unknown, each at most {UNKNOWN_S:g} s; share unknown or older than"
    f" {OLD_S:g} s; * the scenario's own rule. What a rule changes of relays and of the age of all pairs,"
    " seed by seed against everybody's relaying, with 95 % intervals:"
)
