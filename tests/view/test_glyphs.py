"""States, robots and what is put on a floor can be told apart, by everybody; each word has one glyph."""

from collections.abc import Mapping
from itertools import combinations

import pytest
from coloraide import Color

from actors.observer import glyphs
from actors.observer.glyphs import Colour
from observation.accounting.time_spent import Cause
from observation.trace.rows import ACTIVITIES
from observation.view.drawn import SEEN_FROM_OUTSIDE

LEAST = 10.0
EYES = ("", "protan", "deutan")
METHODS = ("brettel", "vienot", "machado")


def seen(colour: Colour, eye: str, method: str) -> Color:
    shown = Color("srgb", [part / 255 for part in colour])
    return shown.filter(eye, method=method).clip() if eye else shown


def nearest(named: Mapping[str, Colour]) -> tuple[float, str]:
    """The smallest difference of two, by CIEDE2000, and which two, for which eye."""
    found = []
    for eye in EYES:
        for method in METHODS if eye else METHODS[:1]:
            shown = {name: seen(colour, eye, method) for name, colour in named.items()}
            for one, other in combinations(shown, 2):
                far = shown[one].delta_e(shown[other], method="2000")
                found.append((far, f"{one} and {other} for {eye or 'normal'} eyes by {method}"))
    return min(found)


@pytest.mark.parametrize("states", [glyphs.SEEN_STATES, glyphs.OWN_STATES], ids=["seen", "own"])
def test_any_two_states_of_a_picture_differ_for_all_eyes(states: Mapping[str, glyphs.StateGlyph]) -> None:
    far, which = nearest({word: glyph.colour for word, glyph in states.items()})
    assert far >= LEAST, which


def test_robots_and_what_is_put_on_the_floor_differ_for_all_eyes() -> None:
    named = {f"robot {index}": colour for index, colour in enumerate(glyphs.ROBOTS)}
    far, which = nearest({**named, "put": glyphs.PUT, "jammer": glyphs.JAM})
    assert far >= LEAST, which


def test_states_of_like_colour_differ_by_their_hatch_in_grey() -> None:
    for states in (glyphs.SEEN_STATES, glyphs.OWN_STATES):
        for one, other in combinations(states.values(), 2):
            grey = glyphs.contrast(one.colour, other.colour)
            assert grey >= 1.25 or one.hatch != other.hatch, (one, other)


def test_each_word_has_one_glyph() -> None:
    assert set(glyphs.SEEN_STATES) == {cause.value for cause in Cause}
    assert {*ACTIVITIES, *SEEN_FROM_OUTSIDE.values(), "frozen", "off", "not heard"} <= set(glyphs.OWN_STATES)
    for word in set(glyphs.SEEN_STATES) & set(glyphs.OWN_STATES):
        assert glyphs.SEEN_STATES[word] == glyphs.OWN_STATES[word]


def test_what_is_put_there_can_be_seen_on_both_grounds() -> None:
    floor = (glyphs.FLOOR,) * 3
    for colour in (glyphs.PUT, glyphs.JAM, glyphs.CLOSED, *glyphs.ROBOTS[:4]):
        assert glyphs.contrast(colour, floor) >= 3 and glyphs.contrast(colour, glyphs.WHITE) >= 3
