"""What Wi-Fi and jammers do to frames, counted in the medium."""

import math
from dataclasses import replace

import numpy as np
import pytest

from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Outcome
from actors.radio.propagation.indoor import IndoorPropagation
from actors.radio.propagation.interferers import Jammer, Wifi, WifiParameters
from actors.radio.radio_model import preset

FRAMES = 3000
SPACING_NS = 45_000_000
BEECLICK = preset("beeclick")
PROPAGATION = IndoorPropagation(BEECLICK.propagation)


def counted(wifi: WifiParameters, radio_channel: int, octets: int, link: float) -> tuple[float, float]:
    """The shares of frames that arrive over a link, and that never got the channel."""
    station = Wifi(wifi, radio_channel, PROPAGATION, lambda: np.random.default_rng(2))
    pair = [replace(BEECLICK.transceiver, address=address) for address in (1, 2)]
    medium = Medium(pair, PROPAGATION, BEECLICK.phy, seed=1, interferers=[station])
    medium.place(np.array([[0.0, 0.0], [link, 0.0]]))
    medium.submit(Request(k * SPACING_NS, 0, octets, tag=k) for k in range(FRAMES))
    medium.run(FRAMES * SPACING_NS)
    failures = int(medium.counters()["access_failures"][0])
    return float(medium.outcomes()[1, Outcome.HEARD]) / FRAMES, failures / FRAMES


@pytest.mark.parametrize(("duty", "octets"), [(0.1, 20), (0.1, 127), (0.3, 60), (0.3, 127)])
def test_a_frame_survives_where_no_burst_touches_it(duty: float, octets: int) -> None:
    # 8 dB stronger than the frame, and unnoticed by an assessment from -69 dBm on: the closed form is
    # that of a silence at the frame's begin that lasts for all of it. Standard error at most 0.9 %.
    far = WifiParameters(9.0, 33.0, 1, duty)
    at_both = (
        far.power_dbm
        - 10.41
        - PROPAGATION.loss_db(np.array([[9.0, 33.0]]), np.array([[0.0, 0.0], [18.0, 0.0]]))
    )
    assert (at_both < -70.0).all() and (at_both > -74.0).all()
    silence = 1.5 * (1.0 - duty) / duty
    expected = (1.0 - duty) * math.exp(-(12 + 2 * octets) * 0.016 / silence)
    arrived, failed = counted(far, 11, octets, 18.0)
    assert failed == 0.0
    assert arrived == pytest.approx(expected, abs=0.035)


def test_a_station_nearby_is_noticed_and_one_on_another_channel_is_not() -> None:
    near = WifiParameters(1.0, 2.0, 1, 0.6)
    arrived, failed = counted(near, 11, 127, 3.0)
    assert arrived < 0.2 and failed > 0.05
    assert counted(near, 26, 127, 3.0) == (1.0, 0.0)


def test_a_jammer_drowns_who_is_near_for_as_long_as_it_is_on() -> None:
    jammer = Jammer(10.0, 0.0, 2.0, 5 * SPACING_NS, 10 * SPACING_NS)
    pair = [replace(BEECLICK.transceiver, address=address) for address in (1, 2, 3)]
    medium = Medium(pair, PROPAGATION, BEECLICK.phy, seed=1, interferers=[jammer])
    medium.place(np.array([[0.0, 0.0], [9.0, 0.0], [5.0, 0.0]]))
    medium.submit(Request(k * SPACING_NS, 0, 60, tag=k) for k in range(20))
    medium.run(20 * SPACING_NS)
    outcomes = medium.outcomes()
    assert (outcomes[1, Outcome.HEARD], outcomes[1, Outcome.DISTURBED]) == (15, 5)
    assert outcomes[2, Outcome.HEARD] == 20
    medium.submit(Request(20 * SPACING_NS + 1, 1, 60) for _ in range(1))
    medium.run(21 * SPACING_NS)
    assert medium.outcomes()[0, Outcome.HEARD] == 1


def test_a_sender_beside_a_jammer_does_not_get_the_channel() -> None:
    jammer = Jammer(0.0, 0.0, 2.0, 0, 100 * SPACING_NS)
    pair = [replace(BEECLICK.transceiver, address=address) for address in (1, 2)]
    medium = Medium(pair, PROPAGATION, BEECLICK.phy, seed=1, interferers=[jammer])
    medium.place(np.array([[0.0, 0.0], [9.0, 0.0]]))
    medium.submit(Request(k * SPACING_NS, 0, 60, tag=k) for k in range(10))
    medium.run(10 * SPACING_NS)
    assert int(medium.counters()["access_failures"][0]) == 10
