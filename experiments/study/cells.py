"""Cells: conditions that a study draws from its random factors, spread evenly over all of them together."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.randomness import generator
from actors.runtime.errors import AcrcError
from experiments.study.study import Variant

_CANDIDATES: Final = 64
"""Latin hypercubes of which the most even one is taken."""
_DIGITS: Final = 9
"""Of a discrepancy: what differs less is equal, whatever the processor makes of the last bits."""
_SPAN_DIGITS: Final = 4
"""Significant ones of a drawn number that is not whole."""


class RandomFactor(NamedTuple):
    """A factor of which a study draws levels: from a list, or from all numbers between two."""

    key: str
    among: tuple[Any, ...] = ()
    """Empty: between."""
    between: tuple[float, float] = (0.0, 0.0)
    """Whole numbers, both included, if both are whole."""

    @property
    def levels(self) -> float:
        """How many there are; infinite of numbers that are not whole."""
        if self.among:
            return len(self.among)
        return self.between[1] - self.between[0] + 1 if _whole(self.between) else math.inf

    def level(self, share: float) -> Any:
        """The level at this share, from 0 to below 1, of all there are."""
        low, high = self.between
        if self.among:
            return self.among[int(share * len(self.among))]
        if _whole(self.between):
            return int(low) + int(share * (int(high) - int(low) + 1))
        return float(f"{low + share * (high - low):.{_SPAN_DIGITS}g}")


def draw_cells(factors: Sequence[RandomFactor], samples: int, seed: int) -> tuple[Variant, ...]:
    """So many different cells: a level of each factor. The same seed gives the same.

    A Latin hypercube (McKay, Beckman and Conover 1979): each factor's levels come up equally often, to one.
    Of several, the one with most different cells, and of these with the lowest centred discrepancy.
    AcrcError if the factors have fewer combinations, or no cube has enough different cells.
    """
    from scipy.stats import qmc  # noqa: PLC0415 - half a second, for studies that have random factors

    combinations = math.prod(factor.levels for factor in factors)
    if samples > combinations:
        raise AcrcError(
            f"samples is {samples}, but the random factors have {combinations:g} combinations; must be at "
            "most that many, and with all of them values = [...] says the same"
        )
    sampler = qmc.LatinHypercube(len(factors), rng=generator(seed, "study", "cells"))
    best: tuple[int, float] | None = None
    cells: tuple[Variant, ...] = ()
    for _ in range(_CANDIDATES):
        points = sampler.random(samples)
        drawn = [_cell(factors, row) for row in points]
        found = tuple({repr(cell): cell for cell in drawn}.values())
        rank = (-len(found), round(float(qmc.discrepancy(points)), _DIGITS))
        if best is None or rank < best:
            best, cells = rank, found
    if len(cells) < samples:
        raise AcrcError(
            f"samples is {samples}, but only {len(cells)} different cells come of random factors with "
            f"{combinations:g} combinations; must be at most {len(cells)}, or the factors have more levels"
        )
    return cells


def _cell(factors: Sequence[RandomFactor], shares: NDArray[np.float64]) -> Variant:
    return tuple((one.key, one.level(float(share))) for one, share in zip(factors, shares, strict=True))


def _whole(between: tuple[float, float]) -> bool:
    return all(isinstance(one, int) for one in between)
