"""What a pilot says: how many pairs its comparisons need, and where its runs are too easy."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import PairedSample
from experiments.comparison.family import verdicts
from experiments.comparison.pilot import ceilings, promises, told_apart
from experiments.statistics.sample_size import Effect, power
from experiments.study.study import Study
from observation.results.result import RunResult
from tests.experiments.made_runs import run, sample, study


def pairs(shift: float, count: int, seed: int = 3) -> PairedSample:
    """Places of two strategies of which one is better."""
    rng = np.random.default_rng(seed)
    ones, others = (rng.normal(mean, 1.0, count) for mean in (shift, 0.0))
    return sample(*([run(round(1000 + 100 * one)) for one in side.tolist()] for side in (ones, others)))


def delivered(found: Sequence[PairedSample], made: Study) -> bool:
    return all(one.deciding is not None for one in verdicts(found, made))


def test_what_a_large_pilot_promises_the_comparison_delivers() -> None:
    """A12 = 0.8 in 400 pilot pairs: by resampling, by the model, and by comparisons of fresh campaigns."""
    effect, made = Effect(0.8), study()
    promised = told_apart([pairs(effect.shift, 400)], made, 20, np.random.default_rng(1))[0]
    fresh = [delivered([pairs(effect.shift, 20, seed)], made) for seed in range(100, 300)]
    assert promised == pytest.approx(np.mean(fresh), abs=0.1)
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
