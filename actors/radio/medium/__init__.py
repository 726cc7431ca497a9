"""The medium between transceivers, a library without an actor: event loop, CSMA/CA, reception, state.

`examples/contention.py` shows it at work by itself.
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
