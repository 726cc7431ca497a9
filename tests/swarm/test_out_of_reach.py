"""What a run rests on lies where no robot's code can lay a hand on it: recordings and logs."""

from pathlib import Path

import pytest

from actors.runtime.isolation import available
from actors.runtime.log import create_log
from deploy.launch import ExecLauncher, Program
from deploy.repository import REPOSITORY
from tests.swarm.command import acrc, run

SCENARIO = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"

[run]
duration = 3.0
seed = 1
strategy = "tests.swarm.intruder:behaviour"

[robots]
count = 2

[places]
preset = "free"
per_robot = 1

[[event]]
at = 2.0
restart = "r1"
"""


@pytest.mark.skipif(available() is not None, reason="robots cannot be isolated here")
def test_links_laid_by_a_robot_lead_nowhere(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    victim = tmp_path / "victim.txt"
    victim.write_text("untouched")
    out = tmp_path / "out"
    assert run(out, tmp_path / "scenario.toml", "--isolate")["undelivered"] == 0
    assert victim.read_text() == "untouched"
    assert (out / "r1" / "own" / "diary.txt").read_text() == "what is mine"
    records = ("r1.mcap", "r1.1.mcap", "r1.log", "r1.1.log")
    assert not any((out / "r1" / name).is_symlink() for name in records)
    assert {path.name for path in (out / "r1").glob("*.mcap")} == {"r1.mcap", "r1.1.mcap"}
    assert acrc("record", "check", out).returncode == 0


def test_a_log_is_a_new_file(tmp_path: Path) -> None:
    victim = tmp_path / "victim.txt"
    victim.write_text("untouched")
    (tmp_path / "r1.log").symlink_to(victim)
    (tmp_path / "r2.log").touch()
    (tmp_path / "r3.log").symlink_to(tmp_path / "nothing.txt")
    for name in ("r1", "r2", "r3"):
        with pytest.raises(FileExistsError):
            create_log(tmp_path / f"{name}.log")
        with pytest.raises(FileExistsError):
            ExecLauncher().start(Program(name, "this", (), tmp_path / f"{name}.log", None))
    assert victim.read_text() == "untouched" and not (tmp_path / "nothing.txt").exists()
