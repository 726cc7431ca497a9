"""The medium between transceivers, a library without an actor: event loop, CSMA/CA, reception, state.

`examples/contention.py` shows it at work by itself.
"""

from actors.radio.medium.channel import Interferer, Propagation
from actors.radio.medium.csma import airtime_ns
from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Cca, Kind
from actors.radio.medium.traffic import Poisson, Saturated
from actors.radio.medium.transceiver import PhyParameters, Transceiver

__all__ = [
    "Cca",
    "Interferer",
    "Kind",
    "Medium",
    "PhyParameters",
    "Poisson",
    "Propagation",
    "Request",
    "Saturated",
    "Transceiver",
    "airtime_ns",
]
