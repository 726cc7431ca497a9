"""Which runs are counted, and how what is counted in them is spread over the steps of their robots."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from benchmarks.swarm.task import SwarmTask

ROBOTS: Final = 8
SECONDS: Final = 9.0
"""Simulated, of the longer run."""
_SEED: Final = 1
_STEPS_PER_SECOND: Final = 10
"""Of simulated time, in the scenario."""


def _task(seconds: float) -> SwarmTask:
    return SwarmTask((ROBOTS,), seconds, None, seed=_SEED)


WARM_UP: Final = _task(2.0)


@dataclass(frozen=True)
class CountedSteps:
    """A longer run and one a third as long: the steps between are counted, and no run's beginning or end."""

    seconds: float = SECONDS
    """Simulated, of the longer one."""

    @property
    def tasks(self) -> tuple[SwarmTask, SwarmTask]:
        """The shorter run and the longer one."""
        return _task(self.first_s), _task(self.seconds)

    @property
    def first_s(self) -> float:
        """Where the counted steps begin, simulated s; a whole number of them."""
        return float(self.seconds // 3)

    def per_step(self, short: Mapping[str, float], long: Mapping[str, float]) -> dict[str, float]:
        """What the longer run has more, per robot and step; by name, the greatest first."""
        steps = ROBOTS * (self.seconds - self.first_s) * _STEPS_PER_SECOND
        more = {name: (long.get(name, 0.0) - short.get(name, 0.0)) / steps for name in {**short, **long}}
        return dict(sorted(more.items(), key=lambda one: (-one[1], one[0])))
