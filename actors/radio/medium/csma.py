"""Kernels of the MAC: unslotted CSMA/CA, the transmit queue, acknowledgements.

Sections are those of IEEE 802.15.4-2006; the algorithm is that of 7.5.1.4, Figure 69.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors import ieee802154
from actors.ieee802154 import CCA_NS, SYMBOL_NS, TURNAROUND_NS, UNIT_BACKOFF_NS
from actors.kernels import njit
from actors.portable.compiled import log
from actors.radio.medium.reception import ARRIVAL, BACKOFF, begin, count, drawn, judge, leave, let_go, sense
from actors.radio.medium.state import (
    BROADCAST,
    NEVER,
    NOBODY,
    Cca,
    Due,
    Kind,
    MacState,
    MediumState,
    OfferKind,
    Outcome,
)


@njit(cache=True)  # type: ignore[untyped-decorator]
def push(agenda: NDArray[np.void], size: int, instant: int, order: int, ticket: int) -> int:
    """Put an entry into a heap of so many; the new size."""
    place = size
    while place > 0:
        above = (place - 1) >> 1
        entry = agenda[above]
        if entry.instant_ns < instant or (entry.instant_ns == instant and entry.order <= order):
            break
        agenda[place] = entry
        place = above
    agenda[place].instant_ns = instant
    agenda[place].order = order
    agenda[place].ticket = ticket
    return size + 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def pop(agenda: NDArray[np.void], size: int) -> int:
    """Take the first entry out of a heap of so many, at least one; the new size."""
    size -= 1
    last = agenda[size]
    place = 0
    while True:
        below = 2 * place + 1
        if below >= size:
            break
        entry = agenda[below]
        if below + 1 < size:
            other = agenda[below + 1]
            if other.instant_ns < entry.instant_ns or (
                other.instant_ns == entry.instant_ns and other.order < entry.order
            ):
                below += 1
                entry = other
        if last.instant_ns < entry.instant_ns or (
            last.instant_ns == entry.instant_ns and last.order <= entry.order
        ):
            break
        agenda[place] = entry
        place = below
    agenda[place] = last
    return size


SHORT_SPACING_NS: Final = 12 * SYMBOL_NS
LONG_SPACING_NS: Final = 40 * SYMBOL_NS
"""aMinSIFSPeriod and aMinLIFSPeriod (7.5.1.3)."""
LONGEST_SHORT: Final = 18
"""aMaxSIFSFrameSize, octets (7.4.1)."""
ACK_OCTETS: Final = 5
ACK_WAIT_NS: Final = 54 * SYMBOL_NS
"""macAckWaitDuration: a unit back-off, a turnaround, the header and six octets (7.4.2)."""

_KINDS: Final = 1 << 32
_airtime_ns: Final = njit(cache=True)(ieee802154.airtime_ns)


@njit(cache=True)  # type: ignore[untyped-decorator]
def schedule(st: MediumState, number: int, due: int, after: int, ticket: int) -> None:
    """Put what is due at a transceiver, so long after now, on the agenda."""
    medium = st.medium
    medium.due = push(st.agenda, medium.due, medium.now_ns + after, due * _KINDS + number, ticket)


@njit(cache=True)  # type: ignore[untyped-decorator]
def say(
    st: MediumState, kind: int, number: int, other: int, octets: int, frame: int, tag: int, asked: int
) -> None:
    """Write an event down; power and SINR are nothing."""
    medium = st.medium
    event = st.events[medium.events]
    medium.events += 1
    event.instant_ns = medium.now_ns
    event.kind = kind
    event.transceiver = number
    event.other = other
    event.octets = octets
    event.number = frame
    event.tag = tag
    event.asked_ns = asked
    event.power_mw = 0.0
    event.sinr = 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def hand_over(st: MediumState, number: int, octets: int, to: int, ack: bool, tag: int) -> None:
    """A transceiver is handed a frame now."""
    transceiver = st.transceivers[number]
    settings, mac, counters = transceiver.settings, transceiver.mac, transceiver.counters
    counters.generated += 1
    if not mac.powered:
        counters.discarded += 1
        return
    frame = mac.number
    mac.number += 1
    capacity = st.queue.shape[1]
    if mac.queued >= settings.capacity:
        counters.overflowed += 1
        say(st, Kind.OVERFLOW.value, number, NOBODY, octets, frame, tag, st.medium.now_ns)
        return
    slot = st.queue[number, (mac.head + mac.queued) % capacity]
    slot.octets = octets
    slot.to = to
    slot.ack = ack and to != BROADCAST
    slot.number = frame
    slot.tag = tag
    slot.asked_ns = st.medium.now_ns
    mac.queued += 1
    if mac.state == MacState.IDLE.value:
        access(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def access(st: MediumState, number: int) -> None:
    """Begin CSMA/CA for the frame at the head of the queue."""
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    mac.state = MacState.BACKOFF.value
    mac.nb = 0
    mac.be = settings.min_be
    _back_off(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _back_off(st: MediumState, number: int) -> None:
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    luck = drawn(
        st.medium.seed, BACKOFF, settings.key, st.queue[number, mac.head].number, mac.tries * 16 + mac.nb
    )
    periods = int(luck * (1 << mac.be))
    schedule(st, number, Due.CCA_BEGIN.value, periods * UNIT_BACKOFF_NS, mac.ticket)


@njit(cache=True)  # type: ignore[untyped-decorator]
def assess(st: MediumState, number: int) -> None:
    """The back-off is over: the clear channel assessment begins."""
    medium, transceiver = st.medium, st.transceivers[number]
    mac, receiver = transceiver.mac, transceiver.receiver
    # While it sends an acknowledgement, or changes over for one, the channel is not clear.
    is_acknowledging = receiver.ready_ns > medium.now_ns
    if transceiver.settings.cca == Cca.NEVER.value and not is_acknowledging:
        _turn_around(st, number)
        return
    mac.assessed_ns = medium.now_ns
    mac.peak = 0.0
    mac.carrier = receiver.lock >= 0
    mac.energy = math.inf if is_acknowledging else 0.0
    st.rosters[medium.assessing].assessing = number
    medium.assessing += 1
    schedule(st, number, Due.CCA_END.value, CCA_NS, mac.ticket)


@njit(cache=True)  # type: ignore[untyped-decorator]
def forget_assessment(st: MediumState, number: int) -> None:
    """Take a transceiver from those who assess the channel, if it is one."""
    medium = st.medium
    for place in range(medium.assessing):
        if st.rosters[place].assessing == number:
            medium.assessing -= 1
            st.rosters[place].assessing = st.rosters[medium.assessing].assessing
            return


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_clear(st: MediumState, number: int) -> bool:
    medium, transceiver = st.medium, st.transceivers[number]
    settings, mac, receiver = transceiver.settings, transceiver.mac, transceiver.receiver
    if mac.energy == math.inf or receiver.ready_ns > medium.now_ns:
        return False
    energy = mac.energy / CCA_NS
    carrier = receiver.lock >= 0 or mac.carrier or receiver.unlock_ns > medium.now_ns - CCA_NS
    if medium.peak_cca:
        energy = max(mac.peak, receiver.total_mw + receiver.external_mw)
        carrier = receiver.lock >= 0
    cca, loud = settings.cca, energy >= settings.cca_mw
    if cca == Cca.ENERGY.value:
        return not loud
    if cca == Cca.CARRIER.value:
        return not carrier
    if cca == Cca.EITHER.value:
        return not (loud or carrier)
    return not (loud and carrier)


@njit(cache=True)  # type: ignore[untyped-decorator]
def assessed(st: MediumState, number: int) -> None:
    """The clear channel assessment is over."""
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    sense(st.medium, transceiver)
    forget_assessment(st, number)
    if _is_clear(st, number):
        _turn_around(st, number)
        return
    mac.nb += 1
    mac.be = min(mac.be + 1, settings.max_be)
    if mac.nb <= settings.max_backoffs:
        _back_off(st, number)
        return
    transceiver.counters.access_failures += 1
    mac.state = MacState.IDLE.value
    _finish(st, number, Kind.ACCESS_FAILURE.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _turn_around(st: MediumState, number: int) -> None:
    """Change over to sending; a reception under way is given up."""
    transceiver = st.transceivers[number]
    mac = transceiver.mac
    let_go(st, number, Outcome.HALF_DUPLEX.value)
    transceiver.receiver.ready_ns = NEVER
    mac.state = MacState.TURNAROUND.value
    schedule(st, number, Due.FRAME_BEGIN.value, TURNAROUND_NS, mac.ticket)


@njit(cache=True)  # type: ignore[untyped-decorator]
def transmit(st: MediumState, number: int) -> None:
    """The frame at the head of the queue begins."""
    transceiver = st.transceivers[number]
    mac, flight = transceiver.mac, transceiver.flight
    frame = st.queue[number, mac.head]
    flight.octets = frame.octets
    flight.to = frame.to
    flight.ack = frame.ack
    flight.is_ack = False
    flight.frame = frame.number
    flight.draw = frame.number * 16 + mac.tries
    flight.tag = frame.tag
    flight.asked_ns = frame.asked_ns
    transceiver.counters.overlapping += st.medium.in_air > 0
    mac.state = MacState.SENDING.value
    begin(st, number)
    schedule(st, number, Due.FRAME_END.value, _airtime_ns(frame.octets), mac.ticket)


@njit(cache=True)  # type: ignore[untyped-decorator]
def transmitted(st: MediumState, number: int) -> None:
    """The frame has left the antenna."""
    transceiver = st.transceivers[number]
    mac, flight, counters = transceiver.mac, transceiver.flight, transceiver.counters
    leave(st, number)
    judge(st, number)
    transceiver.receiver.ready_ns = st.medium.now_ns + TURNAROUND_NS
    counters.sent += 1
    counters.octets_sent += flight.octets
    counters.on_air_ns += _airtime_ns(flight.octets)
    _deliver(st, number)
    if flight.ack:
        mac.state = MacState.AWAITING.value
        schedule(st, number, Due.ACK_TIMEOUT.value, ACK_WAIT_NS, mac.ticket)
    else:
        _space(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _space(st: MediumState, number: int) -> None:
    """The exchange was a success: no next frame before the spacing is over."""
    mac = st.transceivers[number].mac
    mac.state = MacState.SPACING.value
    short = st.queue[number, mac.head].octets <= LONGEST_SHORT
    spacing = SHORT_SPACING_NS if short else LONG_SPACING_NS
    schedule(st, number, Due.SPACING_END.value, spacing, mac.ticket)
    _finish(st, number, Kind.SENT.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _finish(st: MediumState, number: int, kind: int) -> None:
    """Take the frame out of the queue, say what became of it, and go on."""
    transceiver = st.transceivers[number]
    traffic, mac = transceiver.traffic, transceiver.mac
    frame = st.queue[number, mac.head]
    say(st, kind, number, frame.to, frame.octets, frame.number, frame.tag, frame.asked_ns)
    if kind == Kind.SENT.value:
        st.medium.sent_by = number
    mac.head = (mac.head + 1) % st.queue.shape[1]
    mac.queued -= 1
    mac.tries = 0
    proceed(st, number)
    if traffic.kind == OfferKind.SATURATED.value:
        hand_over(st, number, traffic.octets, traffic.to, traffic.ack, -1)


@njit(cache=True)  # type: ignore[untyped-decorator]
def proceed(st: MediumState, number: int) -> None:
    """Go on with the queue if nothing is under way."""
    mac = st.transceivers[number].mac
    if mac.state == MacState.IDLE.value and mac.queued > 0:
        access(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _deliver(st: MediumState, sender: int) -> None:
    """Give the frame to those who received it, and count what became of it at all others."""
    medium, flight, outcomes = st.medium, st.transceivers[sender].flight, st.outcomes[sender]
    to, busies = flight.to, flight.ack or medium.dead_ns + medium.dead_octet_ns > 0
    for i in st.reached[sender, : st.transceivers[sender].reached]:
        if outcomes[i] == Outcome.HEARD.value:
            if to not in (BROADCAST, i):
                outcomes[i] = Outcome.FILTERED.value
            elif busies or st.transceivers[i].settings.watched:
                _receive(st, sender, i)
    count(st, sender)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _receive(st: MediumState, sender: int, number: int) -> None:
    medium, flight, transceiver = st.medium, st.transceivers[sender].flight, st.transceivers[number]
    receiver = transceiver.receiver
    if transceiver.settings.watched:
        event = st.events[medium.events]
        say(
            st, Kind.HEARD.value, number, sender, flight.octets, flight.frame, flight.tag, flight.asked_ns
        )  # fmt: skip
        event.power_mw = st.gains_mw[sender, number]
        event.sinr = receiver.worst_sinr
    dead = medium.dead_ns + medium.dead_octet_ns * min(flight.octets, medium.dead_octets)
    receiver.dead_until_ns = medium.now_ns + dead
    if flight.ack:
        mac = transceiver.mac
        mac.ack_to = sender
        mac.ack_number = flight.frame
        mac.ack_draw = flight.draw
        receiver.ready_ns = NEVER
        schedule(st, number, Due.ACK_BEGIN.value, TURNAROUND_NS, mac.epoch)


@njit(cache=True)  # type: ignore[untyped-decorator]
def acknowledge(st: MediumState, number: int) -> None:
    """A transceiver's acknowledgement begins."""
    transceiver = st.transceivers[number]
    mac, flight = transceiver.mac, transceiver.flight
    flight.octets = ACK_OCTETS
    flight.to = mac.ack_to
    flight.ack = False
    flight.is_ack = True
    flight.frame = mac.ack_number
    flight.draw = mac.ack_draw
    begin(st, number)
    schedule(st, number, Due.ACK_END.value, _airtime_ns(ACK_OCTETS), mac.epoch)


@njit(cache=True)  # type: ignore[untyped-decorator]
def acknowledged(st: MediumState, number: int) -> None:
    """A transceiver's acknowledgement has ended: whoever waits for it goes on."""
    transceiver = st.transceivers[number]
    flight = transceiver.flight
    leave(st, number)
    judge(st, number)
    transceiver.receiver.ready_ns = st.medium.now_ns + TURNAROUND_NS
    transceiver.counters.on_air_ns += _airtime_ns(ACK_OCTETS)
    asker = flight.to
    mac = st.transceivers[asker].mac
    waits = mac.state == MacState.AWAITING.value and st.queue[asker, mac.head].number == flight.frame
    if st.outcomes[number, asker] == Outcome.HEARD.value and waits:
        mac.ticket += 1  # the time-out is void
        st.transceivers[asker].counters.acknowledged += 1
        _space(st, asker)


@njit(cache=True)  # type: ignore[untyped-decorator]
def timed_out(st: MediumState, number: int) -> None:
    """No acknowledgement came."""
    transceiver = st.transceivers[number]
    settings, mac, counters = transceiver.settings, transceiver.mac, transceiver.counters
    if mac.tries < settings.max_retries:
        mac.tries += 1
        counters.retries += 1
        access(st, number)
        return
    counters.no_ack += 1
    mac.state = MacState.IDLE.value
    _finish(st, number, Kind.NO_ACK.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def arrive(st: MediumState, number: int) -> None:
    """The traffic that the medium makes hands over a frame."""
    transceiver = st.transceivers[number]
    traffic, mac = transceiver.traffic, transceiver.mac
    if traffic.kind == OfferKind.SATURATED.value:
        if mac.queued == 0:
            hand_over(st, number, traffic.octets, traffic.to, traffic.ack, -1)
        return
    hand_over(st, number, traffic.octets, traffic.to, traffic.ack, -1)
    expect(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def expect(st: MediumState, number: int) -> None:
    """Draw when the next frame of a Poisson process arrives."""
    transceiver = st.transceivers[number]
    settings, traffic = transceiver.settings, transceiver.traffic
    luck = drawn(st.medium.seed, ARRIVAL, settings.key, traffic.arrivals, 0)
    traffic.arrivals += 1
    wait = int(-log(1.0 - luck) * traffic.interval_ns)
    schedule(st, number, Due.ARRIVAL.value, wait, traffic.ticket)
