"""Named areas: where starts and places are drawn, and every way in which they can be wrong."""

import tomllib
from pathlib import Path

import pytest

from actors.floor.placement import Area
from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from actors.world.world_setup import BodySetup
from deploy.scenario.areas import for_places, for_starts
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import load_scenario, parse
from deploy.scenario.toml_text import to_toml
from tests.scenario.faults import fault, scenario

CORRIDOR = REPOSITORY / "scenarios" / "corridor.toml"
OFFICES = (
    '[[area]]\nname = "Office1"\nx = [11.5, 13.5]\ny = [1, 7]\n'
    '[[area]]\nname = "Office2"\nx = [16.5, 18.25]\ny = [1, 7]\n'
)
FIRST = Area("Office1", 11.5, 1.0, 13.5, 7.0)
SECOND = Area("Office2", 16.5, 1.0, 18.25, 7.0)
SPAN = "but must be two numbers [from, to] in m, the first below the second"


def robots(text: str) -> tuple[BodySetup, ...]:
    return resolve(scenario(text)).world.robots


def within(area: Area, point: tuple[float, ...]) -> bool:
    return area.x0 <= point[0] <= area.x1 and area.y0 <= point[1] <= area.y1


def refusal(text: str) -> str:
    with pytest.raises(AcrcError) as caught:
        resolve(scenario(text))
    return str(caught.value)


def test_robots_beyond_the_listed_starts_are_put_in_their_areas() -> None:
    text = f'[robots]\ncount = 8\nstart = [[26, 11, 0]]\nareas = ["Office2"]\n{OFFICES}'
    first, *others = robots(text)
    assert first.start == (26.0, 11.0, 0.0)
    assert all(within(SECOND, robot.start) for robot in others)
    both = robots(text.replace('["Office2"]', '["Office2", "Office1"]'))[1:]
    assert {within(FIRST, robot.start) for robot in both} == {True, False}
    assert all(within(FIRST, robot.start) or within(SECOND, robot.start) for robot in both)


def test_areas_without_a_table_that_names_them_say_nothing_about_starts() -> None:
    text = "[robots]\ncount = 8\n"
    starts = [robot.start for robot in robots(text)]
    assert [robot.start for robot in robots(text + OFFICES)] == starts
    assert not all(within(FIRST, start) or within(SECOND, start) for start in starts)


def test_places_are_drawn_in_all_areas_or_in_those_that_are_named() -> None:
    absent, asked, named = (
        robots(f"[places]\nper_robot = 9\n{line}\n{OFFICES}")
        for line in ("", 'preset = "areas"', 'areas = ["Office1"]')
    )
    assert absent == asked
    everywhere = [place for robot in absent for place in robot.places]
    assert {within(FIRST, place) for place in everywhere} == {True, False}
    assert all(within(FIRST, place) or within(SECOND, place) for place in everywhere)
    assert all(within(FIRST, place) for robot in named for place in robot.places)


def test_without_areas_places_are_drawn_on_all_free_floor() -> None:
    free = '[places]\npreset = "free"\n'
    assert robots("") == robots(free) == robots(free + OFFICES)


def test_robots_without_golden_places_get_theirs_in_the_areas() -> None:
    text = f'[robots]\ncount = 6\n[places]\npreset = "golden"\nareas = ["Office2"]\n{OFFICES}'
    assert [all(within(SECOND, place) for place in robot.places) for robot in robots(text)] == (
        [False] * 4 + [True] * 2
    )


def test_the_shipped_scenario_lists_the_six_areas_of_the_original() -> None:
    shipped = load_scenario(CORRIDOR)
    assert for_places(shipped) == (
        FIRST,
        SECOND,
        Area("Corridor left", 2.25, 11.1, 4.75, 13.75),
        Area("Corridor centre left", 6.25, 11.1, 14.25, 13.75),
        Area("Corridor centre right", 15.75, 11.1, 23.75, 13.75),
        Area("Corridor right", 25.25, 11.1, 28.75, 13.75),
    )
    assert for_starts(shipped) is None


def test_the_lines_about_areas_that_the_shipped_scenario_mentions_can_be_used() -> None:
    text = CORRIDOR.read_text()
    (line,) = {row.removeprefix("# ").partition("  ")[0] for row in text.splitlines() if "# areas" in row}
    assert tomllib.loads(line) == {"areas": ["Office1"]}
    used = text.replace("\n[places]\n", f"\n[places]\n{line}\n")
    used = used.replace("count = 4\n", f"count = 10\n{line}\n")
    last = resolve(parse(used, CORRIDOR)).world.robots[9]
    assert within(FIRST, last.start) and all(within(FIRST, place) for place in last.places)


def test_what_a_run_with_areas_writes_down_gives_the_same_run() -> None:
    text = f'[robots]\nareas = ["Office2"]\n[places]\nareas = ["Office1"]\n{OFFICES}'
    first = resolve(scenario(text))
    second = resolve(parse(to_toml(first.scenario), Path("/elsewhere/scenario.toml")))
    assert (second.world, second.scenario) == (first.world, first.scenario)
    assert parse(to_toml(scenario(text)), Path("/elsewhere/scenario.toml")) == scenario(text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[robots]\nareas = ["Office1", "office2"]',
            'robots.areas[1] is "office2", which is no area; did you mean "Office2"?',
        ),
        (
            '[places]\nareas = ["Kitchen"]',
            'places.areas[0] is "Kitchen", but must be one of "Office1", "Office2"',
        ),
        (
            '[robots]\nareas = ["Office1", "Office1"]',
            'robots.areas[1] is "Office1" once more, but each area must stand there once only',
        ),
        (
            "[robots]\nareas = []",
            'robots.areas is [], but must be a list of names of areas, such as ["hall"]',
        ),
        (
            '[places]\nareas = ["Office1", 2]',
            'places.areas[1] is 2, but must be the name of an area, such as "hall"',
        ),
        (
            '[places]\npreset = "free"\nareas = ["Office1"]',
            'places.areas must be left out where places.preset is "free"',
        ),
        (
            '[[area]]\nname = "Office1"\nx = [1, 2]\ny = [1, 2]',
            'area[1].name is "Office1" once more, but each area must have a name of its own',
        ),
        (
            '[[area]]\nname = ""\nx = [1, 2]\ny = [1, 2]',
            'area[0].name is "", but must be a name such as "hall"',
        ),
        ('[[area]]\nname = "a"\nx = [1, 2]', f"area[0].y is missing, {SPAN}"),
        ('[[area]]\nname = "a"\nx = [1, 2]\ny = [2, 2]', f"area[0].y is [2, 2], {SPAN}"),
        ('[[area]]\nname = "a"\nx = [2, 1]\ny = [1, 2]', f"area[0].x is [2, 1], {SPAN}"),
        ('[[area]]\nname = "a"\nx = [1]\ny = [1, 2]', f"area[0].x is [1], {SPAN}"),
        ('[[area]]\nname = "a"\nx = [1, "b"]\ny = [1, 2]', f'area[0].x is [1, "b"], {SPAN}'),
        (
            '[[area]]\nname = "a"\nx = [1, 2]\ny = [1, 2]\nz = 0',
            "area[0].z is not known; area[0] may hold name, x, y",
        ),
    ],
)
def test_an_area_that_makes_no_sense(text: str, sentence: str) -> None:
    ahead = text.startswith("[[area]]")
    assert fault(f"{text}\n{OFFICES}" if ahead else f"{OFFICES}{text}") == f"some.toml: {sentence}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[robots]\nareas = ["Office1"]',
            'robots.areas[0] is "Office1", but must be the name of an [[area]]',
        ),
        (
            '[places]\npreset = "areas"',
            'places.preset is "areas", but there is none: the scenario must hold tables [[area]]',
        ),
    ],
)
def test_areas_that_are_asked_for_where_there_are_none(text: str, sentence: str) -> None:
    assert fault(text) == f"some.toml: {sentence}"


def test_an_area_must_hold_free_floor_also_if_nobody_uses_it() -> None:
    walled = '[places]\npreset = "free"\n[[area]]\nname = "void"\nx = [4.9, 5.1]\ny = [12.4, 12.6]\n'
    assert refusal(walled) == (
        'area[0] "void" spans x 4.9 to 5.1 and y 12.4 to 12.6 m, where nothing is free,'
        " but must hold free floor"
    )
    outside = f'{OFFICES}[[area]]\nname = "Moon"\nx = [100, 101]\ny = [-5, 1]\n'
    assert refusal(outside) == (
        'area[2] "Moon" spans x 100 to 101 and y -5 to 1 m, where nothing is free, but must hold free floor'
    )


def test_an_area_without_room() -> None:
    narrow = '[[area]]\nname = "edge"\nx = [11.5, 13.5]\ny = [0.9, 1.0]\n'
    room = "area 'edge' has no reachable point at least 0.6 m from walls; a place must be free floor."
    assert refusal(f'[robots]\nareas = ["edge"]\n{narrow}') == (
        f"robot r1 finds no start in robots.areas beside 0 others: {room}"
    )
    assert refusal(narrow) == f"robot r1 cannot get its 10 places in places.areas: {room}"
