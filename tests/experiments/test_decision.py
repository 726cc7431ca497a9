"""Stopping early: by looks planned ahead, without claiming more than at the end."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.runtime.errors import AcrcError
from experiments.campaign import store
from experiments.campaign.store import Store
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.comparison.decision import Watch, p_of, rule_for, told
from experiments.statistics.sample_size import Effect
from experiments.statistics.sequential import last_look
from experiments.study.study import Study
from observation.results.result import RunResult

ROOT = Path(__file__).parents[2]
STUDY = Study("s", str(ROOT / "scenarios" / "corridor.toml"), ("none", "chapter"), 60)
CAP = 60


def run(plain: RunResult, quality: float) -> RunResult:
    """A run of 40 places at most: the better, the more of them, and once all are done the sooner."""
    places = min(40, round(36 + 2 * quality))
    completion = 500 - 50 * quality if places == 40 else None
    return msgspec.structs.replace(
        plain, places_total=40, places_done=places, completion_s=completion, simulated_s=600.0
    )


def campaign(
    folder: Path, plain: RunResult, shift: float, seeds: int, study: Study = STUDY, failing: int = 0
) -> Store:
    kept, rng = store.create(folder, study), np.random.default_rng(5)
    for trial in study.trials():
        if trial.seed <= seeds:
            result = run(plain, rng.normal(shift if trial.strategy == "chapter" else 0.0))
            record = TrialRecord(trial.strategy, trial.seed, {}, result)
            if trial.seed == failing:
                record = TrialRecord(trial.strategy, trial.seed, {}, failure="it rained")
            keep(kept.path(trial), record)
    return kept


def test_a_campaign_against_itself_is_decided_in_five_of_a_hundred_at_most(plain: RunResult) -> None:
    """1000 campaigns of 60 pairs in the lexicographic order, six looks: 5 % and three standard errors."""
    rng, rule = np.random.default_rng(6), rule_for(CAP)
    claims = 0
    for _ in range(1000):
        drawn = rng.normal(size=(CAP, 2)).tolist()
        pairs = [(run(plain, one), run(plain, other)) for one, other in drawn]
        look = last_look(lambda n, pairs=pairs: p_of("lexicographic", pairs[:n]), CAP, rule)  # type: ignore[misc]
        claims += look is not None and look.decides
    assert claims <= 68


def test_a_large_effect_is_decided_with_fewer_than_fifty_pairs_on_average(plain: RunResult) -> None:
    """A12 = 0.71 before places are rounded; cap 60."""
    rng, rule, shift = np.random.default_rng(7), rule_for(CAP), Effect().shift
    looks = []
    for _ in range(300):
        drawn = rng.normal((shift, 0.0), 1.0, (CAP, 2)).tolist()
        pairs = [(run(plain, one), run(plain, other)) for one, other in drawn]
        looks.append(last_look(lambda n, pairs=pairs: p_of("lexicographic", pairs[:n]), CAP, rule))  # type: ignore[misc]
    assert sum(look is not None and look.decides for look in looks) >= 270
    assert np.mean([look.pairs for look in looks if look is not None]) < 50


def test_the_watch_stops_at_the_look_that_decides_and_says_so(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=19)
    watch = Watch(kept)
    assert watch.rule.looks == (10, 20, 30, 40, 50, 60)
    early = watch.enough()
    campaign(tmp_path / "out", plain, 2.5, seeds=20)
    assert early or watch.enough()
    (verdict,) = watch.verdicts()
    assert (verdict.one, verdict.other) == ("chapter", "none")
    assert verdict.look is not None and verdict.look.decides and verdict.look.pairs <= 20
    first, second = told([verdict], watch.rule, "lexicographic")
    assert first.startswith(
        "looks after 10, 20, 30, 40, 50, 60 pairs, at most 60, by lexicographic; p must be"
    )
    assert second.startswith(f"chapter and none: decided after {verdict.look.pairs} pairs, p = ")


def test_no_difference_goes_on_to_the_cap(tmp_path: Path, plain: RunResult) -> None:
    short = msgspec.structs.replace(STUDY, seeds=20)
    kept = campaign(tmp_path / "out", plain, 0.0, seeds=19, study=short)
    watch = Watch(kept)
    assert not watch.enough()
    campaign(tmp_path / "out", plain, 0.0, seeds=20, study=short, failing=20)
    assert watch.enough()
    (verdict,) = watch.verdicts()
    assert (verdict.pairs, verdict.at_cap) == (19, True)
    assert (
        "chapter and none: not decided by the cap, after 10 pairs p = " in told([verdict], watch.rule, "x")[1]
    )


def test_only_seeds_that_have_ended_for_all_are_looked_at(tmp_path: Path, plain: RunResult) -> None:
    kept = campaign(tmp_path / "out", plain, 2.5, seeds=12)
    kept.path(next(STUDY.trials_of(4))).unlink()
    watch = Watch(kept)
    assert not watch.enough()
    assert watch.verdicts()[0].pairs == 3


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
    alone = Watch(store.create(tmp_path / "one", STUDY)).rule
    shared = Watch(store.create(tmp_path / "two", three)).rule
    assert shared.looks == alone.looks
    assert all(one < other for one, other in zip(shared.thresholds, alone.thresholds, strict=True))
    with pytest.raises(AcrcError, match="the study declares no comparison"):
        Watch(store.create(tmp_path / "three", msgspec.structs.replace(three, primary=())))
    with pytest.raises(AcrcError, match="primary_metric is 'speed'; must be one of places, contacts"):
        Watch(store.create(tmp_path / "four", msgspec.structs.replace(STUDY, primary_metric="speed")))
