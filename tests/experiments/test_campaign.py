"""Campaigns: a real one, failing runs, and the content of a folder."""

import csv
import json
import os
import re
import shlex
import time
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from pyarrow import parquet

from acrc_testbed.experiments import campaign, store
from acrc_testbed.experiments.campaign import CampaignOptions, RemainingTime, run_campaign
from acrc_testbed.experiments.comparison import identical_start_sentences, identical_starts
from acrc_testbed.experiments.metrics import MetricTable
from acrc_testbed.experiments.report.report_page import compose
from acrc_testbed.experiments.report.report_view import read_sources
from acrc_testbed.experiments.store import (
    IN_MEMORY,
    ISOLATED,
    PendingTrial,
    Store,
    difference_sentences,
    isolation_sentences,
)
from acrc_testbed.experiments.study import FIRST_TUNING_SEED, Distribution, Factor, Study, Trial
from acrc_testbed.experiments.trial_record import (
    DIGITS,
    MAX_BYTES,
    CheckRecord,
    CodeFolders,
    TrialRecord,
    identical_seconds,
    read_output,
    validated_record,
    write_json,
)
from acrc_testbed.results.outcome import Outcomes
from acrc_testbed.results.result import RunResult
from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario, parse_settings
from tests.experiments.made_runs import CLEANING
from tests.in_process import acrc

pytestmark = pytest.mark.usefixtures("forked_servers")
ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
SHORT = (("robots.count", 1), ("run.duration", 3.0))
STUDY = Study(
    name="short",
    task=CLEANING,
    scenario=str(CORRIDOR),
    strategies=("none", "chapter"),
    seeds=2,
    settings=SHORT,
)
DRAWN = (
    Distribution("dropout", (("share", (0.0, 0.2)),)),
    Distribution("odometry", (("drift", (1.0, 5.0)),)),
    Distribution("closures", (("count", (1, 2)), ("at", (0.0, 2.0)), ("duration", (1.0, 60.0)))),
    Distribution("tasks", (("count", (2, 3)), ("at", (0.0, 2.0)))),
)
CHEAT = '''
"""Reaches the referee through the stack; in a process of its own there is none."""

import sys
from cleaning.strategies.none import behaviour as honest
from msgspec.structs import replace

def world():
    frame = sys._getframe()
    while frame is not None:
        for shell in frame.f_locals.get("shells", ()):
            if hasattr(shell.core, "judge"):
                return shell.core
        frame = frame.f_back

class Cheat:
    def __init__(self, start):
        self.honest, self.done = honest(start), False

    def advance(self, view, until):
        core = world()
        if core is not None and not self.done:
            self.done = True
            say = core.judge.outcome
            core.judge.outcome = lambda present, end: settled(say(present, end))
        return self.honest.advance(view, until)

def settled(one):
    return replace(one, values={**one.values, "places_done": one.values["places_total"]})

quiet = Cheat
'''

COUNTS = """
import math
import os

def driven(tables):
    rows = tables["poses"].to_pylist()
    return sum(math.dist((a["x"], a["y"]), (b["x"], b["y"])) for a, b in zip(rows, rows[1:]))

def commits(tables):
    return len({row["change"] for row in tables["knowledge"].to_pylist()})

def ending(tables):
    os._exit(7)
"""


def own_scenario(folder: Path) -> str:
    (folder / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    return str(folder / "s.toml")


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, forked_servers: None) -> Store:
    """Four runs of two strategies, one of which cheats; the first of each was repeated as processes."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "cheat.py").write_text(CHEAT)
    study = Study(
        name="short", task=CLEANING, scenario=own_scenario(folder), strategies=("chapter", "cheat:quiet"),
        seeds=1, settings=SHORT, factors=(Factor("deeco.publish", (1.0, 2)),), distributions=DRAWN,
        metric=(
            MetricTable("driven", "counts:driven", "less"),
            MetricTable("commits", "counts:commits", "less", tables=("knowledge",)),
            MetricTable("ending", "counts:ending", "less"),
        ),
    )  # fmt: skip
    (folder / "counted").mkdir()
    (folder / "counted" / "counts.py").write_text(COUNTS)
    kept = store.create_store(folder / "out", study)
    folders = CodeFolders((folder,), (folder / "counted",))
    progress = run_campaign(kept, CampaignOptions(jobs=2, check_every=2, folders=folders))
    assert (progress.done, progress.failed, progress.total) == (4, 0, 4)
    return kept


def test_own_metrics_are_computed_in_each_trial_and_equal_in_its_repetition(done: Store) -> None:
    for record in done.records():
        assert record.result is not None
        last_step_m = 0.06
        assert record.result.metrics["driven"] == pytest.approx(record.result.driven_m, abs=last_step_m)
        assert (record.result.metrics["commits"] or 0) > 10
        assert record.result.metric_faults == {
            "ending": "the process of the trial exited while the metric was computed"
        }
    honest = next(check for check in done.checks() if check.strategy == "chapter")
    assert honest.agrees, honest.differs


def test_one_run_is_repeated_alone_from_its_recorded_command(done: Store, tmp_path: Path) -> None:
    record, row = list(done.records())[2], list(campaign.rows(done))[2]
    assert record.strategy == "chapter" and record.result is not None
    given = [event for event in record.drawn["event"] if "give" in event]
    assert record.result.task["places_total"] == 10 + len(given)
    typed = shlex.split(str(row["command"]))
    assert typed[:3] == ["acrc", "run", done.study.scenario]
    words = [word for flag, word in pairwise(typed) if flag == "--set"]
    overrides = Overrides(seed=1, strategy="chapter", settings=parse_settings(words))
    scenario = load_scenario(Path(done.study.scenario), overrides)
    plan = swarm.plan(scenario, RunOptions(tmp_path / "alone", bus="memory"))
    assert swarm.run_in_memory(plan, lambda progress: None).digest == record.result.digest


def test_both_tables_have_a_row_for_each_run_with_all_its_numbers(done: Store) -> None:
    binary, text = campaign.write_tables(done)
    table = parquet.read_table(binary).to_pylist()
    assert [row["vary.deeco.publish"] for row in table] == [1.0] * 2 + [2.0] * 2
    for row, record in zip(table, done.records(), strict=True):
        assert record.result is not None and record.time is not None
        assert [round(sum(each.values()), 6) for each in record.time.robots.values()] == [3.0]
        assert (row["strategy"], row["seed"], row["failure"]) == (record.strategy, 1, None)
        assert (row["digest"], row["commit"]) == (record.result.digest, record.result.origin.commit)
        assert row["places_total"] == record.result.task["places_total"]
        assert row["navigation.goals"] == record.result.navigation.goals
        assert row["frames.frames_sent"] == record.result.frames["frames_sent"]
        assert json.loads(row["versions"])["python"] == record.result.origin.versions["python"]
    with text.open() as file:
        same = list(csv.DictReader(file))
    assert [row["digest"] for row in same] == [row["digest"] for row in table]
    assert list(same[0]) == list(table[0])
    assert not list(done.folder.glob("*.new"))


def test_own_results_are_means_over_robots_and_each_robot_s_own(tmp_path: Path, done: Store) -> None:
    kept = store.create_store(tmp_path / "out", done.study)
    for number, trial in enumerate(kept.study.trials()):
        record = done.record(trial)
        assert record.result is not None
        own: Outcomes = {"turns": {"r1": number, "r2": 4.5}, "mode": {"r1": "slow"}}
        result = msgspec.structs.replace(record.result, outcome=own if number else {})
        write_json(kept.path(trial), msgspec.structs.replace(record, result=result))
    table = campaign.columns(kept)
    assert table["outcome.turns"] == [None, 2.75, 3.25, 3.75]
    assert table["outcome.turns.r1"] == [None, 1, 2, 3] and table["outcome.mode.r1"] == [None] + ["slow"] * 3


def test_a_strategy_that_changes_its_result_in_memory_is_found(done: Store, tmp_path: Path) -> None:
    honest, caught = done.checks()
    assert honest.agrees and honest.failure is None and honest.differs == ()
    assert honest.over_zenoh == honest.in_memory and honest.over_zenoh_speed
    assert (caught.strategy, caught.agrees) == ("cheat:quiet", False)
    assert caught.in_memory == caught.over_zenoh, "messages are the same, so is the digest"
    assert any(re.fullmatch(r"places_done [1-9]\d* in memory, 0 over Zenoh", one) for one in caught.differs)
    assert done.unchecked_trials(2) == []
    assert isolation_sentences(done)[1].startswith(
        "2 of 4 runs were repeated as processes (2 with sandboxes): 1 with the"
    )
    (sentence,) = difference_sentences(done)
    assert sentence.startswith("cheat:quiet with seed 1 differs between Zenoh and memory: ")
    ran = acrc("compare", done.folder, env={"COLUMNS": "200"})
    assert ran.returncode == 1
    assert ran.stdout.splitlines()[1] == IN_MEMORY and f"acrc: {sentence}" in ran.stderr
    asked, found = compose(read_sources([done.folder]), tmp_path).sections[:2]
    assert IN_MEMORY in asked.text
    assert found.text[0].startswith("out: cheat:quiet with seed 1")
    assert "do not trust this campaign" in found.text[0]


def test_every_nth_trial_is_repeated(plain: RunResult, tmp_path: Path) -> None:
    kept = store.create_store(
        tmp_path / "out",
        Study(name="s", task=CLEANING, scenario=str(CORRIDOR), strategies=("none", "chapter"), seeds=5),
    )
    assert campaign.write_tables(kept)[1].read_text() == "\n", "without any run"
    for trial in kept.study.trials():
        write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, plain))
    chosen = [pending.trial for pending in kept.unchecked_trials(2)]
    assert sorted((trial.strategy, trial.seed) for trial in chosen) == [
        (strategy, seed) for strategy in ("chapter", "none") for seed in (1, 3, 5)
    ]
    failed = CheckRecord(chosen[0].strategy, chosen[0].seed, {}, "d", 31.5, failure="no router")
    write_json(kept.check_path(chosen[0]), failed)
    assert [pending.trial for pending in kept.unchecked_trials(2)] == chosen[1:]
    name = f"{failed.strategy} with seed {failed.seed}"
    assert difference_sentences(kept) == [f"{name} succeeded in memory but failed over Zenoh: no router"]


@pytest.mark.timeout(240)
def test_an_isolated_campaign_makes_every_run_as_isolated_processes(tmp_path: Path) -> None:
    (tmp_path / "cheat.py").write_text(CHEAT)
    study = Study(
        name="s",
        task=CLEANING,
        scenario=own_scenario(tmp_path),
        strategies=("cheat:quiet",),
        seeds=1,
        settings=SHORT,
        isolated=True,
    )
    kept = store.create_store(tmp_path / "out", study)
    run_campaign(kept, CampaignOptions(jobs=1, folders=CodeFolders((tmp_path,))))
    (record,) = kept.records()
    assert record.result is not None and record.trace and record.time, record.failure
    assert (record.result.isolation, record.result.task["places_done"]) == ("full", 0)
    assert isolation_sentences(kept) == [ISOLATED]
    untold = msgspec.structs.replace(record.result, isolation="credentials")
    write_json(kept.path(next(study.trials())), msgspec.structs.replace(record, result=untold))
    assert isolation_sentences(kept) == ["1 of 1 runs were NOT isolated, as the study requires."]


def test_runs_that_fail_die_or_hang_are_kept_with_their_causes(tmp_path: Path) -> None:
    for name, line in (
        ("fails", 'raise ValueError(f"no robot {start.robot} today")'),
        ("dies", "import os; os.kill(os.getpid(), 9)"),
        ("hangs", "import time; time.sleep(600)"),
    ):
        (tmp_path / f"{name}.py").write_text(f"def behaviour(start):\n    {line}\n")
    strategies = ("fails:behaviour", "dies:behaviour", "hangs:behaviour", "none")
    folder = store.create_store(
        tmp_path / "out",
        Study(
            name="s",
            task=CLEANING,
            scenario=own_scenario(tmp_path),
            strategies=strategies,
            seeds=1,
            settings=SHORT,
        ),
    )
    began = time.monotonic()
    progress = run_campaign(folder, CampaignOptions(jobs=2, patience_s=9.0, folders=CodeFolders((tmp_path,))))
    assert (progress.done, progress.failed) == (4, 3)
    failed, died, hung, fine = folder.records()
    assert failed.result is None and "no robot r1 today" in (failed.failure or "")
    assert died.failure == "its process exited with code -9 without a result"
    assert hung.failure == "timeout after 9 s" and time.monotonic() - began < 60
    assert fine.failure is None and folder.pending() == []


def test_how_long_runs_coincide(done: Store) -> None:
    assert all(len(record.trace) == 3 * DIGITS for record in done.records())
    assert {seconds for one in identical_starts(done.records()) for seconds in one.seconds} == {3}
    assert identical_seconds("a" * 24, "a" * 16 + "b" * 8) == 2
    assert identical_seconds("a" * 24, "a" * 16) == 2
    assert identical_seconds("", "a" * 8) == 0

    def record(strategy: str, seed: int, same: int) -> TrialRecord:
        trace = "a" * DIGITS * same + strategy[0] * DIGITS * (10 - same)
        return TrialRecord(strategy, seed, {}, trace=trace)

    records = [record(name, seed, same) for name in ("one", "two") for seed, same in enumerate((4, 6, 10, 8))]
    records.append(TrialRecord("two", 9, {}, failure="it rained"))
    (found,) = identical_starts(records)
    assert identical_start_sentences([found]) == [
        "one and two: in 2 of 4 pairs robots move identically for the first 8 s or longer "
        "(shortest 4 s, median 7 s, longest 10 s)",
        "    in 1 until the end (messages may differ): seeds 2",
    ]
    floors = [msgspec.structs.replace(one, variant={"floor": n}) for one in records[:8] for n in "abcde"]
    floors = [one for one in floors if one.variant != {"floor": "b"} or one.seed != 2]
    assert identical_start_sentences(identical_starts(floors)) == [
        "one and two, in 5 variants: 19 pairs in which robots move identically at first "
        "(shortest 4 s, median 6 s, longest 10 s)",
        "    4 of them until the end (messages may differ), in 4 variants; most (1) with floor = a",
    ]
    (same,) = identical_starts([one for one in records if one.seed == 2])
    assert identical_start_sentences([same])[-1].startswith("    use longer runs (--duration) or more robots")


def test_the_time_to_go_knows_that_strategies_take_differently_long() -> None:
    slow, quick = (PendingTrial(trial) for trial in list(STUDY.trials())[:2])
    time = RemainingTime()
    assert time.remaining_s([slow], [], 2) is None
    for pending, took_s in ((slow, 30.0), (quick, 10.0), (quick, 12.0)):
        time.add_duration(pending, took_s)
    assert time.remaining_s([slow, quick, quick], [], 2) == pytest.approx((30 + 11 + 11) / 2)
    assert time.remaining_s([], [(slow, 25.0)], 2) == pytest.approx(5.0)
    assert time.remaining_s([], [(slow, 99.0)], 2) == 0.0
    assert time.remaining_s([PendingTrial(slow.trial, check=True)], [], 1) == pytest.approx((30 + 11) / 2)


def test_a_study_of_its_own_has_a_folder_of_its_own(tmp_path: Path) -> None:
    folder = store.create_store(tmp_path / "out", STUDY)
    with pytest.raises(AcrcError, match=r"contains the campaign of another study, in which strategies is"):
        store.create_store(tmp_path / "out", msgspec.structs.replace(STUDY, strategies=("none",)))
    more = store.create_store(tmp_path / "out", msgspec.structs.replace(STUDY, seeds=3))
    assert len(more.pending()) == 6
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(
        AcrcError, match="contains files that are not a campaign; choose a new or empty folder"
    ):
        store.create_store(tmp_path / "other", STUDY)
    with pytest.raises(AcrcError, match="not a campaign"):
        store.load_store(tmp_path / "nothing")
    trial = next(STUDY.trials())
    folder.path(trial).write_text('{"strategy": 3}')
    with pytest.raises(AcrcError, match=rf"{trial.name}\.json: invalid record of a trial: "):
        list(folder.records())


def test_tuning_has_seeds_that_no_test_has_and_every_variant_has_every_value() -> None:
    tuning = {trial.seed for trial in msgspec.structs.replace(STUDY, tuning=True, seeds=1000).trials()}
    assert max(trial.seed for trial in STUDY.trials()) < FIRST_TUNING_SEED <= min(tuning)
    factors = (Factor("robots.count", (1, 2)), Factor("deeco.relay", (True, False)))
    trials = list(msgspec.structs.replace(STUDY, factors=factors, seeds=1).trials())
    assert len({trial.name for trial in trials}) == 8
    assert {dict(trial.variant)["deeco.relay"] for trial in trials} == {True, False}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"[" * 100_000, "its process left an invalid record: "),
        (b'{"strategy":"x","seed":9,"variant":{}}', "its process left an invalid record: must have either"),
        (None, "it died"),
    ],
)
def test_records_of_processes_are_validated(content: bytes | None, why: str, plain: RunResult) -> None:
    record = validated_record(content, Trial("none", 1, (("robots.count", 2),)), CLEANING, "it died")
    assert record.failure is not None and record.failure.startswith(why)
    assert (record.strategy, record.seed, record.variant) == ("none", 1, {"robots.count": 2})
    other = msgspec.json.encode(TrialRecord("none", 2, {}, plain))
    assert (
        validated_record(other, Trial("none", 1), CLEANING, "").failure
        == "its process left the record of another trial"
    )


def test_irregular_files_do_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "secret").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "secret")
    with (tmp_path / "large").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    for name in ("pipe", "link", "large", "nothing"):
        assert read_output(tmp_path / name, MAX_BYTES) is None
    (tmp_path / "log").write_text("first last")
    assert read_output(tmp_path / "log", 4, end=True) == b"last"
