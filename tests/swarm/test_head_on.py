"""Head-on in the passage to an office: without adaptation for ever, with it not for long."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import EventTable, Scenario
from observation.results.result import RunResult
from tests.seeds import sampled

IN_THE_WAY = 26
"""The seed from which a robot that is done stands in the way of the other one for good."""
SAMPLE = (1, 13)
"""The seeds of every day; the others are left to the night."""
HEAD_ON = REPOSITORY / "scenarios" / "head_on.toml"


def head_on(strategy: str, seed: int, duration: float) -> Scenario:
    return load_scenario(HEAD_ON, Overrides(strategy=strategy, seed=seed, duration=duration))


def outcome(scenario: Scenario, out: Path) -> RunResult:
    return swarm.run_in_memory(swarm.plan(scenario, RunOptions(out, bus="memory")), lambda progress: None)


@pytest.mark.parametrize("seed", sampled((seed for seed in range(1, 21) if seed != IN_THE_WAY), SAMPLE))
def test_the_chapters_example_gets_both_robots_to_all_their_places(seed: int, tmp_path: Path) -> None:
    result = outcome(head_on("chapter", seed, 600.0), tmp_path / "out")
    assert (result.places_done, result.places_total, result.places_lost) == (6, 6, 0)


@pytest.mark.parametrize(("make_way", "done"), [(False, 5), (True, 6)])
def test_who_is_done_may_have_to_make_way(make_way: bool, done: int, tmp_path: Path) -> None:
    scenario = head_on("chapter", IN_THE_WAY, 200.0).model_copy(update={"strategy": {"make_way": make_way}})
    result = outcome(scenario, tmp_path / "out")
    assert (result.places_done, result.places_total, result.places_lost) == (done, 6, 0)


@pytest.mark.parametrize("seed", sampled((1, 2), (1,)))
def test_without_adaptation_they_stand_until_the_limit(seed: int, tmp_path: Path) -> None:
    result = outcome(head_on("none", seed, 60.0), tmp_path / "out")
    assert (result.places_done, result.places_lost, result.simulated_s) == (0, 0, 60.0)


@pytest.mark.parametrize("strategy", ["released", "examples.courteous:behaviour"])
def test_the_released_code_and_the_example_of_ones_own_do_it_too(strategy: str, tmp_path: Path) -> None:
    result = outcome(head_on(strategy, 5, 300.0), tmp_path / "out")
    assert (result.places_done, result.places_lost) == (6, 0)


@pytest.mark.parametrize(("exchange", "done"), [(True, 2), (False, 1)])
def test_who_comes_late_to_an_adoption_needs_the_exchange(exchange: bool, done: int, tmp_path: Path) -> None:
    """Without it, r2 loses its only place, and stands in the passage for good while r1 wants to come out."""
    scenario = head_on("chapter", 1, 120.0)
    asleep = (EventTable(at=18.0, freeze="r2"), EventTable(at=18.2, thaw="r2"))  # when both would adopt
    one_place = scenario.places.model_copy(update={"per_robot": 1})
    r1 = scenario.robot[0].model_copy(update={"places": ((9.0, 12.5),)})
    changed = {
        "places": one_place,
        "robot": (r1,),
        "event": asleep,
        "strategy": {"exchange": exchange},
    }
    result = outcome(scenario.model_copy(update=changed), tmp_path / "out")
    assert (result.places_done, result.places_total, result.places_lost) == (done, 2, 0)
