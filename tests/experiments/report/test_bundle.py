"""Bundles: whole, the same bytes each time, and their runs can be made again."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import msgspec
import pytest
import yaml

from acrc_testbed.experiments import store
from acrc_testbed.experiments.frozen_plan import study_inputs
from acrc_testbed.experiments.report import campaign_bundle
from acrc_testbed.experiments.study import Study, load_study
from acrc_testbed.experiments.trial_record import TrialRecord, write_json
from acrc_testbed.results.result import RunResult
from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.experiments.made_runs import CLEANING

ROOT = Path(__file__).parents[3]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
STUDY = Study(
    name="tiny", task=CLEANING, scenario=str(CORRIDOR), strategies=("none",), seeds=2,
    settings=(("robots.count", 1), ("run.duration", 1.0)),
)  # fmt: skip


def run(study: Study, seed: int, out: Path) -> RunResult:
    overrides = Overrides(seed=seed, strategy="none", settings=study.settings)
    plan = swarm.plan(load_scenario(CORRIDOR, overrides), RunOptions(out, bus="memory"))
    return msgspec.structs.replace(swarm.run_in_memory(plan, lambda progress: None), out="")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("campaigns")
    kept = store.create_store(out / "tiny", STUDY)
    first, second = STUDY.trials()
    write_json(kept.path(first), TrialRecord("none", 1, {}, run(STUDY, 1, out / "run")))
    write_json(kept.path(second), TrialRecord("none", 2, {}, failure="it rained"))
    return out / "tiny"


@pytest.fixture(scope="module")
def unpacked(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bundle")
    campaign_bundle.make_bundle(folder, out / "given.zip", ["Ada Lovelace"])
    with zipfile.ZipFile(out / "given.zip") as archive:
        archive.extractall(out)
    return out / "tiny"


def test_all_that_others_need_is_there(unpacked: Path) -> None:
    names = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    assert {
        "README.md", "CITATION.cff", "SHA256SUMS", "study.json", "reproduce.sh", "check_digests.py",
        "constraints.txt", "digests.csv", "inputs/scenarios/corridor.toml", "inputs/maps/corridor.yaml",
        "inputs/maps/corridor.png", "results/study.json", "results/campaign.json", "report/report.html",
    } <= names  # fmt: skip
    assert len([name for name in names if name.startswith("results/trials/")]) == 2
    assert not any(
        str(ROOT) in path.read_text() for path in (unpacked / "study.json", unpacked / "README.md")
    )
    assert store.load_store(unpacked / "results").study.strategies == ("none",)
    assert "failed" in (unpacked / "digests.csv").read_text()
    told = yaml.safe_load((unpacked / "CITATION.cff").read_text())
    assert (told["cff-version"], told["authors"]) == ("1.2.0", [{"name": "Ada Lovelace"}])


def test_sums_are_those_of_all_files_and_bytes_are_the_same(
    folder: Path, unpacked: Path, tmp_path: Path
) -> None:
    checked = subprocess.run(
        ["sha256sum", "-c", "SHA256SUMS"], cwd=unpacked, capture_output=True, text=True, check=True
    )
    files = [path for path in unpacked.rglob("*") if path.is_file()]
    assert checked.stdout.count(": OK") == len(files) - 1

    campaign_bundle.make_bundle(folder, tmp_path / "deeper" / "again.zip", ["Ada Lovelace"])
    before = (unpacked.parent / "given.zip").read_bytes()
    assert (tmp_path / "deeper" / "again.zip").read_bytes() == before


def test_its_runs_are_made_again_with_the_same_digests(unpacked: Path, tmp_path: Path) -> None:
    acrc = tmp_path / "acrc"
    acrc.write_text(f'#!/bin/sh\nexec {sys.executable} -P -m acrc_testbed.command_line "$@"\n')
    acrc.chmod(0o755)
    told = subprocess.run(
        ["sh", "reproduce.sh", "1"], cwd=unpacked, env={**os.environ, "ACRC": str(acrc)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    last = told.stdout.splitlines()[-1]
    assert last == "1 of 1 repeated runs are identical; the results have 2 runs"
    (path,) = (unpacked / "reproduced" / "trials").iterdir()
    before = json.loads(path.read_text())["result"]["task"]
    path.write_text(path.read_text().replace('"places_done":', '"places_done":1'))
    after = json.loads(path.read_text())["result"]["task"]
    changed = subprocess.run(
        [sys.executable, "check_digests.py", "results", "reproduced"], cwd=unpacked,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert changed.returncode == 1
    assert changed.stdout.startswith(
        f"{path.name}: task was {before}, is {after}\n0 of 1 repeated runs are identical"
    )


def test_inputs_that_others_could_not_find_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    with pytest.raises(AcrcError, match="make it relative to the scenario"):
        study_inputs(msgspec.structs.replace(STUDY, scenario=str(path)))
    with pytest.raises(AcrcError, match="missing; the campaign's runs were made with it"):
        study_inputs(msgspec.structs.replace(STUDY, scenario=str(tmp_path / "gone.toml")))
    store.create_store(tmp_path / "new", STUDY)
    with pytest.raises(AcrcError, match="no run has ended"):
        campaign_bundle.make_bundle(tmp_path / "new", tmp_path / "new.zip")


def test_a_strategy_of_one_s_own_is_an_input(tmp_path: Path) -> None:
    for name in ("corridor.yaml", "corridor.png"):
        (tmp_path / name).write_bytes((ROOT / "maps" / name).read_bytes())
    (tmp_path / "s.toml").write_text(CORRIDOR.read_text().replace("../maps/", ""))
    (tmp_path / "mine.py").write_text("def behaviour(start): ...\n")
    study = Study(
        name="own",
        task=CLEANING,
        scenario=str(tmp_path / "s.toml"),
        strategies=("none", "mine:behaviour"),
        seeds=1,
    )
    assert sorted(study_inputs(study).files) == ["corridor.png", "corridor.yaml", "mine.py", "s.toml"]
    elsewhere = msgspec.structs.replace(study, strategies=("nowhere_at_all:behaviour",))
    with pytest.raises(AcrcError, match="nowhere_at_all:behaviour: its module is not in"):
        study_inputs(elsewhere)


def test_a_study_that_a_campaign_has_written_is_a_study(unpacked: Path, tmp_path: Path) -> None:
    study = load_study(unpacked / "study.json")
    assert study.scenario == str(unpacked / "inputs" / "scenarios" / "corridor.toml")
    assert study.settings == STUDY.settings
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(AcrcError, match="invalid study of a campaign: scenario is missing"):
        load_study(tmp_path / "study.json")
