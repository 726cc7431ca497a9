"""What `acrc campaign` and its neighbours say on the command line."""

import csv
import json
import os
from pathlib import Path

import msgspec
import pytest

from experiments.campaign import results_table, store
from experiments.campaign.trial_record import CheckRecord, TrialRecord, keep
from experiments.campaign.trust import IN_MEMORY
from experiments.study.study import Study
from experiments.study.study_wishes import StudyWishes, study_of
from observation.results.result import RunResult
from tests import warm

ROOT = Path(__file__).parents[2]


def acrc(*words: str, cwd: Path = ROOT) -> tuple[int, str, str]:
    done = warm.run(words, cwd, os.environ | {"COLUMNS": "200"}, 100.0, finds_cwd=False)
    return done.returncode, done.stdout, done.stderr


def over(folder: Path, plain: RunResult, *, digest: str) -> list[str]:
    """The words of a campaign of 20 runs that has nothing left to do; its first run was repeated."""
    kept = store.create(folder, study_of(StudyWishes(seeds=10)))
    for trial in kept.study.trials():
        places = 40 if trial.strategy == "chapter" else 20 + trial.seed
        result = msgspec.structs.replace(
            plain, places_done=places, completion_s=400.0 if places == 40 else None, simulated_s=600.0
        )
        keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))
    first = next(kept.study.trials())
    check = CheckRecord(first.strategy, first.seed, {}, plain.digest, 30.0, digest, 12.0)
    keep(kept.check_path(first), check)
    return ["campaign", "--seeds", "10", "--check-every", "0", "--out", str(folder)]


def test_a_campaign_that_is_over_says_what_came_of_it(plain: RunResult, tmp_path: Path) -> None:
    code, out, err = acrc(*over(tmp_path / "out", plain, digest=plain.digest))
    assert code == 0, err
    lines = out.splitlines()
    assert lines[0] == IN_MEMORY
    assert lines[1].startswith("Of 20 runs 1 were repeated as processes (0 isolated): 1 gave the same; ")
    assert lines[2].startswith("none: all places in 0 of 10 runs, 255 of ")
    assert lines[3].startswith("chapter: all places in 10 of 10 runs, 400 of ")
    assert lines[-1].startswith("20 of 20 runs, 0 failed, in ")
    assert "the golden places: r2 ends 0.25 m from place 1 of r3" in err
    assert (tmp_path / "out" / "results.parquet").stat().st_size > 1000
    with (tmp_path / "out" / "results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 20


def test_a_repetition_with_another_digest_is_exit_code_1(plain: RunResult, tmp_path: Path) -> None:
    words = over(tmp_path / "out", plain, digest="0123")
    code, out, err = acrc(*words, "--json")
    assert code == 1
    assert "none with seed 1 is another run over Zenoh than in memory: digest " in err
    assert f"{plain.digest} in memory, 0123 there; nothing that this campaign shows can be" in err
    assert json.loads(out)["checks"][0]["agrees"] is False


def test_the_primary_comparison_comes_first_and_the_right_way_round(plain: RunResult, tmp_path: Path) -> None:
    over(tmp_path / "out", plain, digest=plain.digest)
    code, out, _ = acrc("compare", str(tmp_path / "out"))
    assert code == 0
    assert "chapter is better than none by places done: 40 against 25.5" in out
    code, out, _ = acrc("plan-study", "--pilot", str(tmp_path / "out"))
    assert code == 0
    assert out.startswith("chapter and none by lexicographic: A12 = 1.00 [1.00, 1.00]")
    assert "10 of 20 runs have all places: they are at their ceiling there." in out


def test_until_decided_begins_no_further_run(plain: RunResult, tmp_path: Path) -> None:
    study = study_of(StudyWishes(seeds=60))
    kept = store.create(tmp_path / "out", study)
    for trial in study.trials():
        if trial.seed <= 30:
            places = 40 if trial.strategy == "chapter" else 20
            result = msgspec.structs.replace(plain, places_done=places, completion_s=None)
            keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, result))
    words = ["campaign", "--seeds", "60", "--until-decided", "--check-every", "0", "--out", str(kept.folder)]
    code, out, err = acrc(*words)
    assert code == 0, err
    assert "looks after 10, 20, 30, 40, 50, 60 pairs, at most 60, by lexicographic; p must be at most" in out
    assert "chapter and none: decided after 20 pairs, p = " in out
    assert "60 of 120 runs, 0 failed, in " in out
    _, out, _ = acrc("compare", str(kept.folder))
    assert "chapter and none: decided after 20 pairs, p = " in out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--preset", "fig7"), "--preset: fig7; must be one of chapter"),
        (("--preset", "chapter", "--strategies", "none"), "--scenario and --strategies: the study says so"),
        (("study.toml", "--preset", "chapter"), "--preset: is a study by itself"),
    ],
)
def test_what_does_not_go_together_is_said(words: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    code, _, err = acrc("campaign", *words, "--out", str(tmp_path / "out"))
    assert code == 2
    assert sentence in err
    assert not (tmp_path / "out").exists()


def test_the_preset_is_the_chapters_experiment() -> None:
    study = study_of(StudyWishes(preset="chapter"))
    assert (study.strategies, study.seeds, study.primary) == (("none", "chapter"), 10, (("chapter", "none"),))
    assert Path(study.scenario) == ROOT / "scenarios" / "chapter.toml"


def test_a_campaign_without_any_run_leaves_empty_tables(tmp_path: Path) -> None:
    kept = store.create(tmp_path / "out", Study("s", "s.toml", ("none",), 1))
    binary, text = results_table.write(kept)
    assert binary.exists() and text.read_text() == "\n"
