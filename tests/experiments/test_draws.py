"""Uncertainty drawn per seed: the same for every strategy, kept, and good for one run to be repeated."""

import shlex
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from actors.runtime.errors import AcrcError
from cleaning.strategies import STRATEGIES
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, settings
from deploy.scenario.toml_text import inline
from experiments.campaign import results_table, store
from experiments.campaign.campaign import CampaignOptions, carry_out
from experiments.study.draws import PARAMETERS, drawn
from experiments.study.study import Distribution, Study
from experiments.study.study_file import load_study
from experiments.study.vary_table import VaryTable

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
STUDY = Study("drawn", str(CORRIDOR), ("none", "chapter"), 40, distributions=ALL)


def test_what_is_drawn_is_the_same_for_every_strategy_and_another_for_another_seed() -> None:
    draws = {(trial.strategy, trial.seed): drawn(STUDY, trial) for trial in list(STUDY.trials())[:16]}
    for (strategy, seed), settings_ in draws.items():
        assert settings_ == draws["none", seed], strategy
    assert len({msgspec.json.encode(one) for one in draws.values()}) == 8


def test_every_distribution_stays_in_its_range() -> None:
    kills = []
    for trial in list(STUDY.trials())[::2]:
        settings_ = drawn(STUDY, trial)
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


def test_doors_that_close_and_places_that_come_stay_in_their_ranges() -> None:
    study = msgspec.structs.replace(
        STUDY, distributions=(CLOSURES, TASKS), settings=(("run.duration", 40.0),)
    )
    opened = set()
    for trial in list(study.trials())[:12:2]:
        settings_ = drawn(study, trial)
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


def test_another_factor_changes_nothing_of_the_others() -> None:
    trial = next(STUDY.trials())
    alone = msgspec.structs.replace(STUDY, distributions=(KILLS, JAMS, DROPOUT))
    both, fewer = drawn(STUDY, trial), drawn(alone, trial)
    assert both["uncertainty.dropout"] == fewer["uncertainty.dropout"]
    assert [event for event in both["event"] if "obstacle" not in event] == fewer["event"]


def test_the_events_of_the_scenario_stay(tmp_path: Path) -> None:
    text = CORRIDOR.read_text().replace("../maps", str(ROOT / "maps"))
    (tmp_path / "s.toml").write_text(text + '\n[[event]]\nat = 7.0\nkill = "r1"\n')
    study = msgspec.structs.replace(STUDY, scenario=str(tmp_path / "s.toml"), distributions=(KILLS,))
    for trial in list(study.trials())[:20]:
        found = drawn(study, trial).get("event", [{"at": 7.0, "kill": "r1"}])
        assert found[0] == {"at": 7.0, "kill": "r1"}
        assert "r1" not in [event["kill"] for event in found[1:]]


@pytest.mark.usefixtures("forked_servers")
def test_one_run_of_a_campaign_can_be_repeated_from_what_was_kept(tmp_path: Path) -> None:
    short = (("robots.count", 2), ("run.duration", 3.0))
    study = Study(
        "s",
        str(CORRIDOR),
        ("chapter",),
        1,
        settings=short,
        distributions=(JAMS, DROPOUT, ODOMETRY, CLOSURES, TASKS),
    )
    kept = store.create(tmp_path / "out", study)
    carry_out(kept, CampaignOptions(jobs=1))
    (record,) = kept.records()
    assert record.result is not None, record.failure
    given = [event for event in record.drawn["event"] if "give" in event]
    assert record.result.places_total == 2 * 10 + len(given)
    (row,) = results_table.rows(kept)
    words = [f"{key}={inline(value)}" for key, value in [*short, *record.drawn.items()]]
    typed = shlex.split(str(row["command"]))
    assert typed[:3] == ["acrc", "run", str(CORRIDOR)]
    assert [word for flag, word in pairwise(typed) if flag == "--set"] == words
    overrides = Overrides(seed=1, strategy="chapter", settings=settings(words))
    alone = swarm.plan(load_scenario(CORRIDOR, overrides), RunOptions(tmp_path / "alone", bus="memory"))
    assert swarm.run_in_memory(alone, lambda progress: None).digest == record.result.digest


def test_every_parameter_can_stand_in_a_file() -> None:
    assert {name for names in PARAMETERS.values() for name in names} <= set(VaryTable.model_fields)


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("key = 'robots.count'", "vary[0] must have a key and its values, or a distribution"),
        ("distribution = 'kills'\ncount = 1", "vary[0] must have count, at beside the distribution kills"),
        ("distribution = 'rain'", 'vary[0].distribution is "rain", but must be "kills", "jams", "dropout"'),
        (
            "distribution = 'dropout'\nshare = [0.3, 0.1]",
            "vary[0].share is [0.3, 0.1], but must be a number from 0 on, or a range [from, to]",
        ),
        ("distribution = 'dropout'\nshare = 0.1\nat = 3", "vary[0] must have share beside the distribution"),
    ],
)
def test_what_is_wrong_with_a_distribution_is_said(tmp_path: Path, table: str, sentence: str) -> None:
    path = tmp_path / "study.toml"
    path.write_text(f"scenario = 's.toml'\nstrategies = ['none']\n[[vary]]\n{table}\n")
    with pytest.raises(AcrcError) as caught:
        load_study(path)
    assert sentence in str(caught.value)


@pytest.mark.parametrize("name", ["drawn_places", "all_strategies"])
def test_the_studies_that_come_along_can_be_carried_out(name: str) -> None:
    study = load_study(ROOT / "studies" / f"{name}.toml")
    assert set(study.strategies) <= set(STRATEGIES)
    assert name != "all_strategies" or set(study.strategies) == set(STRATEGIES)
    first = next(study.trials())
    resolve(load_scenario(Path(study.scenario), Overrides(settings=study.settings_of(first.variant))))


def test_distributions_and_values_stand_side_by_side(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(
        "scenario = 's.toml'\nstrategies = ['none']\n"
        "[[vary]]\ndistribution = 'kills'\ncount = [0, 2]\nat = 30\n"
        "[[vary]]\nkey = 'robots.count'\nvalues = [4, 8]\n"
    )
    study = load_study(path)
    assert study.distributions == (Distribution("kills", (("count", (0, 2)), ("at", (30, 30)))),)
    assert len(study.variants()) == 2
