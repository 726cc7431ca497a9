"""The medium between transceivers as a library: event loop, CSMA/CA, reception and state.

`examples/contention.py` uses it without actors.
"""

from actors.radio.medium.medium import (
    Interferer,
    Medium,
    PoissonTraffic,
    Propagation,
    Request,
    SaturatedTraffic,
)
from actors.radio.medium.state import Cca, EventKind, Outcome, PhyParameters, Transceiver

__all__ = [
    "Cca",
    "EventKind",
    "Interferer",
    "Medium",
    "Outcome",
    "PhyParameters",
    "PoissonTraffic",
    "Propagation",
    "Request",
    "SaturatedTraffic",
    "Transceiver",
]
