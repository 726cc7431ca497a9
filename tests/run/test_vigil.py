"""What a person is told while a step lasts long, and of those who held up steps that are over."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.messages import Progress
from actors.processes.launch import Child, Program
from actors.processes.silence import Telling, Timeout
from deploy.run.supervisor import Vigil

AWAITED = Progress(3, 300_000, 1, 0, False, awaited=("r2",), awaits="step 3 (0.3 s): no Drive from r2")


@pytest.fixture
def sleeper() -> Iterator[Child]:
    with subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(100)"]) as process:
        yield Child(Program("r2", "", (), Path("r2.log"), Path("r2.mcap")), process.pid)
        process.kill()


def test_a_long_step_and_who_held_it_up_are_told_of(
    tmp_path: Path, sleeper: Child, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Telling, "LONG_S", 1.0)
    monkeypatch.setattr(Telling, "MUCH_S", 1.0)
    said: list[str] = []
    watch, recording = Vigil(Timeout(look_s=0.2), time.sleep, said.append), tmp_path / "world.mcap"

    def take_a_step() -> None:
        with recording.open("ab") as file:
            file.write(b"step")
        assert watch.look([sleeper], recording) is None

    take_a_step()
    watch.hear(AWAITED)
    deadline = time.monotonic() + 30
    while not said and time.monotonic() < deadline:
        assert watch.look([sleeper], recording) is None
        time.sleep(0.05)
    assert said == ["step 3 (0.3 s): no Drive from r2 for 1 s; r2 does nothing"]
    take_a_step()
    held_up = watch.held_up["r2"]
    assert held_up.steps == 1 and held_up.most_s == held_up.total_s > 1.0
    assert said[1:] == [
        f"r2 held up 1 step, by {held_up.most_s:.1f} s at most, {held_up.total_s:.1f} s in all."
    ]
    take_a_step()
    assert len(said) == 2
