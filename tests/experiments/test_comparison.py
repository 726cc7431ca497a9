"""Comparisons of made-up trials of which it is known what they should say."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.runtime.errors import AcrcError
from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import compare, estimate, samples
from experiments.comparison.decision import rules_for
from experiments.comparison.family import foreseen, verdicts
from experiments.comparison.judgement import failures, family, too_few, verdict
from experiments.comparison.metrics import JudgedRun
from experiments.statistics.paired_tests import LEAST_PAIRS
from experiments.study.study import Factor, Study
from observation.results.result import RunResult
from tests.experiments.made_runs import Outcome, judged, run, sample, study, trials, verdict_of

TOO_FEW = (
    "5 pairs of runs are too few: the exact test needs 6 to reach 5 %, whatever the runs show. Nothing is "
    "tested or estimated."
)


def test_more_places_are_better_whatever_the_time() -> None:
    found = verdict_of(
        [run(40, 500.0 + seed) for seed in range(20)], [run(20 + seed % 5) for seed in range(20)]
    )
    assert found.deciding is not None and found.deciding.metric == "places"
    assert verdict(found) == (
        "one is better than other by places done: 40 against 22, difference +18 places [+17.3, +18.7], "
        "better on 20 of 20 seeds, worse on 0, equal on 0, A12 = 1.00 [0.90, 1.00], p = 1.9e-06, "
        "after Holm 3.8e-06."
    )


def test_time_decides_only_where_places_are_shown_to_be_equal() -> None:
    fast = [run(40, 300.0 + seed) for seed in range(20)]
    slow = [run(40, None if seed % 7 == 0 else 400.0 + seed) for seed in range(20)]
    said = verdict(verdict_of(fast, slow))
    assert said.startswith("one is as good as other by places done, within 1 place: 40 against 40")
    assert "for equivalence; 0 of 20 seeds differ by more, so that of all up to 14 % may. So time" in said
    assert "So time decides: one is better than other by running time: 309.5 against " in said
    # places that vary and do not differ on average: neither different nor shown to be equal
    rng = np.random.default_rng(2)
    noisy = [
        run(int(places), at.settled_s) for places, at in zip(rng.integers(20, 40, 20), fast, strict=True)
    ]
    others = [
        run(int(places), at.settled_s) for places, at in zip(rng.integers(20, 40, 20), slow, strict=True)
    ]
    open_one = verdict_of(noisy, others)
    assert open_one.deciding is None
    assert verdict(open_one).endswith(
        "They are not shown to be equal within 1 place, so time does not decide."
    )


def test_the_direction_is_that_of_the_test_and_a_disagreement_is_said() -> None:
    """34 of 40 seeds a little better, 6 much worse: the signed-rank test and the mean speak for two sides."""
    ones = [run(22) if seed < 34 else run(2) for seed in range(40)]
    others = [run(20) for _ in range(40)]
    found = verdict_of(ones, others)
    (places, _) = found.steps
    assert places.differs and places.test.direction == 1
    estimated = places.estimated()
    assert estimated is not None and estimated.difference is not None and estimated.difference.value < 0
    assert verdict(found).startswith(
        "one beside other by places done: better on 34 of 40 seeds (median 2 places), much worse on 6 "
        "(median 18 places); test and effect disagree: 19 against 20, difference -1 places [-3.31, +1.31], "
    )
    mirrored = verdict(verdict_of(others, ones))
    assert mirrored.startswith(
        "one beside other by places done: worse on 34 of 40 seeds (median 2 places), much"
    )


def test_where_no_run_was_settled_time_decides_nothing() -> None:
    never = [run(10, length=120.0) for _ in range(12)]
    found = verdict_of(never, never)
    assert found.deciding is None and not found.equivalent
    assert verdict(found).endswith("Time decides nothing: no run was done or given up by 120 s.")


def test_a_test_that_cannot_decide_says_so_and_costs_the_others_nothing() -> None:
    few = [run(21 if seed < 5 else 20) for seed in range(20)]
    level = [run(20) for _ in range(20)]
    alone = verdict_of(few, level).steps[0]
    assert (alone.test.differing, alone.tested, alone.adjusted) == (5, False, 1.0)
    assert "whatever the effect, as 5 of 20 pairs differ and a test needs 6: " in verdict(
        verdict_of(few, level, study(margin_places=0.1))
    )
    six = [run(21 if seed < 6 else 20) for seed in range(20)]
    (place, time) = verdict_of(six, level).steps
    assert (place.tested, place.adjusted, place.differs) == (
        True,
        2 / 2**6,
        True,
    )  # time tells nothing, shares nothing
    assert not time.tested


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
    assert family(found, three) == [
        "Declared: 2 comparisons, 4 tests; 2 can decide, with 5 % in all by Holm's correction; "
        "2 cannot, because too few pairs differ."
    ]
    assert family([], three) == []
    assert family([], Study("s", "/s.toml", ("a", "b", "c"), 40)) == [
        "No comparison was declared, so nothing is tested; all that follows is exploration."
    ]


def test_what_no_run_can_show_is_said_before_the_first() -> None:
    assert foreseen(study(seeds=5)) == [f"acrc compare will say nothing of strategies: {TOO_FEW}"]
    assert foreseen(study(seeds=6)) == foreseen(study(seeds=6, primary_metric="places")) == []
    assert foreseen(study(seeds=6, factors=(Factor("robots.count", (4, 8)),))) == []
    assert foreseen(study(seeds=3), rules_for(study(seeds=3)).least)[0].startswith(
        "acrc compare will say nothing of strategies: 3 pairs of runs are too few: the exact test needs 7 to"
    )
    undeclared = Study("s", "/s.toml", ("a", "b", "c"), 40)
    assert foreseen(undeclared)[0].startswith(
        "The study declares no comparison, so acrc compare will estimate"
    )
    with pytest.raises(AcrcError, match="primary_metric is 'speed'; must be one of places, contacts"):
        verdicts([sample([run(1)], [run(1)])], study(primary_metric="speed"))


def test_crashing_on_hard_seeds_improves_nobody(plain: RunResult) -> None:
    """A strategy fails on half of the seeds, where the other does 10 places; elsewhere it does one more."""
    crashing = [*trials(plain, "one", lambda seed: None if seed % 2 else (31, None), 40)]
    steady = [*trials(plain, "other", lambda seed: (10, None) if seed % 2 else (30, None), 40)]
    made = study()
    (found,) = judged([*steady, *crashing], made)
    assert (found.sample.one, found.sample.other) == ("one", "other"), "as declared"
    assert found.deciding is not None and found.deciding.test.direction == -1
    assert "15.5 against 20, difference -4.5 places" in verdict(found)
    assert failures([*crashing, *steady], made) == [
        "one failed in 20 of 40 runs (seeds 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, …); "
        "each counts as a run that did no place and was never settled"
    ]
    left_out = study(failed_runs="left out")
    (other_way,) = judged([*crashing, *steady], left_out)
    assert other_way.deciding is not None and other_way.deciding.test.direction == 1
    assert "which favours strategies that fail on hard seeds" in failures(crashing, left_out)[0]


def test_the_lexicographic_order_takes_places_first_and_then_running_time(plain: RunResult) -> None:
    one = trials(plain, "one", lambda seed: (40, 590.0))
    other = trials(plain, "other", lambda seed: (39, 100.0) if seed % 2 else (40, 100.0))
    (both,) = compare(samples([*one, *other]), "lexicographic")
    assert both.effect.value == pytest.approx(0.5)
    assert (both.better, both.worse, both.difference) == (10, 10, None)
    never = trials(plain, "never", lambda seed: (39, None))
    late = trials(plain, "late", lambda seed: (40, 599.0))
    (time,) = compare(samples([*never, *late]), "completion")
    assert (time.effect.value, time.ones, time.others) == (0.0, 600.0, 599.0), "not done counts as later"


Runs = st.tuples(st.integers(0, 40), st.none() | st.floats(1, 600))


@given(st.lists(st.tuples(Runs, Runs), min_size=1, max_size=LEAST_PAIRS - 1), st.floats(0.1, 50))
def test_below_the_least_pairs_no_verdict_is_possible(
    pairs: list[tuple[Outcome, Outcome]], margin: float
) -> None:
    ones, others = ([run(*pair[side]) for pair in pairs] for side in (0, 1))
    for metric in ("lexicographic", "places", "settled"):
        made = study(primary_metric=metric, margin_places=margin, margin_s=margin)
        found = verdict_of(ones, others, made)
        assert not found.settled and not any(one.tested or one.differs for one in found.steps)
        assert not any(one.estimated() for one in found.steps)


def test_an_own_result_is_compared_and_more_is_better() -> None:
    def runs(more: float) -> list[JudgedRun]:
        return [JudgedRun(outcomes={"turns": seed + more}) for seed in range(8)]

    found = estimate(sample(runs(1.0), runs(0.0)), "outcome.turns")
    assert found is not None and found.difference is not None
    assert (found.better, found.difference.value, found.unit) == (8, 1.0, "")
    assert estimate(sample(runs(1.0), runs(0.0)), "outcome.other") is None
    assert verdict_of(runs(1.0), runs(0.0), study(primary_metric="outcome.turns")).deciding is not None


def test_variants_are_compared_apart(plain: RunResult) -> None:
    few = [*trials(plain, "a", lambda seed: (1, 1.0), 5), *trials(plain, "b", lambda seed: (2, 1.0), 5)]
    assert compare(samples(few)) == [] and too_few(samples(few)) == [f"a and b: {TOO_FEW}"]
    records = [
        TrialRecord(record.strategy, record.seed, {"robots.count": robots}, record.result)
        for robots in (4, 8)
        for name in ("one", "other")
        for record in trials(plain, name, lambda seed: (40, float(seed)), 6)
    ]
    made = compare(samples(records), "places")
    assert [one.variant for one in made] == [(("robots.count", 4),), (("robots.count", 8),)]
    first, _ = judged(records, study())
    assert "one is as good as other by places done with robots.count = 4, within 1 place: " in verdict(first)


def test_with_the_least_pairs_a_verdict_is_possible() -> None:
    found = verdict_of([run(2)] * LEAST_PAIRS, [run(1)] * LEAST_PAIRS)
    assert found.deciding is not None and found.deciding.tests == 1, "time, which never came, takes no part"
    assert not verdict_of([run(2)] * (LEAST_PAIRS - 1), [run(1)] * (LEAST_PAIRS - 1)).settled
