"""What the kernels of the medium work on: one record per node, per frame in the air, per event.

All instants and durations are whole nanoseconds: a symbol of 16 µs is exact, so is a robot's µs, and nodes
whose phases are drawn at random practically never meet at one instant.
"""

from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Record = Any
"""One entry of an array of records, as kernels know it: fields by name, changed in place."""

SYMBOL_NS: Final = 16_000
NEVER: Final = np.iinfo(np.int64).max
BROADCAST: Final = -1
"""As destination."""
NOBODY: Final = -1
"""As number of a node."""


class Fate(IntEnum):
    """What becomes of one frame at one node other than its sender."""

    HEARD = 0
    COLLISION = 1
    """Other frames: they spoilt it, or the receiver had locked onto one of them."""
    DISTURBED = 2
    """A source that is no transceiver: Wi-Fi, a jammer."""
    HALF_DUPLEX = 3
    """The node was sending at the time, or turning between sending and receiving."""
    RECEIVER_BUSY = 4
    """The node's computer was reading an earlier frame from the transceiver, which cannot receive then."""
    BELOW_SENSITIVITY = 5
    """Too weak even on a free channel, or spoilt by noise alone."""
    POWERED_OFF = 6
    """The node or the sender was switched off before the frame ended."""
    FILTERED = 7
    """Received, but meant for another node."""
    NOT_COUNTED = 8
    """The sender itself, or a node that was off when the frame began."""


class Kind(IntEnum):
    """What an event of the medium says."""

    SENT = 0
    """A frame has left the antenna, or has been acknowledged where that was asked for."""
    HEARD = 1
    ACCESS_FAILURE = 2
    """The channel was never clear."""
    OVERFLOW = 3
    """The transmit queue was full."""
    NO_ACK = 4
    """No acknowledgement came to the last of the retries."""


class Cca(IntEnum):
    """When clear channel assessment takes the channel for busy (IEEE 802.15.4-2006, 6.9.9)."""

    ENERGY = 1
    CARRIER = 2
    """While the receiver is locked onto a frame."""
    EITHER = 3
    BOTH = 4
    NEVER = 5
    """ALOHA (mode 4 of IEEE 802.15.4-2011)."""


class Mac(IntEnum):
    """What a node's MAC is at."""

    IDLE = 0
    BACKOFF = 1
    """The random delay and the assessment after it."""
    TURNING = 2
    SENDING = 3
    AWAITING = 4
    """An acknowledgement."""
    SPACING = 5
    """Interframe spacing."""


class Due(IntEnum):
    """What is due, in the order in which it happens at one instant."""

    FRAME_END = 0
    ACK_END = 1
    CCA_END = 2
    FRAME_BEGIN = 3
    ACK_BEGIN = 4
    ACK_TIMEOUT = 5
    SPACING_END = 6
    CCA_BEGIN = 7
    ARRIVAL = 8


class Offer(IntEnum):
    """The kind of traffic that a node is offered by itself."""

    NONE = 0
    POISSON = 1
    SATURATED = 2


def _dtype(**kinds: str) -> np.dtype[np.void]:
    """Integers all have 64 bits: kernels are compiled once for each kind of argument."""
    return np.dtype(list(kinds.items()), align=True)


NODE: Final = _dtype(
    key="i8", min_be="i8", max_be="i8", max_backoffs="i8", max_retries="i8", cca="i8", cca_mw="f8",
    capacity="i8", watched="b1",
    offer="i8", offer_turn="i8", offer_octets="i8", offer_to="i8", offer_ack="b1", interval_ns="f8",
    powered="b1", mac="i8", nb="i8", be="i8", tries="i8", turn="i8", epoch="i8",
    head="i8", queued="i8", number="i8", arrivals="i8",
    assessed_ns="i8", energy="f8", peak="f8", carrier="b1",
    ack_to="i8", ack_number="i8", ack_draw="i8",
    in_air="i8", assessing="i8", known="b1",
    octets="i8", to="i8", ack="b1", is_ack="b1", frame="i8", draw="i8", tag="i8", asked_ns="i8",
    generated="i8", sent="i8", overflowed="i8", access_failures="i8", acknowledged="i8", no_ack="i8",
    cut_off="i8", discarded="i8", octets_sent="i8", on_air_ns="i8", overlapping="i8", retries="i8",
    fates=f"{len(Fate)}i8",
)  # fmt: skip
"""A node's parameters (up to `interval_ns`), its MAC (up to `ack_draw`), the frame that it has in the air
(`octets` to `asked_ns`) and its counters, `fates` of the frames of others.

`in_air` and `assessing` of the first nodes hold the numbers of the nodes that are in the air, and of those
that assess the channel. `known`: the row of gains holds for the node's next frame."""

RECEIVER: Final = _dtype(
    floor_mw="f8", total_mw="f8", external_mw="f8", lock="i8", lock_ns="i8", unlock_ns="i8", ready_ns="i8",
    dead_until_ns="i8", segment_ns="i8", log_right="f8", log_alone="f8", worst_sinr="f8",
)  # fmt: skip
"""What arrives at a node, and the frame that it is locked onto (number of its sender)."""

FRAME: Final = _dtype(octets="i8", to="i8", ack="b1", number="i8", tag="i8", asked_ns="i8")
"""A frame in a transmit queue."""

REQUEST: Final = _dtype(instant_ns="i8", node="i8", octets="i8", to="i8", ack="b1", tag="i8")
"""A frame that a node is going to be handed."""

SWITCH: Final = _dtype(instant_ns="i8", source="i8", row="i8")
"""An outside source goes on, with row `row` of the powers given, or off: row -1."""

AGENDA: Final = _dtype(instant_ns="i8", order="i8", turn="i8")
"""`order`: what is due << 32 | node; at one instant the smaller is first."""

EVENT: Final = _dtype(
    instant_ns="i8", kind="i8", node="i8", other="i8", octets="i8", number="i8", tag="i8", asked_ns="i8",
    power_mw="f8", sinr="f8",
)  # fmt: skip
"""`node` says it; `other` is the sender of what was heard. `number`: of the sender's frames; `tag`: as given
with the request; `sinr`: the worst during the frame, linear."""

AIR: Final = _dtype(
    seed="i8", noise_mw="f8", lock_sinr="f8", capture="f8", capture_ns="i8", penalty="f8",
    peak_cca="b1", dead_ns="i8", dead_octet_ns="i8", dead_octets="i8",
    now_ns="i8", moving="b1", due="i8", in_air="i8", assessing="i8", events="i8", next_request="i8",
    next_switch="i8", busy_since_ns="i8", busy_ns="i8",
)  # fmt: skip
"""What is not a node's: parameters of the PHY (up to `dead_octets`), and where we are."""


class MediumState(NamedTuple):
    """What happens in the air; n nodes, queues of q frames."""

    air: Record
    """One record of AIR, changed in place."""
    nodes: NDArray[np.void]
    receivers: NDArray[np.void]
    """(n,) of NODE and of RECEIVER."""
    queue: NDArray[np.void]
    """(n, q) of FRAME, a ring."""
    agenda: NDArray[np.void]
    """A binary heap of AGENDA; the first `air.due` count."""
    gains_mw: NDArray[np.float64]
    """(n, n): power of a sender's frame (row) at a node (column)."""
    fate: NDArray[np.uint8]
    """(n, n): what becomes of the frame in the air of a sender (row) at a node (column), so far."""
    events: NDArray[np.void]
    """(m,) of EVENT; the first `air.events` count."""


class Outside(NamedTuple):
    """What comes from outside; s sources that are no transceivers."""

    requests: NDArray[np.void]
    """(r,) of REQUEST, in order of time."""
    switches: NDArray[np.void]
    """(w,) of SWITCH, in order of time."""
    rows_mw: NDArray[np.float64]
    """(rows, n): powers that the switches name."""
    now_mw: NDArray[np.float64]
    """(s, n): power that each source gives now, 0 while it is off."""
