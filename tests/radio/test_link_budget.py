"""Ranges of the presets, and pairs of robots in direct reach."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import fields, replace

from actors.installation.repository import REPOSITORY
from actors.radio.medium.reception import frame_error_rate
from actors.radio.propagation import (
    IndoorPropagation,
    PathLossParameters,
    PropagationParameters,
    line_of_sight,
    path_loss,
)
from actors.radio.radio_model import (
    PRESETS,
    DirectReach,
    RadioSetup,
    preset,
    radio_model,
    reach,
    required_dbm,
    share,
)
from actors.radio.walls import MATERIALS
from tests.refusals import refused

CORRIDOR = str(Path(__file__).parents[2] / "maps" / "corridor.yaml")


def unknown_keys(table: dict[str, Any], parameters: Any) -> set[str]:
    """Return keys of a table, and of tables in it, that are no fields."""
    inner = (
        unknown_keys(value, getattr(parameters, key))
        for key, value in table.items()
        if isinstance(value, dict) and hasattr(parameters, key)
    )
    return set(table).difference(one.name for one in fields(parameters)).union(*inner)


def test_every_key_of_a_preset_is_a_parameter() -> None:
    tables = tomllib.loads((REPOSITORY / "actors" / "radio" / "presets.toml").read_text("utf-8"))
    assert tables.keys() == PRESETS.keys()
    for name, table in tables.items():
        assert not unknown_keys(table, PRESETS[name])
    assert unknown_keys({"phy": {"noise": 1.0}}, PRESETS["ideal"]) == {"noise"}


def arriving(name: str, distance: float, octets: int = 127) -> float:
    p = preset(name)
    loss_db = path_loss(distance, p.propagation.path_loss.coefficients())
    snr_db = p.transceiver.tx_power_dbm - loss_db - p.phy.noise_dbm
    return 1.0 - float(frame_error_rate(np.array([snr_db]), octets)[0])


def test_the_range_of_the_original_is_about_twelve_metres() -> None:
    # By the formula: 0.02 % lost at 10 m, 7.6 % at 11.5 m, 62 % at 12.5 m, all at 14 m.
    lost = [1.0 - arriving("rosomnet", d) for d in (10.0, 11.5, 12.5, 14.0)]
    assert lost == pytest.approx([0.0002, 0.076, 0.62, 1.0], abs=0.02)


def test_presets_have_the_ranges_of_their_sources() -> None:
    assert reach(preset("chapter")) == pytest.approx(10.0, abs=0.05)
    assert reach(preset("beeclick")) == pytest.approx(55.2, abs=0.1)
    assert required_dbm(preset("beeclick"), 0.99, 20) == pytest.approx(-95.0, abs=0.01), (
        "the chip's data sheet"
    )
    ideal = preset("ideal")
    assert reach(ideal) == math.inf
    assert reach(replace(ideal, transceiver=replace(ideal.transceiver, tx_power_dbm=-99))) == 0


@pytest.mark.parametrize("name", ["chapter", "beeclick", "rosomnet"])
@pytest.mark.parametrize("octets", [20, 127])
def test_reach_is_where_the_share_arrives(name: str, octets: int) -> None:
    for part in (0.01, 0.5, 0.99):
        assert arriving(name, reach(preset(name), part, octets), octets) == pytest.approx(part, abs=1e-6)


@settings(derandomize=True, deadline=None)  # the kernel may have to be compiled first
@given(distance=st.floats(0.0, 500.0), slope=st.sampled_from([0.0, 2.0, 3.0]), excess=st.floats(0.0, 30.0))
def test_the_kernel_computes_the_formula(distance: float, slope: float, excess: float) -> None:
    parameters = PathLossParameters(near_exponent=slope, excess_db=excess)
    propagation = IndoorPropagation(PropagationParameters(parameters))
    found = propagation.loss_db(np.array([[0.0, 2.0]]), np.array([[distance, 2.0]]))[0, 0]
    metres = max(distance, 0.1)
    near, far = 40.2 + 10 * slope * math.log10(metres), 58.5 + 33 * math.log10(max(metres / 8.0, 1.0))
    assert found == pytest.approx(excess + (near if metres <= 8.0 else far), abs=1e-9)


def test_pairs_in_reach_are_counted_once_a_second() -> None:
    parameters = preset("chapter")
    seen = DirectReach(parameters, IndoorPropagation(parameters.propagation))
    places = np.array([[0.0, 0.0], [9.9, 0.0], [19.7, 0.0]])
    for instant in range(0, 3_000_000, 100_000):
        if seen.is_due(instant):
            seen.count_pairs(instant, places + 0.2 * (instant // 1_000_000))
    assert seen.counters() == {"pairs": 9, "pairs_in_reach": 6}
    assert share(seen.counters()) == 0.6667
    alone = DirectReach(parameters, IndoorPropagation(parameters.propagation))
    alone.count_pairs(0, places[:1])
    assert share(alone.counters()) is None


def test_a_setup_changes_its_preset() -> None:
    setup = RadioSetup(
        seed=1, step_us=100_000, robots=(), preset="rosomnet", walls="concrete", shadowing_db=3.0, channel=26
    )
    found = radio_model(setup).parameters
    assert found.phy == preset("rosomnet").phy and found.channel == 26
    assert (found.propagation.walls, found.propagation.shadowing.sigma_db) == ("concrete", 3.0)
    assert found.propagation.path_loss == preset("rosomnet").propagation.path_loss
    lossy = radio_model(msgspec.structs.replace(setup, excess_db=6.0)).parameters.propagation.path_loss
    assert lossy == replace(preset("rosomnet").propagation.path_loss, excess_db=6.0)


def test_walls_of_the_map_stand_between_the_offices() -> None:
    through, open_space = np.array([[12.0, 5.0]]), np.array([[17.5, 5.0]])
    losses = {}
    for walls in ("air", "brick", "concrete"):
        propagation = radio_model(
            RadioSetup(seed=1, step_us=100_000, robots=(), map=CORRIDOR, walls=walls)
        ).propagation
        losses[walls] = float(propagation.loss_db(through, open_space)[0, 0])
    assert losses["air"] == pytest.approx(24.5 + 40.2 + 20 * math.log10(5.5))
    assert losses["concrete"] > losses["brick"] > losses["air"] + 2 * MATERIALS["brick"].crossing_db


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"preset": "ether"}, f"Radio preset 'ether' is unknown; known are {', '.join(PRESETS)}."),
        ({"walls": "cheese"}, f"Wall material 'cheese' is unknown; known are {', '.join(MATERIALS)}."),
        (
            {"channel": 27},
            "RadioSetup.channel is 27, but must be an IEEE 802.15.4 channel, a whole number from 11 to 26",
        ),
    ],
)
def test_invalid_setups_are_refused(wrong: dict[str, str], sentence: str) -> None:
    with refused(sentence):
        radio_model(RadioSetup(seed=1, step_us=100_000, robots=(), **wrong))  # type: ignore[arg-type]


ANNEX_E = PathLossParameters()


def test_annex_e_at_known_distances() -> None:
    loss_db = [path_loss(distance, ANNEX_E.coefficients()) for distance in (1.0, 2.0, 8.0, 80.0)]
    assert loss_db == pytest.approx([40.2, 46.2206, 58.2618, 91.5], abs=1e-4)


@given(
    budget_db=st.floats(30.0, 110.0),
    breakpoint_=st.sampled_from([3.0, 8.0, math.inf]),
    distance=st.floats(0.1, 500.0),
)
def test_line_of_sight_ends_where_the_loss_passes_the_budget(
    budget_db: float, breakpoint_: float, distance: float
) -> None:
    parameters = PathLossParameters(breakpoint=breakpoint_)
    edge = line_of_sight(budget_db, parameters)
    if not math.isclose(distance, edge, rel_tol=1e-9):
        loss_db = path_loss(distance, parameters.coefficients())
        assert (loss_db <= budget_db) == (distance < edge)


def test_the_minimum_distance_is_ten_centimetres() -> None:
    touching, apart = (path_loss(distance, ANNEX_E.coefficients()) for distance in (0.0, 0.1))
    assert touching == apart == pytest.approx(20.2)
    assert line_of_sight(5.0, ANNEX_E) == 0.0


MINUS = "\N{MINUS SIGN}"
PAGE = (REPOSITORY / "docs" / "radio.md").read_text()


def rows(of: list[str]) -> dict[str, list[str]]:
    found = re.findall(r"^\| `(\w+)` \|(.*)\|$", PAGE, re.MULTILINE)
    return {name: [cell.strip() for cell in cells.split("|")] for name, cells in found if name in of}


def test_every_material_is_there_with_its_losses() -> None:
    for name, loss in (("brick", "3.1"), ("concrete", "7.7")):  # a wall of nine centimetres
        assert f"{MATERIALS[name].crossing_db + 3 * 0.03125 * MATERIALS[name].per_metre_db:.1f}" == loss
        assert f"{loss} dB in {name}" in PAGE
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
