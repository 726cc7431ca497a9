"""That the benchmark of seeds runs what it says and counts what comes of it."""

import json

import pytest

from benchmarks.swarm import seeds


def test_each_number_of_robots_runs_from_each_seed(capsys: pytest.CaptureFixture[str]) -> None:
    twin = "cleaning.strategies.none:behaviour"
    outcomes = seeds.run((1, 2), 2, json_output=True, duration=3.0, strategies=("none", twin))
    assert [(one.strategy, one.robots, one.seed, one.places_total) for one in outcomes] == [
        (strategy, robots, seed, 10 * robots)
        for strategy in ("none", twin)
        for robots in (1, 2)
        for seed in (1, 2)
    ]
    assert len({one.digest for one in outcomes}) == 4
    printed = json.loads(capsys.readouterr().out)
    assert [one["digest"] for one in printed] == [one.digest for one in outcomes]


def test_the_last_lines_say_what_it_comes_to(capsys: pytest.CaptureFixture[str]) -> None:
    seeds.run((1, 2), 1, duration=3.0)
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "none, robots 1: all places in 0 of 1 seeds, 0 of 10 places, 0 given up, 0 lost, 0 contacts;"
        " goal, all places in every seed: MISSED",
        "none, robots 2: all places in 0 of 1 seeds, 0 of 20 places, 0 given up, 0 lost, 0 contacts",
    ]
