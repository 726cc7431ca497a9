"""Size and air time of the frames that robots send."""

from actors import ieee802154
from actors.ieee802154 import MAC_OCTETS
from actors.messages import FRAME_DATA_LIMIT


def octets(data_bytes: int) -> int:
    """The size of a frame with so many data bytes: its MAC header, the data and the FCS."""
    return data_bytes + MAC_OCTETS


def airtime_us(data_bytes: int) -> int:
    """The time in the air, µs, of a frame with so many data bytes."""
    return ieee802154.airtime_ns(octets(data_bytes)) // 1000


def size_fault(data_bytes: int) -> str:
    """One sentence on why a frame cannot carry so many data bytes; empty if it can."""
    if 0 <= data_bytes <= FRAME_DATA_LIMIT:
        return ""
    return f"The frame has {data_bytes} data bytes; it must have 0 to {FRAME_DATA_LIMIT}."
