"""Seeds of tests that show the same for each: a few every day, all of them at night."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sampled(seeds: Iterable[int], every_day: Collection[int]) -> Any:
    """The seeds as parameters, of which those that are not for `every_day` are left to the night."""
    return [pytest.param(seed, marks=() if seed in every_day else pytest.mark.nightly) for seed in seeds]
