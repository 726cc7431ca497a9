"""The scenario of the original experiment: its numbers, and its places recomputed."""

import tomllib
from collections.abc import Iterator
from dataclasses import fields

import pytest
from msgspec.structs import asdict

from actors.installation.repository import REPOSITORY
from actors.robot.behaviour import from_settings
from actors.settings import Settings
from cleaning.parameters import AdaptationParameters
from cleaning.place import GOLDEN
from cleaning.task import PlacesTable
from deploy.scenario.events import item_area_tables
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import load_scenario

CHAPTER = REPOSITORY / "scenarios" / "chapter.toml"
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
    assert [robot.items for robot in world.robots] == [*GOLDEN]
    assert [len(places) for places in GOLDEN] == [10] * 4
    assert chapter.robots.start == STARTS
    assert {area.name: (*area.x, *area.y) for area in chapter.area} == AREAS
    assert (chapter.radio.preset, chapter.deeco.publish, chapter.deeco.relay) == ("chapter", 1_000_000, True)


def test_the_strategys_settings_are_those_of_the_original() -> None:
    chapter = load_scenario(CHAPTER)
    assert chapter.run.strategy == "chapter"
    told = from_settings(AdaptationParameters, chapter.strategy)
    assert (told.reach, told.still, told.still_checks, told.blocked_checks) == (0.5, 0.01, 3, 6)
    assert (told.adoption_distance, told.adoption_checks) == (1.5, 1)
    assert told.adoption_backoff == 10_000_000
    assert told == AdaptationParameters()  # so that --strategy chapter is the same in every other scenario


def test_every_key_is_set_in_the_file() -> None:
    content = tomllib.loads(CHAPTER.read_text())
    absent = {"modules", "areas", "key", "battery"}  # not used by the original
    for name, table in asdict(load_scenario(CHAPTER)).items():
        if isinstance(table, Settings) and name != "task":
            assert set(table.__struct_fields__) - absent == set(content[name]), name
    assert set(PlacesTable.__struct_fields__) - absent == set(content["places"])
    assert content["localisation"] == {"preset": "chapter"}
    assert content["navigation"] == {"preset": "chapter"}
    assert set(content["strategy"]) == {field.name for field in fields(AdaptationParameters)}


def java_doubles(seed: int) -> Iterator[float]:
    """java.util.Random.nextDouble: a linear congruential generator of 48 bits (Java SE API, class Random)."""
    state = (seed ^ 0x5DEECE66D) % 2**48
    while True:
        bits = []
        for wanted in (26, 27):
            state = (state * 0x5DEECE66D + 0xB) % 2**48
            bits.append(state >> (48 - wanted))
        yield ((bits[0] << 27) + bits[1]) / 2**53


def test_the_golden_places_equal_the_draws_of_the_original() -> None:
    assert next(java_doubles(42)) == 0.7275636800328681, "as Java prints it"
    numbers, areas = java_doubles(42), [table.area for table in item_area_tables(load_scenario())]
    total = sum(area.surface for area in areas)
    for places in GOLDEN:
        for place in places:
            rest = next(numbers) * total
            for area in areas:
                rest -= area.surface
                if rest < 0:
                    break
            x = area.x0 + next(numbers) * (area.x1 - area.x0)
            y = area.y0 + next(numbers) * (area.y1 - area.y0)
            assert place == pytest.approx((x, y), abs=0.00051)
