"""Comparisons of made-up trials of which it is known what they should say."""

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import compare, samples
from experiments.comparison.sentences import chapter_order, sentence, too_few
from observation.results.result import RunResult

Outcome = tuple[int, float | None]
"""Places done, and when all were."""


def trials(
    plain: RunResult, strategy: str, outcome: Callable[[int], Outcome], seeds: int = 20
) -> Iterator[TrialRecord]:
    for seed in range(1, seeds + 1):
        places, completion = outcome(seed)
        result = msgspec.structs.replace(
            plain, places_done=places, completion_s=completion, settled_s=completion, simulated_s=600.0
        )
        yield TrialRecord(strategy, seed, {}, result)


def test_more_places_are_better_whatever_the_time(plain: RunResult) -> None:
    good = trials(plain, "good", lambda seed: (40, 500.0 + seed))
    bad = trials(plain, "bad", lambda seed: (20 + seed % 5, None))
    made = compare(samples([*good, *bad]))
    (places,) = [one for one in made if one.metric == "places"]
    assert places.effect == (1.0, 1.0, 1.0)
    assert places.differ
    (said,) = chapter_order(made)
    assert said.startswith("good is better than bad by places done: 40 against 22, A12 = 1.00 [1.00, 1.00]")


def test_time_decides_where_places_do_not_differ(plain: RunResult) -> None:
    fast = trials(plain, "fast", lambda seed: (40, 300.0 + seed))
    slow = trials(plain, "slow", lambda seed: (40, None if seed % 7 == 0 else 400.0 + seed))
    (said,) = chapter_order(compare(samples([*fast, *slow])))
    assert said.startswith("fast cannot be told from slow by places done")
    assert "So time decides: fast is better than slow by time until all places are done, s" in said


def test_a_run_that_was_not_done_counts_as_later_than_every_one_that_was(plain: RunResult) -> None:
    never = trials(plain, "never", lambda seed: (39, None))
    late = trials(plain, "late", lambda seed: (40, 599.0))
    (time,) = compare(samples([*never, *late]), "completion")
    assert time.effect.value == 0.0
    assert (time.ones, time.others) == (600.0, 599.0)


def test_the_lexicographic_order_takes_places_first_and_then_time(plain: RunResult) -> None:
    one = trials(plain, "one", lambda seed: (40, 590.0))
    other = trials(plain, "other", lambda seed: (39, None) if seed % 2 else (40, 100.0))
    (both,) = compare(samples([*one, *other]), "lexicographic")
    assert both.effect.value == pytest.approx(0.5)


def test_a_strategy_against_itself_differs_in_five_of_a_hundred_at_most(plain: RunResult) -> None:
    """200 campaigns, three metrics each, after Holm: 5 % and three standard errors."""
    rng, claims = np.random.default_rng(8), 0
    for _ in range(200):
        outcomes = [[(40, float(rng.normal(400, 50))) for _ in range(12)] for _ in range(2)]
        records = [
            record
            for name, drawn in zip("ab", outcomes, strict=True)
            for record in trials(plain, name, lambda seed, drawn=drawn: drawn[seed - 1], 12)  # type: ignore[misc]
        ]
        claims += any(one.differ for one in compare(samples(records), "lexicographic"))
    assert claims <= 19


def test_only_seeds_that_both_have_ended_are_pairs(plain: RunResult) -> None:
    ones = list(trials(plain, "one", lambda seed: (40, 1.0), 10))
    others = list(trials(plain, "other", lambda seed: (39, None), 10))
    others[3] = TrialRecord("other", 4, {}, failure="it rained")
    (sample,) = samples([*ones[:8], *others])
    assert len(sample.pairs) == 7


def test_too_few_pairs_are_said_to_be_too_few(plain: RunResult) -> None:
    found = samples(
        [*trials(plain, "a", lambda seed: (1, 1.0), 5), *trials(plain, "b", lambda seed: (2, 1.0), 5)]
    )
    assert compare(found) == []
    assert too_few(found) == [
        "a and b: 5 pairs of runs; at least 6 are needed before any test could tell them apart."
    ]


def test_variants_are_compared_apart(plain: RunResult) -> None:
    records = [
        TrialRecord(record.strategy, record.seed, {"robots.count": robots}, record.result)
        for robots in (4, 8)
        for name in "ab"
        for record in trials(plain, name, lambda seed: (40, float(seed)), 6)
    ]
    made = compare(samples(records), "places")
    assert [one.variant for one in made] == [(("robots.count", 4),), (("robots.count", 8),)]
    assert "with robots.count = 4" in sentence(made[0])


def test_everything_written_about_a_result_can_be_found_again(plain: RunResult, tmp_path: Path) -> None:
    record = TrialRecord("none", 1, {"robots.count": 4}, plain)
    (tmp_path / "r.json").write_bytes(msgspec.json.encode(record))
    assert msgspec.json.decode((tmp_path / "r.json").read_bytes(), type=TrialRecord) == record
