import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.radio.propagation.indoor import PathLossParameters, line_of_sight, over
from actors.radio.radio_model import preset
from actors.runtime.errors import AcrcError

ANNEX_E = PathLossParameters()


def test_annex_e_at_known_distances() -> None:
    loss_db = [over(distance, ANNEX_E.coefficients()) for distance in (1.0, 2.0, 8.0, 80.0)]
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
        loss_db = over(distance, parameters.coefficients())
        assert (loss_db <= budget_db) == (distance < edge)


def test_a_hopeless_budget_reaches_nothing() -> None:
    assert line_of_sight(5.0, ANNEX_E) == 0.0


def test_antennas_that_touch_are_taken_to_be_ten_centimetres_apart() -> None:
    touching, apart = (over(distance, ANNEX_E.coefficients()) for distance in (0.0, 0.1))
    assert touching == apart == pytest.approx(20.2)


def test_an_unknown_preset_is_named() -> None:
    with pytest.raises(AcrcError) as error:
        preset("office")
    known = "chapter, beeclick, rosomnet, ns3, ideal"
    assert str(error.value) == f"Radio preset 'office' is unknown; known are {known}."
