import numpy as np
import pytest

from actors.radio.frame import link_qualities, rssi_codes, rssi_dbm, strengths_dbm
from firmware_bridge.beeclick.parameters import (
    power_setting,
    radiated,
)


@pytest.mark.parametrize(
    ("code", "dbm"),
    [(0, -90), (5, -87), (37, -80), (89, -70), (138, -60), (193, -50), (239, -40), (255, -35)],
)
def test_a_signal_strength_code_is_so_many_dbm(code: int, dbm: float) -> None:
    assert rssi_dbm(code) == dbm
    assert rssi_codes(np.array([dbm])).tolist() == [code]


def test_codes_between_those_of_the_table_lie_between() -> None:
    values = [rssi_dbm(code) for code in range(256)]
    assert values == sorted(values)
    assert len(set(values)) == 256
    assert rssi_dbm(41) == pytest.approx(-80 + 4 / 6)


def test_beyond_its_range_the_chip_gives_the_ends() -> None:
    assert rssi_codes(np.array([-np.inf, -120.0, 10.0])).tolist() == [0, 0, 255]


def test_code_and_dbm_agree_to_half_a_code() -> None:
    dbm = np.arange(-900, -350) / 10
    codes = rssi_codes(dbm)
    assert np.abs(strengths_dbm(codes) - dbm).max() <= 0.51
    assert strengths_dbm(codes).tolist() == [rssi_dbm(code) for code in codes.tolist()]


@pytest.mark.parametrize(
    ("asked", "made"),
    [
        *((0, 0), (-4, 0), (-5, -5), (-6, -5), (-7, -63), (-12, -63), (-63, -63), (-99, -63)),
        *((-100, -100), (-105, -105), (-120, -163), (-300, -300), (-363, -363), (-305, -305)),
    ],
)
def test_the_firmware_makes_another_power_of_most(asked: int, made: int) -> None:
    assert radiated(asked) == made


def test_only_powers_that_the_firmware_gets_right_are_asked_for() -> None:
    right = [asked for asked in range(-363, 1) if radiated(asked) == asked]
    assert right == sorted(-10 * large - small for large in (0, 10, 20, 30) for small in (0, 5, 63))
    assert [power_setting(asked / 10) for asked in right] == right


def test_link_quality_grows_from_the_weakest_frame_over_twenty_decibels() -> None:
    dbm = np.array([-120.0, -96.0, -86.0, -76.0, -30.0])
    assert link_qualities(dbm, -96.0).tolist() == [0, 0, 128, 255, 255]
