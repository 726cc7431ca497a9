"""Rules of relaying side by side: what they have robots send and hear, and how old what robots know is."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean
from typing import Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

import deeco.node
from actors.console import screen
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError, wrong_value
from actors.robot.behaviour.ports import EVERYBODY_DBM
from benchmarks.statistics.measured import ConfidenceInterval, Measured, average
from benchmarks.statistics.runs import in_memory, in_order
from deeco.instant import Instant, seconds
from deeco.knowledge import Knowledge
from deeco.replication.network import Network
from deeco.replication.packet import Version
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario
from observation.results.result import RunResult

WARM_UP_S: Final = 10.0
"""Before it no age is sampled: nobody knows of anybody at first."""
OLD_S: Final = 5.0
"""What is older is of no more use to who wants to know where others are; own choice."""
UNKNOWN_S: Final = 10.0
"""A robot that is not known counts as known of so long ago, and one known of longer ago, too; own choice."""


@dataclass(frozen=True)
class RelayTask:
    """One run."""

    scenario: Path
    robots: int
    seed: int
    duration: float
    """s."""
    below_dbm: float
    """The rule: who hears more strongly does not relay."""


@dataclass(frozen=True)
class RelayFigures:
    """What came of it. Ages are samples: each pair of robots, at each publication of the one that knows."""

    robots: int
    seed: int
    below_dbm: float
    relays: float
    """Per publication."""
    frames: float
    """Sent, per robot and second."""
    packets: float
    """Heard, per robot and second."""
    packets_old: float
    """Of these, no newer than what was known."""
    age_s: float
    """Mean time since what is known was published, of those that are known."""
    age_95_s: float
    """What 95 % of these do not exceed."""
    capped_age_s: float
    """Mean over all pairs, each at most UNKNOWN_S, as also who is not known."""
    old: float
    """Share of all pairs that are not known or older than OLD_S."""
    digest: str


@dataclass
class _Watch:
    """When each version was published, and how old what nodes know of each other is."""

    robots: int
    published: dict[tuple[str, Version], Instant] = field(default_factory=dict)
    ages_us: list[int] = field(default_factory=list)
    unknown: int = 0

    def sample(self, network: Network, now: Instant) -> None:
        known = [now - self.published[replica.id, replica.version] for replica in network.replicas]
        self.ages_us += known
        self.unknown += self.robots - 1 - len(known)


def relay_scenario(task: RelayTask) -> Scenario:
    """The scenario with its relays by the task's rule. Raises AcrcError and OptionError."""
    overrides = Overrides(robots=task.robots, seed=task.seed, duration=task.duration)
    plain = load_scenario(task.scenario, overrides)
    rule = {"relay": True, "relay_below": task.below_dbm}
    return plain.model_copy(update={"deeco": plain.deeco.model_copy(update=rule)})


def examine(task: RelayTask) -> RelayFigures:
    """Run in memory, and sample. Raises OptionError if the scenario's robots publish nothing."""
    watch = _Watch(task.robots)
    with (
        patch.object(deeco.node, "Network", _watched(watch)),
        in_memory(relay_scenario(task)) as (_, result),
    ):
        pass
    if not watch.ages_us:
        raise OptionError(f"{task.scenario}: its robots know nothing of each other; they should talk")
    return _sampled(task, watch, result)


def _watched(watch: _Watch) -> type[Network]:
    class WatchedNetwork(Network):
        def publish(self, now: Instant, knowledge: Sequence[Knowledge]) -> None:
            first = self._publications + 1
            super().publish(now, knowledge)
            for counter, value in enumerate(knowledge, first):
                watch.published[value.id, Version(self._epoch, counter)] = now
            if now >= seconds(WARM_UP_S):
                watch.sample(self, now)

    return WatchedNetwork


def _sampled(task: RelayTask, watch: _Watch, result: RunResult) -> RelayFigures:
    counters = result.deeco.counters
    robot_s = task.robots * result.simulated_s
    ages: NDArray[np.float64] = np.array(watch.ages_us) / seconds(1)
    pairs = len(ages) + watch.unknown
    return RelayFigures(
        task.robots,
        task.seed,
        task.below_dbm,
        relays=counters["relayed"] / counters["published"],
        frames=counters["frames"] / robot_s,
        packets=counters["packets"] / robot_s,
        packets_old=counters["packets_old"] / robot_s,
        age_s=float(ages.mean()),
        age_95_s=float(np.quantile(ages, 0.95)),
        capped_age_s=(float(np.minimum(ages, UNKNOWN_S).sum()) + UNKNOWN_S * watch.unknown) / pairs,
        old=(int((ages > OLD_S).sum()) + watch.unknown) / pairs,
        digest=result.digest,
    )


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
    screen(stderr=True).print(f"{len(tasks)} runs …")
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


def _percent(change: ConfidenceInterval) -> str:
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
