"""Kernels of the MAC: unslotted CSMA/CA, the transmit queue, acknowledgements.

Sections are those of IEEE 802.15.4-2006; the algorithm is that of 7.5.1.4, Figure 69.
"""

import math
from typing import Final

from numba import njit

from actors.portable.compiled import log
from actors.radio.medium.agenda import push
from actors.radio.medium.draws import ARRIVAL, BACKOFF, drawn
from actors.radio.medium.reception import begin, judge, leave, let_go, sense
from actors.radio.medium.state import (
    BROADCAST,
    NEVER,
    NOBODY,
    SYMBOL_NS,
    Cca,
    Due,
    Fate,
    Kind,
    Mac,
    MediumState,
    Offer,
)

UNIT_BACKOFF_NS: Final = 20 * SYMBOL_NS
"""aUnitBackoffPeriod (7.4.1)."""
CCA_NS: Final = 8 * SYMBOL_NS
"""6.9.9."""
TURNAROUND_NS: Final = 12 * SYMBOL_NS
"""aTurnaroundTime (6.4.1)."""
SHORT_SPACING_NS: Final = 12 * SYMBOL_NS
LONG_SPACING_NS: Final = 40 * SYMBOL_NS
"""aMinSIFSPeriod and aMinLIFSPeriod (7.5.1.3)."""
LONGEST_SHORT: Final = 18
"""aMaxSIFSFrameSize, octets (7.4.1)."""
ACK_OCTETS: Final = 5
ACK_WAIT_NS: Final = 54 * SYMBOL_NS
"""macAckWaitDuration: a unit back-off, a turnaround, the header and six octets (7.4.2)."""
HEADER_SYMBOLS: Final = 12
"""Preamble 8, start-of-frame delimiter 2, length 2 (6.3)."""

_KINDS: Final = 1 << 32


@njit(cache=True)  # type: ignore[untyped-decorator]
def airtime_ns(octets: int) -> int:
    """Time in the air of a frame of so many PSDU octets."""
    return (HEADER_SYMBOLS + 2 * octets) * SYMBOL_NS


@njit(cache=True)  # type: ignore[untyped-decorator]
def schedule(st: MediumState, number: int, due: int, after: int, turn: int) -> None:
    """Put what is due at a node, so long after now, on the agenda."""
    air = st.air
    air.due = push(st.agenda, air.due, air.now_ns + after, due * _KINDS + number, turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def say(
    st: MediumState, kind: int, number: int, other: int, octets: int, frame: int, tag: int, asked: int
) -> None:
    """Write an event down; power and SINR are nothing."""
    air = st.air
    event = st.events[air.events]
    air.events += 1
    event.instant_ns = air.now_ns
    event.kind = kind
    event.node = number
    event.other = other
    event.octets = octets
    event.number = frame
    event.tag = tag
    event.asked_ns = asked
    event.power_mw = 0.0
    event.sinr = 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def hand_over(st: MediumState, number: int, octets: int, to: int, ack: bool, tag: int) -> None:
    """A node's transceiver is handed a frame now."""
    node = st.nodes[number]
    node.generated += 1
    if not node.powered:
        node.discarded += 1
        return
    frame = node.number
    node.number += 1
    capacity = st.queue.shape[1]
    if node.queued >= node.capacity:
        node.overflowed += 1
        say(st, Kind.OVERFLOW.value, number, NOBODY, octets, frame, tag, st.air.now_ns)
        return
    slot = st.queue[number, (node.head + node.queued) % capacity]
    slot.octets = octets
    slot.to = to
    slot.ack = ack and to != BROADCAST
    slot.number = frame
    slot.tag = tag
    slot.asked_ns = st.air.now_ns
    node.queued += 1
    if node.mac == Mac.IDLE.value:
        access(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def access(st: MediumState, number: int) -> None:
    """Begin CSMA/CA for the frame at the head of the queue."""
    node = st.nodes[number]
    node.mac = Mac.BACKOFF.value
    node.nb = 0
    node.be = node.min_be
    _back_off(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _back_off(st: MediumState, number: int) -> None:
    node = st.nodes[number]
    luck = drawn(
        st.air.seed, BACKOFF, node.key, st.queue[number, node.head].number, node.tries * 16 + node.nb
    )
    periods = int(luck * (1 << node.be))
    schedule(st, number, Due.CCA_BEGIN.value, periods * UNIT_BACKOFF_NS, node.turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def assess(st: MediumState, number: int) -> None:
    """The back-off is over: the clear channel assessment begins."""
    air, node, receiver = st.air, st.nodes[number], st.receivers[number]
    if node.cca == Cca.NEVER.value:
        _turn(st, number)
        return
    node.assessed_ns = air.now_ns
    node.peak = 0.0
    node.carrier = receiver.lock >= 0
    # While it sends an acknowledgement, or turns for one, the channel is not clear.
    node.energy = math.inf if receiver.ready_ns > air.now_ns else 0.0
    st.nodes[air.assessing].assessing = number
    air.assessing += 1
    schedule(st, number, Due.CCA_END.value, CCA_NS, node.turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def forget_assessment(st: MediumState, number: int) -> None:
    """Take a node from those who assess the channel, if it is one."""
    air = st.air
    for place in range(air.assessing):
        if st.nodes[place].assessing == number:
            air.assessing -= 1
            st.nodes[place].assessing = st.nodes[air.assessing].assessing
            return


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_clear(st: MediumState, number: int) -> bool:
    air, node, receiver = st.air, st.nodes[number], st.receivers[number]
    if node.energy == math.inf or receiver.ready_ns > air.now_ns:
        return False
    energy = node.energy / CCA_NS
    carrier = receiver.lock >= 0 or node.carrier or receiver.unlock_ns > air.now_ns - CCA_NS
    if air.peak_cca:
        energy = max(node.peak, receiver.total_mw + receiver.external_mw)
        carrier = receiver.lock >= 0
    loud = energy >= node.cca_mw
    if node.cca == Cca.ENERGY.value:
        return not loud
    if node.cca == Cca.CARRIER.value:
        return not carrier
    if node.cca == Cca.EITHER.value:
        return not (loud or carrier)
    return not (loud and carrier)


@njit(cache=True)  # type: ignore[untyped-decorator]
def assessed(st: MediumState, number: int) -> None:
    """The clear channel assessment is over."""
    node = st.nodes[number]
    sense(st.air, node, st.receivers[number])
    forget_assessment(st, number)
    if _is_clear(st, number):
        _turn(st, number)
        return
    node.nb += 1
    node.be = min(node.be + 1, node.max_be)
    if node.nb <= node.max_backoffs:
        _back_off(st, number)
        return
    node.access_failures += 1
    node.mac = Mac.IDLE.value
    _finish(st, number, Kind.ACCESS_FAILURE.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _turn(st: MediumState, number: int) -> None:
    """Turn to sending; a reception under way is given up."""
    node = st.nodes[number]
    let_go(st, number, Fate.HALF_DUPLEX.value)
    st.receivers[number].ready_ns = NEVER
    node.mac = Mac.TURNING.value
    schedule(st, number, Due.FRAME_BEGIN.value, TURNAROUND_NS, node.turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def transmit(st: MediumState, number: int) -> None:
    """The frame at the head of the queue begins."""
    node = st.nodes[number]
    frame = st.queue[number, node.head]
    node.octets = frame.octets
    node.to = frame.to
    node.ack = frame.ack
    node.is_ack = False
    node.frame = frame.number
    node.draw = frame.number * 16 + node.tries
    node.tag = frame.tag
    node.asked_ns = frame.asked_ns
    node.overlapping += st.air.in_air > 0
    node.mac = Mac.SENDING.value
    begin(st, number)
    schedule(st, number, Due.FRAME_END.value, airtime_ns(frame.octets), node.turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def transmitted(st: MediumState, number: int) -> None:
    """The frame has left the antenna."""
    node = st.nodes[number]
    leave(st, number)
    judge(st, number)
    st.receivers[number].ready_ns = st.air.now_ns + TURNAROUND_NS
    node.sent += 1
    node.octets_sent += node.octets
    node.on_air_ns += airtime_ns(node.octets)
    _deliver(st, number)
    if node.ack:
        node.mac = Mac.AWAITING.value
        schedule(st, number, Due.ACK_TIMEOUT.value, ACK_WAIT_NS, node.turn)
    else:
        _space(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _space(st: MediumState, number: int) -> None:
    """The exchange was a success: no next frame before the spacing is over."""
    node = st.nodes[number]
    node.mac = Mac.SPACING.value
    short = st.queue[number, node.head].octets <= LONGEST_SHORT
    spacing = SHORT_SPACING_NS if short else LONG_SPACING_NS
    schedule(st, number, Due.SPACING_END.value, spacing, node.turn)
    _finish(st, number, Kind.SENT.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _finish(st: MediumState, number: int, kind: int) -> None:
    """Take the frame out of the queue, say what became of it, and go on."""
    node = st.nodes[number]
    frame = st.queue[number, node.head]
    say(st, kind, number, frame.to, frame.octets, frame.number, frame.tag, frame.asked_ns)
    node.head = (node.head + 1) % st.queue.shape[1]
    node.queued -= 1
    node.tries = 0
    proceed(st, number)
    if node.offer == Offer.SATURATED.value:
        hand_over(st, number, node.offer_octets, node.offer_to, node.offer_ack, -1)


@njit(cache=True)  # type: ignore[untyped-decorator]
def proceed(st: MediumState, number: int) -> None:
    """Go on with the queue if nothing is under way."""
    node = st.nodes[number]
    if node.mac == Mac.IDLE.value and node.queued > 0:
        access(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _deliver(st: MediumState, sender: int) -> None:
    """Give the frame to those who received it, and count what became of it at all others."""
    nodes, fates = st.nodes, st.fate[sender]
    to, busies = nodes[sender].to, nodes[sender].ack or st.air.dead_ns + st.air.dead_octet_ns > 0
    for i in range(nodes.size):
        if fates[i] == Fate.HEARD.value:
            if to not in (BROADCAST, i):
                fates[i] = Fate.FILTERED.value
            elif busies or nodes[i].watched:
                _receive(st, sender, i)
        nodes[i].fates[fates[i]] += 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def _receive(st: MediumState, sender: int, number: int) -> None:
    air, flight, receiver = st.air, st.nodes[sender], st.receivers[number]
    if st.nodes[number].watched:
        event = st.events[air.events]
        say(
            st, Kind.HEARD.value, number, sender, flight.octets, flight.frame, flight.tag, flight.asked_ns
        )  # fmt: skip
        event.power_mw = st.gains_mw[sender, number]
        event.sinr = receiver.worst_sinr
    dead = air.dead_ns + air.dead_octet_ns * min(flight.octets, air.dead_octets)
    receiver.dead_until_ns = air.now_ns + dead
    if flight.ack:
        node = st.nodes[number]
        node.ack_to = sender
        node.ack_number = flight.frame
        node.ack_draw = flight.draw
        receiver.ready_ns = NEVER
        schedule(st, number, Due.ACK_BEGIN.value, TURNAROUND_NS, node.epoch)


@njit(cache=True)  # type: ignore[untyped-decorator]
def acknowledge(st: MediumState, number: int) -> None:
    """A node's acknowledgement begins."""
    node = st.nodes[number]
    node.octets = ACK_OCTETS
    node.to = node.ack_to
    node.ack = False
    node.is_ack = True
    node.frame = node.ack_number
    node.draw = node.ack_draw
    begin(st, number)
    schedule(st, number, Due.ACK_END.value, airtime_ns(ACK_OCTETS), node.epoch)


@njit(cache=True)  # type: ignore[untyped-decorator]
def acknowledged(st: MediumState, number: int) -> None:
    """A node's acknowledgement has ended: whoever waits for it goes on."""
    own = st.nodes[number]
    leave(st, number)
    judge(st, number)
    st.receivers[number].ready_ns = st.air.now_ns + TURNAROUND_NS
    own.on_air_ns += airtime_ns(ACK_OCTETS)
    asker = own.to
    node = st.nodes[asker]
    waits = node.mac == Mac.AWAITING.value and st.queue[asker, node.head].number == own.frame
    if st.fate[number, asker] == Fate.HEARD.value and waits:
        node.turn += 1  # the time-out is void
        node.acknowledged += 1
        _space(st, asker)


@njit(cache=True)  # type: ignore[untyped-decorator]
def timed_out(st: MediumState, number: int) -> None:
    """No acknowledgement came."""
    node = st.nodes[number]
    if node.tries < node.max_retries:
        node.tries += 1
        node.retries += 1
        access(st, number)
        return
    node.no_ack += 1
    node.mac = Mac.IDLE.value
    _finish(st, number, Kind.NO_ACK.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def arrive(st: MediumState, number: int) -> None:
    """The node's own traffic hands over a frame."""
    node = st.nodes[number]
    if node.offer == Offer.SATURATED.value:
        if node.queued == 0:
            hand_over(st, number, node.offer_octets, node.offer_to, node.offer_ack, -1)
        return
    hand_over(st, number, node.offer_octets, node.offer_to, node.offer_ack, -1)
    expect(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def expect(st: MediumState, number: int) -> None:
    """Draw when the next frame of a Poisson process arrives."""
    node = st.nodes[number]
    luck = drawn(st.air.seed, ARRIVAL, node.key, node.arrivals, 0)
    node.arrivals += 1
    wait = int(-log(1.0 - luck) * node.interval_ns)
    schedule(st, number, Due.ARRIVAL.value, wait, node.offer_turn)
