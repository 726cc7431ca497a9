"""Frames between a node and its link, and the limits of packets and frames."""

from dataclasses import dataclass, field, fields
from typing import Final, NamedTuple, Protocol

from deeco.errors import DeploymentError
from deeco.instant import Duration, Instant, seconds


class ReceivedFrame(Protocol):
    """Anything with the attributes of a Reception."""

    @property
    def instant(self) -> int:
        """Instant of its last bit, µs."""

    @property
    def sender(self) -> int:
        """Link address of the transmitter."""

    @property
    def data(self) -> bytes:
        """Untrusted content."""

    @property
    def rssi_dbm(self) -> float | None:
        """Received signal strength, dBm."""


class Reception(NamedTuple):
    """A frame received from the link; its data is untrusted."""

    instant: Instant
    """Instant of its last bit."""
    sender: int
    """Link address of the transmitter of this frame."""
    data: bytes
    rssi_dbm: float | None = None
    """Received signal strength, dBm; None if the link does not measure it."""


class Transmission(NamedTuple):
    """A frame to be broadcast."""

    instant: Instant
    data: bytes


_RANGES: Final = {
    "frame_data": (10, 65_535),
    "min_fragment": (1, 65_535),
    "max_packet": (1, 65_531),
    "reassembly_timeout": (1, 2**63 - 1),
    "max_open": (1, 65_536),
    "max_roles": (1, 1_000),
    "max_items": (1, 10_000),
    "max_text": (0, 65_531),
    "max_id": (1, 65_531),
    "max_depth": (4, 256),
}
"""Valid ranges. L1 has two bytes for sizes and four bytes of checksum; the other limits bound the work."""


@dataclass(frozen=True)
class LinkParameters:
    """Limits of packets and frames. Raises DeploymentError for a value out of range.

    Use the same values for all nodes of a swarm: a node drops packets beyond its own limits.
    """

    frame_data: int = 118
    """Bytes of a frame. Default: IEEE 802.15.4-2006, 7.4.1, aMaxMACPayloadSize."""
    min_fragment: int = 8
    """Smallest free space of a partly filled frame in which a fragment is started, bytes; with less, the
    frame is sent as it is. Default: about the header's 9; JDEECo (DeviceOutputQueue) starts one for a single
    byte."""
    max_packet: int = 1024
    """Bytes of an L2 packet. Default: ten frames; if 5 % of frames are lost, 60 % of such packets arrive
    whole."""
    reassembly_timeout: Duration = field(default=seconds(2))
    """A packet still incomplete this long after its first fragment is dropped, µs. Default: 2000 ms as in
    JDEECo 2 (PacketReceiver)."""
    max_open: int = 32
    """Incomplete packets kept at once; beyond that the oldest is dropped. Default: 16 neighbours with one
    packet of their own and one relayed packet each. Together with max_packet it limits memory to about 40
    KB."""
    max_roles: int = 8
    """Roles of one component. Default: twice the maximum of the examples."""
    max_items: int = 64
    """Items of a tuple and fields of a class. Default: max_packet filled with items of 16 bytes."""
    max_text: int = 256
    """Bytes of a str (in UTF-8) or a bytes value. Default: a quarter of max_packet."""
    max_id: int = 32
    """Bytes of a component's id in UTF-8. Default: a UUID in hexadecimal digits."""
    max_depth: int = 16
    """Nested classes, tuples and unions in a role. Default: far more than readable types have."""

    def __post_init__(self) -> None:
        for one in fields(self):
            value, (least, most) = getattr(self, one.name), _RANGES[one.name]
            if type(value) is not int or not least <= value <= most:
                raise DeploymentError(
                    f"LinkParameters.{one.name} is {value!r}; must be an integer from {least} to {most}"
                )


DEFAULTS: Final = LinkParameters()
"""Limits of a node without explicit parameters."""
