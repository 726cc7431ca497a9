"""Tests of frozen plans and of reported deviations."""

import hashlib
import json
import shutil
import subprocess
import zipfile
from pathlib import Path

import msgspec
import pytest

from acrc_testbed.command_line import campaign_commands
from acrc_testbed.experiments import frozen_plan, store
from acrc_testbed.experiments.evaluation import evaluate
from acrc_testbed.experiments.report import campaign_bundle
from acrc_testbed.experiments.store import isolation_sentences
from acrc_testbed.experiments.study import Study, load_study
from acrc_testbed.experiments.trial_record import TrialRecord, write_json
from acrc_testbed.results.result import RunResult
from actors.installation import version
from actors.runtime.errors import AcrcError
from tests.experiments.made_runs import varied

ROOT = Path(__file__).parents[2]
COMMIT = "c0ffee" * 6 + "c0ff"
STUDY = """
scenario = "corridor.toml"
strategies = ["none", "chapter"]
seeds = 8
primary = [["chapter", "none"]]

[set]
"robots.count" = 1

[[vary]]
distribution = "kills"
count = [0, 1]
at = [60, 240]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a study's folder with all input files, at a fake commit."""
    for name in ("corridor.yaml", "corridor.png"):
        (tmp_path / name).write_bytes((ROOT / "maps" / name).read_bytes())
    scenario = (ROOT / "scenarios" / "corridor.toml").read_text()
    (tmp_path / "corridor.toml").write_text(scenario.replace("../maps/", ""))
    (tmp_path / "study.toml").write_text(STUDY)
    for module in (campaign_commands, store):
        monkeypatch.setattr(module, "software_version", lambda: COMMIT)
    return tmp_path


def frozen(folder: Path, *, until_decided: bool = False) -> Path:
    campaign_commands.freeze(folder / "study.toml", None, until_decided=until_decided, json=False)
    return folder / "study.frozen.json"


def test_too_few_seeds_are_reported_when_freezing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "study.toml").write_text(STUDY.replace("seeds = 8", "seeds = 4"))
    frozen(folder)
    assert "4 pairs of runs are too few: the exact test needs at least 6" in capsys.readouterr().out


def begun(folder: Path, *, looks: bool = False) -> tuple[store.Store, list[str]]:
    """Return the campaign of the current study file, and the sentences before its next run."""
    source = folder / "study.toml"
    kept = store.create_store(folder / "out", load_study(source))
    if looks:
        kept.declare_looks()
    return kept, store.record_plan(kept, store.find_plan(None, source), source, looks=looks)


def over(kept: store.Store, plain: RunResult, seeds: int = 8, commit: str = COMMIT) -> None:
    for trial in kept.study.trials():
        if trial.seed <= seeds:
            origin = msgspec.structs.replace(plain.origin, commit=commit)
            places = 3 * len(trial.strategy)
            result = varied(plain, seed=trial.seed, places_done=places, origin=origin)
            write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))


def edited(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def departures(folder: Path) -> list[str]:
    """Return the deviations reported before the first run; they are also reported after the last."""
    kept, said = begun(folder)
    told = [line for line in store.plan_sentences(kept) if line.startswith("Deviation")]
    assert told[:-1] == said[1:]
    assert told[-1].endswith(" runs are missing.")
    return [line.removeprefix("Deviation from the plan: ") for line in said[1:]]


def test_a_campaign_as_frozen(folder: Path, plain: RunResult, capsys: pytest.CaptureFixture[str]) -> None:
    path = frozen(folder)
    told = (
        f"commit {COMMIT}, SHA-256 {frozen_plan.read_plan(path).sha256}: chapter versus none by "
        "lexicographic, margins of 1 places in places done and 10 s in running time, 8 seeds, no interim "
        "looks."
    )
    assert f"Frozen {told}\nwritten to {path}; publish the hash " in capsys.readouterr().out
    kept, said = begun(folder)
    assert said == [f"Frozen before the first run, {told}"]
    over(kept, plain)
    assert evaluate(kept).declared[:2] == [*said, "The campaign follows the plan."]
    assert (kept.folder / "plan.json").read_bytes() == path.read_bytes()
    with pytest.raises(AcrcError, match="already exists; a frozen plan is not replaced: choose another file"):
        frozen(folder)


def test_anybody_can_compute_the_hash(folder: Path) -> None:
    told = json.loads(frozen(folder).read_bytes())
    own = told.pop("sha256")
    text = json.dumps(told, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert hashlib.sha256(text.encode()).hexdigest() == own
    assert str(folder) not in text
    assert [name for name, _ in told["files"]] == ["corridor.png", "corridor.toml", "corridor.yaml"]


def damage_map(folder: Path) -> None:
    content = bytearray((folder / "corridor.png").read_bytes())
    content[-1] ^= 1
    (folder / "corridor.png").write_bytes(content)


def test_edits_are_deviations_from_the_plan(folder: Path) -> None:
    frozen(folder)
    (folder / "other.png").write_bytes((folder / "corridor.png").read_bytes())
    (folder / "other.yaml").write_text((folder / "corridor.yaml").read_text().replace("corridor", "other"))
    damage_map(folder)
    assert departures(folder) == ["the content of corridor.png was changed."]
    study = folder / "study.toml"
    edited(study, "seeds = 8", "seeds = 7\nmargins = {places = 2}")
    edited(study, '[["chapter", "none"]]', '[["none", "chapter"]]')
    edited(study, "[set]\n", '[set]\nmap = "other.yaml"\n"places.preset" = "free"\n')
    shutil.rmtree(folder / "out")
    told = departures(folder)
    for one in (
        "seeds is 7, planned: 8.",
        'margins is {"places":2.0}, planned: {}.',
        "the comparison of none with chapter was not planned.",
        "the planned comparison of chapter with none is no longer declared.",
        "corridor.yaml is no longer an input file.",
        "other.yaml is a new input file.",
    ):
        assert one in told
    assert any(one.startswith('settings is [["map","other.yaml"],') for one in told)


def test_spelling_order_and_folder_of_a_study_are_no_departures(folder: Path, tmp_path: Path) -> None:
    frozen(folder)
    edited(folder / "study.toml", "seeds = 8", "seeds   = 8   # as many as there is time for")
    moved = tmp_path / "moved"
    moved.mkdir()
    for path in [path for path in folder.iterdir() if path.is_file()]:
        path.rename(moved / path.name)
    assert departures(moved) == []


def test_another_commit_is_not_as_frozen(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frozen(folder)
    monkeypatch.setattr(store, "software_version", lambda: "badc0de")
    about, before = "it was made with commit badc0de, ", tuple[str, ...]()
    for changed, end in (
        (None, "which cannot be shown to descend from the planned one"),
        ((folder / "study.toml", folder / "study.frozen.json", folder / "corridor.png"), ""),
        (
            (folder / "a.py", folder / "b.py"),
            "in which 2 files differ from the planned one (a.py, b.py)",
        ),
    ):
        monkeypatch.setattr(store, "changed_since", lambda commit, files=changed: files)
        before = (*before, *([about + end] if end else []))
        kept, _ = begun(folder)
        assert kept.info().departures == before


def test_runs_made_after_a_commit_on_the_way_are_told(folder: Path, plain: RunResult) -> None:
    frozen(folder)
    kept, _ = begun(folder)
    over(kept, plain, commit="badc0de")
    over(kept, plain, 5)
    said = isolation_sentences(kept)[-1]
    assert said.startswith(f"the campaign began with commit {COMMIT}, but 6 of 16 runs were made with")
    assert store.plan_sentences(kept)[1:-1] == [f"Deviation from the plan: {said}"]


def test_descent_is_determined_by_git(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*words: str) -> str:
        name = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        done = subprocess.run(
            ["git", "-C", str(tmp_path), *name, *words], check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    def commit(file: str) -> str:
        (tmp_path / file).write_text(file)
        git("add", file)
        git("commit", "-q", "-m", file)
        return git("rev-parse", "HEAD")

    monkeypatch.setattr(version, "REPOSITORY", tmp_path)
    monkeypatch.setattr(version, "IS_CLONE", True)
    git("init", "-q")
    first = commit("a")
    second = commit("b")
    assert version.changed_since(second) == ()
    assert version.changed_since(first) == (tmp_path / "b",)
    git("reset", "-q", "--hard", first)
    assert version.changed_since(second) is None, "this one is before it"
    for wrong in ("--output=x", "0" * 40, ""):
        assert version.changed_since(wrong) is None
    monkeypatch.setattr(version, "IS_CLONE", False)
    assert version.changed_since(first) is None


def test_software_that_was_changed_is_not_frozen(folder: Path) -> None:
    with pytest.raises(AcrcError, match=f"the software has changes since commit {COMMIT}; commit them"):
        frozen_plan.freeze(load_study(folder / "study.toml"), f"{COMMIT}+", ())


def test_a_plan_that_was_tampered_with_is_refused(folder: Path) -> None:
    path = frozen(folder)
    edited(path, '"margins": {}', '"margins": {"places": 9.0}')
    with pytest.raises(AcrcError, match="changed after it was frozen: sha256 is "):
        begun(folder)


def test_a_plan_with_a_recomputed_hash_is_another_plan(folder: Path, plain: RunResult) -> None:
    path = frozen(folder)
    kept, _ = begun(folder)
    over(kept, plain)
    path.unlink()
    edited(folder / "study.toml", "seeds = 8", "seeds = 8\nmargins = {settled = 30}")
    frozen(folder)
    edited(folder / "study.toml", "margins = {settled = 30}", "")
    with pytest.raises(AcrcError, match=r"began with the plan .*; use the same plan or a new folder"):
        begun(folder)
    kept.plan_file.write_bytes(path.read_bytes())
    with pytest.raises(AcrcError, match=r"plan\.json: SHA-256 is .*, but the campaign began with the plan "):
        evaluate(kept)


def test_a_campaign_that_had_runs_takes_no_plan(folder: Path, plain: RunResult) -> None:
    kept, said = begun(folder)
    assert said == [] and evaluate(kept).declared == ["No plan was frozen before the first run."]
    over(kept, plain, 1)
    path = frozen(folder)
    _, said = begun(folder)
    assert said == [f"{path}: ignored, because {kept.folder} has runs made without a plan."]
    assert store.plan_sentences(kept) == [store.NO_FROZEN_PLAN]


def test_a_resumed_campaign_keeps_its_plan_and_all_departures(folder: Path, plain: RunResult) -> None:
    path = frozen(folder)
    kept, said = begun(folder)
    over(kept, plain, 3)
    assert "Deviation from the plan: 10 of 16 runs are missing." in store.plan_sentences(kept)
    path.unlink()  # the campaign's own is enough
    assert begun(folder)[1] == said
    was = (folder / "corridor.png").read_bytes()
    damage_map(folder)
    begun(folder)
    (folder / "corridor.png").write_bytes(was)
    begun(folder)
    over(kept, plain)
    assert (
        store.plan_sentences(kept)[1] == "Deviation from the plan: the content of corridor.png was changed."
    )


def test_looks_are_part_of_the_plan(folder: Path) -> None:
    edited(folder / "study.toml", "seeds = 8", "seeds = 25")
    plan = frozen_plan.read_plan(frozen(folder, until_decided=True))
    assert plan.looks == (10, 20, 25)
    _, said = begun(folder)
    assert said[0].endswith("25 seeds, interim looks after 10, 20, 25 pairs.")
    assert (
        len(said) == 2 and "no interim looks were made, but interim looks after 10, 20, 25 pairs" in said[1]
    )
    kept, said = begun(folder, looks=True)
    assert said[1:] == []
    assert kept.looks is not None
    (folder / "study.frozen.json").unlink()
    (folder / "out").rename(folder / "before")
    frozen(folder)
    _, said = begun(folder, looks=True)
    assert said[1:] == ["Deviation from the plan: interim looks were made, but none were planned."]


def test_a_bundle_is_checked_in_another_folder(folder: Path, plain: RunResult, tmp_path: Path) -> None:
    plan = frozen_plan.read_plan(frozen(folder))
    kept, _ = begun(folder)
    over(kept, plain)
    told = evaluate(kept).declared
    campaign_bundle.make_bundle(kept.folder, tmp_path / "b.zip")
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        archive.extractall(tmp_path / "elsewhere")
    unpacked = tmp_path / "elsewhere" / "out"
    assert evaluate(store.load_store(unpacked / "results")).declared == told
    readme = (unpacked / "README.md").read_text()
    assert f"commit `{COMMIT}`, SHA-256 `{plan.sha256}`" in readme
    assert "\n\n".join(told) in readme
    assert "The campaign follows the plan." in (unpacked / "report" / "report.html").read_text()
    again = unpacked / "study.json"
    made = store.create_store(unpacked / "reproduced", load_study(again))
    (map_image,) = (unpacked / "inputs").rglob("corridor.png")
    map_image.write_bytes(map_image.read_bytes() + b"\0")
    said = store.record_plan(made, store.find_plan(None, again), again, looks=False)
    assert said[1:] == ["Deviation from the plan: the content of corridor.png was changed."]
    assert set(msgspec.to_builtins(plan.study)) == set(Study.__struct_fields__)
