"""`acrc campaign` and related commands, and the seal of a campaign."""

import csv
import json
from pathlib import Path

import pytest

from acrc_testbed.experiments import store
from acrc_testbed.experiments.store import IN_MEMORY
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_record import CheckRecord, TrialRecord, write_json
from acrc_testbed.experiments.trial_settings import StudyOptions, make_study, resolve_study
from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import SUMS, SealError, check_seal, checksum_lines, seal
from tests import in_process
from tests.experiments.made_runs import CLEANING, varied

ROOT = Path(__file__).parents[2]


def acrc(*words: str) -> tuple[int, str, str]:
    done = in_process.acrc(*words, env={"COLUMNS": "200"})
    return done.returncode, done.stdout, done.stderr


def over(folder: Path, plain: RunResult, *, digest: str) -> list[str]:
    """Return the command of a complete campaign of 20 runs; its first run was repeated."""
    kept = store.create_store(folder, make_study(StudyOptions(seeds=10)))
    for trial in kept.study.trials():
        places = 40 if trial.strategy == "chapter" else 20 + trial.seed
        result = varied(
            plain,
            places_done=places,
            places_total=40,
            completion_s=400.0 if places == 40 else None,
            simulated_s=600.0,
        )
        write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))
    first = next(kept.study.trials())
    check = CheckRecord(first.strategy, first.seed, {}, plain.digest, 30.0, digest, 12.0)
    write_json(kept.check_path(first), check)
    return ["campaign", "--seeds", "10", "--check-every", "0", "--out", str(folder)]


def test_a_complete_campaign_prints_its_results(plain: RunResult, tmp_path: Path) -> None:
    code, out, err = acrc(*over(tmp_path / "out", plain, digest=plain.digest))
    assert code == 0, err
    lines = out.splitlines()
    assert lines[0] == IN_MEMORY
    assert lines[1].startswith(
        "1 of 20 runs were repeated as processes (0 with sandboxes): 1 with the same result; "
    )
    assert lines[2].startswith("none: 255 of ")
    assert lines[3].startswith("chapter: 400 of ")
    assert lines[-1].startswith("20 of 20 runs done, 0 failed")
    assert (tmp_path / "out" / "results.parquet").stat().st_size > 1000
    with (tmp_path / "out" / "results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 20


def test_a_repetition_with_another_digest_is_exit_code_1(plain: RunResult, tmp_path: Path) -> None:
    words = over(tmp_path / "out", plain, digest="0123")
    code, out, err = acrc(*words, "--json")
    assert code == 1
    assert f"{plain.digest} in memory, 0123 over Zenoh; do not trust this campaign" in err
    assert json.loads(out)["checks"][0]["agrees"] is False


def test_the_primary_comparison_comes_first_in_declared_order(plain: RunResult, tmp_path: Path) -> None:
    over(tmp_path / "out", plain, digest=plain.digest)
    code, out, _ = acrc("compare", str(tmp_path / "out"))
    assert code == 0
    assert "chapter is better than none in places done: 40 versus 25.5, difference +14.5 places " in out
    code, out, _ = acrc("compare", str(tmp_path / "out"), "--json")
    told = json.loads(out)
    assert (told["verdicts"][0]["decided_by"], told["failures"]) == ("places", [])
    assert told["estimates"][0]["difference"][0] == 14.5
    code, out, _ = acrc("study", "plan", "--pilot", str(tmp_path / "out"))
    assert code == 0
    assert "Power: share of campaigns that detect the difference, by 2 tests" in out
    assert "as large as in the pilot, 6 pairs detect each with probability 0.9." in out
    assert "(in brackets; plan with these numbers), 6 pairs detect each with probability 0.9." in out
    assert "10 of 20 runs have the largest possible value of places done (ceiling effect)." in out


def test_until_decided_starts_no_further_run(plain: RunResult, tmp_path: Path) -> None:
    study = make_study(StudyOptions(seeds=60))
    kept = store.create_store(tmp_path / "out", study)
    for trial in study.trials():
        if trial.seed <= 30:
            places = 40 if trial.strategy == "chapter" else 20
            result = varied(plain, places_done=places, places_total=40, completion_s=None)
            write_json(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))
    words = ["campaign", "--seeds", "60", "--until-decided", "--check-every", "0", "--out", str(kept.folder)]
    code, out, err = acrc(*words)
    assert code == 0, err
    assert "interim looks after 10, 20, 30, 40, 50, 60 pairs; thresholds of p for a difference" in out
    assert "chapter and none: decided after 20 pairs; at 10 chapter ahead by places, p = " in out
    assert "60 of 120 runs done, 0 failed" in out
    _, out, _ = acrc("compare", str(kept.folder))
    assert "chapter and none: decided after 20 pairs; at 10 chapter ahead by places, p = " in out


def test_failed_runs_and_too_few_seeds_are_reported_first(plain: RunResult, tmp_path: Path) -> None:
    study = make_study(StudyOptions(seeds=3))
    kept = store.create_store(tmp_path / "out", study)
    for trial in study.trials():
        failed = trial.strategy == "chapter" and trial.seed == 2
        record = TrialRecord(trial.strategy, trial.seed, {}, None, "it rained") if failed else None
        write_json(kept.path(trial), record or TrialRecord(trial.strategy, trial.seed, {}, plain))
    code, _, err = acrc("campaign", "--seeds", "3", "--check-every", "0", "--out", str(kept.folder))
    assert code == 0, err
    too_few = "3 pairs of runs are too few: the exact test needs at least 6 to reach p < 5 %"
    assert too_few in err
    _, out, _ = acrc("compare", str(kept.folder))
    assert out.startswith("chapter failed in 1 of 3 runs (seed 2); each counts as a run with places = 0")
    for option in ("--comparisons", "--a12"):
        code, _, err = acrc("study", "plan", "--pilot", str(kept.folder), option, "1")
        assert code == 2 and err.startswith(f"acrc: {option}: cannot be combined with --pilot")


def test_pairs_for_a_difference_in_percent(plain: RunResult, tmp_path: Path) -> None:
    """None visits 21 to 30 places, and chapter 40: 10 % are 2.55 places, 0.84 standard deviations."""
    over(tmp_path / "out", plain, digest=plain.digest)
    words = ("study", "plan", "--pilot", str(tmp_path / "out"), "--difference")
    code, out, err = acrc(*words, "10%")
    assert code == 0, err
    assert out.startswith(
        "22 pairs detect a difference of 2.55 places in places done (10 % of the mean of none) with "
        "probability 0.9 at p ≤ 0.025, if differences are normal with the pilot's standard deviation "
        "of 3.03 places."
    )
    code, _, err = acrc(*words, "ten")
    assert code == 2 and err.startswith("acrc: --difference: ten; must be a percentage, such as 10%, that")
    code, _, err = acrc("study", "plan", "--difference", "10%")
    assert code == 2 and err.startswith("acrc: --difference: needs --pilot")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("campaign --preset fig7 --out {out}", "--preset: fig7; must be one of chapter"),
        ("campaign --preset chapter --strategies none --out {out}", "--strategies: defined by the study"),
        (
            "campaign scenarios/chapter.toml --preset chapter --out {out}",
            "--preset: is a study; can",
        ),
        ("run studies/chapter.toml", "studies/chapter.toml: is a study, not a scenario; run it with"),
        ("study freeze scenarios/chapter.toml", "scenarios/chapter.toml: is a scenario, not a study; to"),
        ("campaign headlin", "headlin: file not found; did you mean studies/headline.toml?"),
    ],
)
def test_invalid_files_and_options_are_refused(words: str, sentence: str, tmp_path: Path) -> None:
    code, out, err = acrc(*words.format(out=tmp_path / "out").split())
    assert code in {1, 2} and out == "" and sentence in err
    assert not (tmp_path / "out").exists()


def test_a_scenario_given_as_a_study_becomes_one(plain: RunResult, tmp_path: Path) -> None:
    scenario = ROOT / "scenarios" / "chapter.toml"
    wishes = StudyOptions(study=scenario, seeds=2, strategies="chapter")
    assert resolve_study(wishes)[0] == StudyOptions(scenario=scenario, seeds=2, strategies="chapter")
    study = ROOT / "studies" / "chapter.toml"
    assert resolve_study(StudyOptions(study=study)) == (StudyOptions(study=study), ())
    words = over(tmp_path / "out", plain, digest=plain.digest)
    code, out, err = acrc("campaign", "scenarios/chapter.toml", *words[1:])
    assert code == 0 and "20 of 20 runs done, 0 failed" in out
    assert err.startswith("scenarios/chapter.toml is a scenario: comparing none and chapter, each with ")


def test_the_preset_is_the_chapters_experiment() -> None:
    study = make_study(StudyOptions(preset="chapter"))
    assert (study.strategies, study.seeds) == (("none-original", "none", "chapter"), 10)
    assert study.primary == (("chapter", "none-original"), ("chapter", "none"))
    assert Path(study.scenario) == ROOT / "scenarios" / "chapter.toml"


@pytest.fixture
def kept(tmp_path: Path) -> store.Store:
    kept = store.create_store(
        tmp_path / "kept",
        Study(name="kept", task=CLEANING, scenario="/s.toml", strategies=("none",), seeds=1),
    )
    write_json(kept.path(next(kept.study.trials())), TrialRecord("none", 1, {}, failure="it rained"))
    seal(kept.folder)
    return kept


def test_a_changed_trial_is_refused_on_reading_and_resuming(kept: store.Store) -> None:
    assert store.load_store(kept.folder).study == kept.study
    path = kept.path(next(kept.study.trials()))
    path.write_bytes(path.read_bytes().replace(b"rained", b"snowed"))
    with pytest.raises(SealError, match=f"{path}: changed; "):
        store.load_store(kept.folder)
    with pytest.raises(SealError, match=f"{path}: changed; "):
        store.create_store(kept.folder, kept.study)
    assert (kept.folder / SUMS).exists(), "the campaign was not resumed"


def test_a_resumed_campaign_is_unsealed_until_it_ends(kept: store.Store) -> None:
    store.create_store(
        kept.folder, Study(name="kept", task=CLEANING, scenario="/s.toml", strategies=("none",), seeds=2)
    )
    assert check_seal(kept.folder) is None
    assert store.load_store(kept.folder).study.seeds == 2


def test_a_report_can_be_written_before_and_after_sealing(kept: store.Store) -> None:
    page = kept.folder / "report" / "report.html"
    page.parent.mkdir()
    for text in ("while the campaign went on", "by an older version", "after it"):
        page.write_text(text)
        assert store.load_store(kept.folder).study == kept.study
        if text != "by an older version":
            seal(kept.folder)
            assert "report" not in (kept.folder / SUMS).read_text()
    sums = (kept.folder / SUMS).read_text().splitlines()[:-1]
    page.write_text("as an earlier version sealed it")
    told = checksum_lines({name: one for one, _, name in (line.partition("  ") for line in sums)} | {
        "report/report.html": "0" * 64
    })  # fmt: skip
    (kept.folder / SUMS).write_bytes(told)
    assert check_seal(kept.folder) is not None
