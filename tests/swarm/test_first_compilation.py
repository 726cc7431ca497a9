"""A first run in one process compiles its kernels, for longer than the timeout of a step."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from actors.processes.silence import Timeout
from actors.robot import assembly
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario


class SlowAtFirst:
    """A module with a kernel that takes four seconds to compile."""

    __name__ = "slow"

    def __init__(self) -> None:
        self.compiled = False

    def fingerprint(self) -> bytes:
        """What the kernel gives."""
        begin = time.process_time()
        while not self.compiled and time.process_time() < begin + 4.0:
            pass
        self.compiled = True
        return b"the same each time"


def test_compiling_is_nobodys_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = SlowAtFirst()
    plan = swarm.plan(
        load_scenario(None, Overrides(robots=1, duration=1)), RunOptions(tmp_path / "out", isolate=False)
    )
    monkeypatch.setattr(assembly, "KERNELS", (*assembly.KERNELS, slow))
    limited = replace(plan, timeout=Timeout(step_s=2.0))
    assert swarm.run_in_memory(limited, lambda progress: None).simulated_s == 1.0
    assert slow.compiled
