"""Runs of a report grouped by condition and strategy, and writers of its pictures and tables."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from matplotlib.figure import Figure

from acrc_testbed.experiments.evaluation import CampaignEvaluation, evaluate
from acrc_testbed.experiments.metrics import value_of
from acrc_testbed.experiments.paired_tests import Interval
from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.charts import SeriesStyle
from acrc_testbed.experiments.statistical_models import Completion
from acrc_testbed.experiments.store import Store, is_campaign, load_store
from acrc_testbed.experiments.study import Study, variant_text
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.explanation.time_spent import TimeSpent
from acrc_testbed.picture.html_page import PagePicture, PageTable
from acrc_testbed.results.outcome import csv_text
from acrc_testbed.results.result import RunResult
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.task.task import Metric, TaskDeclaration

T = TypeVar("T")
Cell = str | int | float | Interval | None
"""Cell of a table; None: unknown or not applicable."""
Row = Mapping[str, Cell]
"""Row of a table, by column."""
REAL: Final = "real robots"
"""Condition of field trials."""
UPPER_BOUNDS: Final = frozenset({"oracle"})
"""Strategies that use information that robots do not have."""
_RESULTS: Final = ("run.json", "result/run.json")
"""Possible paths of a run's result; the second is that of emulated devices."""


@dataclass(frozen=True)
class RunSource:
    """One folder: a campaign, a run or a field trial."""

    name: str
    records: tuple[TrialRecord, ...]
    conditions: tuple[str, ...]
    """Condition of each record; runs of a condition are compared."""
    store: Store | None = None
    """None: a single run."""
    evaluation: CampaignEvaluation | None = None

    @property
    def study(self) -> Study | None:
        """Study of a campaign; None for a single run."""
        return None if self.store is None else self.store.study

    @property
    def task(self) -> TaskDeclaration:
        """Task of the runs."""
        if self.study is not None:
            return self.study.task
        (run,) = (record.result for record in self.records if record.result is not None)
        return run.declaration

    @property
    def commit(self) -> str:
        """Commit of the software; empty if unknown."""
        if self.store is not None:
            return self.store.commit
        return "".join(record.result.origin.commit for record in self.records if record.result is not None)


def read_sources(folders: Sequence[Path]) -> tuple[RunSource, ...]:
    """Read the folders, in their order. Raises AcrcError, also for runs of different tasks."""
    several = sum(map(is_campaign, folders)) > 1
    named = zip(folders, _unique_names(folders), strict=True)
    sources = tuple(
        _campaign_source(load_store(folder), name, several=several)
        if is_campaign(folder)
        else _run_source(folder, name)
        for folder, name in named
    )
    for folder, one in zip(folders, sources, strict=True):
        if one.task.metrics != sources[0].task.metrics:
            raise AcrcError(
                f"{folder}: its runs are of the task {one.task.name}, those of {folders[0]} of "
                f"{sources[0].task.name}; write a report for each task"
            )
    return sources


def _unique_names(folders: Sequence[Path]) -> list[str]:
    """Return unique names of the folders, numbered if necessary."""
    found: list[str] = []
    for folder in folders:
        name = folder.resolve().name
        tries = (name if number == 1 else f"{name}-{number}" for number in itertools.count(1))
        found.append(next(one for one in tries if one not in found))
    return found


def _campaign_source(store: Store, name: str, *, several: bool) -> RunSource:
    records = tuple(store.records())
    variants = (variant_text(one.variant.items()) for one in records)
    conditions = tuple(
        ": ".join(filter(None, (name if several else "", variant))) or store.study.name
        for variant in variants
    )
    return RunSource(name, records, conditions, store, evaluate(store))


def _run_source(folder: Path, name: str) -> RunSource:
    path = next((folder / one for one in _RESULTS if (folder / one).is_file()), None)
    if path is None:
        raise AcrcError(
            f"{folder}: contains no campaign and no result of a run; give a folder written by "
            "acrc campaign, acrc run or acrc fleet collect"
        )
    result = typed_json.read(path, RunResult, "result of a run")
    if not result.is_simulated:
        return RunSource(name, (TrialRecord(name, 0, {}, result),), (REAL,))
    origin = result.origin
    condition = f"{origin.scenario or 'one scenario'}, {result.robots} robots, {result.simulated_s:g} s"
    return RunSource(name, (TrialRecord(origin.strategy or name, result.seed, {}, result),), (condition,))


def metric_value(metric: Metric, run: RunResult) -> Completion:
    """Return the value of a run; an event is censored at its end.

    Without ground truth, the value that robots reported; NaN if unknown.
    """
    value = value_of(metric, run)
    if value is not None and math.isnan(value) and metric.reported:
        value = value_of(metric._replace(column=metric.reported), run)
    return Completion(run.length_s, False) if value is None else Completion(value, True)


def is_known(metric: Metric, runs: Iterable[RunResult]) -> bool:
    """Return whether the metric has a value in all runs."""
    return not any(math.isnan(metric_value(metric, run).at) for run in runs)


@dataclass(frozen=True, eq=False)
class Group:
    """Runs with a result of one strategy under one condition; at least one."""

    condition: str
    strategy: str
    records: tuple[TrialRecord, ...]

    @property
    def label(self) -> str:
        """Name of the strategy, marked if it is an upper bound."""
        return strategy_label(self.strategy)

    @property
    def results(self) -> tuple[RunResult, ...]:
        """Results of the runs."""
        return tuple(one.result for one in self.records if one.result is not None)

    @property
    def times(self) -> tuple[TimeSpent, ...]:
        """Times by cause of the runs for which they are known."""
        return tuple(one.time for one in self.records if one.time is not None)


def in_order(names: Iterable[Iterable[str]]) -> list[str]:
    """Return the names of all robots, r2 before r10."""
    return sorted({*itertools.chain.from_iterable(names)}, key=lambda name: (len(name), name))


def strategy_label(strategy: str) -> str:
    """Return a strategy's name, marked if it is an upper bound."""
    return f"{strategy} (upper bound)" if strategy in UPPER_BOUNDS else strategy


class ReportView:
    """All runs with a result, and the folder for pictures and tables."""

    def __init__(self, sources: Iterable[RunSource], out: Path) -> None:
        self.out = out
        sources = list(sources)
        self.task = sources[0].task
        self.metrics = {
            one.name: one.metric() for source in sources if source.study for one in source.study.metric
        }
        """Own metrics of the studies, by name."""
        found: dict[tuple[str, str], list[TrialRecord]] = {}
        for source in sources:
            for condition, record in zip(source.conditions, source.records, strict=True):
                if record.result is not None:
                    found.setdefault((condition, record.strategy), []).append(record)
        conditions = dict.fromkeys(condition for condition, _ in found)
        strategies = dict.fromkeys(strategy for _, strategy in found)
        self.groups = tuple(
            Group(condition, strategy, tuple(found[condition, strategy]))
            for condition in conditions
            for strategy in strategies
            if (condition, strategy) in found
        )
        self.results = tuple(run for group in self.groups for run in group.results)
        self.times = tuple(run for group in self.groups for run in group.times)
        self._looks = {name: charts.series_style(number) for number, name in enumerate(strategies)}
        self.has_conditions = len(conditions) > 1

    def look(self, group: Group) -> SeriesStyle:
        """Return the style of a group's strategy, the same in every picture."""
        return self._looks[group.strategy]

    def row_name(self, group: Group) -> str:
        """Return the group's name, with its condition if there are several."""
        return f"{group.condition}: {group.label}" if self.has_conditions else group.label

    def panels(self, content: Callable[[Group], T | None]) -> dict[str, list[T]]:
        """Return the content of each condition's panel; `content`: item of a group, or None."""
        found: dict[str, list[T]] = {}
        for group in self.groups:
            one = content(group)
            if one is not None:
                found.setdefault(group.condition, []).append(one)
        return found

    def picture(self, name: str, figure: Figure, alt: str, caption: str) -> PagePicture:
        """Write a picture as PNG and SVG, and return it for the page."""
        return PagePicture(charts.save(figure, self.out, name), alt, caption)

    def group_table(
        self, name: str, caption: str, rows: Callable[[Group], Iterable[Row]], *, folded: bool = False
    ) -> PageTable:
        """Write a table with rows of every group, labelled with condition and strategy."""
        head = {group: {"strategy": group.label} for group in self.groups}
        if self.has_conditions:
            head = {group: {"condition": group.condition, **names} for group, names in head.items()}
        labelled = [{**head[group], **row} for group in self.groups for row in rows(group)]
        return self.table(name, caption, labelled, folded=folded)

    def table(self, name: str, caption: str, rows: Iterable[Row], *, folded: bool = False) -> PageTable:
        """Write rows as CSV, unless empty, and return them for the page."""
        records = list(rows)
        if not records:
            return PageTable(caption, (), (), ())
        columns, cells = list(records[0]), [list(row.values()) for row in records]
        regular_file.write_atomically(self.out / f"{name}.csv", _csv(columns, cells).encode())
        numeric = [
            any(not isinstance(cell, str | None) for cell in column) for column in zip(*cells, strict=True)
        ]
        return PageTable(caption, columns, [list(map(_cell_text, row)) for row in cells], numeric, folded)


def _cell_text(cell: Cell) -> str:
    """Return the displayed text of a cell."""
    if cell is None:
        return "n/a"
    if isinstance(cell, Interval):
        if math.isnan(cell.low):
            return _number_text(cell.value, 3)
        return f"{_number_text(cell.value, 3)} [{_number_text(cell.low, 3)}, {_number_text(cell.high, 3)}]"
    return cell if isinstance(cell, str) else _number_text(cell, 4)


def _number_text(value: float, digits: int) -> str:
    """Return a number with `digits` significant digits, and all integer digits."""
    if abs(value) >= 10**digits or value == int(value):
        return f"{value:.0f}"
    return f"{float(f'{value:.{digits}g}'):g}"


def _csv(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Return rows as CSV; an interval has three columns."""
    intervals = [any(isinstance(cell, Interval) for cell in column) for column in zip(*rows, strict=True)]
    heads = (
        (name, f"{name}, low", f"{name}, high")[: 3 if wide else 1]
        for name, wide in zip(columns, intervals, strict=True)
    )
    cells = (
        (_interval_cells(cell) if wide else (cell,) for cell, wide in zip(row, intervals, strict=True))
        for row in rows
    )
    return csv_text(map(itertools.chain.from_iterable, (heads, *cells)))


def _interval_cells(cell: Cell) -> Sequence[Cell]:
    if not isinstance(cell, Interval):
        return None, None, None
    return tuple(None if math.isnan(one) else one for one in cell)
