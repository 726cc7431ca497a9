"""Base control for velocities: the formula's cases, its edges, and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.kobuki import motion
from firmware_bridge.kobuki.motion import base_control, velocity
from firmware_bridge.kobuki.wire import BaseControl, WireMisuseError


@pytest.mark.parametrize(
    ("v", "omega", "speed", "radius"),
    [
        (0.0, 0.0, 0, 0),
        (0.5, 0.0, 500, 0),
        (-0.3, 0.0, -300, 0),
        (0.5, 0.00009, 500, 0),  # as good as straight
        (0.0, 1.0, 115, 1),  # on the spot: 1000 * 0.23 * 1 / 2
        (0.0, -1.0, -115, 1),
        (0.00009, 1.0, 115, 1),
        (0.001, 1.0, 115, 1),  # radius 1 mm
        (0.0015, 1.0, 115, 1),  # radius 1.5 mm would be sent as 1: the same
        (-0.0015, 1.0, 115, 1),
        (0.002, 1.0, 117, 2),  # the first radius of its own: 2 + 115
        (0.2, 0.5, 257, 400),  # 400 mm; (400 + 115) * 0.5 = 257.5 towards zero
        (0.2, -0.5, 257, -400),  # (-400 - 115) * -0.5
        (-0.2, 0.5, -257, -400),
        (-0.2, -0.5, -257, 400),
        (0.3, 0.7, 380, 428),  # 428.57 mm, the speed from the radius unrounded: 380.5
        (0.5, 0.0153, 501, 32679),
        (0.5, 0.0152, 500, 0),  # 32894 mm does not fit: straight, not a slight turn
        (-0.5, 0.0152, -500, 0),
        (40.0, 0.0, 32767, 0),
        (-40.0, 0.0, -32768, 0),
        (0.0, 300.0, 32767, 1),
    ],
)
def test_the_formula(v: float, omega: float, speed: int, radius: int) -> None:
    assert base_control(v, omega) == BaseControl(speed, radius)


@pytest.mark.parametrize(("v", "omega"), [(math.nan, 0.0), (0.0, math.inf)])
def test_velocities_that_are_no_numbers_are_our_own_misuse(v: float, omega: float) -> None:
    with pytest.raises(WireMisuseError, match="both should be finite"):
        base_control(v, omega)


@given(st.floats(-0.7, 0.7), st.floats(-math.pi, math.pi))
def test_the_base_moves_as_wanted_within_the_wires_resolution(v: float, omega: float) -> None:
    back_v, back_omega = velocity(base_control(v, omega))
    # Rounding the speed costs 1 mm/s of the outer wheel, rounding the radius up to 2 mm of it.
    assert back_v == pytest.approx(v, abs=0.0012 + 0.0022 * abs(omega))
    if abs(omega) > 0.03:
        assert back_omega == pytest.approx(omega, abs=0.01 + 0.01 * abs(omega))


def test_the_encoder_resolution() -> None:
    assert pytest.approx(2578.33, abs=0.005) == motion.TICKS_PER_TURN
    assert pytest.approx(85.292e-6, abs=1e-9) == motion.METRES_PER_TICK
