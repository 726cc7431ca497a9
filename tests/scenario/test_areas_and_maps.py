"""Areas and maps: random starts and places, drawn floors, copies in runs."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.installation.repository import REPOSITORY, SHIPPED
from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from actors.world.world_setup import BodySetup
from deploy.run.plan import copy_map
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import DEFAULT_SCENARIO, Overrides, load_scenario, map_files, parse
from deploy.scenario.tables import Scenario, to_toml
from tests.floor.maps import written
from tests.scenario.faults import scenario

ELSEWHERE = Path("/elsewhere/scenario.toml")
DRAWN = 'map = "offices:7"\n[robots]\ncount = 4\n[places]\nper_robot = 5\n'
FREE: tuple[tuple[str, object], ...] = (("robots.start", []), ("places.preset", "free"))
CORRIDOR = REPOSITORY / "scenarios" / "corridor.toml"
OFFICES = (
    '[[area]]\nname = "Office1"\nx = [11.5, 13.5]\ny = [1, 7]\n'
    '[[area]]\nname = "Office2"\nx = [16.5, 18.25]\ny = [1, 7]\n'
)
FIRST = Area("Office1", 11.5, 1.0, 13.5, 7.0)
SECOND = Area("Office2", 16.5, 1.0, 18.25, 7.0)


def chapter(*settings: tuple[str, object]) -> Scenario:
    return load_scenario(DEFAULT_SCENARIO, Overrides(settings=settings))


def robots(text: str) -> tuple[BodySetup, ...]:
    return resolve(scenario(text)).world.robots


def within(area: Area, point: tuple[float, ...]) -> bool:
    return area.x0 <= point[0] <= area.x1 and area.y0 <= point[1] <= area.y1


def refusal(text: str) -> str:
    with pytest.raises(AcrcError) as caught:
        resolve(scenario(text))
    return str(caught.value)


def test_robots_without_a_listed_start_are_placed_in_their_areas() -> None:
    text = f'[robots]\ncount = 8\nstart = [[26, 11, 0]]\nareas = ["Office2"]\n{OFFICES}'
    first, *others = robots(text)
    assert first.start == (26.0, 11.0, 0.0)
    assert all(within(SECOND, robot.start) for robot in others)
    both = robots(text.replace('["Office2"]', '["Office2", "Office1"]'))[1:]
    assert {within(FIRST, robot.start) for robot in both} == {True, False}
    assert all(within(FIRST, robot.start) or within(SECOND, robot.start) for robot in both)

    text = "[robots]\ncount = 8\n"
    starts = [robot.start for robot in robots(text)]
    assert [robot.start for robot in robots(text + OFFICES)] == starts, "no table names the areas"
    assert not all(within(FIRST, start) or within(SECOND, start) for start in starts)


def test_places_are_drawn_in_all_or_in_named_areas() -> None:
    absent, asked, named = (
        robots(f"[places]\nper_robot = 9\n{line}\n{OFFICES}")
        for line in ("", 'preset = "areas"', 'areas = ["Office1"]')
    )
    assert absent == asked
    everywhere = [place for robot in absent for place in robot.items]
    assert {within(FIRST, place) for place in everywhere} == {True, False}
    assert all(within(FIRST, place) or within(SECOND, place) for place in everywhere)
    assert all(within(FIRST, place) for robot in named for place in robot.items)
    free = '[places]\npreset = "free"\n'
    assert robots("") == robots(free) == robots(free + OFFICES), "without areas: on all free floor"


def test_an_area_must_contain_free_floor_even_if_unused() -> None:
    walled = '[places]\npreset = "free"\n[[area]]\nname = "void"\nx = [4.9, 5.1]\ny = [12.4, 12.6]\n'
    assert refusal(walled).startswith('area[0] "void" spans x 4.9 to 5.1 and y 12.4 to 12.6 m, where nothing')
    outside = f'{OFFICES}[[area]]\nname = "Moon"\nx = [100, 101]\ny = [-5, 1]\n'
    assert refusal(outside).startswith('area[2] "Moon" spans x 100 to 101 and y -5 to 1 m, where nothing')
    narrow = '[[area]]\nname = "edge"\nx = [11.5, 13.5]\ny = [0.9, 1.0]\n'
    room = "area 'edge' has no reachable point at least 0.6 m from walls; reduce clearance or move the area."
    assert refusal(f'[robots]\nareas = ["edge"]\n{narrow}') == (
        f"no start for robot r1 in robots.areas beside 0 others: {room}"
    )
    assert refusal(narrow) == f"cannot draw 10 places for robot r1 in places.areas: {room}"


def test_a_drawn_floor_has_its_rooms_as_areas_unless_the_scenario_has_its_own() -> None:
    drawn = parse(DRAWN, ELSEWHERE)
    names = [area.name for area in drawn.area]
    assert names[:2] == ["corridor", "office 1"] and len(names) == len(set(names)) > 4
    settled = resolve(drawn).scenario
    inside = [any(within(area.area, place) for area in drawn.area) for place in _places(settled)]
    assert settled.area == drawn.area and len(inside) == 20 and all(inside)
    own = DRAWN + '[[area]]\nname = "mine"\nx = [1, 4]\ny = [1, 3]\n'
    assert [area.name for area in parse(own, ELSEWHERE).area] == ["mine"]


def test_the_copied_scenario_of_a_drawn_floor_gives_the_same_run(tmp_path: Path) -> None:
    first = resolve(parse(DRAWN, ELSEWHERE))
    copy_map(Path(first.world.map), tmp_path)
    text = to_toml(msgspec.structs.replace(first.scenario, map="map.yaml"))
    second = resolve(parse(text, tmp_path / "scenario.toml"))
    assert second.world.robots == first.world.robots and second.scenario.area == first.scenario.area
    assert np.array_equal(load_map(second.world.map).cells, load_map(first.world.map).cells)
    assert parse(to_toml(parse(DRAWN, ELSEWHERE)), ELSEWHERE) == parse(DRAWN, ELSEWHERE)


def test_another_map_drops_the_areas_of_the_scenario() -> None:
    maze = chapter(("map", "../maps/maze.yaml"), *FREE)
    assert maze.area == () and resolve(maze).world.robots
    drawn = chapter(("map", "offices:3"), ("robots.start", []), ("places.preset", "areas"))
    assert drawn.area[0].name == "corridor" and resolve(drawn).world.robots
    same = chapter(("map", "../scenarios/../maps/corridor.yaml"))
    assert same == chapter() and same.area
    named = [{"name": "mine", "x": [1.0, 4.0], "y": [1.0, 3.0]}]
    assert [area.name for area in chapter(("map", "offices:3"), ("area", named), *FREE).area] == ["mine"]


def test_starts_and_places_of_the_own_map(tmp_path: Path) -> None:
    for settings, missing in (
        ((), "robots.start=[] and places.preset=free"),
        (FREE[:1], "places.preset=free"),
        (FREE[1:], "robots.start=[]"),
    ):
        with pytest.raises(OptionError, match=f"also set {re.escape(missing)}$"):
            chapter(("map", "offices:7"), *settings)
    file = tmp_path / "scenario.toml"
    maze = SHIPPED / "maps" / "maze.yaml"
    file.write_text(f'map = "{maze}"\n[[robot]]\nid = "r1"\nstart = [0.6, 1.0, 0.0]\n')
    with pytest.raises(OptionError, match=r"also set robot=\[\]$"):
        load_scenario(file, Overrides(settings=(("map", "offices:7"),)))
    assert load_scenario(file, Overrides(settings=(("map", "offices:7"), ("robot", [])))).robot == ()


def test_invalid_drawn_floors_are_reported_with_their_key() -> None:
    with pytest.raises(AcrcError, match=r"count=50': count is '50', but must be a whole number from 1 to 20"):
        parse('map = "offices:7,count=50"\n', ELSEWHERE)
    with pytest.raises(OptionError, match=r"^--set map: 'offices:x': the seed is 'x'"):
        chapter(("map", "offices:x"), *FREE)


def _places(scenario: Scenario) -> list[tuple[float, float]]:
    return [place for robot in scenario.robot for place in robot.items or ()]


def test_the_copy_in_a_run_reads_as_the_map_itself(tmp_path: Path) -> None:
    odd = {"origin": '["-1e-05", 2, 1.5708]', "mode": "Scale", "negate": "yes", "map_frame": "map"}
    path = written(tmp_path, **odd, free_thresh=None)
    folder = tmp_path / "run"
    folder.mkdir()
    copy_map(path, folder)
    copy, grid = load_map(folder / "map.yaml"), load_map(path)
    assert copy.content == grid.content
    assert (folder / "map.yaml").read_text() == (
        "image: map.png\nmode: scale\nresolution: 0.05\norigin: [-1e-05, 2.0, 1.5708]\nnegate: 1\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    assert list(map_files(path)) == [path, tmp_path / "plan.png"]
