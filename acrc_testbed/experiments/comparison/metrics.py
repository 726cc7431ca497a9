"""What a run is judged by: one number each, of which it is known whether more or less is better."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from acrc_testbed.results.outcome import means
from acrc_testbed.results.result import RunResult


class JudgedRun(msgspec.Struct, frozen=True):
    """What a verdict needs to know of a run; a run that failed has done nothing by its end."""

    places_done: int = 0
    places_total: int = 0
    completion_s: float | None = None
    settled_s: float | None = None
    simulated_s: float = 0.0
    contacts: float = math.nan
    """NaN: unknown, as the next two."""
    radio: float = math.nan
    """Octets on the air per robot and s."""
    driven_m: float = math.nan
    """By all robots."""
    failed: bool = False
    outcomes: dict[str, float] = {}
    """The strategy's own results, each the mean over robots."""


FAILED: Final = JudgedRun(failed=True)


def judged(run: RunResult | None) -> JudgedRun:
    """What a run came to; None: it failed."""
    if run is None:
        return FAILED
    names = (
        "places_done",
        "places_total",
        "completion_s",
        "settled_s",
        "simulated_s",
        "contacts",
        "driven_m",
    )
    known = {name: value for name in names if (value := getattr(run, name)) is not None}
    return JudgedRun(**known, radio=run.radio_bytes_per_robot_s, outcomes=means(run.outcome))


@dataclass(frozen=True)
class Metric:
    """One number of a run, of which the mean over runs is told."""

    name: str
    says: str
    """What it is."""
    unit: str
    value: Callable[[JudgedRun], float]
    """NaN: unknown of this run."""
    more_is_better: bool


@dataclass(frozen=True)
class TimeMetric:
    """When something was the case, if it was by the run's end; the mean over runs is restricted to that."""

    name: str
    says: str
    event: str
    """What a run is once it is the case."""
    at: Callable[[JudgedRun], float | None]
    """s; None: not by the end."""
    unit: str = "s"


PLACES: Final = Metric("places", "places done", "places", lambda run: float(run.places_done), True)
METRICS: Final = (
    PLACES,
    Metric("contacts", "contacts", "contacts", lambda run: run.contacts, False),
    Metric("radio", "octets on the air per robot and second", "octets/s", lambda run: run.radio, False),
    Metric("driven", "metres driven by all robots", "m", lambda run: run.driven_m, False),
)
SETTLED: Final = TimeMetric("settled", "running time", "done or given up", lambda run: run.settled_s)
TIMES: Final = (SETTLED, TimeMetric("completion", "time to complete", "done", lambda run: run.completion_s))
"""`last_reached_s` is none of them: it rewards a run that gives up early."""
LEXICOGRAPHIC: Final = "lexicographic"
"""The order of docs/model-problem.md: more places done, and of as many the shorter running time."""
NAMES: Final = (*(one.name for one in METRICS), *(one.name for one in TIMES), LEXICOGRAPHIC)
ORDER: Final = (PLACES.name, *(one.name for one in TIMES), LEXICOGRAPHIC, *(one.name for one in METRICS[1:]))
"""In which metrics are shown: the chapter's first, then what it costs."""
_BY_NAME: Final = {one.name: one for one in (*METRICS, *TIMES)}
_OWN: Final = "outcome."
"""Prefix of a result of the strategy's own."""
CHOICE: Final = f"one of {', '.join(NAMES)} or {_OWN}NAME, of a strategy's own result"


def is_metric(name: str) -> bool:
    """Return whether runs can be compared by the metric of this name."""
    return name in NAMES or (name.startswith(_OWN) and name != _OWN)


def named(name: str) -> Metric | TimeMetric:
    """Return the metric of this name; of a strategy's own result, `outcome.NAME`, more counts as better."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    own = name.removeprefix(_OWN)
    return Metric(name, name, "", lambda run: run.outcomes.get(own, math.nan), more_is_better=True)


def horizon(runs: Sequence[JudgedRun]) -> float:
    """Until when these runs of one scenario were watched, s; a run ends sooner once nothing is left to do."""
    return max((run.simulated_s for run in runs), default=0.0)


def values(metric: Metric | TimeMetric, runs: Sequence[JudgedRun], until: float) -> list[float]:
    """A number for each run; of times the horizon `until` where it was not the case by then."""
    if isinstance(metric, Metric):
        return [metric.value(run) for run in runs]
    times = (metric.at(run) for run in runs)
    return [until if at is None else min(at, until) for at in times]


def ranks(runs: Sequence[JudgedRun]) -> list[float]:
    """The place of each run in the lexicographic order, equal for equal ones; more is better."""
    keys = [
        (run.places_done, -math.inf if run.settled_s is None else -run.settled_s, not run.failed)
        for run in runs
    ]
    order = {key: float(place) for place, key in enumerate(sorted(set(keys)))}
    return [order[key] for key in keys]
