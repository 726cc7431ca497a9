"""What the report says in sentences: what was asked, what was found, what failed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from experiments.comparison.across_cells import AcrossCells
from experiments.comparison.comparison import Comparison, PairedSample
from experiments.comparison.family import ComparedMetric, PairVerdict
from experiments.comparison.judgement import CampaignJudgement
from experiments.comparison.metrics import named
from experiments.report.cases import REAL, CaseSource
from experiments.report.numbers import Cell, NumberTable
from experiments.report.section import label
from experiments.report.verdict_table import counted, verdict_table
from experiments.study.study import FIRST_TUNING_SEED, Study, Variant

_MOST_TOLD: Final = 8
"""Verdicts that are told in a sentence each."""
_MOST_OPEN: Final = 12
"""Estimates whose table is shown unasked."""


class Findings:
    """The comparisons of a campaign's strategies."""

    def __init__(self, source: CaseSource, judgement: CampaignJudgement) -> None:
        self.source = source
        self.judgement = judgement
        self.estimates = [
            replace(one, one=label(one.one), other=label(one.other)) for one in judgement.estimates
        ]

    def sentences(self) -> list[str]:
        """What failed, and what the declared comparisons come to: many of them are a table, and counted."""
        told = replace(
            self.judgement,
            verdicts=[] if self._many else self._verdicts,
            across=[_named_across(one) for one in self.judgement.across],
        )
        return [*told.sentences(), *(counted(self._verdicts) if self._many else ())]

    @property
    def _verdicts(self) -> list[PairVerdict]:
        return [_labelled(one) for one in self.judgement.verdicts if one.steps]

    @property
    def _many(self) -> bool:
        return len(self._verdicts) > _MOST_TOLD

    def tables(self) -> Iterator[NumberTable]:
        """Every test of the family with its p-values, and every estimate with its intervals."""
        where = ("condition",) if any(one.variant for one in self.estimates) else ()
        if self._many:
            yield verdict_table(self.source.name, self._verdicts)
        steps = [step for one in self.judgement.verdicts for step in _labelled(one).steps]
        if steps:
            yield NumberTable(
                f"tests_{self.source.name}",
                "The tests of the declared comparisons. p is of the runs swapped within their pairs in all "
                "ways. Holm's correction holds for the rows that have it; the others have too few pairs that "
                "differ. "
                "Equivalence is that the means differ by less than the margin.",
                (
                    *("first", "second", *where, "metric", "pairs", "that differ", "p", "Holm"),
                    *("margin", "p of equivalence"),
                ),
                tuple(_test(step, where) for step in steps),
            )
        across = [one for one in map(_named_across, self.judgement.across) if one.fitted is not None]
        if across:
            yield NumberTable(
                f"cells_{self.source.name}",
                "The declared comparisons over all cells: the mean difference in places within pairs, "
                "what a new cell with as many seeds would show, and standard deviations. Cells and seeds are "
                "random effects, fitted by restricted maximum likelihood; none of it is a test.",
                (
                    *("first", "second", "cells", "pairs", "difference", "in a new cell"),
                    *("between cells", "between seeds", "of what is left"),
                ),
                tuple(_cells(one) for one in across),
            )
            maps = tuple((one.one, one.other, *each) for one in across for each in one.without)
            if maps:
                yield NumberTable(
                    f"without_map_{self.source.name}",
                    "The same difference without each map in turn.",
                    ("first", "second", "without", "difference"),
                    maps,
                )
        if self.estimates:
            yield NumberTable(
                f"comparisons_{self.source.name}",
                "Estimates; none of them is a test. Values are means, of times restricted means. A12 is the "
                "probability that a run of the first is better than one of the second, ties counted half. "
                "Intervals are of 95 %.",
                (
                    *("first", "second", *where, "metric", "first has", "second has", "difference"),
                    *("better", "worse", "A12"),
                ),
                tuple(_estimate(one, where) for one in self.estimates),
                folded=len(self.estimates) > _MOST_OPEN,
            )


def _labelled(verdict: PairVerdict) -> PairVerdict:
    steps = tuple(replace(step, sample=_named(step.sample)) for step in verdict.steps)
    return PairVerdict(_named(verdict.sample), steps)


def _named_across(one: AcrossCells) -> AcrossCells:
    return one._replace(one=label(one.one), other=label(one.other))


def _cells(one: AcrossCells) -> tuple[Cell, ...]:
    fitted = one.fitted
    assert fitted is not None
    return (
        *(one.one, one.other, fitted.cells, fitted.values, fitted.mean, fitted.new_cell),
        *(fitted.between_cells, fitted.between_seeds, fitted.rest),
    )


def _named(sample: PairedSample) -> PairedSample:
    return sample._replace(one=label(sample.one), other=label(sample.other))


def _condition(variant: Variant, where: Sequence[str]) -> tuple[Cell, ...]:
    return (", ".join(f"{key} = {value}" for key, value in variant),) if where else ()


def _test(step: ComparedMetric, where: Sequence[str]) -> tuple[Cell, ...]:
    sample, test = step.sample, step.test
    return (
        *(sample.one, sample.other, *_condition(sample.variant, where), named(step.metric).says),
        *(len(sample.pairs), test.differing, test.p, step.adjusted if step.tested else None),
        *(step.margin, step.equivalence_p),
    )


def _estimate(one: Comparison, where: Sequence[str]) -> tuple[Cell, ...]:
    unit = f", {one.unit}" if one.unit not in {"", one.says} else ""
    return (
        *(one.one, one.other, *_condition(one.variant, where), one.says + unit),
        *(one.ones, one.others, one.difference, one.better, one.worse, one.effect),
    )


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
    if study.cells:
        drawn = (f"{factor.key} ({', '.join(map(str, factor.values))})" for factor in study.random)
        told.append(f"each in {len(study.cells)} cells, drawn together from {', '.join(drawn)}")
    if study.conditions == "drawn":
        told.append(
            "seeds draw starts, places, odometry's errors and shadowing where the study does not set them"
        )
    if study.settings:
        told.append("with " + ", ".join(f"{key} = {value}" for key, value in study.settings))
    declared = " and ".join(f"{one} against {other}" for one, other in study.primary_pairs)
    told.append(f"the study declares: {declared}" if declared else "the study declares no comparison")
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
