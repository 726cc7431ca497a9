"""Ten senders around a receiver, without robots: packet delivery ratio as a function of load.

`python -m examples.contention` prints for each load the share of delivered frames, the share of channel
access failures, and the mean latency from a frame's arrival to the end of its reception.
"""

import sys

import numpy as np

from actors.ieee802154 import airtime_ns
from actors.radio.medium import EventKind, Medium, PoissonTraffic
from actors.radio.propagation import IndoorPropagation
from actors.radio.radio_model import preset

SENDERS, OCTETS, SECONDS = 10, 60, 30
PARAMETERS = preset("beeclick")


def contend(load: float, seed: int = 1) -> tuple[float, float, float]:
    """Return delivery ratio, share of access failures and mean latency, ms; `load`: share of air time."""
    angles = np.arange(SENDERS) * 2 * np.pi / SENDERS
    around = 10 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    transceivers = [PARAMETERS.transceiver.numbered(address) for address in range(SENDERS + 1)]
    propagation = IndoorPropagation(PARAMETERS.propagation)
    medium = Medium(transceivers, propagation, PARAMETERS.phy, seed=seed, watched=[SENDERS])
    medium.place(np.concatenate([around, np.zeros((1, 2))]))  # m; the last one is the receiver
    for sender in range(SENDERS):
        medium.offer(sender, PoissonTraffic(OCTETS, load * 1e9 / airtime_ns(OCTETS) / SENDERS))
    events = medium.run(SECONDS * 1_000_000_000)
    heard = events[(events["kind"] == EventKind.HEARD)]
    counted = medium.counters()
    offered, failed = counted["generated"].sum(), counted["access_failures"].sum()
    return len(heard) / offered, failed / offered, (heard["instant_ns"] - heard["asked_ns"]).mean() / 1e6


def main() -> None:
    """Print a line for each load."""
    for load in (0.05, 0.1, 0.2, 0.4, 0.8):
        delivered, failed, latency_ms = contend(load)
        line = f"load {load:4.2f}: {delivered:6.1%} delivered, {failed:5.1%} no access, {latency_ms:6.2f} ms"
        sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
