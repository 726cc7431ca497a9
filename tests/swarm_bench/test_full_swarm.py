"""That the benchmark of swarms runs and measures what it says; never how fast anything is."""

import dataclasses
import json
import math
from itertools import combinations

import pytest

from actors.robot.core import RobotParts
from benchmarks.statistics.measured import Measured
from benchmarks.swarm import benchmark
from benchmarks.swarm.task import SwarmTask, planned


@pytest.fixture(scope="module")
def measured(forked_servers: None) -> Measured:
    return benchmark.measure((1, 4), 3.0, repeat=1)


def test_the_budget_names_all_parts_and_adds_up(measured: Measured) -> None:
    assert json.dumps(measured.figures)
    assert measured.figures["task"]["seconds"] == 3.0 and measured.holds is None
    for swarm in measured.figures["swarms"]:
        mesh, memory = swarm["mesh"], swarm["memory"]
        assert {actor for actor, _, _ in swarm["lines"]} == {"world", "radio", "robots", "parent"}
        parts = {part for actor, part, _ in swarm["lines"] if actor == "robots"}
        stated = {field.name for field in dataclasses.fields(RobotParts)} - {
            "moving"
        }  # thresholds do no work
        assert stated <= parts and {"codec", "recorder", "shell", "processes and mesh"} <= parts
        assert sum(ms for _, _, ms in swarm["lines"]) == pytest.approx(sum(mesh["by_actor"].values()))
        assert sum(ms for _, _, ms in memory["lines"]) + memory["clock_ms"] == pytest.approx(
            memory["clocked_ms"]
        )
        assert all(ms > 0 for actor, _, ms in memory["lines"] if actor == "world")
        assert mesh["memory"]["robots"]["processes"] == swarm["robots"]
        for kind in mesh["memory"].values():
            assert 0 < kind["private_mb"] <= kind["pss_mb"] <= kind["rss_mb"]
        assert 0 < swarm["idle"]["memory_ms"] < memory["ms"] and swarm["ping_pong"]["cpu_us"] > 0


def test_traffic_adds_up(measured: Measured) -> None:
    alone, few = (swarm["traffic"] for swarm in measured.figures["swarms"])
    assert alone["copies"] == alone["packets"] == 0.0
    assert few["copies"] == pytest.approx(3 * few["frames"], rel=0.15)  # at the three others
    assert 0 < few["heard"] <= few["copies"] and 0 <= few["stale"] <= few["packets"]


def test_what_a_person_reads(measured: Measured, capsys: pytest.CaptureFixture[str]) -> None:
    measured.show()
    printed = capsys.readouterr().out
    for title in (
        "chapter.toml, over Zenoh",
        "CPU by part",
        "processes:",
        "memory, all of a kind",
        "the air",
    ):
        assert title in printed
    assert "goal, 4 robots: simulated seconds per second over Zenoh, at least 100:" in printed


def test_more_robots_than_the_scenario_has_room_for_stand_closer() -> None:
    with planned(150, SwarmTask(seconds=1.0), "zenoh") as plan:
        places = [robot.start[:2] for robot in plan.world.robots]
    assert len(places) == 150
    assert min(math.dist(one, other) for one, other in combinations(places, 2)) >= 0.42 - 1e-9
