"""The scenario of the original experiment, against its figures."""

import tomllib
from dataclasses import fields

from actors.installation.repository import REPOSITORY
from cleaning.parameters import AdaptationParameters
from cleaning.settings import from_settings
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import load_scenario
from deploy.scenario.stack_tables import TABLES

CHAPTER = REPOSITORY / "scenarios" / "chapter.toml"
FIRST_PLACES = [
    ((21.216, 11.918), (17.665, 6.420), (8.456, 12.329), (23.105, 12.257), (18.843, 11.570),
     (7.928, 13.289), (17.528, 5.508), (10.890, 13.094), (12.216, 5.907), (14.042, 12.991)),
    ((8.583, 13.617), (20.843, 12.078), (3.337, 12.312), (10.002, 13.292), (17.959, 3.762),
     (2.740, 11.575), (19.643, 12.216), (21.349, 11.936), (9.218, 13.410), (20.680, 12.092)),
    ((23.019, 11.620), (20.773, 12.328), (3.600, 12.783), (12.495, 1.164), (12.468, 4.930),
     (13.771, 12.119), (21.914, 13.469), (14.058, 11.304), (17.981, 13.483), (9.700, 11.981)),
    ((3.357, 11.356), (17.117, 13.234), (11.686, 1.162), (8.508, 13.664), (26.454, 11.137),
     (19.922, 13.313), (11.756, 12.574), (12.677, 6.371), (18.811, 13.495), (17.832, 13.650)),
]  # fmt: skip
AREAS = {
    "Office1": (11.50, 13.50, 1.00, 7.00),
    "Office2": (16.50, 18.25, 1.00, 7.00),
    "Corridor left": (2.25, 4.75, 11.10, 13.75),
    "Corridor centre left": (6.25, 14.25, 11.10, 13.75),
    "Corridor centre right": (15.75, 23.75, 11.10, 13.75),
    "Corridor right": (25.25, 28.75, 11.10, 13.75),
}
STARTS = (
    (12, 5, 0), (17.5, 5, 0), (12, 13, 0), (26, 11, 0), (28, 11, 0), (9, 11, 0), (11, 13, 0), (10, 13, 0),
    (9, 13, 0),
)  # fmt: skip


def test_the_figures_are_those_of_the_original() -> None:
    chapter = load_scenario(CHAPTER)
    world = resolve(chapter).world
    assert (world.duration_us, world.step_us) == (600_000_000, 100_000)
    assert [robot.start for robot in world.robots] == [*STARTS[:4]]
    assert [robot.places for robot in world.robots] == FIRST_PLACES
    assert chapter.robots.start == STARTS
    assert {area.name: (*area.x, *area.y) for area in chapter.area} == AREAS
    assert round(sum((x1 - x0) * (y1 - y0) for x0, x1, y0, y1 in AREAS.values()), 3) == 80.8
    assert (chapter.radio.preset, chapter.deeco.publish, chapter.deeco.relay) == ("chapter", 1.0, True)


def test_the_strategys_settings_are_those_of_the_original() -> None:
    chapter = load_scenario(CHAPTER)
    assert chapter.run.strategy == "chapter"
    told = from_settings(AdaptationParameters, chapter.strategy)
    assert (told.reach, told.still, told.still_checks, told.blocked_checks) == (0.5, 0.01, 3, 6)
    assert (told.adoption_distance, told.adoption_checks) == (1.5, 1)
    assert told.adoption_backoff == 10_000_000
    assert told == AdaptationParameters()  # so that --strategy chapter is the same in every other scenario


def test_every_value_stands_in_the_file_and_none_is_left_to_a_default() -> None:
    content = tomllib.loads(CHAPTER.read_text())
    absent = {"modules", "areas", "key"}  # where one's own code and further starts would lie; a secret
    for name, table in load_scenario(CHAPTER).model_dump().items():
        if isinstance(table, dict) and name not in ("strategy", *TABLES):
            assert set(table) - absent == set(content[name]), name
    assert content["localisation"] == {"preset": "chapter"}
    assert content["navigation"] == {"preset": "chapter"}
    assert set(content["strategy"]) == {field.name for field in fields(AdaptationParameters)}
