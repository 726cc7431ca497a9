"""The numbers behind pictures: spreads, shares with their intervals, and tables of them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from experiments.statistics.effect_size import CONFIDENCE, Interval

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
