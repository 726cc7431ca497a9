"""A first run in one process compiles its kernels, for longer than anybody's patience with a step."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from actors.robot import setup
from deploy import swarm
from deploy.options import RunOptions
from deploy.scenario_file import Overrides, load_scenario
from deploy.silence import Patience


def test_compiling_is_nobodys_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = setup.kernels
    compiled: list[bool] = []

    def slow_at_first() -> dict[str, str]:
        begin = time.process_time()
        while not compiled and time.process_time() < begin + 4.0:
            pass
        compiled.append(True)
        return known()

    plan = swarm.plan(load_scenario(None, Overrides(robots=1, duration=1)), RunOptions(tmp_path / "out"))
    monkeypatch.setattr(setup, "kernels", slow_at_first)
    monkeypatch.setattr("actors.robot.program.kernels", slow_at_first)
    patient = replace(plan, patience=Patience(step_s=2.0))
    assert swarm.run_in_memory(patient, lambda progress: None).simulated_s == 1.0
