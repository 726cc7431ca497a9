"""PHY kernels: reception of frames under noise and interference.

Interference is exact: whenever a frame or an outside source begins or ends, every receiver that is locked
onto a frame closes a segment of constant SINR; interference counts while it lasts.

Bit errors are those of the 2.4 GHz O-QPSK PHY in white noise: `BER = 8/15 · 1/16 · Σ_{k=2}^{16} (−1)^k C(16,
k) exp(20 SINR (1/k − 1))` (IEEE 802.15.4-2006, E.4.1.8), as in ns-3 and INET. As there, the 6 octets of
preamble, delimiter and length count like data.

Random numbers are functions of their key, without stream, order or state: the output function of SplitMix64
(Steele, Lea & Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014; variant 13 of D.
Stafford's mixers) is applied along the key. Further transceivers or steps do not change other draws.
"""

from math import comb
from pathlib import Path
from typing import Final

import numpy as np

from actors.array_types import Floats
from actors.ieee802154 import PHY_HEADER_OCTETS
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import exp
from actors.radio.medium.state import NO_TRANSCEIVER, MediumState, Outcome, Record

BACKOFF: Final = 1
"""Key: transceiver, frame, try."""
RECEPTION: Final = 2
"""Key: sender, frame, receiver."""
ACK_RECEPTION: Final = 3
"""Key: sender of the acknowledged frame, that frame, receiver."""
ARRIVAL: Final = 4
"""Key: transceiver, number of the arrival."""

_GAMMA: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)


@kernel
def _mixed(state: np.uint64, word: int) -> np.uint64:
    z = (state ^ np.uint64(word)) + _GAMMA
    z = (z ^ (z >> _S30)) * _FIRST
    z = (z ^ (z >> _S27)) * _SECOND
    return z ^ (z >> _S31)


@kernel
def keyed_uniform(seed: int, purpose: int, transceiver: int, frame: int, other: int) -> float:
    """Return the uniform number in [0, 1) of this key; integers of up to 63 bits."""
    state = _mixed(np.uint64(purpose), seed)
    state = _mixed(_mixed(_mixed(state, transceiver), frame), other)
    return np.float64(state >> _S11) * 1.1102230246251565e-16


CLEAN: Final = 4.5
"""SINR, linear, above which no bit is lost: below 1e-19 per bit."""
_STEPS: Final = 4096
"""Table entries per unit of SINR; linear interpolation then has a relative error of 1e-6."""


def bit_error_rate(sinr: Floats) -> Floats:
    """Return the probability of a bit error at signal to interference and noise ratios, linear; same
    shape."""
    k = np.arange(2, 17, dtype=np.float64)
    weights = np.array([(-comb(16, i) if i % 2 else comb(16, i)) for i in range(2, 17)], dtype=np.float64)
    terms = weights * arrays.exp(20.0 * np.asarray(sinr)[..., None] * (1.0 / k - 1.0))
    return np.clip(8.0 / 15.0 / 16.0 * arrays.total(terms), 0.0, 0.5)


def frame_error_rate(snr_db: Floats, octets: int) -> Floats:
    """Return the probability that a frame of `octets` of PSDU is lost at a constant ratio, dB; same shape."""
    bits = 8 * (octets + PHY_HEADER_OCTETS)
    log_right = arrays.log1p(-bit_error_rate(arrays.exp10(np.asarray(snr_db) / 10.0)))
    return -arrays.expm1(bits * log_right)


_LOG_RIGHT: Final[Floats] = np.load(Path(__file__).with_name("log_right.npy"))
"""log(1 - bit_error_rate(k / _STEPS)), up to CLEAN; a test computes it."""
_LOG_RIGHT.setflags(write=False)


@kernel
def log_right(sinr: float) -> float:
    """Return the logarithm of the probability that a bit is correct, in kernels; `sinr` ≥ 0, linear."""
    if sinr >= CLEAN:
        return 0.0
    place = sinr * _STEPS
    left = int(place)
    low = _LOG_RIGHT[left]
    between: float = low + (place - left) * (_LOG_RIGHT[left + 1] - low)
    return between


_BITS_PER_NS: Final = 250e-6
_HEARD: Final = int(Outcome.HEARD)
_COLLISION: Final = int(Outcome.COLLISION)
_DISTURBED: Final = int(Outcome.DISTURBED)
_HALF_DUPLEX: Final = int(Outcome.HALF_DUPLEX)
_RECEIVER_BUSY: Final = int(Outcome.RECEIVER_BUSY)
_BELOW: Final = int(Outcome.BELOW_SENSITIVITY)
_NOT_COUNTED: Final = int(Outcome.NOT_COUNTED)
_WITHHELD: Final = int(Outcome.WITHHELD)


@kernel
def _close_segment(medium: Record, receiver: Record, signal: float) -> None:
    """Close the receiver's segment: update the probability that all bits so far are correct."""
    lasted = medium.now_ns - receiver.segment_ns
    receiver.segment_ns = medium.now_ns
    if lasted == 0:
        return
    quiet = medium.noise_mw + receiver.external_mw
    sinr = signal / (quiet + medium.penalty * max(receiver.total_mw - signal, 0.0))
    receiver.worst_sinr = min(receiver.worst_sinr, sinr)
    if sinr < CLEAN:
        receiver.log_right += lasted * _BITS_PER_NS * log_right(sinr)
        receiver.log_alone += lasted * _BITS_PER_NS * log_right(signal / quiet)


@kernel
def settle(st: MediumState) -> None:
    """Close all segments, and add up the energy for channel assessments in progress."""
    medium, transceivers = st.medium, st.transceivers
    for k in range(medium.in_air):
        sender = st.rosters[k].in_air
        for i in st.reached[sender, : transceivers[sender].reached]:
            if transceivers[i].receiver.lock == sender:
                _close_segment(medium, transceivers[i].receiver, st.gains_mw[sender, i])
    for k in range(medium.assessing):
        add_energy(medium, transceivers[st.rosters[k].assessing])


@kernel
def add_energy(medium: Record, transceiver: Record) -> None:
    """Add up the energy at a transceiver until now."""
    mac, receiver = transceiver.mac, transceiver.receiver
    level = receiver.total_mw + receiver.external_mw
    mac.energy += level * (medium.now_ns - mac.assessed_ns)
    mac.assessed_ns = medium.now_ns


@kernel
def update_peaks(st: MediumState) -> None:
    """Update the peak power of channel assessments in progress."""
    for k in range(st.medium.assessing):
        transceiver = st.transceivers[st.rosters[k].assessing]
        mac, receiver = transceiver.mac, transceiver.receiver
        mac.peak = max(mac.peak, receiver.total_mw + receiver.external_mw)


@kernel
def _lock(medium: Record, receiver: Record, sender: int) -> None:
    receiver.lock = sender
    receiver.lock_ns = receiver.segment_ns = medium.now_ns
    receiver.log_right = receiver.log_alone = 0.0
    receiver.worst_sinr = np.inf


@kernel
def abort_reception(st: MediumState, number: int, outcome: int) -> None:
    """Abort a transceiver's reception, if any, with this outcome."""
    receiver = st.transceivers[number].receiver
    if receiver.lock >= 0:
        st.outcomes[receiver.lock, number] = outcome
        receiver.lock = NO_TRANSCEIVER
        receiver.unlock_ns = st.medium.now_ns


@kernel
def _outcome_at_begin(
    medium: Record, transceiver: Record, sender: int, power: float, locked_mw: float
) -> int:
    """Return a transceiver's outcome of a beginning frame; its segment is closed, its total without the
    frame.

    `locked_mw`: power of the frame that it is locked onto, and leaves if it locks onto this one.
    """
    receiver = transceiver.receiver
    if power < transceiver.settings.floor_mw:
        return _BELOW
    if receiver.ready_ns > medium.now_ns or receiver.dead_until_ns > medium.now_ns:
        return _HALF_DUPLEX if receiver.ready_ns > medium.now_ns else _RECEIVER_BUSY
    quiet = medium.noise_mw + receiver.external_mw
    clear = power > medium.lock_sinr * (quiet + medium.penalty * receiver.total_mw)
    if receiver.lock < 0:
        if clear:
            _lock(medium, receiver, sender)
            return _HEARD
        return _COLLISION if power > medium.lock_sinr * quiet else _DISTURBED
    early = medium.now_ns - receiver.lock_ns < medium.capture_ns
    if not (early and clear and power >= medium.capture * locked_mw):
        return _COLLISION
    _lock(medium, receiver, sender)
    return _HEARD


@kernel
def free_share(st: MediumState) -> int:
    """Return the first share, from 1, that no frame in the air has; the next may omit 2 ** -share.

    So all frames in the air together omit less than the whole.
    """
    share, place = 1, 0
    while place < st.medium.in_air:
        place += 1
        if st.transceivers[st.rosters[place - 1].in_air].flight.share == share:
            share, place = share + 1, 0
    return share


@kernel
def begin(st: MediumState, sender: int) -> None:
    """Begin the sender's frame, described by its flight and its row of gains."""
    medium = st.medium
    settle(st)
    st.transceivers[sender].flight.share = medium.share
    transceivers, gains_mw, outcomes = st.transceivers, st.gains_mw, st.outcomes
    outcomes[sender, :] = _BELOW
    outcomes[sender, sender] = _NOT_COUNTED
    for k in range(medium.off):
        outcomes[sender, st.rosters[k].off] = _NOT_COUNTED
    for i in st.reached[sender, : transceivers[sender].reached]:
        receiver, power = transceivers[i].receiver, gains_mw[sender, i]
        if transceivers[i].mac.powered:
            locked = receiver.lock
            locked_mw = gains_mw[locked, i] if locked >= 0 else 0.0
            outcomes[sender, i] = _outcome_at_begin(medium, transceivers[i], sender, power, locked_mw)
            if locked >= 0 and receiver.lock == sender:
                outcomes[locked, i] = _COLLISION
        receiver.total_mw += power
        receiver.arriving += 1
    update_peaks(st)
    if medium.in_air == 0:
        medium.busy_since_ns = medium.now_ns
    st.rosters[medium.in_air].in_air = sender
    medium.in_air += 1


@kernel
def end_signal(st: MediumState, sender: int) -> None:
    """Remove the sender's frame from the air; receivers stay locked onto it."""
    medium, transceivers, gains_mw = st.medium, st.transceivers, st.gains_mw
    settle(st)
    place = 0
    while st.rosters[place].in_air != sender:
        place += 1
    medium.in_air -= 1
    st.rosters[place].in_air = st.rosters[medium.in_air].in_air
    if medium.in_air == 0:
        medium.busy_ns += medium.now_ns - medium.busy_since_ns
    for i in st.reached[sender, : transceivers[sender].reached]:
        receiver = transceivers[i].receiver
        receiver.arriving -= 1
        left_mw = receiver.total_mw - gains_mw[sender, i]
        receiver.total_mw = left_mw if receiver.arriving > 0 else 0.0  # without rounding errors


@kernel
def decide_reception(st: MediumState, sender: int) -> None:
    """Decide the reception of a complete frame at all receivers locked onto it."""
    medium, transceivers = st.medium, st.transceivers
    flight = transceivers[sender].flight
    purpose = ACK_RECEPTION if flight.is_ack else RECEPTION
    key = transceivers[flight.to if flight.is_ack else sender].settings.key
    for i in st.reached[sender, : transceivers[sender].reached]:
        receiver = transceivers[i].receiver
        if receiver.lock != sender:
            continue
        receiver.lock = NO_TRANSCEIVER
        receiver.unlock_ns = medium.now_ns
        if receiver.log_right < 0.0:
            chance = keyed_uniform(medium.seed, purpose, key, flight.draw, transceivers[i].settings.key)
            if chance >= exp(receiver.log_right):
                st.outcomes[sender, i] = _loss_cause(
                    medium, receiver, st.gains_mw[sender, i], flight.octets, chance
                )
                continue
        if not flight.is_ack and st.withheld[sender, i] > 0:
            st.withheld[sender, i] -= 1
            st.outcomes[sender, i] = _WITHHELD


@kernel
def count(st: MediumState, sender: int) -> None:
    """Count the outcomes of the sender's frame (not acknowledgement) at all transceivers."""
    st.medium.ended += 1
    for i in range(st.transceivers.size):
        if st.outcomes[sender, i] != _BELOW:
            st.transceivers[i].counters.outcomes[st.outcomes[sender, i]] += 1


@kernel
def _loss_cause(medium: Record, receiver: Record, power: float, octets: int, chance: float) -> int:
    """Return the cause of a loss: the outcome with the same random number and less interference."""
    bits = 8 * (octets + PHY_HEADER_OCTETS)
    if chance >= exp(bits * log_right(power / medium.noise_mw)):
        return _BELOW
    return _DISTURBED if chance >= exp(receiver.log_alone) else _COLLISION


@kernel
def set_external_power(st: MediumState, now_mw: Floats) -> None:
    """Set the powers of outside sources (rows) at the receivers (columns) from now on."""
    settle(st)
    for i in range(st.transceivers.size):
        total = 0.0
        for source in range(now_mw.shape[0]):
            total += now_mw[source, i]
        st.transceivers[i].receiver.external_mw = total
    update_peaks(st)
