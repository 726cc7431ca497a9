"""What a run is judged by: one number each, of which it is known whether more or less is better."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from observation.results.result import RunResult


@dataclass(frozen=True)
class Metric:
    """One number of a run."""

    name: str
    says: str
    """What it is, with its unit."""
    value: Callable[[RunResult], float]
    """NaN: unknown of this run."""
    more_is_better: bool


@dataclass(frozen=True)
class TimeMetric:
    """When something was the case, if it was by the run's end."""

    name: str
    says: str
    at: Callable[[RunResult], float | None]
    """s; None: not by the end."""


def _driven(run: RunResult) -> float:
    return math.nan if run.driven_m is None else run.driven_m


PLACES: Final = Metric("places", "places done", lambda run: float(run.places_done), more_is_better=True)
METRICS: Final = (
    PLACES,
    Metric("contacts", "contacts", lambda run: float(run.contacts), more_is_better=False),
    Metric(
        "radio",
        "octets on the air per robot and second",
        lambda run: run.radio_bytes_per_robot_s,
        more_is_better=False,
    ),
    Metric("driven", "metres driven by all robots", _driven, more_is_better=False),
)
TIMES: Final = (
    TimeMetric("completion", "time until all places are done, s", lambda run: run.completion_s),
    TimeMetric("settled", "time until all places are done or given up, s", lambda run: run.settled_s),
)
"""`last_reached_s` is none of them: it rewards a run that gives up early."""
LEXICOGRAPHIC: Final = "lexicographic"
"""Our own order of runs: more places done, and of as many the earlier completion."""


NAMES: Final = (*(one.name for one in METRICS), *(one.name for one in TIMES), LEXICOGRAPHIC)


def lexicographic_key(run: RunResult) -> tuple[int, float]:
    """Greater is better."""
    return run.places_done, -run.completion_s if run.completion_s is not None else -run.simulated_s
