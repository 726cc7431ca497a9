import pytest

from actors.messages import FRAME_DATA_LIMIT
from actors.radio.frame import airtime_us, size_fault


@pytest.mark.parametrize(("data", "microseconds"), [(118, 4256), (0, 480), (1, 512), (11, 832), (51, 2112)])
def test_airtime_is_that_of_the_standard(data: int, microseconds: int) -> None:
    assert airtime_us(data) == microseconds


def test_airtime_is_250_kilobits_per_second() -> None:
    octets = 10
    assert (airtime_us(50 + octets) - airtime_us(50)) * 250 == octets * 8 * 1000


def test_a_frame_carries_0_to_118_bytes() -> None:
    assert size_fault(0) == size_fault(FRAME_DATA_LIMIT) == ""
    assert size_fault(119) == "The frame has 119 data bytes; it must have 0 to 118."
