"""Robots whose processes have no network: their boards are the only way from one to another."""

from collections.abc import Callable
from pathlib import Path

import pytest

from actors.processes.launch import Launcher
from deploy.laboratory import hardware_in_the_loop
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.field_trial.trial_result import TrialResult
from observation.replay import record_replay
from tests.swarm.command import ROOT

NO_NETWORK = ("unshare", "--map-root-user", "--net")
"""util-linux; a namespace in which no link is up."""
SCENARIO = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
strategy = "chapter"
[robots]
count = 2
[[robot]]
id = "r1"
start = [8.0, 12.5, 0.0]
places = [[8.9, 12.5]]
[[robot]]
id = "r2"
start = [11.0, 12.5, 0.0]
places = [[11.9, 12.5]]
"""


def run(scenario: Path, robots: int, duration: float, out: Path) -> TrialResult:
    """Run on board until no place is left, then replay each robot from what it received."""
    plan = load_scenario(scenario, Overrides(robots=robots, duration=duration))
    options = RunOptions(out, spawn="exec", hardware=True, json=True)
    result = hardware_in_the_loop.run(plan, options, Launcher("exec", NO_NETWORK, reap=False))
    for name, robot in result.per_robot.items():
        assert robot.frames["copies_heard"] > 0
        assert record_replay.replay_actor(out, name).outputs > 0
    return result


@pytest.mark.claim("onboard")
@pytest.mark.timeout(240)
def test_robots_talk_by_serial_bytes_alone(tmp_path: Path) -> None:
    scenario = tmp_path / "few.toml"
    scenario.write_text(SCENARIO)
    result = run(scenario, 2, 100.0, tmp_path / "out")
    assert (result.places_done, result.places_total, result.contacts) == (2, 2, 0)


@pytest.mark.claim("onboard")
@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_robots_that_meet_clean_all_places(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    robots, duration = (3, 300.0) if full else (2, 15.0)
    result = run(ROOT / "scenarios" / "head_on.toml", robots, duration, tmp_path / "out")
    record_property("places done", f"{result.places_done} of {result.places_total}")
    late = {name: one.lateness_p99_ms for name, one in result.per_robot.items()}
    record_property("99 % of the steps answered within, ms", late)
    assert not full or result.places_done == result.places_total
