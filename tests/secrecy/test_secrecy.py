"""What a robot that is shut off can find out of its run: neither scenario, nor folder, nor seed."""

import json
import shutil
from pathlib import Path

import pytest

from actors.randomness import derived_seed
from deploy.repository import REPOSITORY
from tests.isolation.test_attacks import need_isolation
from tests.swarm.command import acrc

SEED = 7_316_820_459_125_388_641
SCENARIO = f"""
map = "{REPOSITORY}/maps/corridor.yaml"
[run]
duration = 0.2
seed = {SEED}
strategy = "snoop:behaviour"
[robots]
count = 2
[places]
preset = "golden"
per_robot = 1
"""
WORDS = (
    *(b"zebrastudy", b"quaggascenario", b"okapirun", b"corridor.yaml"),
    *(str(SEED).encode(), f"{SEED:x}".encode(), SEED.to_bytes(8, "little"), SEED.to_bytes(8, "big")),
    str(derived_seed(SEED, "r2")).encode(),  # r1 is who looks
    derived_seed(SEED, "r2").to_bytes(8, "little"),
)


@pytest.mark.parametrize("spawn", ["forkserver", "exec"])
def test_nothing_that_a_robot_can_reach_tells_of_scenario_folder_or_seed(tmp_path: Path, spawn: str) -> None:
    need_isolation()
    study = tmp_path / "zebrastudy"
    study.mkdir()
    (study / "quaggascenario.toml").write_text(SCENARIO)
    shutil.copy(Path(__file__).with_name("snoop.py"), study)
    (study / "words.json").write_text(json.dumps([word[::-1].hex() for word in WORDS]))
    out = tmp_path / "okapirun"
    words = ("--isolate", "--spawn", spawn, "--trust", "--json", "--out", out)
    done = acrc("run", study / "quaggascenario.toml", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["isolation"] == "full"
    assert json.loads((out / "r1" / "own" / "found.json").read_text()) == []
