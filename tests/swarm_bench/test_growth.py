"""That the benchmark of growth runs and measures what it says; never how fast anything is."""

import json
import math
from collections.abc import Iterator
from functools import cache
from itertools import combinations
from unittest.mock import patch

import pytest

from benchmarks.swarm.growth import command, measuring
from benchmarks.swarm.task import SwarmTask, planned


@pytest.fixture(scope="module", autouse=True)
def measured_once() -> Iterator[None]:
    """What is printed for programs and for people is one measurement."""
    with patch.object(command, "measured", cache(measuring.measured)):
        yield


def test_every_size_is_measured_and_its_traffic_adds_up(capsys: pytest.CaptureFixture[str]) -> None:
    figures = command.run((1, 3), 3.0, json_output=True)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(figures))
    alone, few = figures["sizes"]
    assert [size["robots"] for size in figures["sizes"]] == [1, 3]
    assert alone["traffic"]["copies"] == alone["traffic"]["packets"] == 0.0
    traffic = few["traffic"]
    assert traffic["copies"] == pytest.approx(2 * traffic["frames"], rel=0.1)  # at the two others
    assert 0 < traffic["heard"] <= traffic["copies"] and 0 <= traffic["stale"] <= traffic["packets"]
    assert few["mesh"]["memory"]["robots"]["processes"] == 3 and few["mesh"]["ms"] > 0
    assert {actor for actor, _, _ in few["lines"]} >= {"world", "radio", "robots"}


def test_more_robots_than_the_scenario_has_room_for_stand_closer() -> None:
    with planned(150, SwarmTask(seconds=1.0), "zenoh") as plan:
        places = [robot.start[:2] for robot in plan.world.robots]
    assert len(places) == 150
    assert min(math.dist(one, other) for one, other in combinations(places, 2)) >= 0.42 - 1e-9


def test_what_a_person_reads(capsys: pytest.CaptureFixture[str]) -> None:
    command.run((1, 3), 3.0)
    printed = capsys.readouterr().out
    for title in ("chapter.toml, 3 s simulated", "the air, per robot", "CPU by part in memory"):
        assert title in printed
