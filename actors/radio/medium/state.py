"""What the kernels of the medium work on: a record per transceiver, waiting frame and event.

All instants and durations are whole nanoseconds: a symbol of 16 µs is exact, so is a robot's µs, and
transceivers whose phases are drawn at random practically never meet at one instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.ieee802154 import PSDU_LIMIT
from actors.portable import arrays

Record = Any
"""One entry of an array of records, as kernels know it: fields by name, changed in place."""

NEVER: Final = np.iinfo(np.int64).max
BROADCAST: Final = -1
"""As destination."""
NOBODY: Final = -1
"""As number of a transceiver."""


class Outcome(IntEnum):
    """What becomes of one frame at one transceiver other than its sender's."""

    HEARD = 0
    COLLISION = 1
    """Other frames: they spoilt it, or the receiver had locked onto one of them."""
    DISTURBED = 2
    """A source that is no transceiver: Wi-Fi, a jammer."""
    HALF_DUPLEX = 3
    """The transceiver was sending at the time, or in the turnaround between sending and receiving."""
    RECEIVER_BUSY = 4
    """The robot's computer was reading an earlier frame from the transceiver, which cannot receive then."""
    BELOW_SENSITIVITY = 5
    """Too weak even on a free channel, or spoilt by noise alone."""
    POWERED_OFF = 6
    """The transceiver or the sender was switched off before the frame ended."""
    FILTERED = 7
    """Received, but meant for another transceiver."""
    WITHHELD = 8
    """It would have been received, had nobody asked for its loss (`Medium.withhold`)."""
    NOT_COUNTED = 9
    """The sender itself, or a transceiver that was off when the frame began."""


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


class MacState(IntEnum):
    """What a transceiver's MAC is at."""

    IDLE = 0
    BACKOFF = 1
    """The random delay and the assessment after it."""
    TURNAROUND = 2
    """From receiving to sending."""
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


class OfferKind(IntEnum):
    """The kind of traffic that the medium makes for a transceiver."""

    NONE = 0
    POISSON = 1
    SATURATED = 2


def _dtype(**kinds: str | np.dtype[np.void]) -> np.dtype[np.void]:
    """Integers all have 64 bits: kernels are compiled once for each kind of argument."""
    return np.dtype(list(kinds.items()), align=True)


SETTINGS: Final = _dtype(
    key="i8", min_be="i8", max_be="i8", max_backoffs="i8", max_retries="i8", cca="i8", cca_mw="f8",
    floor_mw="f8", tx_dbm="f8", capacity="i8", watched="b1",
)  # fmt: skip
"""What a transceiver is set to; `tx_dbm`, its power, alone may change. `key`: of its random numbers;
`floor_mw`: weaker frames are not received; `capacity`: of its queue; `watched`: what it hears becomes
events."""

TRAFFIC: Final = _dtype(
    kind="i8", ticket="i8", octets="i8", to="i8", ack="b1", interval_ns="f8", arrivals="i8"
)  # fmt: skip
"""What the medium makes for a transceiver to send, and how many arrivals have been drawn."""

MAC: Final = _dtype(
    powered="b1", state="i8", nb="i8", be="i8", tries="i8", ticket="i8", epoch="i8",
    head="i8", queued="i8", number="i8",
    assessed_ns="i8", energy="f8", peak="f8", carrier="b1",
    ack_to="i8", ack_number="i8", ack_draw="i8",
)  # fmt: skip
"""Where a MAC is: its MacState, its ring of waiting frames and the number of the next, what its
clear channel assessment has seen, and the acknowledgement that it owes."""

FLIGHT: Final = _dtype(
    octets="i8", to="i8", ack="b1", is_ack="b1", frame="i8", draw="i8", tag="i8", asked_ns="i8", share="i8"
)  # fmt: skip
"""The frame that a transceiver has in the air, or had last. `frame`: its number; `draw`: number and try;
`share`: see `reception.free_share`."""

COUNTERS: Final = _dtype(
    generated="i8", sent="i8", overflowed="i8", access_failures="i8", acknowledged="i8", no_ack="i8",
    cut_off="i8", discarded="i8", octets_sent="i8", on_air_ns="i8", overlapping="i8", retries="i8",
    outcomes=f"{len(Outcome)}i8",
)  # fmt: skip
"""What has become of a transceiver's frames; `outcomes`: of all frames at it, by Outcome. Those below the
sensitivity, most of them in a large swarm, are what the others leave of `medium.ended`: found when read."""

RECEIVER: Final = _dtype(
    total_mw="f8", arriving="i8", external_mw="f8", lock="i8", lock_ns="i8", unlock_ns="i8", ready_ns="i8",
    dead_until_ns="i8", segment_ns="i8", log_right="f8", log_alone="f8", worst_sinr="f8",
)  # fmt: skip
"""What arrives at a transceiver, of how many frames, and the one that it is locked onto (number of its
sender)."""

TRANSCEIVER: Final = _dtype(
    settings=SETTINGS, traffic=TRAFFIC, mac=MAC, receiver=RECEIVER, flight=FLIGHT, counters=COUNTERS,
    row="i8", reached="i8",
)  # fmt: skip
"""One record, not an array for each part: every array that kernels pass on to one another costs time.
`row`: the share for which its row of gains was computed, 0: it does not hold for the next frame; `reached`:
how many that row reaches."""

ROSTER: Final = _dtype(in_air="i8", assessing="i8", off="i8")
"""Three lists side by side: who has a frame in the air, who assesses the channel, and who has no power, by
number."""

FRAME: Final = _dtype(octets="i8", to="i8", ack="b1", number="i8", tag="i8", asked_ns="i8")
"""A frame in a transmit queue."""

REQUEST: Final = _dtype(instant_ns="i8", transceiver="i8", octets="i8", to="i8", ack="b1", tag="i8")
"""A frame that a transceiver is going to be handed."""

SWITCH: Final = _dtype(instant_ns="i8", source="i8", row="i8")
"""An outside source goes on, with row `row` of the powers given, or off: row -1."""

AGENDA: Final = _dtype(instant_ns="i8", order="i8", ticket="i8")
"""`order`: what is due << 32 | transceiver; at one instant the smaller is first. An entry has been called off
if its `ticket` is no longer that of the MAC, or of the traffic, or the epoch."""

EVENT: Final = _dtype(
    instant_ns="i8", kind="i8", transceiver="i8", other="i8", octets="i8", number="i8", tag="i8",
    asked_ns="i8", power_mw="f8", sinr="f8",
)  # fmt: skip
"""`transceiver` says it; `other` is the sender of what was heard. `number`: of the sender's frames; `tag`: as
given with the request; `sinr`: the worst during the frame, linear."""

MEDIUM: Final = _dtype(
    seed="i8", noise_mw="f8", lock_sinr="f8", capture="f8", capture_ns="i8", penalty="f8",
    peak_cca="b1", dead_ns="i8", dead_octet_ns="i8", dead_octets="i8", faintest_dbm="f8",
    now_ns="i8", moving="b1", due="i8", in_air="i8", assessing="i8", off="i8", events="i8",
    next_request="i8", next_switch="i8", busy_since_ns="i8", busy_ns="i8", ended="i8",
    share="i8", sender="i8", most_db="f8", pauses="b1", sent_by="i8",
)  # fmt: skip
"""What is no single transceiver's: parameters of the PHY (up to `dead_octets`), how weak all that is left
out of the air may be together (`faintest_dbm`), and where we are. `ended`: frames, without acknowledgements.
Of the frame that begins next: its `share` of what may be left out, see `reception.free_share`, its `sender`,
and the loss from which on it is left out, `most_db`. `pauses`: kernels return after each frame that has been
sent; `sent_by`: the sender of the last one since they were called, or NOBODY."""


class MediumState(NamedTuple):
    """What happens on the medium; n transceivers, queues of q frames."""

    medium: Record
    """One record of MEDIUM, changed in place."""
    transceivers: NDArray[np.void]
    """(n,) of TRANSCEIVER."""
    queue: NDArray[np.void]
    """(n, q) of FRAME, a ring."""
    agenda: NDArray[np.void]
    """A binary heap of AGENDA; the first `medium.due` count."""
    rosters: NDArray[np.void]
    """(n,) of ROSTER; the first `medium.in_air`, `medium.assessing` and `medium.off` count."""
    gains_mw: NDArray[np.float64]
    """(n, n): power of a sender's frame (row) at a receiver (column); 0: it does not get there."""
    reached: NDArray[np.int64]
    """(n, n): those whom a sender's frame (row) gets to, by number, upward; the first `reached` count."""
    outcomes: NDArray[np.uint8]
    """(n, n): what becomes of the frame in the air of a sender (row) at a receiver (column), so far."""
    withheld: NDArray[np.int64]
    """(n, n): how many frames of a sender (row) a receiver (column) is still not to receive."""
    events: NDArray[np.void]
    """(m,) of EVENT; the first `medium.events` count."""


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


@dataclass(frozen=True)
class PhyParameters:
    """How every receiver of a medium decodes; the defaults are a fair model of a 2.4 GHz O-QPSK receiver."""

    noise_dbm: float = -98.0
    """Thermal noise with the receiver's noise figure, in its 2 MHz, dBm. Default: the bit error rate's
    formula then gives 1 % of lost frames of 20 octets at -97.4 dBm."""
    lock_sinr_db: float = -5.0
    """A receiver locks onto a frame only above this ratio, dB. Default: as ns-3 has it; below, one bit in ten
    is wrong (IEEE 802.15.4-2006, Figure E.2)."""
    cochannel_penalty_db: float = 3.0
    """How much worse another 802.15.4 frame disturbs than white noise of its power, dB. Default: CC2420 data
    sheet, co-channel rejection -3 dB; 0 treats it as noise, which is what ns-3 and INET do."""
    capture_db: float = 3.0
    """How much stronger a later frame must be for the receiver to drop the one it is locked onto, dB.
    Default: Cooja's MRM channel model."""
    capture_us: int = 128
    """How long after the lock that may happen, µs; 0 = never. Default: the preamble, 8 symbols."""
    peak_cca: bool = False
    """False: the energy that counts for clear channel assessment is the mean over all of its 8 symbols, and a
    carrier at any time in them. True: as in ns-3, the level at the end and wherever a frame begins meanwhile;
    what ends before is missed."""
    dead_us: int = 0
    """After each frame that a receiver gives to its computer it receives nothing for so long, µs, while its
    buffer is read."""
    dead_octet_us: int = 0
    """… and for so much longer per octet of the frame, µs."""
    dead_octets: int = PSDU_LIMIT
    """… of at most so many octets."""


@dataclass(frozen=True)
class Transceiver:
    """The settings of one transceiver; the defaults are the standard's, with the MRF24J40's sensitivity."""

    address: int
    """Short address; it keys all random numbers of this transceiver, so it must be its own."""
    tx_power_dbm: float = 0.0
    sensitivity_dbm: float = -95.0
    """No frame that arrives weaker is received, dBm. Default: typical for the MRF24J40 (Microchip
    DS39776C)."""
    cca: Cca = Cca.ENERGY
    """Default: mode 1 of the standard."""
    cca_threshold_dbm: float = -85.0
    """Energy from which the channel counts as busy, dBm. Default: 10 dB above the sensitivity, the most that
    the standard allows (6.9.9)."""
    min_be: int = 3
    max_be: int = 5
    max_backoffs: int = 4
    max_retries: int = 3
    """macMinBE, macMaxBE, macMaxCSMABackoffs, macMaxFrameRetries (7.4.2)."""
    queue: int = 8
    """Frames that the transmit queue holds, with the one that is being sent."""

    def numbered(self, address: int) -> "Transceiver":
        """The same settings with another address."""
        return replace(self, address=address)


_DUE_EACH = 8
"""One thing of the MAC, an acknowledgement, an arrival, and what has been called off but not yet come up."""
_EVENTS = 4096
_LEFT_OUT_DB: Final = -26.38
"""So far below noise a power is that raises it by 0.01 dB: 10 log10(10^0.001 - 1)."""


def milliwatts(dbm: Any) -> Any:
    """Power in mW; any shape."""
    return arrays.exp10(np.asarray(dbm, dtype=np.float64) / 10.0)


def initial_state(
    transceivers: Sequence[Transceiver], phy: PhyParameters, seed: int, *, pauses: bool = False
) -> MediumState:
    """All transceivers on, silent and listening; `pauses`: as in MEDIUM."""
    n = len(transceivers)
    records = np.zeros(n, TRANSCEIVER)
    records["settings"] = _settings(transceivers, phy)
    records["mac"]["powered"] = True
    records["receiver"]["lock"] = NOBODY
    records["receiver"]["unlock_ns"] = -NEVER
    medium = _medium(transceivers, phy, seed)
    medium["pauses"] = pauses
    return MediumState(
        medium=medium[0],
        transceivers=records,
        queue=np.zeros((n, max((t.queue for t in transceivers), default=1)), FRAME),
        agenda=np.zeros(_DUE_EACH * n + 1, AGENDA),
        rosters=np.zeros(n, ROSTER),
        gains_mw=np.zeros((n, n)),
        reached=np.zeros((n, n), np.int64),
        outcomes=np.zeros((n, n), np.uint8),
        withheld=np.zeros((n, n), np.int64),
        events=np.zeros(max(_EVENTS, 4 * n), EVENT),
    )


def _medium(transceivers: Sequence[Transceiver], phy: PhyParameters, seed: int) -> NDArray[np.void]:
    medium = np.zeros(1, MEDIUM)
    medium["seed"] = seed
    medium["noise_mw"] = milliwatts(phy.noise_dbm)
    medium["lock_sinr"] = milliwatts(phy.lock_sinr_db)
    medium["capture"] = milliwatts(phy.capture_db)
    medium["capture_ns"] = phy.capture_us * 1000
    medium["penalty"] = milliwatts(phy.cochannel_penalty_db)
    medium["peak_cca"] = phy.peak_cca
    medium["dead_ns"], medium["dead_octet_ns"] = phy.dead_us * 1000, phy.dead_octet_us * 1000
    medium["dead_octets"] = phy.dead_octets
    # What is left out of a receiver's sum adds 0.01 dB to the noise or to the least energy of a busy channel,
    # and no receiver locks onto it.
    least_dbm = min([phy.noise_dbm, *(one.cca_threshold_dbm for one in transceivers)])
    together_dbm = least_dbm + _LEFT_OUT_DB - max(phy.cochannel_penalty_db, 0.0)
    medium["faintest_dbm"] = min(together_dbm, phy.noise_dbm + phy.lock_sinr_db)
    return medium


def _settings(transceivers: Sequence[Transceiver], phy: PhyParameters) -> NDArray[np.void]:
    settings = np.zeros(len(transceivers), SETTINGS)
    settings["key"] = [t.address for t in transceivers]
    for name in ("min_be", "max_be", "max_backoffs", "max_retries", "cca"):
        settings[name] = [getattr(t, name) for t in transceivers]
    settings["cca_mw"] = milliwatts([t.cca_threshold_dbm for t in transceivers])
    settings["tx_dbm"] = [t.tx_power_dbm for t in transceivers]
    settings["capacity"] = [t.queue for t in transceivers]
    faintest = milliwatts(phy.lock_sinr_db + phy.noise_dbm)
    settings["floor_mw"] = np.maximum(milliwatts([t.sensitivity_dbm for t in transceivers]), faintest)
    settings["watched"] = True
    return settings
