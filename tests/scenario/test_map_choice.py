"""Maps of scenarios: drawn floors, maps other than the file's own, copies in runs, surveys."""

from pathlib import Path

import numpy as np
import pytest

from actors.floor.map_file import load_map
from actors.floor.placement import Area
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from deploy.run.plan import copy_map
from deploy.scenario.named_files import map_files
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import DEFAULT_SCENARIO, Overrides, load_scenario, parse
from deploy.scenario.survey import map_as_json, map_sentences, survey_map
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import to_toml
from tests.floor.map_files import written

ELSEWHERE = Path("/elsewhere/scenario.toml")
DRAWN = 'map = "offices:7"\n[robots]\ncount = 4\n[places]\nper_robot = 5\n'
FREE: tuple[tuple[str, object], ...] = (("robots.start", []), ("places.preset", "free"))
OWN = "../maps/corridor.yaml"


def chapter(*settings: tuple[str, object]) -> Scenario:
    return load_scenario(DEFAULT_SCENARIO, Overrides(settings=settings))


def test_a_drawn_floor_has_its_rooms_as_areas() -> None:
    scenario = parse(DRAWN, ELSEWHERE)
    names = [area.name for area in scenario.area]
    assert names[:2] == ["corridor", "office 1"] and len(names) == len(set(names)) > 4
    settled = resolve(scenario)
    assert settled.scenario.area == scenario.area
    inside = [any(_within(area.area, place) for area in scenario.area) for place in _places(settled.scenario)]
    assert len(inside) == 20 and all(inside)


def test_starts_and_places_can_be_drawn_in_rooms_of_ones_choice() -> None:
    text = DRAWN.replace("[places]", 'areas = ["corridor"]\n[places]\nareas = ["office 1", "office 2"]')
    scenario = parse(text, ELSEWHERE)
    settled = resolve(scenario).scenario
    areas = {area.name: area.area for area in scenario.area}
    assert all(robot.start and _within(areas["corridor"], robot.start) for robot in settled.robot)
    rooms = [areas["office 1"], areas["office 2"]]
    assert all(any(_within(room, place) for room in rooms) for place in _places(settled))


def test_own_areas_of_a_scenario_on_a_drawn_floor_count() -> None:
    own = DRAWN + '[[area]]\nname = "mine"\nx = [1, 4]\ny = [1, 3]\n'
    assert [area.name for area in parse(own, ELSEWHERE).area] == ["mine"]


def test_what_a_run_on_a_drawn_floor_writes_down_gives_the_same_run(tmp_path: Path) -> None:
    first = resolve(parse(DRAWN, ELSEWHERE))
    copy_map(Path(first.world.map), tmp_path)
    text = to_toml(first.scenario.model_copy(update={"map": "map.yaml"}))
    second = resolve(parse(text, tmp_path / "scenario.toml"))
    assert second.world.robots == first.world.robots and second.scenario.area == first.scenario.area
    assert np.array_equal(load_map(second.world.map).cells, load_map(first.world.map).cells)
    assert parse(to_toml(parse(DRAWN, ELSEWHERE)), ELSEWHERE) == parse(DRAWN, ELSEWHERE)


def test_of_another_map_the_areas_of_the_scenario_are_none() -> None:
    maze = chapter(("map", "../maps/maze.yaml"), *FREE)
    assert maze.area == () and resolve(maze).world.robots
    drawn = chapter(("map", "offices:3"), ("robots.start", []), ("places.preset", "areas"))
    assert drawn.area[0].name == "corridor" and resolve(drawn).world.robots
    same = chapter(("map", "../scenarios/../maps/corridor.yaml"))
    assert same == chapter() and same.area
    named = [{"name": "mine", "x": [1.0, 4.0], "y": [1.0, 3.0]}]
    assert [area.name for area in chapter(("map", "offices:3"), ("area", named), *FREE).area] == ["mine"]


@pytest.mark.parametrize(
    ("settings", "missing"),
    [
        ((), "robots.start=[] and places.preset=free"),
        ((("robots.start", []),), "places.preset=free"),
        ((("places.preset", "free"),), "robots.start=[]"),
    ],
)
def test_starts_and_places_of_the_own_map_must_be_set_with_another(
    settings: tuple[tuple[str, object], ...], missing: str
) -> None:
    with pytest.raises(OptionError) as caught:
        chapter(("map", "offices:7"), *settings)
    assert str(caught.value) == (
        f"--set map: offices:7 is another map than the scenario's own {OWN}, for which its starts or places"
        f" are made; must be set together with {missing}"
    )


def test_a_robot_with_a_start_of_its_own_is_of_the_own_map_too(tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    maze = SHIPPED / "maps" / "maze.yaml"
    file.write_text(f'map = "{maze}"\n[[robot]]\nid = "r1"\nstart = [0.6, 1.0, 0.0]\n')
    with pytest.raises(OptionError, match=r"must be set together with robot=\[\]$"):
        load_scenario(file, Overrides(settings=(("map", "offices:7"),)))
    assert load_scenario(file, Overrides(settings=(("map", "offices:7"), ("robot", [])))).robot == ()


def test_a_floor_that_cannot_be_drawn_is_told_where_it_stands() -> None:
    with pytest.raises(AcrcError) as caught:
        parse('map = "offices:7,count=50"\n', ELSEWHERE)
    assert str(caught.value) == (
        f"{ELSEWHERE}: map 'offices:7,count=50': count is '50', but must be a whole number from 1 to 20"
    )
    with pytest.raises(OptionError, match=r"^--set map: 'offices:x': the seed is 'x'"):
        chapter(("map", "offices:x"), *FREE)


def _places(scenario: Scenario) -> list[tuple[float, float]]:
    return [place for robot in scenario.robot for place in robot.places or ()]


def _within(area: Area, point: tuple[float, ...]) -> bool:
    return area.x0 <= point[0] <= area.x1 and area.y0 <= point[1] <= area.y1


def test_the_copy_in_a_run_reads_as_the_map_itself(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        origin='["-1e-05", 2, 1.5708]',
        mode="Scale",
        negate="yes",
        map_frame="map",
        free_thresh=None,
    )
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


def test_a_survey_tells_the_warnings(tmp_path: Path) -> None:
    found = survey_map(written(tmp_path, map_frame="map"))
    assert "warning: plan.yaml: ignored keys: 'map_frame'" in list(map_sentences(found))
    assert map_as_json(found)["warnings"] == ["plan.yaml: ignored keys: 'map_frame'"]
