"""Wi-Fi stations and jammers: when they are on, and what of them arrives."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.radio.propagation.indoor import IndoorPropagation, PropagationParameters
from actors.radio.propagation.interferers import Jammer, Wifi, WifiParameters, in_band_db
from actors.runtime.errors import AcrcError

PROPAGATION = IndoorPropagation(PropagationParameters())
HOUR = 3_600_000_000_000


def wifi(duty: float = 0.3, channel: int = 1, seed: int = 1) -> Wifi:
    return Wifi(WifiParameters(2.0, 1.0, channel, duty), 11, PROPAGATION, lambda: np.random.default_rng(seed))


@pytest.mark.parametrize("duty", [0.05, 0.3, 0.8])
def test_the_share_of_time_on_is_the_duty(duty: float) -> None:
    # About 30 000 bursts or more: the standard error of the share is below 0.6 %.
    until = int(100_000_000_000 / duty * 0.5)
    bursts = wifi(duty).bursts(0, until)
    lengths = bursts[:, 1] - bursts[:, 0]
    assert lengths.sum() / until == pytest.approx(duty, rel=0.03)
    assert 1_000_000 <= lengths.min() < 1_001_000 and 1_999_000 < lengths.max() <= 2_000_000
    assert lengths.mean() == pytest.approx(1_500_000, rel=0.01)
    assert (bursts[1:, 0] >= bursts[:-1, 1]).all()


@settings(max_examples=50, deadline=None, derandomize=True)
@given(cuts=st.lists(st.integers(0, 20_000_000_000), max_size=12))
def test_windows_do_not_change_the_bursts(cuts: list[int]) -> None:
    whole = wifi().bursts(0, 20_000_000_000)
    borders = [0, *sorted(cuts), 20_000_000_000]
    station = wifi()
    parts = [station.bursts(a, b) for a, b in itertools.pairwise(borders)]
    assert np.array_equal(np.concatenate(parts), whole)
    for low, high in zip(borders[-2::-1], borders[::-1], strict=False):  # and looking back
        within = (whole[:, 0] >= low) & (whole[:, 0] < high)
        assert np.array_equal(station.bursts(low, high), whole[within])


def test_a_long_run_forgets_and_is_right_when_asked_again() -> None:
    station = wifi()
    first = station.bursts(0, 1_000_000_000)
    for second in range(0, 120, 5):
        station.bursts(second * 1_000_000_000, (second + 5) * 1_000_000_000)
    assert len(station._known) < 10_000
    assert np.array_equal(station.bursts(0, 1_000_000_000), first)


def test_what_arrives_is_the_part_in_band_less_the_loss() -> None:
    receivers = np.array([[2.0, 2.0], [2.0, 9.0], [12.0, 1.0]])
    expected = 17.0 - 10.4139 - np.array([40.2, 58.2618, 61.6981])
    assert wifi().power_dbm(receivers) == pytest.approx(expected, abs=1e-3)
    assert wifi().power_dbm(receivers.reshape(3, 1, 2)).shape == (3, 1)
    assert wifi(channel=6).power_dbm(receivers) == pytest.approx(expected - 50.0, abs=1e-3)


def test_the_channels_between_and_above_wifi_are_the_free_ones() -> None:
    least = {radio: max(in_band_db(wifi, radio) for wifi in (1, 6, 11)) for radio in range(11, 27)}
    assert [radio for radio, db in least.items() if db < -40] == [15, 20, 25, 26]
    assert in_band_db(1, 12) == pytest.approx(-10.41, abs=0.01)
    assert in_band_db(11, 26) == pytest.approx(-40.41, abs=0.01)
    assert in_band_db(1, 26) == pytest.approx(-60.41, abs=0.01)


def test_a_jammer_drowns_its_surroundings_for_its_time() -> None:
    jammer = Jammer(1.0, 0.0, 2.0, 5_000, 9_000)
    assert jammer.power_dbm(np.array([[0.0, 0.0], [3.0, 0.0], [3.01, 0.0]])).tolist() == [0.0, 0.0, -np.inf]
    assert jammer.bursts(0, 10_000).tolist() == [[5_000, 9_000]]
    assert jammer.bursts(0, 5_000).size == jammer.bursts(5_001, HOUR).size == 0
    assert jammer.bursts(5_000, 5_001).tolist() == [[5_000, 9_000]]
    assert Jammer(0.0, 0.0, 1.0, 7, 7).bursts(0, HOUR).size == 0


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"channel": 14}, "wifi.channel is 14, but must be from 1 to 13"),
        ({"duty": 1.0}, "wifi.duty is 1, but must be above 0 and below 1"),
        ({"shortest_burst_us": 0}, "wifi.shortest_burst_us is 0, but must be above 0"),
        ({"shortest_burst_us": 3000}, "wifi.longest_burst_us is 2000, but must be at least 3000"),
    ],
)
def test_a_station_that_makes_no_sense_is_named(wrong: dict[str, int], sentence: str) -> None:
    values: dict[str, float] = {"x": 0.0, "y": 0.0, "channel": 1, "duty": 0.5, **wrong}
    with pytest.raises(AcrcError) as error:
        WifiParameters(**values)  # type: ignore[arg-type]
    assert str(error.value) == sentence
