"""Robots with a board and without one share one air.

Both are late alike only where processes get their turn: a board that waits for a processor says less, and its
hearer hears less. So nothing runs beside this.
"""

import json
from pathlib import Path

import pytest

from tests.swarm.command import ROOT, acrc, leftovers, processes_of

pytestmark = pytest.mark.alone
APART = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 12.0
strategy = "chapter"
[robots]
count = 3
[[robot]]
id = "r1"
start = [12.5, 3.0, 1.57]
places = [[12.5, 6.9]]
[[robot]]
id = "r2"
start = [12.5, 4.5, 1.57]
places = [[12.5, 6.8]]
[[robot]]
id = "r3"
start = [17.4, 4.0, 1.57]
places = [[17.4, 6.9]]
[radio]
walls = "concrete"
"""


def test_boards_and_simulated_transceivers_talk_on_one_air_with_its_walls(tmp_path: Path) -> None:
    """r1 has a board, r2 none, and both hear each other; r3 is behind two walls of concrete."""
    scenario, out = tmp_path / "apart.toml", tmp_path / "out"
    scenario.write_text(APART)
    done = acrc(
        "run", scenario, "--hardware-in-the-loop", "--board", "r1", "--out", out, "--json", timeout_s=100.0
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    heard = {robot: part["frames"]["copies_heard"] for robot, part in result["per_robot"].items()}
    weak = result["per_robot"]["r3"]["frames"]["copies_lost_below_sensitivity"]
    assert heard["r1"] > 3 and heard["r2"] > 3 and (heard["r3"], weak > 6) == (0, True), result["frames"]
    checked = acrc("record", "check", out)
    assert checked.returncode == 0, checked.stderr
    assert checked.stdout.startswith("no digest without a recording of the world, over "), checked.stdout
    setup = json.loads((out / "laboratory" / "setup.json").read_text())
    assert setup["without_board"] == ["r2", "r3"]
    links = [out / f"r{number}.radio" / "setup.json" for number in (1, 2)]
    assert [json.loads(link.read_text())["actor"]["board"] for link in links] == [True, False]
    again = acrc("replay", out, "--robot", "r2")
    assert again.returncode == 0 and ": identical: " in again.stdout, again.stderr
    assert processes_of(out) == [] and leftovers(out) == []
