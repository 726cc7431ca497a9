"""The frame check sequence, sizes and air time of a BEE click's frames."""

import pytest

from actors.ieee802154 import PSDU_LIMIT
from actors.messages import FRAME_DATA_LIMIT
from actors.radio.frame import DataFrame, airtime_us, frame_check, octets, size_fault


@pytest.mark.parametrize(
    ("frame", "body"),
    [
        (DataFrame(0xBABA, 0x0103, b"x"), "01 80 00 ba ba 03 01 78"),
        (DataFrame(0x1234, 0xFFFD, b"hi"), "01 80 00 34 12 fd ff 6869"),
        (DataFrame(1, 2, b""), "01 80 00 0100 0200"),
    ],
)
def test_the_check_covers_header_and_data(frame: DataFrame, body: str) -> None:
    assert frame.check == frame_check(bytes.fromhex(body))
    assert len(bytes.fromhex(body)) + 2 == octets(len(frame.data))


def test_the_frame_check_sequence_is_the_standards() -> None:
    # The catalogue's check value of CRC-16/KERMIT, which is the same sum.
    assert frame_check(b"123456789") == 0x2189
    # The example of IEEE 802.15.4-2006, 7.2.1.9: header and sum of an acknowledgement, first bit first.
    header = bytes(int(bits[::-1], 2) for bits in ("01000000", "00000000", "01010110"))
    assert f"{frame_check(header):016b}"[::-1] == "0010011110011110"


def test_a_frame_carries_118_bytes_and_no_more() -> None:
    assert octets(118) == PSDU_LIMIT
    assert size_fault(0) == size_fault(FRAME_DATA_LIMIT) == ""
    assert size_fault(119) == "The frame has 119 data bytes; it must have 0 to 118."


@pytest.mark.parametrize(("data", "microseconds"), [(118, 4256), (0, 480), (1, 512), (11, 832), (51, 2112)])
def test_airtime_is_that_of_the_standard(data: int, microseconds: int) -> None:
    assert airtime_us(data) == microseconds
