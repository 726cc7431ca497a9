"""What seeds draw unless a study fixes it: the same for every strategy, another for another seed."""

from pathlib import Path

import msgspec
import pytest

from actors.installation.usage import OptionError
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario
from experiments.study.conditions import SHADOWING_DB, drawn_conditions, same_for_all_seeds
from experiments.study.draws import drawn
from experiments.study.study import Study, Trial, Variant
from experiments.study.study_file import load_study
from experiments.study.study_wishes import StudyWishes, check, study_of

ROOT = Path(__file__).parents[2]
CHAPTER = ROOT / "scenarios" / "chapter.toml"
STUDY = Study("s", str(CHAPTER), ("none", "chapter"), 3, conditions="drawn")
EVERYTHING = {
    "robots.start": [],
    "places.preset": "areas",
    "robots.odometry": "kobuki",
    "radio.shadowing_db": SHADOWING_DB,
}


def world(study: Study, trial: Trial) -> tuple[object, object]:
    """Where the robots of a trial start, and their places."""
    own = (*study.settings_of(trial.variant), *drawn(study, trial).items())
    overrides = Overrides(seed=trial.seed, strategy=trial.strategy, settings=own)
    robots = resolve(load_scenario(Path(study.scenario), overrides)).world.robots
    return tuple(one.start for one in robots), tuple(one.places for one in robots)


def test_seeds_draw_starts_and_places_the_same_for_every_strategy() -> None:
    worlds = {(trial.strategy, trial.seed): world(STUDY, trial) for trial in STUDY.trials()}
    for seed in (1, 2, 3):
        assert worlds["none", seed] == worlds["chapter", seed]
    for part in (0, 1):
        assert len({repr(worlds["none", seed][part]) for seed in (1, 2, 3)}) == 3


def test_as_written_nothing_is_drawn_and_every_seed_begins_alike() -> None:
    written = msgspec.structs.replace(STUDY, conditions="as written")
    assert [drawn(written, trial) for trial in written.trials()] == [{}] * 6
    assert len({repr(world(written, trial)) for trial in written.trials()}) == 1


def test_a_study_of_before_is_as_written() -> None:
    """Its study.json knows nothing of conditions, and its campaign must go on as it began."""
    old = b'{"name":"s","scenario":"/s.toml","strategies":["none"],"seeds":3}'
    assert msgspec.json.decode(old, type=Study) == Study("s", "/s.toml", ("none",), 3)
    assert Study("s", "/s.toml", ("none",), 3).conditions == "as written"


def chapter(own: Variant) -> Scenario:
    return load_scenario(CHAPTER, Overrides(settings=own))


def test_all_that_the_scenario_fixes_is_drawn() -> None:
    assert drawn_conditions(chapter, ()) == EVERYTHING


@pytest.mark.parametrize("key", EVERYTHING)
def test_what_the_study_names_stays(key: str) -> None:
    written = {"robots.start": [[12.0, 5.0, 0.0]], "places.preset": "golden", "robots.odometry": "exact"}
    left = drawn_conditions(chapter, ((key, written.get(key, 0.0)), ("run.duration", 10.0)))
    assert left == {other: value for other, value in EVERYTHING.items() if other != key}


def test_a_table_that_the_study_sets_stays_whole() -> None:
    robots = {"count": 2, "start": [[12.0, 5.0, 0.0]]}
    assert set(drawn_conditions(chapter, (("robots", robots),))) == {"places.preset", "radio.shadowing_db"}


def test_what_is_drawn_already_stays() -> None:
    assert drawn_conditions(chapter, tuple(EVERYTHING.items())) == {}


def test_on_another_map_starts_and_places_are_drawn_for_that_map() -> None:
    maze = drawn_conditions(chapter, (("map", "../maps/maze.yaml"),))
    assert (maze["robots.start"], maze["places.preset"]) == ([], "free")
    offices = drawn_conditions(chapter, (("map", "offices:7"),))
    assert (offices["robots.start"], offices["places.preset"]) == ([], "areas")
    with pytest.raises(OptionError, match=r"must be set together with places\.preset=free"):
        chapter((("map", "offices:7"), ("robots.start", [])))


def test_a_sentence_says_what_all_seeds_have_in_common() -> None:
    told = same_for_all_seeds(load_scenario(CHAPTER))
    assert told is not None and told.startswith(
        "with every seed all robots begin in the same positions, the places are the same, odometry is exact, "
        "radio has no shadowing"
    )
    ten = same_for_all_seeds(load_scenario(CHAPTER, Overrides(robots=10)))
    assert ten is not None and "9 of 10 robots begin in the same positions" in ten
    overrides = Overrides(settings=tuple(EVERYTHING.items()))
    assert same_for_all_seeds(load_scenario(CHAPTER, overrides)) is None


def test_a_campaign_says_that_all_seeds_begin_alike() -> None:
    written = msgspec.structs.replace(STUDY, conditions="as written")
    (sentence,) = [line for line in check(written, Permit(), CHAPTER)[0] if "the same positions" in line]
    assert sentence == same_for_all_seeds(load_scenario(CHAPTER))
    assert not any("the same positions" in line for line in check(STUDY, Permit(), CHAPTER)[0])
    assert study_of(StudyWishes(scenario=CHAPTER, strategies="none")).conditions == "as written"


def test_a_file_draws_unless_it_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    plain = "scenario = 's.toml'\nstrategies = ['none']\n"
    path.write_text(plain)
    assert load_study(path).conditions == "drawn"
    path.write_text(plain + "conditions = 'as written'\n")
    assert load_study(path).conditions == "as written"
    path.write_text(plain + "conditions = 'same'\n")
    with pytest.raises(AcrcError, match='conditions is "same", but must be "drawn" or "as written"'):
        load_study(path)


def test_the_chapters_experiment_is_as_written() -> None:
    study = load_study(ROOT / "studies" / "chapter.toml")
    assert study == Study(
        "chapter", str(CHAPTER), ("none-original", "none", "chapter"), 10,
        primary=(("chapter", "none-original"), ("chapter", "none")),
    )  # fmt: skip
