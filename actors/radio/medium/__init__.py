"""The medium between transceivers as a library: event loop, CSMA/CA, reception and state.

`examples/contention.py` uses it without actors.
"""

from actors.radio.medium.medium import Interferer, Medium, Poisson, Propagation, Request, Saturated
from actors.radio.medium.state import Cca, Kind, Outcome, PhyParameters, Transceiver

__all__ = [
    "Cca",
    "Interferer",
    "Kind",
    "Medium",
    "Outcome",
    "PhyParameters",
    "Poisson",
    "Propagation",
    "Request",
    "Saturated",
    "Transceiver",
]
