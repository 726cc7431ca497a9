"""That the benchmark of full swarms runs and measures what it says; never how fast anything is."""

import dataclasses
import json
from collections.abc import Iterator
from functools import cache
from unittest.mock import patch

import pytest
from rich.console import Console

from actors.robot.core import RobotParts
from benchmarks.swarm import full_swarm, in_memory
from benchmarks.swarm.task import SwarmTask

TASK = SwarmTask(robots=(1, 4), seconds=1.5, repeat=1)


@pytest.fixture(scope="module", autouse=True)
def measured_once() -> Iterator[None]:
    """What is printed for programs and for people is one measurement."""
    measured = cache(lambda task: full_swarm._figures(task, Console(quiet=True)))
    measured(TASK)
    profiled = cache(in_memory.profile)
    with (
        patch.object(full_swarm, "_figures", lambda task, console: measured(task)),
        patch.object(full_swarm, "profile", profiled),
    ):
        yield


def test_the_budget_names_all_parts_and_adds_up(capsys: pytest.CaptureFixture[str]) -> None:
    figures = full_swarm.run(TASK, json_output=True)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(figures))
    for swarm in figures["swarms"]:
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


def test_what_a_person_reads(capsys: pytest.CaptureFixture[str]) -> None:
    full_swarm.run(TASK)
    printed = capsys.readouterr().out
    for title in ("chapter.toml, over Zenoh", "CPU by part", "processes:", "memory, all of a kind"):
        assert title in printed
    assert "goal, 4 robots: simulated seconds per second over Zenoh, at least 100:" in printed
