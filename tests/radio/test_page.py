"""What docs/radio.md says in numbers is what the code has."""

import math
import re

import pytest

from actors.installation.repository import REPOSITORY
from actors.radio.propagation.walls import MATERIALS
from actors.radio.radio_model import PRESETS, reach

MINUS = "\N{MINUS SIGN}"
PAGE = (REPOSITORY / "docs" / "radio.md").read_text()


def rows(of: list[str]) -> dict[str, list[str]]:
    """The cells behind each first cell in backticks that is one of the names."""
    found = re.findall(r"^\| `(\w+)` \|(.*)\|$", PAGE, re.MULTILINE)
    return {name: [cell.strip() for cell in cells.split("|")] for name, cells in found if name in of}


def test_every_material_is_there_with_its_losses() -> None:
    told = {name: cells[:2] for name, cells in rows(list(MATERIALS)).items()}
    assert told == {
        name: [f"{one.crossing_db:.2f}", f"{one.per_metre_db:.1f}"] for name, one in MATERIALS.items()
    }


def test_every_preset_is_there_with_its_power_noise_and_reach() -> None:
    told = rows(list(PRESETS))
    assert list(told) == list(PRESETS)
    for name, parameters in PRESETS.items():
        power, assessment, noise, _, half = told[name]
        assert power == f"{parameters.transceiver.tx_power_dbm:g} dBm".replace("-", MINUS)
        assert f"≥ {parameters.transceiver.cca_threshold_dbm:g} dBm".replace("-", MINUS) in assessment
        assert noise == f"{parameters.phy.noise_dbm:.1f} dBm".replace("-", MINUS)
        distance = reach(parameters)
        assert half == ("anywhere" if math.isinf(distance) else f"{distance:.1f} m")


@pytest.mark.parametrize(("name", "loss"), [("brick", "3.1"), ("concrete", "7.7")])
def test_a_wall_of_nine_centimetres_costs_what_the_page_says(name: str, loss: str) -> None:
    one = MATERIALS[name]
    assert f"{one.crossing_db + 3 * 0.03125 * one.per_metre_db:.1f}" == loss
    assert f"{loss} dB in {name}" in PAGE
