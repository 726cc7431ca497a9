"""Frozen plans: what campaigns say of them, and of whatever is not as frozen."""

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
from acrc_testbed.experiments.judgement import judge
from acrc_testbed.experiments.report import bundle
from acrc_testbed.experiments.store import protection
from acrc_testbed.experiments.study import Study, load_study
from acrc_testbed.experiments.trial_record import TrialRecord, keep
from acrc_testbed.results.result import RunResult
from actors.installation import version
from actors.runtime.errors import AcrcError

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
    """A study with all that it reads, and software of a commit of which nothing else is known."""
    for name in ("corridor.yaml", "corridor.png"):
        (tmp_path / name).write_bytes((ROOT / "maps" / name).read_bytes())
    scenario = (ROOT / "scenarios" / "corridor.toml").read_text()
    (tmp_path / "corridor.toml").write_text(scenario.replace("../maps/", ""))
    (tmp_path / "study.toml").write_text(STUDY)
    for module in (campaign_commands, store):
        monkeypatch.setattr(module, "software", lambda: COMMIT)
    return tmp_path


def frozen(folder: Path, *, until_decided: bool = False) -> Path:
    campaign_commands.freeze(folder / "study.toml", None, until_decided=until_decided, json=False)
    return folder / "study.frozen.json"


def begun(folder: Path, *, looks: bool = False) -> tuple[store.Store, list[str]]:
    """The campaign of the study's file as it is now, and what is said before its next run."""
    source = folder / "study.toml"
    kept = store.create(folder / "out", load_study(source))
    if looks:
        kept.declare_looks()
    return kept, store.take_in(kept, store.plan_of(None, source), source, looks=looks)


def over(kept: store.Store, plain: RunResult, seeds: int = 8, commit: str = COMMIT) -> None:
    for trial in kept.study.trials():
        if trial.seed <= seeds:
            origin = msgspec.structs.replace(plain.origin, commit=commit)
            places = 3 * len(trial.strategy)
            result = msgspec.structs.replace(plain, seed=trial.seed, places_done=places, origin=origin)
            keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))


def edited(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def departures(folder: Path) -> list[str]:
    """What the campaign says to be not as frozen, before its first run and after all."""
    kept, said = begun(folder)
    told = [line for line in store.plan_sentences(kept) if line.startswith("Not as")]
    assert told[:-1] == said[1:]
    assert told[-1].endswith(" runs are still to be made.")
    return [line.removeprefix("Not as frozen: ") for line in said[1:]]


def test_a_campaign_as_frozen(folder: Path, plain: RunResult, capsys: pytest.CaptureFixture[str]) -> None:
    path = frozen(folder)
    told = (
        f"at commit {COMMIT}, SHA-256 {frozen_plan.read(path).sha256}: chapter against none by "
        "lexicographic, margins of 1 in places and 10 s, 8 seeds, no look on the way."
    )
    assert f"Frozen {told}\nwritten to {path}; publish the hash " in capsys.readouterr().out
    kept, said = begun(folder)
    assert said == [f"Frozen before the first run, {told}"]
    over(kept, plain)
    assert judge(kept).declared[:2] == [*said, "The campaign is as frozen."]
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


def test_what_was_edited_is_not_as_frozen(folder: Path) -> None:
    frozen(folder)
    (folder / "other.png").write_bytes((folder / "corridor.png").read_bytes())
    (folder / "other.yaml").write_text((folder / "corridor.yaml").read_text().replace("corridor", "other"))
    damage_map(folder)
    assert departures(folder) == ["corridor.png has another content."]
    study = folder / "study.toml"
    edited(study, "seeds = 8", "seeds = 7\nmargin_places = 2")
    edited(study, '[["chapter", "none"]]', '[["none", "chapter"]]')
    edited(study, "[set]\n", '[set]\nmap = "other.yaml"\n"places.preset" = "free"\n')
    shutil.rmtree(folder / "out")
    told = departures(folder)
    for one in (
        "seeds is 7, frozen was 8.",
        "margin_places is 2.0, frozen was 1.0.",
        "the comparison of none with chapter was not declared beforehand.",
        "the comparison of chapter with none was declared beforehand, and is not any more.",
        "corridor.yaml is not read any more.",
        "other.yaml was not read.",
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
    monkeypatch.setattr(store, "software", lambda: "badc0de")
    about, before = "it was made with badc0de, ", tuple[str, ...]()
    for changed, end in (
        (None, "of which nothing shows that it descends from the frozen commit"),
        ((folder / "study.toml", folder / "study.frozen.json", folder / "corridor.png"), ""),
        (
            (folder / "a.py", folder / "b.py"),
            "which descends from the frozen commit, but 2 files differ (a.py, b.py)",
        ),
    ):
        monkeypatch.setattr(store, "changed_since", lambda commit, files=changed: files)
        before = (*before, *([about + end] if end else []))
        kept, _ = begun(folder)
        assert kept.about().departures == before


def test_runs_made_after_a_commit_on_the_way_are_told(folder: Path, plain: RunResult) -> None:
    frozen(folder)
    kept, _ = begun(folder)
    over(kept, plain, commit="badc0de")
    over(kept, plain, 5)
    said = protection(kept)[-1]
    assert said.startswith(f"6 of 16 runs were made with other software than {COMMIT}, with which")
    assert store.plan_sentences(kept)[1:-1] == [f"Not as frozen: {said}"]


def test_what_descends_is_known_from_git(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    with pytest.raises(AcrcError, match=f"the software was changed since its commit {COMMIT}; must be"):
        frozen_plan.freeze(load_study(folder / "study.toml"), f"{COMMIT}+", ())


def test_a_plan_that_was_tampered_with_is_refused(folder: Path) -> None:
    path = frozen(folder)
    edited(path, '"margin_places": 1.0', '"margin_places": 9.0')
    with pytest.raises(AcrcError, match="no frozen plan: was changed after it was frozen, as its sha256 is "):
        begun(folder)


def test_a_plan_whose_hash_was_computed_anew_is_another_plan(folder: Path, plain: RunResult) -> None:
    path = frozen(folder)
    kept, _ = begun(folder)
    over(kept, plain)
    path.unlink()
    edited(folder / "study.toml", "seeds = 8", "seeds = 8\nmargin_s = 30")
    frozen(folder)
    edited(folder / "study.toml", "margin_s = 30", "")
    with pytest.raises(AcrcError, match=r"was begun with the plan .*; must be that one, or another campaign"):
        begun(folder)
    kept.plan_file.write_bytes(path.read_bytes())
    with pytest.raises(AcrcError, match=r"plan\.json: has SHA-256 .*, but the campaign was begun with "):
        judge(kept)


def test_a_campaign_that_had_runs_takes_no_plan(folder: Path, plain: RunResult) -> None:
    kept, said = begun(folder)
    assert said == [] and judge(kept).declared == ["Nothing was frozen before."]
    over(kept, plain, 1)
    path = frozen(folder)
    _, said = begun(folder)
    assert said == [f"{path}: is not taken, as {kept.folder} had runs before it had a plan."]
    assert store.plan_sentences(kept) == [store.NOTHING_FROZEN]


def test_a_resumed_campaign_keeps_its_plan_and_all_departures(folder: Path, plain: RunResult) -> None:
    path = frozen(folder)
    kept, said = begun(folder)
    over(kept, plain, 3)
    assert "Not as frozen: 10 of 16 runs are still to be made." in store.plan_sentences(kept)
    path.unlink()  # the campaign's own is enough
    assert begun(folder)[1] == said
    was = (folder / "corridor.png").read_bytes()
    damage_map(folder)
    begun(folder)
    (folder / "corridor.png").write_bytes(was)
    begun(folder)
    over(kept, plain)
    assert store.plan_sentences(kept)[1] == "Not as frozen: corridor.png has another content."


def test_looks_are_part_of_the_plan(folder: Path) -> None:
    edited(folder / "study.toml", "seeds = 8", "seeds = 25")
    plan = frozen_plan.read(frozen(folder, until_decided=True))
    assert plan.looks == (10, 20, 25)
    _, said = begun(folder)
    assert said[0].endswith("25 seeds, looks after 10, 20, 25 pairs.")
    assert len(said) == 2 and "it is not looked at on the way, and looks after 10, 20, 25 pairs" in said[1]
    kept, said = begun(folder, looks=True)
    assert said[1:] == []
    assert kept.looks is not None
    (folder / "study.frozen.json").unlink()
    (folder / "out").rename(folder / "before")
    frozen(folder)
    _, said = begun(folder, looks=True)
    assert said[1:] == ["Not as frozen: it is looked at on the way, and no look was planned."]


def test_a_bundle_is_checked_in_another_folder(folder: Path, plain: RunResult, tmp_path: Path) -> None:
    plan = frozen_plan.read(frozen(folder))
    kept, _ = begun(folder)
    over(kept, plain)
    told = judge(kept).declared
    bundle.make(kept.folder, tmp_path / "b.zip")
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        archive.extractall(tmp_path / "elsewhere")
    unpacked = tmp_path / "elsewhere" / "out"
    assert judge(store.load(unpacked / "results")).declared == told
    readme = (unpacked / "README.md").read_text()
    assert f"frozen at commit `{COMMIT}`, with SHA-256 `{plan.sha256}`" in readme
    assert "\n\n".join(told) in readme
    assert "The campaign is as frozen." in (unpacked / "report" / "report.html").read_text()
    again = unpacked / "study.json"
    made = store.create(unpacked / "reproduced", load_study(again))
    (map_image,) = (unpacked / "inputs").rglob("corridor.png")
    map_image.write_bytes(map_image.read_bytes() + b"\0")
    said = store.take_in(made, store.plan_of(None, again), again, looks=False)
    assert said[1:] == ["Not as frozen: corridor.png has another content."]
    assert set(msgspec.to_builtins(plan.study)) == set(Study.__struct_fields__)
