"""`acrc verify verdicts`: how often a difference is claimed that is not there, and one found that is."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.stats import norm

from benchmarks.statistics.measured import ConfidenceInterval, Measured, proportion, table_of
from benchmarks.verdicts import campaign_rows
from experiments.comparison.comparison import PairedSample, scores
from experiments.comparison.decision import look, rules_for
from experiments.comparison.family import PairVerdict, tests_of, verdicts
from experiments.comparison.metrics import FAILED, PLACES, JudgedRun
from experiments.comparison.pilot import redrawn, told_apart
from experiments.statistics.effect_size import a12, a12_bounds, mean_interval
from experiments.statistics.paired_tests import ALPHA, equivalence_p
from experiments.statistics.sample_size import Effect, power
from experiments.study.study import Study

Floats = NDArray[np.float64]
_PRIMARY: Final = (("chapter", "none"), ("auction", "chapter"))
_MOST_ERRORS: Final = 0.06
_LEAST_COVERAGE: Final = 0.93
_NEGATIVE: Final = -0.3
"""A correlation of runs with the same seed that hardly occurs: it is shown, and not held to anything."""
_NORMAL: Final = "normal places, A12 = "
_CAP: Final = 40
_SPLITS: Final = 20
"""Ways to divide the real campaign into a pilot and what is delivered after it."""
_MARGIN: Final = Study("", "", (), 0).margin_places
_FAILURES: Final = 0.05
"""Share of runs that fail in some of the drawn campaigns, whatever their strategy."""
_SHARES: Final = (0.5, 0.6, 0.71, 0.8, 0.9, 0.95, 0.97, 0.99)
_PAIRS: Final = (6, 8, 10, 20, 40)
_POPULATION: Final = 100_000
Judge = Callable[[Sequence[PairedSample], Study], bool]
"""Whether any difference is claimed."""


def check(runs: int = 5000, draws: int = 4000, campaigns: int = 300, seed: int = 1) -> Measured:
    """Resample a real campaign, and hold what `acrc compare` claims against what is known to be so.

    `runs`: campaigns of strategies with themselves, for each row of the first table. `draws`: of samples for
    each cell of the coverage. `campaigns`: for each power. It holds where no more than 6 % of campaigns claim
    a difference that is not there (of few campaigns: 5 % and three standard errors), intervals of A12 hold
    93 % at least, of the real runs, too, and normal effects are told as often as promised, less three
    standard errors.
    """
    rng = np.random.default_rng(seed)
    errors = _errors(runs, rng)
    powers = _powers(campaigns, rng)
    coverage = _coverage(draws, np.random.default_rng([seed, 1]))
    means = _coverage_of_means(draws, np.random.default_rng([seed, 2]))
    real = _coverage_on_rows(draws, np.random.default_rng([seed, 3]))
    equivalent = _false_equivalence(draws // 4, np.random.default_rng([seed, 4]))
    worst = min(
        *(row[str(share)] for row in coverage if row["correlation"] != _NEGATIVE for share in _SHARES),
        *(row[str(pairs)] for row in real for pairs in _PAIRS),
    )
    kept = all(
        float(str(row["delivered"])) >= float(str(row["promised"])) - _chance(0.5, campaigns)
        for row in powers
        if str(row["comparison"]).startswith(_NORMAL)
    )
    most = max(_MOST_ERRORS, ALPHA + _chance(ALPHA, runs))
    holds = max(found.value for _, found in errors) <= most and worst >= _LEAST_COVERAGE and kept
    shown = (
        table_of(
            [
                {"campaigns of a strategy with itself": name, "claim a difference": _percent(found)}
                for name, found in errors
            ],
            f"{runs} campaigns each; at most {100 * most:.3g} %",
        ),
        table_of(
            [
                {key: f"{value:.2f}" if isinstance(value, float) else value for key, value in row.items()}
                for row in powers
            ],
            f"power: promised by acrc study plan, delivered by compare in {campaigns} campaigns",
        ),
        table_of(
            coverage,
            f"coverage of the 95 % interval by A12, {draws} samples a cell; at least {_LEAST_COVERAGE:g}",
        ),
        table_of(
            real,
            f"the same of the real campaign's places, with ties and ceilings; at least {_LEAST_COVERAGE:g}",
        ),
        table_of(
            means,
            f"coverage of the 95 % interval of a mean difference, {draws} samples a cell; only measured",
        ),
        table_of(
            equivalent,
            f"equality claimed where the mean differs by the margin, {_MARGIN:g} place; {draws // 4} samples "
            "a cell; only measured",
        ),
    )
    figures = {
        "errors": {name: found.value for name, found in errors},
        "powers": powers,
        "coverage": coverage,
        "coverage_on_rows": real,
        "coverage_of_means": means,
        "false_equivalence": equivalent,
    }
    return Measured(figures, shown, holds)


def _chance(share: float, count: int) -> float:
    """Three standard errors of a share."""
    return 3.0 * float(np.sqrt(share * (1 - share) / count))


def _percent(found: ConfidenceInterval) -> str:
    return f"{100 * found.value:.2f} % ({100 * found.low:.2f} to {100 * found.high:.2f})"


def _errors(count: int, rng: Generator) -> list[tuple[str, ConfidenceInterval]]:
    """How often campaigns claim a difference where there is none, by how they were drawn and judged."""
    family = campaign_rows.study(_PRIMARY, _CAP)
    alone = campaign_rows.study(_PRIMARY[:1], _CAP)
    real = campaign_rows.samples(_PRIMARY)
    judges: tuple[tuple[str, Judge], ...] = (
        ("after all runs", _after_all),
        ("with looks on the way", _looked),
    )
    found = []
    for words, study, samples, drawn in (
        ("one comparison in 2 conditions, runs of one strategy", alone, real, _of_one_strategy),
        ("two comparisons in 2 conditions, runs swapped in their pairs", family, real, _swapped),
        ("the same, and 5 % of runs fail", family, real, _swapped_and_failing),
    ):
        declared = [one for one in samples if (one.one, one.other) in study.primary_pairs]
        for how, judge in judges:
            wrong = sum(judge(drawn(declared, rng), study) for _ in range(count))
            found.append((f"{words}, {how}", proportion(wrong, count)))
    return found


def _after_all(drawn: Sequence[PairedSample], study: Study) -> bool:
    return any(one.deciding is not None for one in verdicts(drawn, study))


def _looked(drawn: Sequence[PairedSample], study: Study) -> bool:
    rules = rules_for(study)
    return any(look(one, study, rules).verdict.deciding is not None for one in drawn)


def _of_one_strategy(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    """Both sides of each comparison drawn from the runs of its first strategy."""
    made = []
    for one in declared:
        runs = [first for first, _ in one.pairs]
        chosen = rng.integers(len(runs), size=(_CAP, 2)).tolist()
        made.append(one._replace(pairs=tuple((runs[a], runs[b]) for a, b in chosen)))
    return made


def _swapped(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    """Pairs as they are, drawn with replacement, whose sides a fair coin swaps."""
    known = len(declared[0].pairs)
    made = redrawn(declared, rng.integers(known, size=_CAP))
    return [
        one._replace(
            pairs=tuple(
                pair[::-1] if swap else pair
                for pair, swap in zip(one.pairs, (rng.random(_CAP) < 0.5).tolist(), strict=True)
            )
        )
        for one in made
    ]


def _swapped_and_failing(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    made = _swapped(declared, rng)
    return [
        one._replace(pairs=tuple((_failing(a, rng), _failing(b, rng)) for a, b in one.pairs)) for one in made
    ]


def _failing(run: JudgedRun, rng: Generator) -> JudgedRun:
    return FAILED if rng.random() < _FAILURES else run


def _powers(campaigns: int, rng: Generator) -> list[dict[str, object]]:
    """What `acrc study plan` promises of normal effects, and of half of the seeds, beside what is delivered.

    The latter, as if the pilot were drawn itself, beside campaigns drawn from the other half of the seeds, on
    average over halves that are drawn by lot.
    """
    rows: list[dict[str, object]] = []
    study = Study("normal", "", ("one", "other"), _CAP, primary=(("one", "other"),))
    for share in (0.6, 0.71, 0.8):
        for pairs in (10, 20, 40):
            drawn = ([_normal(share, pairs, rng)] for _ in range(campaigns))
            told = sum(_by_places(verdicts(one, study)) for one in drawn)
            promised = power(Effect(share, tests=tests_of(study)), pairs)
            rows.append(_power_row(f"{_NORMAL}{share}", pairs, promised, told / campaigns))
    real, family = campaign_rows.samples(_PRIMARY), campaign_rows.study(_PRIMARY, _CAP)
    known, each = len(real[0].pairs), -(-campaigns // _SPLITS)
    for pairs in (10, 20, 40):
        found = np.zeros((len(real), 2))
        for _ in range(_SPLITS):
            pilot, rest = (redrawn(real, half) for half in np.split(rng.permutation(known), 2))
            found[:, 0] += told_apart(pilot, family, pairs, rng, each, cautious=True)
            found[:, 1] += told_apart(rest, family, pairs, rng, each)
        for sample, (promised, delivered) in zip(real, (found / _SPLITS).tolist(), strict=True):
            rows.append(_power_row(_name(sample), pairs, promised, delivered))
    return rows


def _name(sample: PairedSample) -> str:
    return f"{sample.one} and {sample.other}{sample.where}"


def _power_row(name: str, pairs: int, promised: float, delivered: float) -> dict[str, object]:
    return {"comparison": name, "pairs": pairs, "promised": promised, "delivered": delivered}


def _by_places(found: Sequence[PairVerdict]) -> bool:
    deciding = found[0].deciding
    return deciding is not None and (deciding.metric, deciding.test.direction) == (PLACES.name, 1)


def _normal(share: float, pairs: int, rng: Generator) -> PairedSample:
    """Places of which the first strategy has more with this probability; times are as long for both."""
    places = rng.normal((Effect(share).shift, 0.0), 1.0, (pairs, 2))
    times = rng.uniform(300.0, 600.0, (pairs, 2))
    ones, others = (
        [
            JudgedRun(round(1000 + 100 * done), 2000, None, at, 600.0)
            for done, at in zip(places[:, side].tolist(), times[:, side].tolist(), strict=True)
        ]
        for side in (0, 1)
    )
    return PairedSample("one", "other", (), tuple(zip(ones, others, strict=True)))


def _coverage(draws: int, rng: Generator) -> list[dict[str, Any]]:
    """How often the interval of A12 holds the truth, for pairs of normal values with a correlation."""
    rows = []
    for correlation in (_NEGATIVE, 0.0, 0.3, 0.6):
        for pairs in _PAIRS:
            row: dict[str, Any] = {"correlation": correlation, "pairs": pairs}
            for share in _SHARES:
                shift = np.sqrt(2.0) * norm.ppf(share)
                ones, others = rng.multivariate_normal(
                    (shift, 0.0), ((1.0, correlation), (correlation, 1.0)), (draws, pairs)
                ).transpose(2, 0, 1)
                low, high = a12_bounds(a12(ones, others), pairs)
                row[str(share)] = round(float(((low <= share) & (share <= high)).mean()), 3)
            rows.append(row)
    return rows


def _coverage_on_rows(draws: int, rng: Generator) -> list[dict[str, Any]]:
    """How often the interval of A12 holds that of the real runs, whose pairs are drawn with replacement."""
    rows = []
    for sample in campaign_rows.samples(_PRIMARY):
        ones, others, *_ = scores(PLACES, sample.pairs)
        share = a12(ones, others)
        row: dict[str, Any] = {"comparison": _name(sample), "A12": round(float(share), 3)}
        for pairs in _PAIRS:
            chosen = rng.integers(ones.size, size=(draws, pairs))
            low, high = a12_bounds(a12(ones[chosen], others[chosen]), pairs)
            row[str(pairs)] = round(float(((low <= share) & (share <= high)).mean()), 3)
        rows.append(row)
    return rows


def _false_equivalence(draws: int, rng: Generator) -> list[dict[str, object]]:
    """How often a mean difference that is the margin is claimed to be within it.

    Rare: a share of the pairs differs by what makes the mean the margin, all others are equal. Few pairs may
    have none of the rare ones, and then nothing shows them.
    """
    rows: list[dict[str, object]] = []
    for name, share in (
        ("all pairs alike, and normal", 1.0),
        ("1 pair in 2", 0.5),
        ("1 in 5", 0.2),
        ("1 in 10", 0.1),
    ):
        row: dict[str, object] = {"pairs that differ": name}
        for pairs in _PAIRS:
            size = (draws, pairs)
            noise = rng.normal(size=size) if share == 1.0 else np.zeros(size)
            drawn = np.where(rng.random(size) < share, _MARGIN / share, 0.0) + noise
            row[str(pairs)] = round(
                float(np.mean([equivalence_p(one, _MARGIN) <= ALPHA for one in drawn])), 3
            )
        rows.append(row)
    return rows


def _coverage_of_means(draws: int, rng: Generator) -> list[dict[str, object]]:
    """How often Student's interval holds the mean of differences, made up and real ones."""
    rare = rng.random(_POPULATION) < 0.15
    populations = {
        "normal": rng.normal(size=_POPULATION),
        "exponential": rng.exponential(size=_POPULATION),
        "2 more in 85 %, 11 fewer in 15 %": np.where(rare, -11.0, 2.0) + rng.normal(size=_POPULATION),
    }
    for sample in campaign_rows.samples(_PRIMARY):
        populations[_name(sample)] = scores(PLACES, sample.pairs).gains
    return [
        {"differences": name, **{str(pairs): _held(population, pairs, draws, rng) for pairs in _PAIRS}}
        for name, population in populations.items()
    ]


def _held(population: Floats, pairs: int, draws: int, rng: Generator) -> float:
    found = [mean_interval(one) for one in rng.choice(population, (draws, pairs))]
    return round(float(np.mean([one.low <= population.mean() <= one.high for one in found])), 3)
