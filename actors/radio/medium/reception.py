"""Kernels of the PHY: what a receiver makes of the frames that begin and end around it.

Interference is exact: whenever a frame or an outside source begins or ends, every receiver that is locked
onto a frame closes a segment of constant SINR; what ends before the frame does counts while it lasted.
"""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.portable.compiled import exp
from actors.radio.medium.draws import ACK_RECEPTION, RECEPTION, drawn
from actors.radio.medium.error_rate import CLEAN, HEADER_OCTETS, log_right
from actors.radio.medium.state import NOBODY, Fate, MediumState, Record

_BITS_PER_NS: Final = 250e-6
_HEARD: Final = int(Fate.HEARD)
_COLLISION: Final = int(Fate.COLLISION)
_DISTURBED: Final = int(Fate.DISTURBED)
_HALF_DUPLEX: Final = int(Fate.HALF_DUPLEX)
_RECEIVER_BUSY: Final = int(Fate.RECEIVER_BUSY)
_BELOW: Final = int(Fate.BELOW_SENSITIVITY)
_NOT_COUNTED: Final = int(Fate.NOT_COUNTED)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _close(air: Record, receiver: Record, signal: float) -> None:
    """Close the receiver's segment: the chance that all bits so far are right."""
    lasted = air.now_ns - receiver.segment_ns
    receiver.segment_ns = air.now_ns
    if lasted == 0:
        return
    quiet = air.noise_mw + receiver.external_mw
    sinr = signal / (quiet + air.penalty * max(receiver.total_mw - signal, 0.0))
    receiver.worst_sinr = min(receiver.worst_sinr, sinr)
    if sinr < CLEAN:
        receiver.log_right += lasted * _BITS_PER_NS * log_right(sinr)
        receiver.log_alone += lasted * _BITS_PER_NS * log_right(signal / quiet)


@njit(cache=True)  # type: ignore[untyped-decorator]
def settle(st: MediumState) -> None:
    """Close all segments and let those who assess the channel sense what was on it until now."""
    air, receivers, gains_mw = st.air, st.receivers, st.gains_mw
    for i in range(receivers.size):
        receiver = receivers[i]
        if receiver.lock >= 0:
            _close(air, receiver, gains_mw[receiver.lock, i])
    for k in range(air.assessing):
        sense(air, st.nodes[st.nodes[k].assessing], st.receivers[st.nodes[k].assessing])


@njit(cache=True)  # type: ignore[untyped-decorator]
def sense(air: Record, node: Record, receiver: Record) -> None:
    """Add up the energy at a node until now."""
    level = receiver.total_mw + receiver.external_mw
    node.energy += level * (air.now_ns - node.assessed_ns)
    node.assessed_ns = air.now_ns


@njit(cache=True)  # type: ignore[untyped-decorator]
def note_peaks(st: MediumState) -> None:
    """Let those who assess the channel see what is on it since now."""
    for k in range(st.air.assessing):
        node, receiver = st.nodes[st.nodes[k].assessing], st.receivers[st.nodes[k].assessing]
        node.peak = max(node.peak, receiver.total_mw + receiver.external_mw)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _lock(air: Record, receiver: Record, sender: int) -> None:
    receiver.lock = sender
    receiver.lock_ns = receiver.segment_ns = air.now_ns
    receiver.log_right = receiver.log_alone = 0.0
    receiver.worst_sinr = np.inf


@njit(cache=True)  # type: ignore[untyped-decorator]
def let_go(st: MediumState, number: int, fate: int) -> None:
    """A node gives up the frame that it is locked onto, if any; that is what becomes of the frame here."""
    receiver = st.receivers[number]
    if receiver.lock >= 0:
        st.fate[receiver.lock, number] = fate
        receiver.lock = NOBODY
        receiver.unlock_ns = st.air.now_ns


@njit(cache=True)  # type: ignore[untyped-decorator]
def _meet(air: Record, receiver: Record, sender: int, power: float, locked_mw: float) -> int:
    """What a receiver makes of a frame that begins; its segment is closed, the frame not yet in its total.

    `locked_mw`: power of the frame that it is locked onto, and lets go of if it locks onto this one.
    """
    if power < receiver.floor_mw:
        return _BELOW
    if receiver.ready_ns > air.now_ns or receiver.dead_until_ns > air.now_ns:
        return _HALF_DUPLEX if receiver.ready_ns > air.now_ns else _RECEIVER_BUSY
    quiet = air.noise_mw + receiver.external_mw
    clear = power > air.lock_sinr * (quiet + air.penalty * receiver.total_mw)
    if receiver.lock < 0:
        if clear:
            _lock(air, receiver, sender)
            return _HEARD
        return _COLLISION if power > air.lock_sinr * quiet else _DISTURBED
    early = air.now_ns - receiver.lock_ns < air.capture_ns
    if not (early and clear and power >= air.capture * locked_mw):
        return _COLLISION
    _lock(air, receiver, sender)
    return _HEARD


@njit(cache=True)  # type: ignore[untyped-decorator]
def begin(st: MediumState, sender: int) -> None:
    """The sender's frame begins, as its flight and its row of gains describe it."""
    air = st.air
    settle(st)
    nodes, receivers, gains_mw, fate = st.nodes, st.receivers, st.gains_mw, st.fate
    for i in range(receivers.size):
        receiver, power = receivers[i], gains_mw[sender, i]
        if i == sender or not nodes[i].powered:
            fate[sender, i] = _NOT_COUNTED
        else:
            locked = receiver.lock
            locked_mw = gains_mw[locked, i] if locked >= 0 else 0.0
            fate[sender, i] = _meet(air, receiver, sender, power, locked_mw)
            if locked >= 0 and receiver.lock == sender:
                fate[locked, i] = _COLLISION
        if i != sender:
            receiver.total_mw += power
    note_peaks(st)
    if air.in_air == 0:
        air.busy_since_ns = air.now_ns
    st.nodes[air.in_air].in_air = sender
    air.in_air += 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def leave(st: MediumState, sender: int) -> None:
    """The sender's frame leaves the air; who is locked onto it stays so for now."""
    air, receivers, gains_mw = st.air, st.receivers, st.gains_mw
    settle(st)
    place = 0
    while st.nodes[place].in_air != sender:
        place += 1
    air.in_air -= 1
    st.nodes[place].in_air = st.nodes[air.in_air].in_air
    if air.in_air == 0:
        air.busy_ns += air.now_ns - air.busy_since_ns
        for i in range(receivers.size):
            receivers[i].total_mw = 0.0  # exactly, not but for what sums and differences leave
        return
    for i in range(receivers.size):
        if i != sender:
            receivers[i].total_mw -= gains_mw[sender, i]


@njit(cache=True)  # type: ignore[untyped-decorator]
def judge(st: MediumState, sender: int) -> None:
    """The sender's frame has ended whole: decide at every receiver that is locked onto it."""
    air, nodes, receivers = st.air, st.nodes, st.receivers
    flight = nodes[sender]
    purpose = ACK_RECEPTION if flight.is_ack else RECEPTION
    origin = flight.to if flight.is_ack else sender
    for i in range(receivers.size):
        receiver = receivers[i]
        if receiver.lock != sender:
            continue
        receiver.lock = NOBODY
        receiver.unlock_ns = air.now_ns
        if receiver.log_right < 0.0:
            luck = drawn(air.seed, purpose, nodes[origin].key, flight.draw, nodes[i].key)
            if luck >= exp(receiver.log_right):
                st.fate[sender, i] = _cause(air, receiver, st.gains_mw[sender, i], flight.octets, luck)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _cause(air: Record, receiver: Record, power: float, octets: int, luck: float) -> int:
    """Why a frame was spoilt: what would have become of it, with the same luck, with less around it."""
    bits = 8 * (octets + HEADER_OCTETS)
    if luck >= exp(bits * log_right(power / air.noise_mw)):
        return _BELOW
    return _DISTURBED if luck >= exp(receiver.log_alone) else _COLLISION


@njit(cache=True)  # type: ignore[untyped-decorator]
def change_outside(st: MediumState, now_mw: NDArray[np.float64]) -> None:
    """The outside sources (rows) give these powers at the nodes (columns) from now on."""
    settle(st)
    for i in range(st.receivers.size):
        total = 0.0
        for source in range(now_mw.shape[0]):
            total += now_mw[source, i]
        st.receivers[i].external_mw = total
    note_peaks(st)
