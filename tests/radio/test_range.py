"""How far frames really get: counted in the medium, not computed."""

from dataclasses import replace

import numpy as np
import pytest

from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Outcome
from actors.radio.propagation.indoor import IndoorPropagation
from actors.radio.radio_model import RadioParameters, preset, reach

FRAMES = 1500
SPACING_NS = 45_000_000
"""Longer than the longest channel access."""


def arriving(parameters: RadioParameters, distance: float, octets: int = 127) -> float:
    """The share of frames from one transceiver that another one hears in line of sight."""
    pair = [replace(parameters.transceiver, address=address) for address in (1, 2)]
    medium = Medium(pair, IndoorPropagation(parameters.propagation), parameters.phy, seed=3)
    medium.place(np.array([[0.0, 0.0], [distance, 0.0]]))
    medium.submit(Request(k * SPACING_NS, 0, octets, tag=k) for k in range(FRAMES))
    medium.run(FRAMES * SPACING_NS)
    outcomes = medium.outcomes()[1]
    assert outcomes.sum() == FRAMES
    return float(outcomes[Outcome.HEARD] / FRAMES)


def test_half_of_the_longest_frames_arrive_at_ten_metres() -> None:
    # The standard error of a share of 1500 frames is at most 1.3 %.
    chapter = preset("chapter")
    assert arriving(chapter, 9.0) > 0.9
    assert arriving(chapter, 11.0) < 0.1
    assert arriving(chapter, 10.0) == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("name", ["chapter", "beeclick", "rosomnet"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_the_reach_by_the_formula_is_the_reach_in_the_medium(name: str, share: float) -> None:
    parameters = preset(name)
    assert arriving(parameters, reach(parameters, share, 60), 60) == pytest.approx(share, abs=0.06)


def test_in_the_ideal_air_everything_arrives() -> None:
    assert arriving(preset("ideal"), 500.0) == 1.0
