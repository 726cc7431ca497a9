"""Quantities of a run, for simulated runs and real robots alike; their spreads, and tables of numbers."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from acrc_testbed.experiments.statistics.models import Completion
from acrc_testbed.experiments.statistics.paired_tests import CONFIDENCE, Interval
from acrc_testbed.results.outcome import means
from acrc_testbed.results.result import RobotResult, RunResult
from actors.ieee802154 import airtime_ns

Cell = str | int | float | Interval | None
"""None: unknown, or none."""


@dataclass(frozen=True)
class NumberTable:
    """Numbers as a reader sees them, and as a file of comma-separated values has them."""

    name: str
    """Of its file."""
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    folded: bool = False
    """True: long, and shown when asked for."""


@dataclass(frozen=True)
class BoxSpread:
    """Some values, and what a box shows of them; quartiles by linear interpolation."""

    values: tuple[float, ...]
    least: float
    q1: float
    median: float
    q3: float
    most: float
    mean: float

    @property
    def whiskers(self) -> tuple[float, float]:
        """The last values within one and a half box lengths (Tukey, "Exploratory Data Analysis", 1977)."""
        reach = 1.5 * (self.q3 - self.q1)
        inside = [one for one in self.values if self.q1 - reach <= one <= self.q3 + reach]
        return min(inside), max(inside)


def spread(values: Iterable[float]) -> BoxSpread:
    """Of at least one value."""
    known = tuple(values)
    least, q1, median, q3, most = (float(one) for one in np.quantile(known, [0.0, 0.25, 0.5, 0.75, 1.0]))
    return BoxSpread(known, least, q1, median, q3, most, float(np.mean(known)))


def share(count: int, of: int) -> Interval:
    """A proportion of at least one, with Wilson's 95 % interval."""
    bounds = binomtest(count, of).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(count / of, float(bounds.low), float(bounds.high))


def written(cell: Cell) -> str:
    """As a reader sees it."""
    if cell is None:
        return "n/a"
    if isinstance(cell, Interval):
        if math.isnan(cell.low):
            return _number(cell.value, 3)
        return f"{_number(cell.value, 3)} [{_number(cell.low, 3)}, {_number(cell.high, 3)}]"
    return cell if isinstance(cell, str) else _number(cell, 4)


def _number(value: float, digits: int) -> str:
    """So many significant digits, those before the point all."""
    if abs(value) >= 10**digits or value == int(value):
        return f"{value:.0f}"
    return f"{float(f'{value:.{digits}g}'):g}"


def length_s(outcome: RunResult) -> float:
    """How long it was watched, s."""
    return outcome.length_s


def is_watched(outcome: RunResult) -> bool:
    """True if ground truth says which places were done."""
    return outcome.places_done is not None


def places(part: RunResult | RobotResult) -> float:
    """Places done; where nobody watched, those that were reported."""
    return float(part.places_claimed if part.places_done is None else part.places_done)


def completion(outcome: RunResult) -> Completion:
    """When all places were done."""
    return _completion(outcome.completion_s, outcome)


def running(outcome: RunResult) -> Completion:
    """When all places were done or given up."""
    return _completion(outcome.settled_s, outcome)


def robot_completion(outcome: RunResult, robot: str) -> Completion:
    """When all places were done that this robot was given."""
    return _completion(outcome.per_robot[robot].completion_s, outcome)


def octets(outcome: RunResult) -> float:
    """On the air, per robot and s."""
    return outcome.radio_bytes_per_robot_s


def airtime_percent(outcome: RunResult) -> float:
    """The share of its time that a robot sends, on the mean of all of them, %."""
    frames = outcome.frames["frames_sent"]
    if not frames:
        return 0.0
    mean_ns = airtime_ns(0) + (airtime_ns(1) - airtime_ns(0)) * outcome.frames["bytes_sent"] / frames
    return 100.0 * frames * mean_ns / 1e9 / _robot_seconds(outcome)


def own_means(outcome: RunResult) -> dict[str, float]:
    """Return the numbers of the strategy's own outcome by name, each the mean over robots."""
    return means(outcome.outcome)


def cpu_ms(outcome: RunResult) -> float | None:
    """Of all processes of the simulation, CPU ms per robot and simulated s; None for real robots."""
    return 1000.0 * outcome.cpu_s / _robot_seconds(outcome) if outcome.is_simulated else None


def driven_m(outcome: RunResult) -> float | None:
    """How far all robots truly came, m; None where nobody watched."""
    return outcome.driven_m


def age_s(outcome: RunResult) -> float | None:
    """Mean age of what robots know of one another, s."""
    return outcome.deeco.replica_age_mean_s


def contacts(outcome: RunResult) -> float | None:
    """Contacts that began; None where nobody watched."""
    return None if outcome.contacts is None else float(outcome.contacts)


def commit(outcome: RunResult) -> str:
    """Of the software; empty: unknown."""
    return outcome.origin.commit


def _robot_seconds(outcome: RunResult) -> float:
    return max(outcome.robots * length_s(outcome), 1e-9)


def _completion(at: float | None, outcome: RunResult) -> Completion:
    return Completion(length_s(outcome), False) if at is None else Completion(at, True)
