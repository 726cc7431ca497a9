"""Robots whose processes have no network at all: their boards are the only way from one to another."""

from pathlib import Path

import pytest

from benchmarks.hardware import onboard
from tests.seeds import sampled
from tests.swarm.command import ROOT

SCENARIO = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
strategy = "chapter"
[robots]
count = 3
[[robot]]
id = "r1"
start = [8.0, 12.5, 0.0]
places = [[8.9, 12.5]]
[[robot]]
id = "r2"
start = [11.0, 12.5, 0.0]
places = [[11.9, 12.5]]
"""
THIRD = """
[[robot]]
id = "r3"
start = [17.0, 12.5, 0.0]
places = [[17.9, 12.5]]
"""


@pytest.mark.timeout(240)
@pytest.mark.parametrize("robots", sampled((2, 3), (2,)))
def test_robots_talk_by_serial_bytes_alone(tmp_path: Path, robots: int) -> None:
    scenario = tmp_path / "few.toml"
    scenario.write_text((SCENARIO + THIRD * (robots == 3)).replace("count = 3", f"count = {robots}"))
    found = onboard.check(scenario=scenario, robots=robots, duration=100.0)
    figures = found.figures
    assert (figures["places_done"], figures["places_total"], figures["contacts"]) == (robots, robots, 0)
    heard = figures["copies_heard"]
    assert sorted(heard) == [f"r{number + 1}" for number in range(robots)] and min(heard.values()) > 0
    assert all(word.endswith("messages, all equal") for word in figures["executed_again"].values())
    assert found.holds and str(found.shown[-1]).startswith("goal, 99 % of the steps answered within 20 ms: ")
