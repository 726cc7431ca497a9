"""Metrics by which strategies are compared: of the task, of every task, and functions of a study."""

import importlib
import math
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from msgspec import Meta

from acrc_testbed.results.outcome import outcome_means
from acrc_testbed.results.result import RunResult
from actors.installation.usage import missing_extra_named, wrong_value
from actors.runtime.errors import AcrcError
from actors.settings import Settings, Text
from actors.task.task import Metric, TaskDeclaration

if TYPE_CHECKING:
    import pyarrow

Run = RunResult | None
"""Result of a run; None: failed."""
LEXICOGRAPHIC: Final = "lexicographic"
"""Name of the order of metrics by rank; a later one counts if all earlier ones are equal."""
COMMON: Final = (
    Metric("contacts", "contacts", "contacts", "contacts", "less"),
    Metric("people_contacts", "contacts with people", "contacts", "people_contacts", "less"),
    Metric("people_contact_s", "time in contact with people", "s", "people_contact_s", "less"),
    Metric("radio", "octets on the air per robot and second", "octets/s", "radio_bytes_per_robot_s", "less"),
    Metric("driven", "metres driven by all robots", "m", "driven_m", "less"),
    Metric("energy", "energy used by all robots", "J", "energy_j", "less"),
)
"""Metrics of every task."""
_OUTCOME: Final = "outcome"
"""Prefix of values returned by a strategy's outcome()."""
OWN: Final = "metrics"
"""Prefix of the columns of a study's own metrics."""
LEAN_TABLES: Final = ("poses", "people", "outcomes")
"""Tables that every recording has, besides that of the task's items."""
FULL_TABLES: Final = ("estimates", "goals", "frames", "knowledge", "exchanges", "decisions")
"""Tables of full recordings only."""


class MetricTable(Settings, frozen=True):
    """[[metric]]: a function over the tables of a run, as a metric of the study."""

    name: Annotated[
        str, Meta(pattern="^[a-z][a-z0-9_]{0,39}$", description='a name of a-z, 0-9 and _, such as "idle"')
    ]
    use: Annotated[
        str,
        Meta(pattern=r"^\w+(\.\w+)*:\w+$", description='a function, such as "package.module:function"'),
    ]
    better: Literal["more", "less"]
    description: Text | None = None
    """Default: the name."""
    unit: Annotated[str, Meta(max_length=20)] = ""
    event: Text | None = None
    """As in `Metric`."""
    worst: Annotated[float, Meta(ge=-1e15, le=1e15)] | None = None
    """As in `Metric`."""
    margin: Annotated[float, Meta(gt=0, le=1e15)] | None = None
    """As in `Metric`."""
    tables: Annotated[tuple[Text, ...], Meta(max_length=20)] = ()
    """Tables of docs/tables.md that the function reads; empty: all that every recording has."""

    def metric(self) -> Metric:
        """Return the declaration, in the form of the shipped metrics."""
        return Metric(
            self.name, self.description or self.name, self.unit, f"{OWN}.{self.name}", self.better,
            self.event or "", worst=self.worst, margin=self.margin,
        )  # fmt: skip


def task_metrics(task: TaskDeclaration) -> dict[str, Metric]:
    """Return the metrics of a task and those of every task by name, in order of display."""
    order = Metric(LEXICOGRAPHIC, ", then ".join(one.description for one in by_rank(task.metrics)), "", "")
    return {one.name: one for one in (*task.metrics, order, *COMMON)}


def check_names(tables: Sequence[MetricTable], task: TaskDeclaration) -> None:
    """Raise AcrcError for the name of another metric, and for a table that no run of the task has."""
    taken, known = {*task_metrics(task)}, (*LEAN_TABLES, task.table, *FULL_TABLES)
    for index, table in enumerate(tables):
        if table.name in taken:
            raise AcrcError(f"metric[{index}].name: {table.name!r} is the name of another metric; rename it")
        taken.add(table.name)
        if missing := next((name for name in table.tables if name not in known), None):
            raise AcrcError(f"metric[{index}].tables: {missing!r} must be one of {', '.join(known)}")


def needs_full_recording(tables: Iterable[MetricTable]) -> bool:
    """Return whether a function reads a table that lean recordings lack."""
    return any({*one.tables}.intersection(FULL_TABLES) for one in tables)


def find_metric(name: str, metrics: Mapping[str, Metric]) -> Metric | None:
    """Return the metric of this name; None if unknown. For `outcome.NAME`, more is better."""
    is_outcome = name.startswith(f"{_OUTCOME}.") and name != f"{_OUTCOME}."
    return metrics.get(name) or (Metric(name, name, "", name) if is_outcome else None)


def choice(metrics: Iterable[str]) -> str:
    """Return the valid names as text, which continues "must be"."""
    return f"one of {', '.join(metrics)} or {_OUTCOME}.NAME, a value returned by outcome()"


def chosen_metric(option: str, name: str | None, metrics: Mapping[str, Metric]) -> Metric | None:
    """Return the metric given by an option; None if not given. Raises OptionError."""
    if name is None:
        return None
    found = find_metric(name, metrics)
    if found is None:
        raise wrong_value(option, name, choice(metrics))
    return found


def by_rank(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    """Return the metrics that decide a comparison, in order."""
    ranked = (one for one in metrics if one.rank is not None)
    return tuple(sorted(ranked, key=lambda one: one.rank or 0))


def value_of(metric: Metric, run: RunResult) -> float | None:
    """Return the value of a run; None for an event that did not happen, NaN if unknown."""
    found = _cell(metric.column, run)
    if found is None and metric.event:
        return None
    return float(found) if isinstance(found, int | float) else math.nan


def known_values(metric: Metric, runs: Iterable[RunResult]) -> list[float]:
    """Return the values of the runs in which they are known; without events that did not happen."""
    found = (value_of(metric, run) for run in runs)
    return [value for value in found if value is not None and not math.isnan(value)]


def total_of(metric: Metric, run: RunResult) -> float | None:
    """Return the largest possible value of a run; None: there is none, or it is unknown."""
    found = _cell(metric.total, run) if metric.total else None
    return float(found) if isinstance(found, int | float) else None


def is_full(metric: Metric, run: RunResult) -> bool:
    """Return whether the value of a run is the largest possible one."""
    total = total_of(metric, run)
    return total is not None and value_of(metric, run) == total


def _cell(column: str, run: RunResult) -> Any:
    """Return a field of the result, a value in one of its tables, or else a value of the task."""
    head, _, key = column.partition(".")
    if head not in run.__struct_fields__:
        return run.task.get(column, math.nan)
    found: Any = getattr(run, head)
    return (outcome_means(found) if head == _OUTCOME else found or {}).get(key, math.nan) if key else found


def values(metric: Metric, runs: Iterable[Run], until: float) -> list[float]:
    """Return a value for each run, NaN if unknown; times of events are capped at the horizon `until`."""
    worst = metric.worst
    if worst is None:
        worst = math.nan if not metric.event else until if metric.better == "less" else 0.0
    found = (worst if run is None else value_of(metric, run) for run in runs)
    if not metric.event:
        until = math.inf
    return [until if value is None else min(value, until) for value in found]


def ranks(runs: Sequence[Run], steps: Sequence[Metric]) -> list[float]:
    """Return the rank of each run in the lexicographic order of metrics, with ties; more is better."""
    gains = [[_gain(value, one) for value in values(one, runs, math.inf)] for one in steps]
    keys = list(zip(*gains, (run is not None for run in runs), strict=True))
    order = {key: float(rank) for rank, key in enumerate(sorted(set(keys)))}
    return [order[key] for key in keys]


def _gain(value: float, metric: Metric) -> float:
    if math.isnan(value):
        return -math.inf
    return value if metric.better == "more" else -value


Tables = dict[str, "pyarrow.Table"]
TIME_LIMIT_S: Final = 60.0
"""Time limit of a metric's function for one trial."""


class MetricError(AcrcError):
    """A metric's function that cannot be loaded or returned no number."""


class MetricTimeout(BaseException):
    """Raised in a function beyond the time limit; functions may catch any Exception."""


def load_function(use: str) -> Callable[[Tables], object]:
    """Import the function of an entry `module:function`. Raises MetricError."""
    module, _, name = use.partition(":")
    try:
        function = getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # the module is the user's
        raise MetricError(f"{use} cannot be loaded: {type(error).__name__}: {error}") from error
    if not callable(function):
        raise MetricError(f"{use} is a {type(function).__name__}; must be a function of a run's tables")
    return function  # type: ignore[no-any-return]


def read_tables(out: Path) -> Tables:
    """Return the tables of a run by name. Raises AcrcError without pyarrow."""
    with missing_extra_named():
        from acrc_testbed.export import parquet_files, table_rows

    return parquet_files.arrow_tables(table_rows.tables(out))


def compute(table: MetricTable, tables: Tables) -> float | None:
    """Return a metric of the run with these tables. Raises MetricError, or an error of the function."""
    with _time_limit(table.use):
        named = table.tables or [name for name in tables if name not in FULL_TABLES]
        found = load_function(table.use)({name: tables[name] for name in named})
    value: Any = found.as_py() if hasattr(found, "as_py") else found  # a scalar of pyarrow
    if value is None:
        return None
    if not isinstance(value, Real):
        raise MetricError(f"{table.use} returned a {type(value).__name__}; must be a number or None")
    number = float(value)
    if not math.isfinite(number) or (table.event and number < 0.0):
        right = "a time of at least 0 s" if table.event else "a finite number"
        raise MetricError(f"{table.use} returned {number:g}; must be {right}, or None")
    return number


@contextmanager
def _time_limit(use: str) -> Iterator[None]:
    """Raise MetricError after the time limit, in the main thread."""

    def expire(number: int, frame: FrameType | None) -> None:
        raise MetricTimeout

    before = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, TIME_LIMIT_S, TIME_LIMIT_S)  # again: another thread may take it
    try:
        yield
    except MetricTimeout:
        raise MetricError(f"{use} did not return within {TIME_LIMIT_S:g} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
