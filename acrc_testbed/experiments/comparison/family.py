"""The comparisons that a study declared: a test for each step of each, and what all of them decide."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from acrc_testbed.experiments.comparison import metrics
from acrc_testbed.experiments.comparison.comparison import (
    Comparison,
    PairedSample,
    estimate,
    scores,
    too_few_pairs,
)
from acrc_testbed.experiments.comparison.metrics import SETTLED, TimeMetric
from acrc_testbed.experiments.statistics.paired_tests import (
    ALPHA,
    LEAST_PAIRS,
    PairedTest,
    decidable,
    equivalence_p,
    fewest_differing,
    holm,
    mean_test,
    signed_rank,
)
from acrc_testbed.experiments.study.study import Study
from actors.runtime.errors import AcrcError

_NOTHING: Final = PairedTest(0, 0, 1.0)


@dataclass(frozen=True)
class ComparedMetric:
    """One metric of a primary comparison: its test, and what the family makes of it."""

    sample: PairedSample
    """The pairs that it is of."""
    metric: str
    test: PairedTest
    """Of how much better the first run of each pair is."""
    happened: bool
    """False: a time at which nothing happened in any run, which tells nothing."""
    margin: float | None
    """Within which strategies are equivalent, in the metric's unit; None: none was declared."""
    equivalence_p: float
    tests: int = 1
    """So many share the error."""
    tested: bool = False
    """False: too few pairs differ for any claim."""
    adjusted: float = 1.0
    """The test's p-value after Holm; where it was looked at on the way, as it is."""
    differs: bool = False
    equivalent: bool = False
    threshold: float | None = None
    """What p must be at most at the look at which the step was taken; None: after all runs."""

    @property
    def fewest(self) -> int:
        """Pairs that must differ before this step can show anything."""
        return fewest_differing(self.tests) if self.threshold is None else fewest_differing(1, self.threshold)

    def estimated(self) -> Comparison | None:
        """Return the step's numbers, or None if too few pairs have them."""
        return estimate(self.sample, self.metric)


@dataclass(frozen=True)
class PairVerdict:
    """What a primary comparison in one variant comes to: its steps, in the order in which they are asked."""

    sample: PairedSample
    steps: tuple[ComparedMetric, ...]

    @property
    def deciding(self) -> ComparedMetric | None:
        """The first step by which the strategies differ, if they are equivalent by all before it."""
        for step in self.steps:
            if step.differs:
                return step
            if not step.equivalent:
                return None
        return None

    @property
    def equivalent(self) -> bool:
        """True if the strategies are as good as each other by every step."""
        return bool(self.steps) and all(step.equivalent and not step.differs for step in self.steps)

    @property
    def settled(self) -> bool:
        """True if more pairs have nothing left to decide."""
        return self.deciding is not None or self.equivalent


def step_names(study: Study) -> tuple[str, ...]:
    """The metrics by which primary comparisons are decided, in order. AcrcError for one that there is not."""
    name = study.primary_metric
    if not metrics.is_metric(name):
        raise AcrcError(f"primary_metric is {name!r}; must be {metrics.CHOICE}")
    return (metrics.PLACES.name, SETTLED.name) if name == metrics.LEXICOGRAPHIC else (name,)


def tests_of(study: Study) -> int:
    """How many tests share the error: one for each step of each primary pair in each fixed variant."""
    return len(study.primary_pairs) * len(study.fixed_variants()) * len(step_names(study))


def pairs_of(study: Study) -> int:
    """How many pairs each test is of, once all runs have ended."""
    return study.seeds * max(len(study.cells), 1)


def primary(found: Sequence[PairedSample], study: Study) -> list[PairedSample]:
    """Those of the samples that the study declared."""
    declared = set(study.primary_pairs)
    return [sample for sample in found if (sample.one, sample.other) in declared]


def verdicts(found: Sequence[PairedSample], study: Study) -> list[PairVerdict]:
    """What the primary comparisons among the samples come to after all runs: Holm over their tests alone."""
    names = step_names(study)
    raw = [step(sample, name, study) for sample in primary(found, study) for name in names]
    able = decidable([one.test.differing for one in raw])
    adjusted = iter(holm([one.test.p for one, is_able in zip(raw, able, strict=True) if is_able]))
    steps = []
    for one, is_able in zip(raw, able, strict=True):
        p = next(adjusted) if is_able else 1.0
        steps.append(
            replace(
                one,
                tests=sum(able) + (not is_able),
                tested=is_able,
                adjusted=p,
                differs=p <= ALPHA,
                equivalent=one.equivalence_p <= ALPHA,
            )
        )
    count = len(names)
    return [
        PairVerdict(steps[place].sample, tuple(steps[place : place + count]))
        for place in range(0, len(steps), count)
    ]


def step(sample: PairedSample, name: str, study: Study) -> ComparedMetric:
    """The test of one metric of a sample, before anything is made of it."""
    if name == metrics.LEXICOGRAPHIC:
        raise ValueError("the order is asked step by step")
    metric = metrics.named(name)
    found = scores(metric, sample.pairs)
    is_time = isinstance(metric, TimeMetric)
    margin = study.margin_s if is_time else study.margin_places if metric is metrics.PLACES else None
    if not found.happened or not found.ones.size:
        return ComparedMetric(sample, name, _NOTHING, False, margin, 1.0)
    gains = np.round(found.gains, 9)  # equal decimals are equal, whatever floats make of their difference
    test = mean_test(gains) if is_time else signed_rank(gains)
    return ComparedMetric(
        sample, name, test, True, margin,
        1.0 if margin is None or gains.size < LEAST_PAIRS else equivalence_p(gains, margin),
    )  # fmt: skip


def foreseen(study: Study, least: int = LEAST_PAIRS) -> list[str]:
    """Return what is known before a study's first run: that its comparisons can never show anything.

    `least`: pairs that a verdict needs.
    """
    if len(study.strategies) < 2:
        return []
    if not study.primary_pairs:
        return [
            "The study declares no comparison, so acrc compare will estimate and test nothing; "
            "to test, declare primary = [[ONE, OTHER]]"
        ]
    pairs = pairs_of(study)
    return (
        []
        if pairs >= least
        else [f"acrc compare will say nothing of strategies: {too_few_pairs(pairs, least)}"]
    )
