"""What a pilot says: how many pairs its effects need, and where its runs are too easy."""

import msgspec
import numpy as np
import pytest

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import samples
from experiments.comparison.pilot import ceilings, estimate, told
from observation.results.result import RunResult


def records(plain: RunResult, shift: float, common: float, pairs: int = 200) -> list[TrialRecord]:
    """Places of two strategies that share part of what a seed brings."""
    rng = np.random.default_rng(3)
    made = []
    for seed in range(1, pairs + 1):
        shared = rng.normal() * common**0.5
        for name, mean in (("new", shift), ("old", 0.0)):
            places = round(1000 + 100 * (mean + shared + rng.normal() * (1 - common) ** 0.5))
            result = msgspec.structs.replace(plain, places_done=places, completion_s=None, simulated_s=600.0)
            made.append(TrialRecord(name, seed, {}, result))
    return made


def test_a_pilot_finds_effect_correlation_and_pairs_again(plain: RunResult) -> None:
    """A12 = 0.71, ρ = 0.3: 27 pairs, give or take what 200 pairs leave open."""
    (sample,) = samples(records(plain, 0.783, 0.3))
    found = estimate(sample, "places", 0.9, 1)
    assert found.effect is not None and found.effect.value == pytest.approx(0.71, abs=0.04)
    assert found.correlation == pytest.approx(0.3, abs=0.15)
    assert found.needed is not None and 18 <= found.needed <= 42
    assert found.needed_at_least is not None and found.needed_at_least > found.needed
    assert f"{found.needed} pairs show it with probability 0.9 at 5 %, " in told(found)


def test_a_pilot_that_does_not_tell_says_so(plain: RunResult) -> None:
    (sample,) = samples(records(plain, 0.4, 0.0, pairs=10))
    assert "the pilot does not tell whether it is" in told(estimate(sample, "places", 0.9, 1))
    (same,) = samples(records(plain, 0.0, 0.0))
    assert told(estimate(same, "places", 0.9, 1)).endswith("needed to show an effect so small.")
    (few,) = samples(records(plain, 1.0, 0.0, pairs=4))
    assert told(estimate(few, "places", 0.9, 1)).startswith("new and old by places: 4 pairs; at least 6 are")


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
