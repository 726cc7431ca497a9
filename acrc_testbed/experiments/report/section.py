"""What a page is made of, and the runs by condition and strategy that its sections are made from."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeVar

from matplotlib.figure import Figure

from acrc_testbed.experiments.report import charts
from acrc_testbed.experiments.report.cases import Case
from acrc_testbed.experiments.report.charts import Look
from acrc_testbed.experiments.report.quantities import BoxSpread, Cell, NumberTable
from acrc_testbed.results.result import RunResult

T = TypeVar("T")
UPPER_BOUNDS: Final = frozenset({"oracle"})
"""Strategies that use what no robot can know."""
BOX: Final = (
    "A box holds the middle half of the runs, the line in it is the median, whiskers reach to the last run "
    "within one and a half box lengths, and each run is a dot; up to four runs are dots alone."
)
SPREAD: Final = ("runs", "least", "1st quartile", "median", "3rd quartile", "most", "mean")


@dataclass(frozen=True)
class Picture:
    """A picture, and what those are told who do not see it."""

    name: str
    """Of its files, without their ends."""
    figure: Figure
    alt: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading, sentences, at most one picture, and the numbers behind it."""

    title: str
    text: tuple[str, ...]
    picture: Picture | None
    tables: tuple[NumberTable, ...]


class Group(NamedTuple):
    """The runs of one strategy under one condition that have a result; at least one."""

    condition: str
    strategy: str
    cases: tuple[Case, ...]

    @property
    def label(self) -> str:
        """The strategy, with what a reader must know of it."""
        return label(self.strategy)

    @property
    def outcomes(self) -> tuple[RunResult, ...]:
        """Of its runs."""
        return tuple(case.outcome for case in self.cases if case.outcome is not None)


def label(strategy: str) -> str:
    """A strategy's name; an upper bound is marked as such everywhere."""
    return f"{strategy} (upper bound)" if strategy in UPPER_BOUNDS else strategy


class ReportView:
    """All runs that have a result, in the order in which they came."""

    def __init__(self, cases: Iterable[Case]) -> None:
        found: dict[tuple[str, str], list[Case]] = {}
        for case in cases:
            if case.outcome is not None:
                found.setdefault((case.condition, case.strategy), []).append(case)
        conditions = dict.fromkeys(condition for condition, _ in found)
        strategies = dict.fromkeys(strategy for _, strategy in found)
        self.groups = tuple(
            Group(condition, strategy, tuple(found[condition, strategy]))
            for condition in conditions
            for strategy in strategies
            if (condition, strategy) in found
        )
        self._looks = {name: charts.look(place) for place, name in enumerate(strategies)}
        self.has_conditions = len(conditions) > 1

    def look(self, group: Group) -> Look:
        """The same strategy looks the same in every picture."""
        return self._looks[group.strategy]

    def row_name(self, group: Group) -> str:
        """Names a group where all stand below one another."""
        return f"{group.condition}: {group.label}" if self.has_conditions else group.label

    def panels(self, made: Callable[[Group], T | None]) -> dict[str, list[T]]:
        """What each condition's panel shows, group by group; None: nothing."""
        found: dict[str, list[T]] = {}
        for group in self.groups:
            one = made(group)
            if one is not None:
                found.setdefault(group.condition, []).append(one)
        return found

    def table(
        self,
        name: str,
        caption: str,
        columns: Sequence[str],
        rows: Callable[[Group], Iterable[Sequence[Cell]]],
        *,
        folded: bool = False,
    ) -> NumberTable:
        """Rows of every group, which begin with what it is called."""
        head = ("condition", "strategy") if self.has_conditions else ("strategy",)
        told = tuple(
            (*((group.condition, group.label) if self.has_conditions else (group.label,)), *row)
            for group in self.groups
            for row in rows(group)
        )
        return NumberTable(name, caption, (*head, *columns), told, folded)


def spread_cells(spread: BoxSpread) -> tuple[Cell, ...]:
    """As SPREAD says."""
    return (
        len(spread.values), spread.least, spread.q1, spread.median, spread.q3, spread.most, spread.mean,
    )  # fmt: skip


def medians(view: ReportView, what: str, unit: str, found: Callable[[Group], BoxSpread]) -> str:
    """What a box plot shows, in a sentence for those who do not see it."""
    told = "; ".join(f"{view.row_name(one)} {found(one).median:.4g}{unit}" for one in view.groups)
    return f"Box plots of {what}. Medians: {told}. All numbers are in the table below."
