import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.radio.parameters import PRESETS, RadioParameters, preset
from actors.radio.path_loss import reach, received_dbm
from actors.runtime.errors import AcrcError

DEFAULT = RadioParameters()


def test_annex_e_at_known_distances() -> None:
    loss_db = DEFAULT.tx_power_dbm - received_dbm(np.array([1.0, 2.0, 8.0, 80.0]), DEFAULT)
    assert loss_db == pytest.approx([40.2, 46.2206, 58.2618, 91.5], abs=1e-4)


def test_the_chapter_preset_reaches_about_ten_metres() -> None:
    assert reach(preset("chapter")) == pytest.approx(10.50, abs=0.01)
    assert reach(preset("beeclick")) == pytest.approx(50.83, abs=0.01)


@pytest.mark.parametrize("parameters", PRESETS.values(), ids=PRESETS)
def test_reach_is_where_the_power_passes_the_sensitivity(parameters: RadioParameters) -> None:
    edge = reach(parameters)
    inside, outside = received_dbm(np.array([edge * (1 - 1e-9), edge * (1 + 1e-9)]), parameters)
    assert inside >= parameters.sensitivity_dbm > outside


@given(
    power=st.floats(-60.0, 20.0),
    breakpoint_=st.sampled_from([3.0, 8.0, math.inf]),
    distance=st.floats(0.1, 500.0),
)
def test_reach_and_power_agree(power: float, breakpoint_: float, distance: float) -> None:
    parameters = replace(DEFAULT, tx_power_dbm=power, breakpoint=breakpoint_, near_loss_db=30.0)
    edge = reach(parameters)
    if not math.isclose(distance, edge, rel_tol=1e-9):
        received = received_dbm(np.array([distance]), parameters)[0]
        assert (received >= parameters.sensitivity_dbm) == (distance < edge)


def test_a_hopeless_budget_reaches_nothing() -> None:
    assert reach(replace(DEFAULT, tx_power_dbm=-90.0)) == 0.0


def test_antennas_that_touch_are_taken_to_be_ten_centimetres_apart() -> None:
    power = received_dbm(np.array([0.0, 0.1]), DEFAULT)
    assert power[0] == power[1] == pytest.approx(-32.6 - 20.2)


def test_an_unknown_preset_is_named() -> None:
    with pytest.raises(AcrcError) as error:
        preset("office")
    assert str(error.value) == "Radio preset 'office' is unknown; known are chapter, beeclick."
