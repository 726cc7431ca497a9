"""Uncertainty drawn per seed: the same for every strategy, kept, and good for one run to be repeated."""

from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from acrc_testbed.experiments.comparison import samples
from acrc_testbed.experiments.study import (
    Distribution,
    Factor,
    RandomFactor,
    Study,
    Trial,
    Variant,
    draw_cells,
    load_study,
)
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.experiments.trial_settings import (
    SHADOWING_DB,
    StudyOptions,
    check_study,
    common_conditions,
    condition_settings,
    draw_settings,
    make_study,
)
from acrc_testbed.experiments.verdicts import family_size as count_tests
from acrc_testbed.experiments.verdicts import stopping_rules, verdicts
from acrc_testbed.results.result import RunResult
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import Permit
from actors.runtime.errors import AcrcError
from cleaning.strategies import STRATEGIES
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario
from tests.experiments.made_runs import CLEANING, varied

ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
KILLS = Distribution("kills", (("count", (0, 2)), ("at", (5.0, 50.0))))
JAMS = Distribution(
    "jams", (("count", (1, 1)), ("at", (0.0, 2.0)), ("radius", (3.0, 9.0)), ("duration", (1.0, 5.0)))
)
DROPOUT = Distribution("dropout", (("share", (0.0, 0.2)),))
ODOMETRY = Distribution("odometry", (("drift", (1.0, 5.0)),))
DOORS = Distribution(
    "doors", (("count", (1, 1)), ("points", ((12.5, 9.0), (17.0, 9.0))), ("radius", (0.4, 0.4)))
)
CLOSURES = Distribution("closures", (("count", (1, 2)), ("at", (0.0, 2.0)), ("duration", (1.0, 60.0))))
TASKS = Distribution("tasks", (("count", (2, 3)), ("at", (0.0, 2.0))))
ALL = (KILLS, JAMS, DROPOUT, ODOMETRY, DOORS)
STUDY = Study(
    name="drawn",
    task=CLEANING,
    scenario=str(CORRIDOR),
    strategies=("none", "chapter"),
    seeds=40,
    distributions=ALL,
)


def test_draws_depend_on_the_seed_but_not_on_the_strategy() -> None:
    draws = {(trial.strategy, trial.seed): draw_settings(STUDY, trial) for trial in list(STUDY.trials())[:16]}
    for (strategy, seed), settings_ in draws.items():
        assert settings_ == draws["none", seed], strategy
    assert len({msgspec.json.encode(one) for one in draws.values()}) == 8


def test_every_distribution_stays_in_its_range() -> None:
    kills = []
    for trial in list(STUDY.trials())[::2]:
        settings_ = draw_settings(STUDY, trial)
        events = settings_["event"]
        killed = [event["kill"] for event in events if "kill" in event]
        assert len(set(killed)) == len(killed) <= 2
        kills.append(len(killed))
        assert all(5.0 <= event["at"] <= 50.0 for event in events if "kill" in event)
        (jam,) = [event for event in events if "jam" in event]
        assert 3.0 <= jam["radius"] <= 9.0 and 1.0 <= jam["duration"] <= 5.0
        (door,) = [event for event in events if "obstacle" in event]
        assert door["at"] == 0.0 and tuple(door["obstacle"]) in {(12.5, 9.0), (17.0, 9.0)}
        assert 0.0 <= settings_["uncertainty.dropout"] <= 0.2
        assert 1.0 <= settings_["uncertainty.drift"] <= 5.0
        load_scenario(CORRIDOR, Overrides(settings=tuple(settings_.items())))
    assert set(kills) == {0, 1, 2}


def test_drawn_closures_and_tasks_are_in_their_ranges() -> None:
    study = msgspec.structs.replace(
        STUDY, distributions=(CLOSURES, TASKS), settings=(("run.duration", 40.0),)
    )
    opened = set()
    for trial in list(study.trials())[:8:2]:
        settings_ = draw_settings(study, trial)
        given = [event for event in settings_["event"] if "give" in event]
        closed = [event for event in settings_["event"] if "close" in event]
        openings = [event for event in settings_["event"] if "open" in event]
        assert 2 <= len(given) <= 3 and 1 <= len(closed) <= 2
        assert all(event["at"] <= 2.0 for event in given + closed)
        assert len({tuple(event["close"]) for event in closed}) == len(closed)
        for opening in openings:
            (closing,) = [event for event in closed if event["close"] == opening["open"]]
            assert 1.0 <= opening["at"] - closing["at"] < 40.0
        opened.add(len(closed) - len(openings))
        resolve(load_scenario(CORRIDOR, Overrides(settings=(*study.settings, *settings_.items()))))
    assert len(opened) > 1, "some open again before the end, others do not"


def test_the_events_of_the_scenario_stay(tmp_path: Path) -> None:
    text = CORRIDOR.read_text().replace("../maps", str(ROOT / "maps"))
    (tmp_path / "s.toml").write_text(text + '\n[[event]]\nat = 7.0\nkill = "r1"\n')
    study = msgspec.structs.replace(STUDY, scenario=str(tmp_path / "s.toml"), distributions=(KILLS,))
    for trial in list(study.trials())[:20]:
        found = draw_settings(study, trial).get("event", [{"at": 7.0, "kill": "r1"}])
        assert found[0] == {"at": 7.0, "kill": "r1"}
        assert "r1" not in [event["kill"] for event in found[1:]]


@pytest.mark.parametrize("name", ["drawn_places", "all_strategies", "logistics"])
def test_shipped_studies_can_be_run(name: str) -> None:
    study = load_study(ROOT / "studies" / f"{name}.toml")
    assert set(study.strategies) <= set(STRATEGIES)
    cleaning = {one for one in STRATEGIES if not one.startswith("logistics-")}
    assert name != "all_strategies" or set(study.strategies) == cleaning
    first = next(study.trials())
    resolve(load_scenario(Path(study.scenario), Overrides(settings=study.settings_of(first.variant))))


HEAD = "scenario = 's.toml'\nstrategies = ['none', 'chapter']\n"
VARY, SAMPLES = f"{HEAD}[[vary]]\n", f"{HEAD}samples = 4\n[[vary]]\nkey = "
FAULTS = {
    "strategies = ['none']": "scenario is missing, but must be",
    "scenario = 's.toml'\nstrategies = []": "strategies is [], but must be a list of strategies",
    HEAD + "seeds = 0": "seeds is 0, but must be a whole number from 1",
    HEAD + "seed = 3": "unknown key seed; did you mean seeds",
    HEAD + "primary = [['none', 'auction']]": "primary: 'auction' is not one of the study's strategies",
    HEAD + "conditions = 'same'": 'conditions is "same", but must be "drawn" or "as written"',
    HEAD + "samples = 3": "samples is 3, but no factor is random (among or between)",
    VARY + "key = 'robots.count'": "vary[0] must have key and values, or a distribution",
    VARY + "distribution = 'kills'\ncount = 1": "vary[0] must have only count, at besides",
    VARY + "distribution = 'rain'": 'vary[0].distribution is "rain", but must be "kills", "jams", "dropout"',
    VARY + "distribution = 'dropout'\nshare = [0.3, 0.1]": "vary[0].share is [0.3, 0.1], but must be a",
    VARY + "key = 'a.b'\nbetween = [1, 3]": "samples is missing; it is required for random factors",
    VARY + "key = 'a'\nvalues = [1]\n[[vary]]\nkey = 'a'\nvalues = [2]": "vary[1]: a is set by another",
    VARY + "factor = 'floor'\nvalues = ['maze']": "vary[0].values[0] is 'maze'; must be a table with na",
    VARY + "factor = 'f'\nvalues = [{name = 'm', map = 'a'}, {name = 'm', map = 'b'}]":
        "vary[0]: names of levels must be unique: m, m",
    SAMPLES + "'a'\nbetween = [1, 3]": "samples: 4 exceeds the 3 combinations of the random factors",
    SAMPLES + "'a'\nbetween = [3, 1]": "vary[0].between is [3, 1], but must be two",
    SAMPLES + "'a'\nbetween = [1, 3]\nvalues = [1]": "vary[0] must have key and values",
    SAMPLES + "'run.duration'\nbetween = [100, 300]": "vary[0]: run.duration cannot be random",
}  # fmt: skip


@pytest.mark.parametrize("text", FAULTS)
def test_faults_of_a_study(tmp_path: Path, text: str) -> None:
    with pytest.raises(AcrcError, match=r"study\.toml") as caught:
        loaded(tmp_path, text)
    assert FAULTS[text] in str(caught.value)


def test_distributions_and_values_stand_side_by_side(tmp_path: Path) -> None:
    kills, robots = "distribution = 'kills'\ncount = [0, 2]\nat = 30", "key = 'robots.count'\nvalues = [4, 8]"
    study = loaded(tmp_path, f"{VARY}{kills}\n[[vary]]\n{robots}\n")
    assert study.distributions == (Distribution("kills", (("count", (0, 2)), ("at", (30, 30)))),)
    assert len(study.variants()) == 2


CHAPTER = ROOT / "scenarios" / "chapter.toml"
CONDITIONS_STUDY = Study(
    name="s",
    task=CLEANING,
    scenario=str(CHAPTER),
    strategies=("none", "chapter"),
    seeds=3,
    conditions="drawn",
)
EVERYTHING = {
    "robots.start": [],
    "places.preset": "areas",
    "robots.odometry": "kobuki",
    "radio.shadowing_db": SHADOWING_DB,
}


def world(study: Study, trial: Trial) -> tuple[object, object]:
    own = (*study.settings_of(trial.variant), *draw_settings(study, trial).items())
    overrides = Overrides(seed=trial.seed, strategy=trial.strategy, settings=own)
    robots = resolve(load_scenario(Path(study.scenario), overrides)).world.robots
    return tuple(one.start for one in robots), tuple(one.items for one in robots)


def test_seeds_draw_starts_and_places_the_same_for_every_strategy() -> None:
    worlds = {
        (trial.strategy, trial.seed): world(CONDITIONS_STUDY, trial) for trial in CONDITIONS_STUDY.trials()
    }
    for seed in (1, 2, 3):
        assert worlds["none", seed] == worlds["chapter", seed]
    for part in (0, 1):
        assert len({repr(worlds["none", seed][part]) for seed in (1, 2, 3)}) == 3


def test_as_written_nothing_is_drawn_and_every_seed_begins_alike() -> None:
    written = msgspec.structs.replace(CONDITIONS_STUDY, conditions="as written")
    assert [draw_settings(written, trial) for trial in written.trials()] == [{}] * 6
    assert len({repr(world(written, trial)) for trial in written.trials()}) == 1
    (sentence,) = [
        line for line in check_study(written, Permit(), CHAPTER)[0] if "the same positions" in line
    ]
    assert sentence == common_conditions(load_scenario(CHAPTER))
    assert not any(
        "the same positions" in line for line in check_study(CONDITIONS_STUDY, Permit(), CHAPTER)[0]
    )
    assert make_study(StudyOptions(scenario=CHAPTER, strategies="none")).conditions == "as written"


def chapter(own: Variant) -> Scenario:
    return load_scenario(CHAPTER, Overrides(settings=own))


@pytest.mark.parametrize("key", EVERYTHING)
def test_everything_is_drawn_except_settings_of_the_study(key: str) -> None:
    assert condition_settings(chapter, ()) == EVERYTHING
    assert condition_settings(chapter, tuple(EVERYTHING.items())) == {}
    written = {"robots.start": [[12.0, 5.0, 0.0]], "places.preset": "golden", "robots.odometry": "exact"}
    left = condition_settings(chapter, ((key, written.get(key, 0.0)), ("run.duration", 10.0)))
    assert left == {other: value for other, value in EVERYTHING.items() if other != key}
    robots = {"count": 2, "start": [[12.0, 5.0, 0.0]]}
    assert set(condition_settings(chapter, (("robots", robots),))) == {"places.preset", "radio.shadowing_db"}


def test_on_another_map_starts_and_places_are_drawn_for_that_map() -> None:
    maze = condition_settings(chapter, (("map", "../maps/maze.yaml"),))
    assert (maze["robots.start"], maze["places.preset"]) == ([], "free")
    offices = condition_settings(chapter, (("map", "offices:7"),))
    assert (offices["robots.start"], offices["places.preset"]) == ([], "areas")
    with pytest.raises(OptionError, match=r"also set places\.preset=free"):
        chapter((("map", "offices:7"), ("robots.start", [])))


def test_common_conditions_of_all_seeds_are_reported() -> None:
    told = common_conditions(load_scenario(CHAPTER))
    assert told is not None and "the places are the same, odometry is exact, the radio has no" in told
    ten = common_conditions(load_scenario(CHAPTER, Overrides(robots=10)))
    assert ten is not None and "9 of 10 robots start at the same positions" in ten
    overrides = Overrides(settings=tuple(EVERYTHING.items()))
    assert common_conditions(load_scenario(CHAPTER, overrides)) is None


def test_conditions_are_drawn_by_default(tmp_path: Path) -> None:
    assert loaded(tmp_path, HEAD).conditions == "drawn"
    assert loaded(tmp_path, HEAD + "conditions = 'as written'\n").conditions == "as written"


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
    (tmp_path / "s.toml").write_text('map = "corridor.yaml"')
    return load_study(path, tuning=tuning)


@given(seed=some.integers(1, 10_000), samples=some.integers(2, 12), levels=some.integers(2, 5))
def test_frequencies_of_levels_differ_by_at_most_one(seed: int, samples: int, levels: int) -> None:
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


def test_cells_and_levels_of_a_study(tmp_path: Path) -> None:
    study = loaded(tmp_path, RANDOM)
    settings = dict(study.settings_of((("robots.count", 5), ("floor", "two"))))
    assert settings == {"robots.count": 5, "map": "two.yaml", "places.preset": "free"}
    assert study == msgspec.json.decode(msgspec.json.encode(study), type=Study)
    trials = list(study.trials())
    by_strategy = [[(one.seed, one.variant) for one in trials if one.strategy == n] for n in study.strategies]
    assert by_strategy[0] == by_strategy[1]
    assert len(by_strategy[0]) == len({repr(one) for one in by_strategy[0]}) == 3 * 6 * 2
    presets = {dict(study.fixed_part(variant))["navigation.preset"] for variant in study.variants()}
    assert presets == {"chapter", "robust"}
    assert loaded(tmp_path, RANDOM) == study != loaded(tmp_path, RANDOM, tuning=True)
    assert loaded(tmp_path, RANDOM, tuning=True).cells != study.cells


def test_cells_are_compared_together_and_fixed_factors_one_by_one(plain: RunResult) -> None:
    """Two cells of four seeds, in which one strategy is always better: eight pairs, one test."""
    study = Study(
        name="s", task=CLEANING, scenario="/s.toml", strategies=("a", "b"), seeds=4, primary=(("a", "b"),),
        primary_metric="places", factors=(Factor("p", (1, 2)),),
        random=(Factor("r", (4, 8)),), cells=((("r", 4),), (("r", 8),)),
    )  # fmt: skip
    records = [made(plain, trial) for trial in study.trials()]
    found = samples(records, study)
    assert [(one.variant, len(one.pairs), one.cells) for one in found] == [
        ((("p", 1),), 8, 2), ((("p", 2),), 8, 2),
    ]  # fmt: skip
    assert found[0].where == " with p = 1 over 2 cells"
    assert [mine.task["places_done"] for mine, _ in found[0].pairs if mine] == [14, 18] * 4, (
        "seed by seed, cell by cell"
    )
    assert count_tests(study) == 2 and stopping_rules(study).differ.looks == (8,)
    first = verdicts(found, study)[0]
    assert first.steps[0].test.p == pytest.approx(2 / 2**8) and first.deciding is not None


def made(plain: RunResult, trial: Trial) -> TrialRecord:
    places = 10 + int(dict(trial.variant)["r"]) - (trial.strategy == "b")
    result = varied(plain, seed=trial.seed, places_done=places)
    return TrialRecord(trial.strategy, trial.seed, dict(trial.variant), result)


def test_another_factor_changes_nothing_of_the_others() -> None:
    trial = next(STUDY.trials())
    alone = msgspec.structs.replace(STUDY, distributions=(KILLS, JAMS, DROPOUT))
    both, fewer = draw_settings(STUDY, trial), draw_settings(alone, trial)
    assert both["uncertainty.dropout"] == fewer["uncertainty.dropout"]
    assert [event for event in both["event"] if "obstacle" not in event] == fewer["event"]
