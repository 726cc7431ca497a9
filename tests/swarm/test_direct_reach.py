"""Walls, Wi-Fi and distance in a whole run: what it says of robots that do and do not reach each other."""

from pathlib import Path

import pytest

from actors.radio.radio_model import RadioSetup
from observation.replay.recorded_setup import setup_of
from tests.swarm.command import ROOT, run

TWO = f"""
map = "{ROOT / "maps" / "corridor.yaml"}"
[run]
duration = 3.0
[robots]
count = 2
start = [[12.0, 5.0, 0.0], [17.5, 5.0, 0.0]]
[places]
preset = "free"
per_robot = 1
[radio]
preset = "chapter"
"""


def test_in_the_chapters_scenario_many_pairs_need_others_between(tmp_path: Path) -> None:
    # 30 s: until then nobody stands where it stays
    result = run(tmp_path, ROOT / "scenarios" / "chapter.toml", "--bus", "memory", "--duration", "30")
    assert 0.3 < result["direct_reach"] < 0.8
    assert not any(name.startswith("pairs") for name in result["frames"])
    assert result["frames"]["copies_heard"] > 0


@pytest.mark.parametrize(("walls", "share"), [("air", 1.0), ("concrete", 0.0)])
def test_walls_of_the_map_stand_between_robots(tmp_path: Path, walls: str, share: float) -> None:
    scenario = tmp_path / "two.toml"
    scenario.write_text(f'{TWO}walls = "{walls}"\n')
    result = run(tmp_path / walls, scenario, "--bus", "memory")
    assert result["direct_reach"] == share
    setup = setup_of(tmp_path / walls / "radio" / "radio.mcap", RadioSetup, "a radio")
    assert (setup.walls, setup.preset) == (walls, "chapter")


def test_a_robot_alone_has_nobody_to_reach(tmp_path: Path) -> None:
    scenario = tmp_path / "one.toml"
    scenario.write_text(TWO.replace("count = 2", "count = 1"))
    assert run(tmp_path / "out", scenario, "--bus", "memory")["direct_reach"] is None


def test_wifi_spoils_frames_of_robots_nearby(tmp_path: Path) -> None:
    quiet = tmp_path / "quiet.toml"
    quiet.write_text(TWO.replace("3.0", '20.0\nstrategy = "chapter"') + 'walls = "air"\n')
    noisy = tmp_path / "noisy.toml"
    noisy.write_text(quiet.read_text() + "[[wifi]]\nat = [14.0, 5.0]\nchannel = 1\nduty = 0.5\n")
    alone, beside = (run(tmp_path / file.stem, file, "--bus", "memory")["frames"] for file in (quiet, noisy))
    assert alone["copies_heard"] > beside["copies_heard"]
    assert alone["copies_lost_disturbed"] == 0 and beside["copies_lost_disturbed"] > 10
