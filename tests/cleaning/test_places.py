"""The testbed's places, computed again with the generator that it used."""

from collections.abc import Iterator

import pytest

from cleaning.places import GOLDEN
from deploy.scenario.areas import for_places
from deploy.scenario.scenario_file import load_scenario

AREAS = for_places(load_scenario()) or ()


def java_doubles(seed: int) -> Iterator[float]:
    """java.util.Random.nextDouble: a linear congruential generator of 48 bits (Java SE API, class Random)."""
    state = (seed ^ 0x5DEECE66D) % 2**48
    while True:
        bits = []
        for wanted in (26, 27):
            state = (state * 0x5DEECE66D + 0xB) % 2**48
            bits.append(state >> (48 - wanted))
        yield ((bits[0] << 27) + bits[1]) / 2**53


def test_the_generator_gives_javas_first_value() -> None:
    assert next(java_doubles(42)) == 0.7275636800328681


def test_the_golden_places_are_what_the_testbed_drew() -> None:
    numbers = java_doubles(42)
    total = sum(area.surface for area in AREAS)
    for places in GOLDEN:
        for place in places:
            rest = next(numbers) * total
            for area in AREAS:
                rest -= area.surface
                if rest < 0:
                    break
            x = area.x0 + next(numbers) * (area.x1 - area.x0)
            y = area.y0 + next(numbers) * (area.y1 - area.y0)
            assert place == pytest.approx((x, y), abs=0.00051)


def test_there_are_four_robots_with_ten_places_each_and_areas_of_80_8_square_metres() -> None:
    assert [len(places) for places in GOLDEN] == [10] * 4
    assert sum(area.surface for area in AREAS) == pytest.approx(80.8)
