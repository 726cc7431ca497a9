"""Stopping early: by looks planned ahead, without claiming more than at the end."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.runtime.errors import AcrcError
from experiments.campaign import store
from experiments.campaign.store import Store
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.comparison.comparison import PairedSample
from experiments.comparison.decision import LookedAt, Watch, look, rules_for, told
from experiments.comparison.family import verdicts
from experiments.comparison.judgement import judge
from experiments.comparison.metrics import judged
from experiments.comparison.pilot import ceilings, promises, told_apart
from experiments.statistics.paired_tests import Effect, power
from experiments.study.study import Study
from observation.results.result import RunResult
from tests.experiments.made_runs import run, sample, study

ROOT = Path(__file__).parents[2]
STUDY = Study("s", str(ROOT / "scenarios" / "corridor.toml"), ("none", "chapter"), 60)
CAP = 60
Floats = NDArray[np.float64]


def result_of(plain: RunResult, quality: float) -> RunResult:
    """A run of 40 places at most: the better, the more of them, and once all are done the sooner."""
    places = min(40, round(36 + 2 * quality))
    completion = 500 - 50 * quality if places == 40 else None
    return msgspec.structs.replace(
        plain, places_total=40, places_done=places, completion_s=completion, settled_s=completion,
        simulated_s=600.0,
    )  # fmt: skip


def looked(plain: RunResult, drawn: Floats) -> LookedAt:
    """After all looks at pairs of these qualities, (pairs, 2)."""
    ones, others = ([judged(result_of(plain, one)) for one in drawn[:, side].tolist()] for side in (0, 1))
    return look(sample(ones, others), STUDY, rules_for(STUDY))


def campaign(
    folder: Path, plain: RunResult, shift: float, seeds: int, study: Study = STUDY, failing: int = 0
) -> Store:
    kept, rng = store.create(folder, study), np.random.default_rng(5)
    for trial in study.trials():
        if trial.seed <= seeds:
            result = result_of(plain, rng.normal(shift if trial.strategy == "chapter" else 0.0))
            record = TrialRecord(trial.strategy, trial.seed, {}, result)
            if trial.seed == failing:
                record = TrialRecord(trial.strategy, trial.seed, {}, failure="it rained")
            keep(kept.path(trial), record)
    return kept


def test_a_campaign_against_itself_is_decided_in_five_of_a_hundred_at_most(
    plain: RunResult, full: bool
) -> None:
    """Campaigns of 60 pairs, places and then time, six looks: 5 % and three standard errors."""
    rng, count = np.random.default_rng(6), 300 if full else 100
    drawn = (looked(plain, rng.normal(size=(CAP, 2))) for _ in range(count))
    assert sum(one.verdict.deciding is not None for one in drawn) <= (26 if full else 11)


def test_a_large_effect_is_decided_with_fewer_than_fifty_pairs_on_average(
    plain: RunResult, full: bool
) -> None:
    """A12 = 0.71 before places are rounded; cap 60."""
    rng, shift, count = np.random.default_rng(7), Effect().shift, 100 if full else 40
    found = [looked(plain, rng.normal((shift, 0.0), 1.0, (CAP, 2))) for _ in range(count)]
    assert sum(one.verdict.deciding is not None for one in found) >= 0.85 * count
    assert np.mean([len(one.looks[-1].sample.pairs) for one in found]) < 50


def test_the_watch_stops_at_the_look_that_decides_and_says_so(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=19)
    watch = Watch(kept)
    assert watch.rules.differ.looks == (10, 20, 30, 40, 50, 60)
    early = watch.enough()
    campaign(tmp_path / "out", plain, 2.5, seeds=20)
    assert early or watch.enough()
    (found,) = watch.looked_at()
    step = found.verdict.deciding
    assert step is not None and (step.sample.one, step.sample.other) == ("chapter", "none")
    assert step.threshold is not None and step.test.p <= step.threshold and len(step.sample.pairs) <= 20
    first, second = told([found], watch.rules)
    assert first.startswith(
        "looks after 10, 20, 30, 40, 50, 60 pairs, at most 60; for a difference p must be at most "
    )
    after = len(step.sample.pairs)
    assert second.startswith(
        f"chapter and none: decided after {after} pairs; at 10 chapter ahead by places, p"
    )


def test_a_campaign_that_was_looked_at_is_judged_by_its_looks(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=30)
    kept.declare_looks()
    found = judge(kept)
    (said,) = [line for line in found.sentences() if line.startswith("chapter is better than none")]
    assert ", at most " in said and said.endswith(" after 20 pairs.") and "Holm" not in said
    assert found.family == ["Declared: 1 comparison, looked at on the way; 2 tests share the 5 %."]
    early = campaign(tmp_path / "early", plain, 2.5, seeds=7)
    early.declare_looks()
    assert (
        judge(early).sentences()[-1]
        == "chapter and none: none of the looks has come, so nothing is said yet."
    )


def test_equivalence_stops_a_campaign_too(tmp_path: Path, plain: RunResult) -> None:
    """Every run has all places after as long: the first look at which equivalence can be shown ends it."""
    kept = store.create(tmp_path / "out", STUDY)
    for trial in STUDY.trials():
        if trial.seed <= 30:
            keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result_of(plain, 3.0)))
    watch = Watch(kept)
    assert watch.enough()
    (found,) = watch.looked_at()
    assert found.verdict.equivalent and found.verdict.deciding is None
    assert (
        "chapter and none: equivalent after 20 pairs; at 10 level by places" in told([found], watch.rules)[1]
    )


def test_no_difference_goes_on_to_the_cap(tmp_path: Path, plain: RunResult) -> None:
    short = msgspec.structs.replace(STUDY, seeds=20)
    kept = campaign(tmp_path / "out", plain, 0.0, seeds=19, study=short)
    watch = Watch(kept)
    assert not watch.enough()
    campaign(tmp_path / "out", plain, 0.0, seeds=20, study=short, failing=20)
    assert watch.enough()
    (found,) = watch.looked_at()
    assert (len(found.verdict.sample.pairs), found.at_cap) == (20, True)
    assert "chapter and none: not decided by the cap, after 20 pairs; at 10 " in told([found], watch.rules)[1]


def test_only_seeds_that_have_ended_for_all_are_looked_at(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=12)
    kept.path(next(STUDY.trials_of(4))).unlink()
    watch = Watch(kept)
    assert not watch.enough()
    (found,) = watch.looked_at()
    assert len(found.verdict.sample.pairs) == 3 and not found.looks
    assert told([found], watch.rules)[1] == "chapter and none: 3 pairs, none of the looks has come"


def test_the_cap_stays_what_it_was_once_somebody_has_looked(tmp_path: Path) -> None:
    store.create(tmp_path / "out", STUDY).declare_looks()
    store.create(tmp_path / "out", STUDY).declare_looks()
    more = store.create(tmp_path / "out", msgspec.structs.replace(STUDY, seeds=80))
    with pytest.raises(AcrcError, match=r"was looked at on the way to 60 pairs; with 80 the error rate"):
        more.declare_looks()


def test_several_comparisons_share_the_error(tmp_path: Path) -> None:
    three = msgspec.structs.replace(
        STUDY,
        strategies=("none", "chapter", "released"),
        primary=(("chapter", "none"), ("chapter", "released")),
    )
    alone = Watch(store.create(tmp_path / "one", STUDY)).rules.differ
    shared = Watch(store.create(tmp_path / "two", three)).rules.differ
    assert shared.looks == alone.looks
    assert all(one < other for one, other in zip(shared.thresholds, alone.thresholds, strict=True))
    with pytest.raises(AcrcError, match="the study declares no comparison"):
        Watch(store.create(tmp_path / "three", msgspec.structs.replace(three, primary=())))
    with pytest.raises(AcrcError, match="primary_metric is 'speed'; must be one of places, contacts"):
        Watch(store.create(tmp_path / "four", msgspec.structs.replace(STUDY, primary_metric="speed")))


def pairs(shift: float, count: int, seed: int = 3) -> PairedSample:
    """Places of two strategies of which one is better."""
    rng = np.random.default_rng(seed)
    ones, others = (rng.normal(mean, 1.0, count) for mean in (shift, 0.0))
    return sample(*([run(round(1000 + 100 * one)) for one in side.tolist()] for side in (ones, others)))


def delivered(found: Sequence[PairedSample], made: Study) -> bool:
    return all(one.deciding is not None for one in verdicts(found, made))


def test_what_a_large_pilot_promises_the_comparison_delivers(full: bool) -> None:
    """A12 = 0.8 in 400 pilot pairs: by resampling, by the model, and by comparisons of fresh campaigns."""
    effect, made = Effect(0.8), study()
    promised = told_apart([pairs(effect.shift, 400)], made, 20, np.random.default_rng(1))[0]
    fresh = [delivered([pairs(effect.shift, 20, seed)], made) for seed in range(100, 300 if full else 180)]
    assert promised == pytest.approx(np.mean(fresh), abs=0.1 if full else 0.15)
    assert promised == pytest.approx(
        power(effect, 20), abs=0.1
    )  # no run is settled: places have all of the 5 %


def test_the_family_that_will_be_tested_is_the_one_that_is_promised() -> None:
    """With three comparisons more, that share the 5 %, the same pilot promises less."""
    one = pairs(Effect(0.75).shift, 60)
    four = msgspec.structs.replace(
        study(), strategies=("one", "other", "b", "c", "d"),
        primary=(("one", "other"), ("b", "other"), ("c", "other"), ("d", "other")),
    )  # fmt: skip
    others = [pairs(0.0, 60, seed)._replace(one=name) for seed, name in enumerate("bcd")]
    alone = told_apart([one], study(), 20, np.random.default_rng(1))[0]
    shared = told_apart([one, *others], four, 20, np.random.default_rng(1))
    assert shared[0] < alone - 0.1
    assert max(shared[1:]) < 0.2


def test_sizes_grow_until_the_power_is_reached_and_small_pilots_are_doubted() -> None:
    made = list(promises([pairs(Effect(0.85).shift, 12)], study(), 0.9))
    assert [one.pairs for one in made] == [6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200][
        : len(made)
    ]
    assert made[-1].shares[0] >= 0.9 and all(one.shares[0] < 0.9 for one in made[:-1])
    assert made[-1].cautious[0] < made[-1].shares[0]


def test_a_ceiling_is_pointed_out_with_a_harder_condition(plain: RunResult) -> None:
    def made(done: int, robots: int) -> list[TrialRecord]:
        times = [320.0 + 10 * seed if seed < done else None for seed in range(10)]
        return [
            TrialRecord(
                "a", seed, {},
                msgspec.structs.replace(plain, completion_s=at, simulated_s=600.0, robots=robots),
            )
            for seed, at in enumerate(times)
        ]  # fmt: skip

    assert list(ceilings(made(4, 4))) == []
    (said,) = ceilings(made(5, 4))
    assert said == (
        "5 of 10 runs have all places: they are at their ceiling there."
        " A harder condition tells more: --robots 8 and --duration 320."
    )
    assert "tells more: --duration 340" in next(iter(ceilings(made(10, 8))))


def test_the_last_look_takes_the_pairs_there_are_where_failed_runs_are_left_out(
    tmp_path: Path, plain: RunResult
) -> None:
    short = msgspec.structs.replace(STUDY, seeds=20, failed_runs="left out")
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=20, study=short, failing=20)
    (found,) = Watch(kept).looked_at()
    assert (len(found.verdict.sample.pairs), found.at_cap) == (19, True)
    assert found.looks[-1].threshold == Watch(kept).rules.differ.thresholds[-1]
    assert found.verdict.deciding is not None
