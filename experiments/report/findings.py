"""What the report says in sentences: what was asked, what was found, what failed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from experiments.comparison.comparison import Comparison, PairedSample, compare, samples
from experiments.comparison.sentences import chapter_order
from experiments.report.cases import REAL, CaseSource
from experiments.report.numbers import Cell, NumberTable
from experiments.report.section import label
from experiments.study.study import FIRST_TUNING_SEED, Study

_MOST_OPEN: Final = 12
"""Comparisons whose table is shown unasked."""


class Findings:
    """The comparisons of a campaign's strategies."""

    def __init__(self, source: CaseSource) -> None:
        self.source = source
        self.samples: Sequence[PairedSample] = samples(source.records)
        self.comparisons = [
            replace(one, one=label(one.one), other=label(one.other)) for one in compare(self.samples)
        ]

    def primary(self) -> list[str]:
        """In the chapter's order, of the pairs for which the study was made."""
        return chapter_order([one for one in self.comparisons if self._is_primary(one)])

    def others(self) -> list[str]:
        """Of all other pairs."""
        return chapter_order([one for one in self.comparisons if not self._is_primary(one)])

    def tables(self) -> Iterator[NumberTable]:
        """Every test with its p-value, and every difference with its interval."""
        if not self.comparisons:
            return
        where = ("condition",) if any(one.variant for one in self.comparisons) else ()
        yield NumberTable(
            f"comparisons_{self.source.name}",
            "Every test that was made. Values are medians, of times restricted means. A12 is the probability "
            "that a run of the first is better than one of the second, ties counted half. p after Holm holds "
            "for all rows together; the first test of each metric is the one that counts.",
            ("first", "second", *where, "metric", "first has", "second has", "A12", "test", "p", "Holm"),
            tuple(row for one in self.comparisons for row in _tests(one, where)),
            folded=len(self.comparisons) > _MOST_OPEN,
        )
        yield NumberTable(
            f"differences_{self.source.name}",
            "First less second, with 95 % bootstrap intervals",
            ("first", "second", *where, "metric", "difference of", "is"),
            tuple(
                (*_who(one, where), one.says, name, found)
                for one in self.comparisons
                for name, found in one.differences.items()
            ),
            folded=True,
        )

    def _is_primary(self, comparison: Comparison) -> bool:
        study = self.source.study
        pair = {comparison.one, comparison.other}
        return study is not None and any(set(map(label, declared)) == pair for declared in study.primary)


def _who(one: Comparison, where: Sequence[str]) -> tuple[Cell, ...]:
    variant = ", ".join(f"{key} = {value}" for key, value in one.variant)
    return one.one, one.other, *((variant,) if where else ())


def _tests(one: Comparison, where: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    for test, adjusted in zip(one.tests, one.adjusted, strict=True):
        yield (*_who(one, where), one.says, one.ones, one.others, one.effect, test.name, test.p, adjusted)


def asked(sources: Sequence[CaseSource]) -> list[str]:
    """What the runs were made for, a sentence for each folder."""
    return [_asked(one) for one in sources]


def _asked(source: CaseSource) -> str:
    study = source.study
    if study is None:
        (case,) = source.cases
        if case.condition == REAL:
            return f"{source.name}: what real robots recorded on one field trial."
        return f"{source.name}: one run of {label(case.strategy)} with seed {case.seed}."
    told = [
        f"{source.name}: {', '.join(map(label, study.strategies))} in {_file(study.scenario)}, each with the "
        f"same {study.seeds} seeds ({_seeds(study)})"
    ]
    told += [f"{factor.key} is {', '.join(map(str, factor.values))} in turn" for factor in study.factors]
    if study.settings:
        told.append("with " + ", ".join(f"{key} = {value}" for key, value in study.settings))
    declared = " and ".join(f"{one} against {other}" for one, other in study.primary)
    told.append(f"declared beforehand: {declared}" if declared else "no comparison was declared beforehand")
    return "; ".join(told) + "."


def _seeds(study: Study) -> str:
    first = FIRST_TUNING_SEED if study.tuning else 1
    return f"{first} to {first + study.seeds - 1}{', for tuning' if study.tuning else ''}"


def _file(path: str) -> str:
    """Without the folders in which somebody keeps it."""
    return path.replace("\\", "/").rpartition("/")[2]


def failures(sources: Sequence[CaseSource]) -> NumberTable | None:
    """Runs without a result, by cause; None if there is none."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for source in sources:
        for case in source.cases:
            if case.failure is not None:
                key = (case.condition, label(case.strategy), case.failure)
                found.setdefault(key, []).append(str(case.seed))
    if not found:
        return None
    rows = tuple((*key, len(seeds), _some(seeds)) for key, seeds in found.items())
    return NumberTable(
        "failures", "Runs that failed", ("condition", "strategy", "cause", "runs", "seeds"), rows
    )


def _some(seeds: Sequence[str]) -> str:
    return ", ".join(seeds[:12]) + (", …" if len(seeds) > 12 else "")
