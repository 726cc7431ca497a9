"""What a campaign leaves: tables, repetitions over Zenoh, and until when runs of a pair are the same."""

import csv
import json
from pathlib import Path

import msgspec
import pytest
from pyarrow import parquet

from experiments.campaign import results_table, store
from experiments.campaign.campaign import CampaignOptions, TimeToGo, carry_out
from experiments.campaign.pool import EndedTrial
from experiments.campaign.store import Pending, Store
from experiments.campaign.trace import DIGITS, coincide_s
from experiments.campaign.trial_record import CheckRecord, TrialRecord, keep
from experiments.campaign.trust import differing, protection
from experiments.comparison.coincidence import coincidences, told
from experiments.study.study import Factor, Study
from observation.results.outcome import Outcomes

ROOT = Path(__file__).parents[2]
SHORT = (("robots.count", 2), ("run.duration", 3.0))
STUDY = Study(
    "short",
    str(ROOT / "scenarios" / "corridor.toml"),
    ("none", "chapter"),
    1,
    settings=SHORT,
    factors=(Factor("deeco.publish", (1.0, 2)),),
)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, forked_servers: None) -> Store:
    """A campaign of four runs, all of which were repeated."""
    kept = store.create(tmp_path_factory.mktemp("campaign") / "out", STUDY)
    carry_out(kept, CampaignOptions(jobs=2, check_every=1))
    return kept


def test_both_tables_have_a_row_for_each_run_with_all_its_numbers(done: Store) -> None:
    binary, text = results_table.write(done)
    table = parquet.read_table(binary).to_pylist()
    records = list(done.records())
    assert [row["strategy"] for row in table] == ["none", "chapter"] * 2
    assert [row["vary.deeco.publish"] for row in table] == [1.0, 1.0, 2.0, 2.0]
    for row, record in zip(table, records, strict=True):
        assert record.result is not None
        assert (row["digest"], row["seed"], row["failure"]) == (record.result.digest, 1, None)
        assert row["places_total"] == record.result.places_total
        assert row["navigation.goals"] == record.result.navigation.goals
        assert row["frames.frames_sent"] == record.result.frames["frames_sent"]
        assert json.loads(row["versions"])["python"] == record.result.origin.versions["python"]
        assert row["commit"] == record.result.origin.commit
    with text.open() as file:
        same = list(csv.DictReader(file))
    assert [row["digest"] for row in same] == [row["digest"] for row in table]
    assert list(same[0]) == list(table[0])
    assert not list(done.folder.glob("*.new"))


def test_own_results_are_means_over_robots_and_each_robot_s_own(tmp_path: Path, done: Store) -> None:
    kept = store.create(tmp_path / "out", STUDY)
    for seed, trial in enumerate(STUDY.trials()):
        record = done.record(trial)
        assert record.result is not None
        own: Outcomes = {"turns": {"r1": seed, "r2": 4.5}, "mode": {"r1": "slow"}}
        result = msgspec.structs.replace(record.result, outcome=own if seed else {})
        keep(kept.path(trial), msgspec.structs.replace(record, result=result))
    table = results_table.columns(kept)
    assert table["outcome.turns"] == [None, 2.75, 3.25, 3.75]
    assert table["outcome.turns.r1"] == [None, 1, 2, 3] and table["outcome.mode.r1"] == [None] + ["slow"] * 3


def test_runs_are_repeated_over_zenoh(done: Store) -> None:
    check = next(done.checks())
    assert len(list(done.checks())) == 4
    first = next(done.records())
    assert first.result is not None
    assert (check.strategy, check.seed, check.variant) == (first.strategy, first.seed, first.variant)
    assert check.agrees and check.failure is None and check.differs == ()
    assert check.over_zenoh == check.in_memory == first.result.digest
    assert check.over_zenoh_speed and check.in_memory_speed == first.result.real_time_factor
    assert done.unchecked(1) == []
    _, said = protection(done)
    assert said.startswith("4 of 4 runs were repeated as processes (4 iso")
    assert differing(done) == []


def test_another_digest_over_zenoh_is_said_loudly_with_both(tmp_path: Path, done: Store) -> None:
    kept = store.create(tmp_path / "out", STUDY)
    trial = next(STUDY.trials())
    keep(kept.path(trial), done.record(trial))
    check = done.check(trial)
    keep(kept.check_path(trial), msgspec.structs.replace(check, over_zenoh="other"))
    (said,) = differing(kept)
    assert said.startswith("none with seed 1 is another run over Zenoh than in memory: digest ")
    assert check.in_memory in said
    failed = msgspec.structs.replace(check, over_zenoh="", failure="no router")
    keep(kept.check_path(trial), failed)
    assert differing(kept) == ["none with seed 1 came to its end in memory, but not over Zenoh: no router"]


def test_runs_coincide_until_the_first_second_in_which_a_robot_is_elsewhere(done: Store) -> None:
    for record in done.records():
        assert len(record.trace) == 3 * DIGITS
    found = coincidences(done.records())
    assert [one.seconds for one in found] == [(3,), (3,)]
    assert coincide_s("a" * 24, "a" * 16 + "b" * 8) == 2
    assert coincide_s("a" * 24, "a" * 16) == 2
    assert coincide_s("", "a" * 8) == 0


def test_what_coincides_is_told_in_a_sentence() -> None:
    def record(strategy: str, seed: int, same: int) -> TrialRecord:
        trace = "a" * DIGITS * same + strategy[0] * DIGITS * (10 - same)
        return TrialRecord(strategy, seed, {}, trace=trace)

    records = [record(name, seed, same) for name in ("one", "two") for seed, same in enumerate((4, 6, 10, 8))]
    records.append(TrialRecord("two", 9, {}, failure="it rained"))
    (found,) = coincidences(records)
    assert told([found]) == [
        "one and two: the first 8 s of 2 of 4 pairs coincide (least 4 s, median 7 s, most 10 s)",
        "    1 from beginning to end, so they tell no difference: seeds 2",
    ]
    floors = [
        msgspec.structs.replace(one, variant={"floor": name}) for one in records[:8] for name in "abcde"
    ]
    floors = [one for one in floors if one.variant != {"floor": "b"} or one.seed != 2]
    assert told(coincidences(floors)) == [
        "one and two, in 5 combinations: 19 pairs coincide at first (least 4 s, median 6 s, most 10 s)",
        "    4 from beginning to end, so they tell no difference, in 4 combinations; most (1) with floor = a",
    ]


def test_the_time_to_go_knows_that_strategies_take_differently_long() -> None:
    trials = list(STUDY.trials())
    slow, quick = (Pending(trials[number]) for number in (0, 1))
    time = TimeToGo()
    assert time.left_s([slow], [], 2) is None
    for ended in (
        EndedTrial(slow, 30.0, None, ""),
        EndedTrial(quick, 10.0, None, ""),
        EndedTrial(quick, 12.0, None, ""),
    ):
        time.learn(ended.pending, ended.took_s)
    assert time.left_s([slow, quick, quick], [], 2) == pytest.approx((30 + 11 + 11) / 2)
    assert time.left_s([], [(slow, 25.0)], 2) == pytest.approx(5.0)
    assert time.left_s([], [(slow, 99.0)], 2) == 0.0
    unknown = Pending(trials[0], check=True)
    assert time.left_s([unknown], [], 1) == pytest.approx((30 + 11) / 2)


def test_what_a_check_leaves_survives_its_file() -> None:
    check = CheckRecord("none", 1, {"robots.count": 4}, "d", 31.5, failure="no router")
    assert msgspec.json.decode(msgspec.json.encode(check), type=CheckRecord) == check
