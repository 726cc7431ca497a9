"""Campaigns: every trial once, whatever ends them; failures kept; another's folder refused."""

import time
from pathlib import Path

import msgspec
import pytest

from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from experiments.campaign import store
from experiments.campaign.campaign import CampaignOptions, carry_out
from experiments.campaign.trial_record import TrialRecord
from experiments.study.study import FIRST_TUNING_SEED, Factor, Study
from experiments.study.study_file import load_study

pytestmark = pytest.mark.usefixtures("forked_servers")
ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
SHORT = (("robots.count", 2), ("run.duration", 3.0))
STUDY = Study("short", str(CORRIDOR), ("none", "chapter"), 2, settings=SHORT)
SABOTEUR = """
def behaviour(start):
    raise ValueError(f"no robot {start.robot} today")
"""


def digests(folder: Path) -> dict[tuple[str, int], str | None]:
    return {
        (record.strategy, record.seed): record.result.digest if record.result else None
        for record in store.load(folder).records()
    }


def test_every_strategy_runs_with_every_seed_as_it_would_alone(tmp_path: Path) -> None:
    progress = carry_out(store.create(tmp_path / "out", STUDY), CampaignOptions(jobs=2))
    assert (progress.done, progress.failed, progress.total) == (4, 0, 4)
    found = digests(tmp_path / "out")
    assert list(found) == [("none", 1), ("chapter", 1), ("none", 2), ("chapter", 2)]
    for record in store.load(tmp_path / "out").records():
        assert record.time is not None
        spent = [round(sum(each.values()), 6) for each in record.time.robots.values()]
        assert spent == [3.0, 3.0], "where all of each robot's time went"
    overrides = Overrides(seed=2, strategy="chapter", settings=SHORT)
    alone = swarm.plan(load_scenario(CORRIDOR, overrides), RunOptions(tmp_path / "alone", bus="memory"))
    assert found["chapter", 2] == swarm.run_in_memory(alone, lambda progress: None).digest


def test_a_run_that_fails_is_kept_with_its_cause(tmp_path: Path) -> None:
    (tmp_path / "saboteur.py").write_text(SABOTEUR)
    (tmp_path / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    study = Study("fails", str(tmp_path / "s.toml"), ("none", "saboteur:behaviour"), 1, settings=SHORT)
    folder = store.create(tmp_path / "out", study)
    progress = carry_out(folder, CampaignOptions(jobs=1, modules=(tmp_path,)))
    assert (progress.done, progress.failed) == (2, 1)
    fine, failed = folder.records()
    assert fine.failure is None
    assert failed.result is None
    assert failed.failure is not None
    assert "no robot r1 today" in failed.failure
    assert folder.pending() == []


def test_a_process_that_dies_is_a_failure_and_not_a_hole(tmp_path: Path) -> None:
    (tmp_path / "dies.py").write_text("import os\n\ndef behaviour(start):\n    os.kill(os.getpid(), 9)\n")
    (tmp_path / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    folder = store.create(tmp_path / "out", Study("d", str(tmp_path / "s.toml"), ("dies:behaviour",), 1))
    carry_out(folder, CampaignOptions(jobs=1, modules=(tmp_path,)))
    (record,) = folder.records()
    assert record.failure == "its process ended with exit code -9 without a result"


def test_a_run_that_takes_too_long_is_ended_and_a_failure(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\n\ndef behaviour(start):\n    time.sleep(600)\n")
    (tmp_path / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    folder = store.create(tmp_path / "out", Study("d", str(tmp_path / "s.toml"), ("slow:behaviour",), 1))
    began = time.monotonic()
    carry_out(folder, CampaignOptions(jobs=1, patience_s=2.0, modules=(tmp_path,)))
    (record,) = folder.records()
    assert record.failure == "took longer than 2 s"
    assert time.monotonic() - began < 60


def test_a_study_of_its_own_has_a_folder_of_its_own(tmp_path: Path) -> None:
    store.create(tmp_path / "out", STUDY)
    with pytest.raises(AcrcError, match=r"holds the campaign of another study \(strategies differs\)"):
        store.create(tmp_path / "out", msgspec.structs.replace(STUDY, strategies=("none",)))
    more = store.create(tmp_path / "out", msgspec.structs.replace(STUDY, seeds=3))
    assert len(more.pending()) == 6
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(AcrcError, match="holds something that is no campaign; must be new or empty"):
        store.create(tmp_path / "other", STUDY)
    with pytest.raises(AcrcError, match="holds no campaign"):
        store.load(tmp_path / "nothing")


def test_a_damaged_record_is_named(tmp_path: Path) -> None:
    folder = store.create(tmp_path / "out", STUDY)
    trial = next(iter(STUDY.trials()))
    folder.path(trial).write_text('{"strategy": 3}')
    with pytest.raises(AcrcError, match=rf"{trial.name}\.json: no record of a trial: "):
        list(folder.records())


def test_tuning_has_seeds_that_no_test_has() -> None:
    tests = {trial.seed for trial in STUDY.trials()}
    tuning = {trial.seed for trial in msgspec.structs.replace(STUDY, tuning=True, seeds=1000).trials()}
    assert max(tests) < FIRST_TUNING_SEED <= min(tuning)


def test_every_variant_has_every_value() -> None:
    study = msgspec.structs.replace(
        STUDY, factors=(Factor("robots.count", (1, 2)), Factor("deeco.relay", (True, False))), seeds=1
    )
    assert len({trial.name for trial in study.trials()}) == 8
    assert {dict(trial.variant)["deeco.relay"] for trial in study.trials()} == {True, False}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("strategies = ['none']", "scenario is missing, but must be"),
        ("scenario = 's.toml'\nstrategies = []", "strategies is [], but must be a list of strategies"),
        (
            "scenario = 's.toml'\nstrategies = ['none']\nseeds = 0",
            "seeds is 0, but must be a whole number from 1",
        ),
        ("scenario = 's.toml'\nstrategies = ['none']\nseed = 3", "seed is not known; did you mean seeds"),
        (
            "scenario = 's.toml'\nstrategies = ['none']\nprimary = [['none', 'chapter']]",
            "primary compares 'chapter', which is none of the study's strategies: none",
        ),
    ],
)
def test_what_is_wrong_with_a_study_is_said(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(AcrcError) as caught:
        load_study(path)
    assert sentence in str(caught.value)


def test_a_record_survives_its_file() -> None:
    record = TrialRecord("none", 3, {"robots.count": 4}, failure="it rained")
    assert msgspec.json.decode(msgspec.json.encode(record), type=TrialRecord) == record
