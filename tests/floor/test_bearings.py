"""Which rays may meet a disc, against looking at all of them."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from actors.floor.bearings import bearing_to, half_width, window

COORDINATES = st.floats(-5, 5)


@given(COORDINATES, COORDINATES, st.floats(0.05, 1), st.floats(-4, 4), st.floats(-3.2, 0), st.integers(2, 90))
def test_no_ray_outside_of_the_windows_meets_the_disc(
    x: float, y: float, radius: float, heading: float, first_angle: float, rays: int
) -> None:
    apart, increment = math.hypot(x, y), 2 * math.pi / rays
    assume(apart > 1e-6)
    bearing, half = bearing_to(x, y, heading, first_angle), half_width(apart, radius)
    windows = [window(bearing, half, turn, increment, rays) for turn in (-1, 0, 1)]
    inside = {ray for begin, end in windows for ray in range(begin, end)}
    assert inside <= set(range(rays))
    for ray in set(range(rays)) - inside:
        away = math.remainder(heading + first_angle + ray * increment - math.atan2(y, x), 2 * math.pi)
        assert apart > radius
        assert abs(away) > math.asin(radius / apart)


def test_a_narrow_thing_is_met_by_few_rays() -> None:
    bearing, half = bearing_to(3.0, 0.0, 0.0, -1.0), half_width(3.0, 0.1)
    begin, end = window(bearing, half, 0, 0.02, 101)
    assert begin <= 50 < end <= begin + 8
