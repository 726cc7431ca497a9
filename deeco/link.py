"""What goes into a node and what comes out: frames of the link below, with their instants."""

from typing import NamedTuple

from deeco.instant import Instant


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
