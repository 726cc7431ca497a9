"""`acrc scenario`: check, description and picture of a scenario."""

from pathlib import Path

import numpy as np
from PIL import Image

from actors.installation.repository import REPOSITORY as ROOT
from actors.items import ItemKey
from deploy.scenario import map_survey, scenario_picture, survey
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.in_process import acrc

CHAPTER = ROOT / "scenarios" / "chapter.toml"
NARROW = "narrow place: robots cannot pass each other"
SHUT_IN = """
map = "room.yaml"
[robots]
count = 1
model = "turtlebot2"
[[robot]]
id = "r1"
start = [1.0, 1.0, 0.0]
places = [[2.0, 1.0], [4.6, 1.0]]
"""


def two_rooms(folder: Path) -> Path:
    """Return a scenario with a place in each of two separate rooms of 3 by 2 m."""
    picture = np.full((40, 120), 254, np.uint8)
    picture[[0, -1]], picture[:, [0, 60, -1]] = 0, 0
    Image.fromarray(picture).save(folder / "room.png")
    (folder / "room.yaml").write_text(
        "image: room.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (folder / "room.toml").write_text(SHUT_IN)
    return folder / "room.toml"


def test_the_chapters_scenario_in_words_and_as_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "chapter.png"
    done = acrc("scenario", CHAPTER, "--png", picture)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "4 robots, 40 places, 600 s at most, strategy chapter, seed 42",
        "floor: 29.4 m by 14.8 m, of which a robot's centre can reach 120 m²; 7 regions, 5 narrow places",
        "navigation chapter, localisation chapter",
        "radio: half of the longest frames arrive at 10.0 m in line of sight",
        "places r2/1 and r2/9 are 0.16 m apart: one visit may do both",
        str(picture),
    ]
    with Image.open(picture) as image:
        assert len(set(np.asarray(image.convert("RGB")).reshape(-1, 3)[:, 0].tolist())) > 50


def test_a_place_behind_a_wall_is_out_of_reach(tmp_path: Path) -> None:
    file = two_rooms(tmp_path)
    found = survey.survey(resolve(load_scenario(file)))
    assert found.out_of_reach == (ItemKey("r1", 1),)
    assert found.parts.doors == ()
    done = acrc("scenario", file)
    assert "warning: no path leads from the start of robot r1 at (1.00, 1.00) to place r1/1" in done.stdout
    assert {"out of reach", "wide enough for a robot, but no path"} <= legend_of(found)


def legend_of(found: survey.ScenarioSurvey) -> set[str]:
    handles = scenario_picture.draw_scenario(found).legends[0].legend_handles
    return {str(handle.get_label()) for handle in handles if handle}


def test_items_of_another_task_have_its_symbols() -> None:
    found = survey.survey(resolve(load_scenario(ROOT / "scenarios" / "logistics.toml")))
    told = legend_of(found)
    assert {"station", "charger"} <= told and not any("place " in text for text in told - {NARROW})


def test_the_link_margin_is_zero_at_the_range_and_lower_behind_walls() -> None:
    resolved = resolve(load_scenario(CHAPTER))
    found = survey.survey(resolved)
    x, y = scenario_picture._lattice(found.grid)
    (sx, sy, _), left = (
        resolved.world.robots[2].start,
        scenario_picture._link_margins(resolved, found.grid)[2],
    )
    away = np.hypot(x - sx, y[:, None] - sy)
    assert (left[away > found.radio_reach + 0.01] < 0).all(), "walls only take"
    assert (left[away < 0.5] > 0).all()
    assert (left[away < found.radio_reach - 0.5] < 0).any(), "behind a wall"


def test_options_override_the_file_and_wrong_ones_are_reported(tmp_path: Path) -> None:
    more = [
        *map_survey.sentences(survey.survey(resolve(load_scenario(CHAPTER, Overrides(robots=6, seed=3)))))
    ]
    assert more[0] == "6 robots, 60 places, 600 s at most, strategy chapter, seed 3"
    for words, told in (
        ((CHAPTER, "--png", tmp_path / "a.gif"), "must be a file in an existing folder, with the suffix"),
        ((CHAPTER, "--png", tmp_path / "no" / "a.png"), "must be a file in an existing folder"),
        ((CHAPTER, "--robots", "none"), "--robots: none; must be a whole number from 1 to 500"),
        ((tmp_path / "no.toml",), "the scenario file cannot be read"),
    ):
        done = acrc("scenario", *words)
        assert done.returncode in (1, 2) and done.stderr.count("\n") == 1
        assert told in done.stderr


def test_a_map_and_a_robot_model_are_checked_and_drawn_alone(tmp_path: Path) -> None:
    two_rooms(tmp_path)
    done = acrc("scenario", tmp_path / "room.yaml", "--png", tmp_path / "map.png")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "room.yaml: 6.0 m by 2.0 m in cells of 0.05 m, from (0, 0) on; free 11 m², unknown 0 m²",
        "the centre of a robot of 0.354 m can reach 4 m²; no narrow place",
        "3.8 m² more are wide enough, but no path leads there from the largest part",
        str(tmp_path / "map.png"),
    ]
    model = ROOT / "actors" / "models" / "omnibox.toml"
    done = acrc("scenario", model, "--png", tmp_path / "omnibox.png")
    assert done.stdout.splitlines()[:4] == [
        "Omnibox: a polygon within 0.56 m, 0.38 m at its narrowest, 22 kg; odometry stage",
        "omnidirectional drive: up to 0.8 m/s, stopping distance 0.21 m, 115° per second; "
        "brakes 0.3 s after its last command",
        "sensor kinect: 640 rays over 58°, 0.45 to 6.5 m, 10 Hz, noise of 0 mm, 68 mm at its farthest",
        "bumper: centre to 40° either side, right and left to 100°",
    ]
    for name in ("map", "omnibox"):
        with Image.open(tmp_path / f"{name}.png") as image:
            assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 20


def test_faults_of_the_strategy_are_reported_after_the_floor(tmp_path: Path) -> None:
    file = two_rooms(tmp_path)
    scenario = file.read_text()
    (tmp_path / "own_moves.py").write_text("from cleaning.strategies.none import behaviour\n")
    names = f"{file}: strategy"
    for run, words, fault in (
        ('strategy = "chapter"\n[strategy]\nreech = 3', (), "unknown key strategy.reech"),
        ('strategy = "gone_moves:behaviour"', (), f"{names} gone_moves:behaviour: there is"),
        ('strategy = "own_moves:behaviour"', (), f"{names} own_moves:behaviour: its code "),
        ('strategy = "own_moves:behaviour"', ("--modules", tmp_path), ""),
        ('strategy = "own_moves:behavior"', ("--modules", tmp_path), "behaviour 'own_moves:behavior': "),
    ):
        file.write_text(f"{scenario}[run]\n{run}\n")
        done = acrc("scenario", file, *words)
        assert done.stdout.startswith("1 robot, 2 places, "), done.stdout
        assert done.stderr.startswith(f"acrc: {fault}" if fault else ""), done.stderr
        assert (done.returncode, done.stderr.count("\n")) == ((1, 1) if fault else (0, 0)), done.stderr
