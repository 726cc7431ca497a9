"""One swarm whose nodes relay by a rule: what they sent and heard, and how old what they knew truly was."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import deeco.node
from actors.installation.usage import OptionError
from deeco.instant import Instant, seconds
from deeco.knowledge import Knowledge
from deeco.replication.network import Network
from deeco.replication.packet import Version
from deploy.run import swarm
from deploy.run.options import RunOptions
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
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        plan = swarm.plan(relay_scenario(task), RunOptions(Path(folder) / "out", bus="memory", json=True))
        with patch.object(deeco.node, "Network", _watched(watch)):
            result = swarm.run_in_memory(plan, lambda progress: None)
    if not watch.ages_us:
        raise OptionError(f"{task.scenario}: its robots know nothing of each other; they should talk")
    return _figures(task, watch, result)


def _watched(watch: _Watch) -> type[Network]:
    class Watched(Network):
        def publish(self, now: Instant, knowledge: Sequence[Knowledge]) -> None:
            first = self._publications + 1
            super().publish(now, knowledge)
            for counter, value in enumerate(knowledge, first):
                watch.published[value.id, Version(self._epoch, counter)] = now
            if now >= seconds(WARM_UP_S):
                watch.sample(self, now)

    return Watched


def _figures(task: RelayTask, watch: _Watch, result: RunResult) -> RelayFigures:
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
