"""Traffic that the medium makes by itself, open loop: the same whatever becomes of the frames."""

from dataclasses import dataclass

from actors.radio.medium.state import BROADCAST


@dataclass(frozen=True)
class Poisson:
    """Frames at random, independent of one another."""

    octets: int
    """Of the PSDU, MAC header and FCS included: 9 to 127."""
    per_second: float
    to: int = BROADCAST
    """Number of the receiving transceiver."""
    acknowledged: bool = False


@dataclass(frozen=True)
class Saturated:
    """Always one more frame: the next is handed over as soon as one is done with."""

    octets: int
    """As in Poisson."""
    after_ns: int = 0
    """When the first comes, counted from now: phases that differ keep transceivers from moving in step."""
    to: int = BROADCAST
    acknowledged: bool = False


Traffic = Poisson | Saturated
