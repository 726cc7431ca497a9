"""Comparisons of made-up trials, and campaigns that stop at planned looks."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from acrc_testbed.experiments import store
from acrc_testbed.experiments.comparison import PairedSample, compare, comparison_of, samples
from acrc_testbed.experiments.evaluation import (
    evaluate,
    failure_sentences,
    family_sentences,
    too_few_sentences,
    verdict_sentence,
)
from acrc_testbed.experiments.metrics import Run, find_metric
from acrc_testbed.experiments.paired_tests import MIN_PAIRS, AssumedEffect
from acrc_testbed.experiments.store import Store
from acrc_testbed.experiments.study import Factor, Study
from acrc_testbed.experiments.trial_record import TrialRecord, write_json
from acrc_testbed.experiments.verdicts import (
    InterimAnalysis,
    PairVerdict,
    ceiling_sentences,
    interim_verdict,
    look_sentences,
    power_estimates,
    power_warnings,
    simulated_power,
    stopping_rules,
    verdicts,
)
from acrc_testbed.results.result import RunResult
from actors.runtime.errors import AcrcError
from tests.experiments.made_runs import (
    CLEANING,
    METRICS,
    Outcome,
    judged,
    run,
    sample,
    study,
    trials,
    varied,
    verdict_of,
)


def test_more_places_are_better_whatever_the_time() -> None:
    found = verdict_of(
        [run(40, 500.0 + seed) for seed in range(20)], [run(20 + seed % 5) for seed in range(20)]
    )
    assert found.deciding is not None and found.deciding.metric == "places"
    assert verdict_sentence(found) == (
        "one is better than other in places done: 40 versus 22, difference +18 places [+17.3, +18.7], "
        "better on 20 of 20 seeds, worse on 0, equal on 0, A12 = 1.00 [0.90, 1.00], p = 1.9e-06, "
        "Holm-adjusted 3.8e-06."
    )
    never = [run(10, length=120.0) for _ in range(12)]
    found = verdict_of(never, never)
    assert found.deciding is None and not found.equivalent
    assert verdict_sentence(found).endswith(
        "They cannot be compared in running time: no run was done or given up by 120 s."
    )


def test_time_decides_only_where_places_are_shown_to_be_equal() -> None:
    fast = [run(40, 300.0 + seed) for seed in range(20)]
    slow = [run(40, None if seed % 7 == 0 else 400.0 + seed) for seed in range(20)]
    said = verdict_sentence(verdict_of(fast, slow))
    assert said.startswith("one and other are equivalent in places done within 1 place: 40 versus 40")
    assert "for equivalence; 0 of 20 seeds differ by more (95 % upper bound of the share: 14 %). " in said
    assert (
        "Therefore they are compared in running time: one is better than other in running time: 309.5 versus "
        in said
    )
    # places that vary and do not differ on average: neither different nor shown to be equal
    rng = np.random.default_rng(2)
    noisy = [
        run(int(places), at.task["settled_s"])
        for places, at in zip(rng.integers(20, 40, 20), fast, strict=True)
    ]
    others = [
        run(int(places), at.task["settled_s"])
        for places, at in zip(rng.integers(20, 40, 20), slow, strict=True)
    ]
    open_one = verdict_of(noisy, others)
    assert open_one.deciding is None
    assert verdict_sentence(open_one).endswith(
        "Equivalence within 1 place is not shown, so they are not compared in running time."
    )


def test_the_direction_is_that_of_the_test_and_a_disagreement_is_said() -> None:
    """34 of 40 seeds a little better, 6 much worse: the signed-rank test and the mean speak for two sides."""
    ones = [run(22) if seed < 34 else run(2) for seed in range(40)]
    others = [run(20) for _ in range(40)]
    found = verdict_of(ones, others)
    (places, _) = found.steps
    assert places.differs and places.test.direction == 1
    assert places.difference is not None and places.difference.value < 0
    said = "one versus other in places done: {} on 34 of 40 seeds (median 2 places), much {} on 6 (median 18 "
    assert verdict_sentence(found).startswith(said.format("better", "worse"))
    assert (
        "test and effect disagree: 19 versus 20, difference -1 places [-3.31, +1.31], "
        in verdict_sentence(found)
    )
    assert verdict_sentence(verdict_of(others, ones)).startswith(said.format("worse", "better"))


def test_a_test_that_cannot_decide_says_so_and_costs_the_others_nothing() -> None:
    few = [run(21 if seed < 5 else 20) for seed in range(20)]
    level = [run(20) for _ in range(20)]
    alone = verdict_of(few, level).steps[0]
    assert (alone.test.differing, alone.tested, alone.adjusted) == (5, False, 1.0)
    assert "because only 5 of 20 pairs differ and a test needs 6: " in verdict_sentence(
        verdict_of(few, level, study(margins={"places": 0.1}))
    )
    six = [run(21 if seed < 6 else 20) for seed in range(20)]
    (place, time) = verdict_of(six, level).steps
    assert (place.tested, place.adjusted, place.differs, time.tested) == (True, 2 / 2**6, True, False)


def test_holm_is_over_the_declared_tests_alone() -> None:
    """Two pairs of three strategies are declared; the third is explored, and is no test."""
    made = study()
    three = msgspec.structs.replace(
        made, strategies=("one", "other", "third"), primary=(("one", "other"), ("third", "one"))
    )
    pairs = [run(21) for _ in range(8)], [run(20) for _ in range(8)]
    first = sample(*pairs)
    others = [first._replace(one="third", other="one"), first._replace(one="third", other="other")]
    found = verdicts([first, *others], three)
    assert [(one.sample.one, one.sample.other) for one in found] == [("one", "other"), ("third", "one")]
    assert [one.steps[0].adjusted for one in found] == [4 / 2**8, 4 / 2**8]
    assert family_sentences(found, three) == [
        "Declared: 2 comparisons, 4 tests; 2 can be significant, at a family-wise error rate of 5 % (Holm); "
        "2 cannot, because too few pairs differ."
    ]
    assert family_sentences([], three) == []
    assert family_sentences(
        [], Study(name="s", task=CLEANING, scenario="/s.toml", strategies=("a", "b", "c"), seeds=40)
    ) == ["No comparison was declared, so nothing is tested; all estimates are exploratory."]


def test_impossible_verdicts_are_reported_before_the_first_run() -> None:
    said = "acrc compare will have too little data: {} pairs of runs are too few: the exact test needs"
    assert power_warnings(study(seeds=5))[0].startswith(said.format(5))
    assert power_warnings(study(seeds=6)) == power_warnings(study(seeds=6, primary_metric="places")) == []
    assert power_warnings(study(seeds=6, factors=(Factor("robots.count", (4, 8)),))) == []
    assert power_warnings(study(seeds=3), stopping_rules(study(seeds=3)).least)[0].startswith(said.format(3))
    undeclared = Study(name="s", task=CLEANING, scenario="/s.toml", strategies=("a", "b", "c"), seeds=40)
    assert power_warnings(undeclared)[0].startswith(
        "No comparison is declared, so acrc compare will only estimate"
    )
    with pytest.raises(AcrcError, match="primary_metric is 'speed'; must be one of places, settled"):
        verdicts([sample([run(1)], [run(1)])], study(primary_metric="speed"))


def test_crashing_on_hard_seeds_improves_no_strategy(plain: RunResult) -> None:
    """A strategy fails on half of the seeds, where the other does 10 places; elsewhere it does one more."""
    crashing = [*trials(plain, "one", lambda seed: None if seed % 2 else (31, None), 40)]
    steady = [*trials(plain, "other", lambda seed: (10, None) if seed % 2 else (30, None), 40)]
    made = study()
    (found,) = judged([*steady, *crashing], made)
    assert (found.sample.one, found.sample.other) == ("one", "other"), "as declared"
    assert found.deciding is not None and found.deciding.test.direction == -1
    assert "15.5 versus 20, difference -4.5 places" in verdict_sentence(found)
    assert failure_sentences([*crashing, *steady], made) == [
        "one failed in 20 of 40 runs (seeds 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, …); "
        "each counts as a run with places = 0, never done or given up"
    ]
    left_out = study(failed_runs="left out")
    (other_way,) = judged([*crashing, *steady], left_out)
    assert other_way.deciding is not None and other_way.deciding.test.direction == 1
    assert "this favours strategies that fail on hard seeds" in failure_sentences(crashing, left_out)[0]


def test_the_lexicographic_order_takes_places_first_and_then_running_time(plain: RunResult) -> None:
    one = trials(plain, "one", lambda seed: (40, 590.0))
    other = trials(plain, "other", lambda seed: (39, 100.0) if seed % 2 else (40, 100.0))
    (both,) = compare(samples([*one, *other]), [METRICS["lexicographic"]])
    assert both.effect.value == pytest.approx(0.5)
    assert (both.better, both.worse, both.difference) == (10, 10, None)
    never = trials(plain, "never", lambda seed: (39, None))
    late = trials(plain, "late", lambda seed: (40, 599.0))
    (time,) = compare(samples([*never, *late]), [METRICS["completion"]])
    assert (time.effect.value, time.ones, time.others) == (0.0, 600.0, 599.0), "not done counts as later"


Runs = st.tuples(st.integers(0, 40), st.none() | st.floats(1, 600))


@given(st.lists(st.tuples(Runs, Runs), min_size=1, max_size=MIN_PAIRS - 1), st.floats(0.1, 50))
def test_below_the_least_pairs_no_verdict(pairs: list[tuple[Outcome, Outcome]], margin: float) -> None:
    ones, others = ([run(*pair[side]) for pair in pairs] for side in (0, 1))
    for metric in ("lexicographic", "places", "settled"):
        made = study(primary_metric=metric, margins={"places": margin, "settled": margin})
        found = verdict_of(ones, others, made)
        assert not found.is_decided and not any(one.tested or one.differs for one in found.steps)
        assert not any(one.is_estimated for one in found.steps)
    found = verdict_of([run(2)] * MIN_PAIRS, [run(1)] * MIN_PAIRS)
    assert found.deciding is not None and found.deciding.tests == 1, "time, which never came, takes no part"


def test_an_own_result_is_compared_and_more_is_better() -> None:
    def runs(more: float) -> list[Run]:
        return [run(0, outcome={"turns": {"r1": seed + more}}) for seed in range(8)]

    turns, other = (find_metric(f"outcome.{name}", METRICS) for name in ("turns", "other"))
    assert turns is not None and other is not None
    found = comparison_of(sample(runs(1.0), runs(0.0)), turns)
    assert found.difference is not None
    assert (found.better, found.difference.value, found.unit) == (8, 1.0, "")
    assert not comparison_of(sample(runs(1.0), runs(0.0)), other).is_estimated
    assert verdict_of(runs(1.0), runs(0.0), study(primary_metric="outcome.turns")).deciding is not None


def test_variants_are_compared_apart(plain: RunResult) -> None:
    few = [*trials(plain, "a", lambda seed: (1, 1.0), 5), *trials(plain, "b", lambda seed: (2, 1.0), 5)]
    assert compare(samples(few), METRICS.values()) == [] and too_few_sentences(samples(few))[0].startswith(
        "a and b: 5 pairs of runs are"
    )
    records = [
        TrialRecord(record.strategy, record.seed, {"robots.count": robots}, record.result)
        for robots in (4, 8)
        for name in ("one", "other")
        for record in trials(plain, name, lambda seed: (40, float(seed)), 6)
    ]
    made = compare(samples(records), [METRICS["places"]])
    assert [one.variant for one in made] == [(("robots.count", 4),), (("robots.count", 8),)]
    first, _ = judged(records, study())
    assert "equivalent in places done with robots.count = 4 within 1 place: " in verdict_sentence(first)


ROOT = Path(__file__).parents[2]
STUDY = Study(
    name="s",
    task=CLEANING,
    scenario=str(ROOT / "scenarios" / "corridor.toml"),
    strategies=("none", "chapter"),
    seeds=60,
)
CAP = 60
Floats = NDArray[np.float64]


def result_of(plain: RunResult, quality: float) -> RunResult:
    """Return a run of at most 40 places; better runs have more, and then are complete sooner."""
    places = min(40, round(36 + 2 * quality))
    completion = 500 - 50 * quality if places == 40 else None
    return varied(
        plain, places_total=40, places_done=places, completion_s=completion, settled_s=completion,
        simulated_s=600.0,
    )  # fmt: skip


def looked(plain: RunResult, drawn: Floats) -> PairVerdict:
    """After all looks at pairs of these qualities, (pairs, 2)."""
    ones, others = ([result_of(plain, one) for one in drawn[:, side].tolist()] for side in (0, 1))
    return interim_verdict(sample(ones, others), STUDY, stopping_rules(STUDY))


def campaign(
    folder: Path, plain: RunResult, shift: float, seeds: int, study: Study = STUDY, failing: int = 0
) -> Store:
    kept, rng = store.create_store(folder, study), np.random.default_rng(5)
    for trial in study.trials():
        if trial.seed <= seeds:
            result = result_of(plain, rng.normal(shift if trial.strategy == "chapter" else 0.0))
            record = TrialRecord(trial.strategy, trial.seed, {}, result)
            if trial.seed == failing:
                record = TrialRecord(trial.strategy, trial.seed, {}, failure="it rained")
            write_json(kept.path(trial), record)
    return kept


def test_a_large_effect_is_decided_with_fewer_than_fifty_pairs(plain: RunResult, full: bool) -> None:
    """A12 = 0.71 before places are rounded; cap 60."""
    rng, shift, count = np.random.default_rng(7), AssumedEffect().shift, 100 if full else 40
    found = [looked(plain, rng.normal((shift, 0.0), 1.0, (CAP, 2))) for _ in range(count)]
    assert sum(one.deciding is not None for one in found) >= 0.85 * count
    assert np.mean([len(one.looks[-1].sample.pairs) for one in found]) < 50


def test_the_watch_stops_at_the_look_that_decides_and_says_so(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=19)
    watch = InterimAnalysis(kept)
    assert watch.rules.differ.looks == (10, 20, 30, 40, 50, 60)
    early = watch.is_decided()
    campaign(tmp_path / "out", plain, 2.5, seeds=20)
    assert early or watch.is_decided()
    (found,) = watch.verdicts()
    step = found.deciding
    assert step is not None and (step.sample.one, step.sample.other) == ("chapter", "none")
    assert step.threshold is not None and step.test.p <= step.threshold and len(step.sample.pairs) <= 20
    first, second = look_sentences([found], watch.rules)
    assert first.startswith(
        "interim looks after 10, 20, 30, 40, 50, 60 pairs; thresholds of p for a difference "
    )
    after = len(step.sample.pairs)
    assert second.startswith(
        f"chapter and none: decided after {after} pairs; at 10 chapter ahead by places, p"
    )


def test_a_campaign_that_was_looked_at_is_judged_by_its_looks(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=30)
    kept.declare_looks()
    found = evaluate(kept)
    (said,) = [line for line in found.sentences() if line.startswith("chapter is better than none")]
    assert ", at most " in said and said.endswith(" after 20 pairs.") and "Holm" not in said
    assert found.family == [
        "Declared: 1 comparison, with interim looks; 2 tests share the error rate of 5 %."
    ]
    early = campaign(tmp_path / "early", plain, 2.5, seeds=7)
    early.declare_looks()
    assert evaluate(early).sentences()[-1].startswith("chapter and none: no interim look has been reached")


def test_equivalence_stops_a_campaign_too(tmp_path: Path, plain: RunResult) -> None:
    """Every run has all places after as long: the first look at which equivalence can be shown ends it."""
    kept = store.create_store(tmp_path / "out", STUDY)
    for trial in STUDY.trials():
        if trial.seed <= 30:
            write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result_of(plain, 3.0)))
    watch = InterimAnalysis(kept)
    assert watch.is_decided()
    (found,) = watch.verdicts()
    assert found.equivalent and found.deciding is None
    assert "equivalent after 20 pairs; at 10 tied by places" in look_sentences([found], watch.rules)[1]


def test_no_difference_goes_on_to_the_cap(tmp_path: Path, plain: RunResult) -> None:
    short = msgspec.structs.replace(STUDY, seeds=20)
    kept = campaign(tmp_path / "out", plain, 0.0, seeds=19, study=short)
    watch = InterimAnalysis(kept)
    assert not watch.is_decided()
    campaign(tmp_path / "out", plain, 0.0, seeds=20, study=short, failing=20)
    assert watch.is_decided()
    (found,) = watch.verdicts()
    assert (len(found.sample.pairs), found.at_cap) == (20, True)
    assert (
        "chapter and none: not decided at the last look, after 20 pairs; at 10 "
        in look_sentences([found], watch.rules)[1]
    )


def test_only_seeds_that_have_ended_for_all_are_looked_at(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=12)
    kept.path(next(STUDY.trials_of(4))).unlink()
    watch = InterimAnalysis(kept)
    assert not watch.is_decided()
    (found,) = watch.verdicts()
    assert len(found.sample.pairs) == 3 and not found.looks
    assert look_sentences([found], watch.rules)[1] == "chapter and none: 3 pairs, no look reached yet"


def test_the_maximum_is_fixed_after_the_first_look(tmp_path: Path) -> None:
    store.create_store(tmp_path / "out", STUDY).declare_looks()
    store.create_store(tmp_path / "out", STUDY).declare_looks()
    more = store.create_store(tmp_path / "out", msgspec.structs.replace(STUDY, seeds=80))
    with pytest.raises(AcrcError, match=r"has had interim looks for 60 pairs by .*; 80 pairs"):
        more.declare_looks()


def test_several_comparisons_share_the_error(tmp_path: Path) -> None:
    three = msgspec.structs.replace(
        STUDY,
        strategies=("none", "chapter", "released"),
        primary=(("chapter", "none"), ("chapter", "released")),
    )
    alone = InterimAnalysis(store.create_store(tmp_path / "one", STUDY)).rules.differ
    shared = InterimAnalysis(store.create_store(tmp_path / "two", three)).rules.differ
    assert shared.looks == alone.looks
    assert all(one < other for one, other in zip(shared.thresholds, alone.thresholds, strict=True))
    with pytest.raises(AcrcError, match="the study declares no comparison"):
        InterimAnalysis(store.create_store(tmp_path / "three", msgspec.structs.replace(three, primary=())))
    with pytest.raises(AcrcError, match="primary_metric is 'speed'; must be one of places, settled"):
        InterimAnalysis(
            store.create_store(tmp_path / "four", msgspec.structs.replace(STUDY, primary_metric="speed"))
        )


def pairs(shift: float, count: int, seed: int = 3) -> PairedSample:
    """Places of two strategies of which one is better."""
    rng = np.random.default_rng(seed)
    ones, others = (rng.normal(mean, 1.0, count) for mean in (shift, 0.0))
    return sample(*([run(round(1000 + 100 * one)) for one in side.tolist()] for side in (ones, others)))


def test_the_family_that_will_be_tested_is_the_one_that_is_promised() -> None:
    """With three comparisons more, that share the 5 %, the same pilot promises less."""
    one = pairs(AssumedEffect(0.75).shift, 60)
    four = msgspec.structs.replace(
        study(), strategies=("one", "other", "b", "c", "d"),
        primary=(("one", "other"), ("b", "other"), ("c", "other"), ("d", "other")),
    )  # fmt: skip
    others = [pairs(0.0, 60, seed)._replace(one=name) for seed, name in enumerate("bcd")]
    alone = simulated_power([one], study(), 20, np.random.default_rng(1))[0]
    shared = simulated_power([one, *others], four, 20, np.random.default_rng(1))
    assert shared[0] < alone - 0.1
    assert max(shared[1:]) < 0.2


def test_sizes_grow_until_the_power_is_reached_and_small_pilots_are_doubted() -> None:
    made = list(power_estimates([pairs(AssumedEffect(0.85).shift, 12)], study(), 0.9))
    assert [one.pairs for one in made] == [6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200][
        : len(made)
    ]
    assert made[-1].cautious[0] >= 0.9 and all(one.cautious[0] < 0.9 for one in made[:-1])
    first = next(one for one in made if one.shares[0] >= 0.9)
    assert first.cautious[0] < 0.9


def test_a_ceiling_is_pointed_out_with_a_harder_condition(plain: RunResult) -> None:
    def made(done: int, robots: int) -> list[TrialRecord]:
        times = [320.0 + 10 * seed if seed < done else None for seed in range(10)]
        return [
            TrialRecord(
                "a", seed, {},
                varied(
                    plain, places_done=39 + (at is not None), places_total=40, completion_s=at,
                    settled_s=at, simulated_s=600.0, robots=robots,
                ),
            )
            for seed, at in enumerate(times)
        ]  # fmt: skip

    assert list(ceiling_sentences(made(4, 4), study())) == []
    (said,) = ceiling_sentences(made(5, 4), study())
    assert said.startswith("5 of 10 runs have the largest possible value of places done (ceiling effect).")
    assert said.endswith(" Use a harder condition, such as --robots 8 and --duration 320.")
    assert "such as --duration 340" in next(iter(ceiling_sentences(made(10, 8), study())))


def test_the_last_look_without_failed_runs(tmp_path: Path, plain: RunResult) -> None:
    short = msgspec.structs.replace(STUDY, seeds=20, failed_runs="left out")
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=20, study=short, failing=20)
    (found,) = InterimAnalysis(kept).verdicts()
    assert (len(found.sample.pairs), found.at_cap) == (19, True)
    assert found.looks[-1].threshold == InterimAnalysis(kept).rules.differ.thresholds[-1]
    assert found.deciding is not None
