"""Cells of random factors: spread evenly, the same for every strategy, and compared together."""

from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from actors.runtime.errors import AcrcError
from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.comparison import samples
from experiments.comparison.decision import rules_for
from experiments.comparison.family import tests_of as count_tests
from experiments.comparison.family import verdicts
from experiments.study.cells import RandomFactor, draw_cells
from experiments.study.study import Factor, Study, Trial
from experiments.study.study_file import load_study
from observation.results.result import RunResult

ROOT = Path(__file__).parents[2]
HEAD = "scenario = 's.toml'\nstrategies = ['none', 'chapter']\n"
FLOORS = (
    '{name = "one", map = "one.yaml", area = []}, {name = "two", map = "two.yaml", places.preset = "free"}'
)
RANDOM = (
    f"{HEAD}seeds = 3\nsamples = 6\n[[vary]]\nkey = 'robots.count'\nbetween = [4, 12]\n"
    f"[[vary]]\nfactor = 'floor'\namong = [{FLOORS}]\n"
    "[[vary]]\nkey = 'navigation.preset'\nvalues = ['chapter', 'robust']\n"
)


def loaded(tmp_path: Path, text: str, *, tuning: bool = False) -> Study:
    path = tmp_path / "study.toml"
    path.write_text(text)
    return load_study(path, tuning=tuning)


@given(seed=some.integers(1, 10_000), samples=some.integers(2, 12), levels=some.integers(2, 5))
def test_every_level_comes_up_equally_often_to_one(seed: int, samples: int, levels: int) -> None:
    factors = [RandomFactor("a", tuple(range(levels))), RandomFactor("b", between=(0.5, 1.5))]
    cells = draw_cells(factors, samples, seed)
    assert len({repr(cell) for cell in cells}) == len(cells) == samples
    counts = Counter(dict(cell)["a"] for cell in cells)
    assert all(abs(counts[level] - samples / levels) < 2 for level in range(levels))
    shares = sorted(int((dict(cell)["b"] - 0.5) * samples * (1 - 1e-9)) for cell in cells)
    assert all(abs(share - place) <= 1 for place, share in enumerate(shares))


def test_cells_are_of_the_seed_and_of_nothing_else() -> None:
    factors = [RandomFactor("a", between=(4, 12)), RandomFactor("b", ("x", "y", "z"))]
    first = draw_cells(factors, 6, 1)
    np.random.seed(5)  # noqa: NPY002 - the global state, which must not count
    assert draw_cells(factors, 6, 1) == first != draw_cells(factors, 6, 2)
    assert all(isinstance(dict(cell)["a"], int) and 4 <= dict(cell)["a"] <= 12 for cell in first)


def test_every_strategy_has_the_same_cells_with_every_value_of_fixed_factors(tmp_path: Path) -> None:
    study = loaded(tmp_path, RANDOM)
    by_strategy = {
        name: [(trial.seed, trial.variant) for trial in study.trials() if trial.strategy == name]
        for name in study.strategies
    }
    assert by_strategy["none"] == by_strategy["chapter"]
    assert len(by_strategy["none"]) == len({repr(one) for one in by_strategy["none"]}) == 3 * 6 * 2
    assert {dict(study.fixed_part(variant))["navigation.preset"] for variant in study.variants()} == {
        "chapter", "robust",
    }  # fmt: skip
    assert loaded(tmp_path, RANDOM) == study
    assert loaded(tmp_path, RANDOM, tuning=True).cells != study.cells


def test_a_level_sets_all_its_keys(tmp_path: Path) -> None:
    study = loaded(tmp_path, RANDOM)
    settings = dict(study.settings_of((("robots.count", 5), ("floor", "two"))))
    assert settings == {"robots.count": 5, "map": "two.yaml", "places.preset": "free"}
    assert study == msgspec.json.decode(msgspec.json.encode(study), type=Study)


def test_cells_are_compared_together_and_fixed_factors_one_by_one(plain: RunResult) -> None:
    """Two cells of four seeds, in which one strategy is always better: eight pairs, one test."""
    study = Study(
        "s", "/s.toml", ("a", "b"), 4, primary=(("a", "b"),), primary_metric="places",
        factors=(Factor("p", (1, 2)),), random=(Factor("r", (4, 8)),), cells=((("r", 4),), (("r", 8),)),
    )  # fmt: skip
    records = [made(plain, trial) for trial in study.trials()]
    found = samples(records, study)
    assert [(one.variant, len(one.pairs), one.cells) for one in found] == [
        ((("p", 1),), 8, 2), ((("p", 2),), 8, 2),
    ]  # fmt: skip
    assert found[0].where == " with p = 1 over 2 cells"
    assert [mine.places_done for mine, _ in found[0].pairs] == [14, 18] * 4, "seed by seed, cell by cell"
    assert count_tests(study) == 2 and rules_for(study).differ.looks == (8,)
    first = verdicts(found, study)[0]
    assert first.steps[0].test.p == pytest.approx(2 / 2**8) and first.deciding is not None


def made(plain: RunResult, trial: Trial) -> TrialRecord:
    places = 10 + int(dict(trial.variant)["r"]) - (trial.strategy == "b")
    result = msgspec.structs.replace(plain, seed=trial.seed, places_done=places)
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), result)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "[[vary]]\nkey = 'a.b'\nbetween = [1, 3]\n",
            "samples is missing, but a factor has among or between",
        ),
        ("samples = 3\n", "samples is 3, but no factor has among or between; must have both or neither"),
        (
            "samples = 4\n[[vary]]\nkey = 'a.b'\nbetween = [1, 3]\n",
            "samples is 4, but the random factors have 3 combinations; must be at most that many",
        ),
        (
            "samples = 2\n[[vary]]\nkey = 'a.b'\nbetween = [3, 1]\n",
            "vary[0].between is [3, 1], but must be two",
        ),
        (
            "samples = 2\n[[vary]]\nkey = 'a.b'\nbetween = [1, 3]\nvalues = [1]\n",
            "vary[0] must have a key and its values",
        ),
        (
            "samples = 2\n[[vary]]\nkey = 'run.duration'\nbetween = [100, 300]\n",
            "vary[0] draws run.duration; must be fixed, so that runs compare",
        ),
        (
            "[[vary]]\nkey = 'a.b'\nvalues = [1]\n[[vary]]\nkey = 'a.b'\nvalues = [2]\n",
            "vary[1] sets a.b once more; must leave it to one factor",
        ),
        (
            "[[vary]]\nfactor = 'floor'\nvalues = ['maze']\n",
            "vary[0].values[0] is 'maze'; must be a table with a name and keys of the scenario",
        ),
        (
            "[[vary]]\nfactor = 'f'\nvalues = [{name = 'm', map = 'a'}, {name = 'm', map = 'b'}]\n",
            "vary[0] has two levels of one name (m, m); each must have its own",
        ),
    ],
)
def test_what_is_wrong_with_factors_is_said(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        loaded(tmp_path, HEAD + text)
    assert sentence in str(caught.value) and str(tmp_path / "study.toml") in str(caught.value)
