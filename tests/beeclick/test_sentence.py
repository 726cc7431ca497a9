"""GPS sentences RMC, valid and invalid."""

from functools import reduce
from operator import xor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.beeclick.reception import parse_rmc


def sentence(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}".encode()


FIX = "GPRMC,123519.50,A,5005.2460,N,01425.1230,E,000.0,084.4,230614,,"


def test_a_fix_is_in_degrees_south_and_west_negative() -> None:
    position = parse_rmc(sentence(FIX))
    assert position is not None
    assert position.valid
    assert position.latitude == pytest.approx(50.087433333333334)
    assert position.longitude == pytest.approx(14.418716666666667)
    south = parse_rmc(sentence("GPRMC,000000,A,3351.0000,S,15112.0000,W,0,0,010100"))
    assert south is not None and (south.latitude, south.longitude) == (-33.85, -151.2)


@given(st.integers(0, 89), st.integers(0, 59), st.integers(0, 10**7 - 1), st.integers(0, 7))
def test_minutes_may_have_any_number_of_decimals(whole: int, minute: int, fraction: int, digits: int) -> None:
    decimals = f".{fraction:07d}"[: digits + 1] if digits else ""
    position = parse_rmc(sentence(f"GPRMC,000000,A,{whole:02d}{minute:02d}{decimals},N,00000.0,E,0,0,010100"))
    assert position is not None
    assert position.latitude == pytest.approx(whole + float(f"{minute}{decimals}") / 60, abs=1e-12)


def test_without_a_fix_there_is_no_position() -> None:
    position = parse_rmc(sentence("GPRMC,,V,,,,,,,,,,N"))
    assert position is not None
    assert (position.valid, position.latitude, position.longitude) == (False, None, None)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"$GPRMC",
        sentence(FIX)[:-2] + b"00",
        sentence(FIX.replace("GPRMC", "GPGGA")),
        sentence(FIX.replace(",A,", ",B,")),
        sentence(FIX.replace("5005.2460", "")),
        sentence(FIX.replace("5005.2460", "50052460")),
        sentence(FIX.replace("5005.2460", "5060.0000")),
        sentence(FIX.replace("5005.2460", "9000.0001")),
        sentence(FIX.replace(",N,", ",X,")),
        sentence(FIX.replace("01425.1230", "1425.1230")),
        sentence(FIX.replace("01425.1230", "18000.1000")),
        sentence("GPRMC,123519,A"),
        sentence(FIX).replace(b"A", b"\xc1"),
    ],
)
def test_anything_else_is_no_sentence(text: bytes) -> None:
    assert parse_rmc(text) is None


@given(st.binary(max_size=100))
def test_any_bytes_are_borne(text: bytes) -> None:
    assert parse_rmc(b"$GPRMC," + text) is None
