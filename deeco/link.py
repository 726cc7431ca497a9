"""Frames of the link below a node, with their instants, and the limits of what a node sends and keeps."""

from dataclasses import dataclass, field, fields
from typing import Final, NamedTuple

from deeco.errors import DeploymentError
from deeco.instant import Duration, Instant, seconds


class Reception(NamedTuple):
    """A frame that the link has received; nothing about its data is taken for granted."""

    instant: Instant
    """When its last bit came in."""
    sender: int
    """Link address of the node that sent this frame."""
    data: bytes
    rssi_dbm: float | None = None
    """Received signal strength, dBm; None if the link does not say."""


class Transmission(NamedTuple):
    """A frame to be broadcast."""

    instant: Instant
    data: bytes


_RANGES: Final = {
    "frame_data": (10, 65_535),
    "least_fragment": (1, 65_535),
    "most_packet": (1, 65_531),
    "reassembly_timeout": (1, 2**63 - 1),
    "most_open": (1, 65_536),
    "most_roles": (1, 1_000),
    "most_items": (1, 10_000),
    "most_text": (0, 65_531),
    "most_id": (1, 65_531),
    "most_depth": (4, 256),
}
"""From the two bytes that L1 has for sizes, of which four go to the checksum; the rest bounds the work."""


@dataclass(frozen=True)
class LinkParameters:
    """Every limit of the wire. Raises DeploymentError for one that makes no sense.

    All nodes of a swarm should have the same: what one sends beyond the limits of another is junk there.
    """

    frame_data: int = 118
    """Data bytes of a frame. Default: IEEE 802.15.4-2006, 7.4.1, aMaxMACPayloadSize."""
    least_fragment: int = 8
    """Data bytes for which a fragment is begun in a frame that others have begun to fill; a frame with less
    room is sent as it is. Default: about the header's 9; JDEECo (DeviceOutputQueue)
    begins one for a single byte."""
    most_packet: int = 1024
    """Bytes of an L2 packet. Default: ten frames, of which with 5 % of the frames lost 60 % arrive whole."""
    reassembly_timeout: Duration = field(default=seconds(2))
    """A packet whose fragments are not all here so long after the first is given up, µs. Default: the 2000 ms
    of JDEECo 2 (PacketReceiver)."""
    most_open: int = 32
    """Packets in reassembly at once; one more, and the oldest is given up. Default: 16 neighbours
    with a packet of their own and a relayed one each. With most_packet it bounds the memory: some 40 KB."""
    most_roles: int = 8
    """Roles that a component plays. Default: twice what any example has."""
    most_items: int = 64
    """Items of a tuple, and fields of a class. Default: as many of 16 bytes as fill most_packet."""
    most_text: int = 256
    """Bytes of a str, in UTF-8, and of a bytes. Default: a quarter of most_packet."""
    most_id: int = 32
    """Bytes of a component's id, in UTF-8. Default: a UUID in hexadecimal digits."""
    most_depth: int = 16
    """Classes, tuples and unions inside one another in a role. Default: far beyond what anybody can read."""

    def __post_init__(self) -> None:
        for one in fields(self):
            value, (least, most) = getattr(self, one.name), _RANGES[one.name]
            if not least <= value <= most:
                raise DeploymentError(
                    f"LinkParameters.{one.name} is {value}, but must be from {least} to {most}"
                )


DEFAULTS: Final = LinkParameters()
"""Of a node that is given no others."""
