"""MAC kernels: unslotted CSMA/CA, transmit queue, acknowledgements.

Sections are those of IEEE 802.15.4-2006; the algorithm is that of 7.5.1.4, Figure 69.
"""

import math
from typing import Final

from actors import ieee802154
from actors.array_types import Records
from actors.ieee802154 import CCA_NS, SYMBOL_NS, TURNAROUND_NS, UNIT_BACKOFF_NS
from actors.kernels import kernel, njit
from actors.portable.compiled import log
from actors.radio.medium.reception import (
    ARRIVAL,
    BACKOFF,
    abort_reception,
    add_energy,
    begin,
    count,
    decide_reception,
    end_signal,
    keyed_uniform,
)
from actors.radio.medium.state import (
    BROADCAST,
    NEVER,
    NO_TRANSCEIVER,
    ActionKind,
    Cca,
    EventKind,
    MacState,
    MediumState,
    Outcome,
    TrafficKind,
)


@kernel
def push(agenda: Records, size: int, instant: int, order: int, ticket: int) -> int:
    """Add an entry to a heap of `size` entries; return the new size."""
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


@kernel
def pop(agenda: Records, size: int) -> int:
    """Remove the first entry from a heap of `size` ≥ 1 entries; return the new size."""
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
_airtime_ns: Final = njit()(ieee802154.airtime_ns)


@kernel
def schedule(st: MediumState, number: int, due: int, after: int, ticket: int) -> None:
    """Schedule an action of a transceiver `after` ns from now."""
    medium = st.medium
    medium.due = push(st.agenda, medium.due, medium.now_ns + after, due * _KINDS + number, ticket)


@kernel
def record_event(
    st: MediumState, kind: int, number: int, other: int, octets: int, frame: int, tag: int, asked: int
) -> None:
    """Record an event with power and SINR of 0."""
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


@kernel
def enqueue(st: MediumState, number: int, octets: int, to: int, ack: bool, tag: int) -> None:
    """Give a frame to a transceiver now."""
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
        record_event(
            st, EventKind.OVERFLOW.value, number, NO_TRANSCEIVER, octets, frame, tag, st.medium.now_ns
        )
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


@kernel
def access(st: MediumState, number: int) -> None:
    """Begin CSMA/CA for the frame at the head of the queue."""
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    mac.state = MacState.BACKOFF.value
    mac.nb = 0
    mac.be = settings.min_be
    _begin_backoff(st, number)


@kernel
def _begin_backoff(st: MediumState, number: int) -> None:
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    chance = keyed_uniform(
        st.medium.seed, BACKOFF, settings.key, st.queue[number, mac.head].number, mac.tries * 16 + mac.nb
    )
    periods = int(chance * (1 << mac.be))
    schedule(st, number, ActionKind.CCA_BEGIN.value, periods * UNIT_BACKOFF_NS, mac.ticket)


@kernel
def begin_assessment(st: MediumState, number: int) -> None:
    """Begin the clear channel assessment after a back-off."""
    medium, transceiver = st.medium, st.transceivers[number]
    mac, receiver = transceiver.mac, transceiver.receiver
    # The channel is not clear during an acknowledgement of its own or the turnaround for one.
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
    schedule(st, number, ActionKind.CCA_END.value, CCA_NS, mac.ticket)


@kernel
def cancel_assessment(st: MediumState, number: int) -> None:
    """Remove a transceiver from those that assess the channel, if it is one."""
    medium = st.medium
    for place in range(medium.assessing):
        if st.rosters[place].assessing == number:
            medium.assessing -= 1
            st.rosters[place].assessing = st.rosters[medium.assessing].assessing
            return


@kernel
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


@kernel
def end_assessment(st: MediumState, number: int) -> None:
    """End the clear channel assessment."""
    transceiver = st.transceivers[number]
    settings, mac = transceiver.settings, transceiver.mac
    add_energy(st.medium, transceiver)
    cancel_assessment(st, number)
    if _is_clear(st, number):
        _turn_around(st, number)
        return
    mac.nb += 1
    mac.be = min(mac.be + 1, settings.max_be)
    if mac.nb <= settings.max_backoffs:
        _begin_backoff(st, number)
        return
    transceiver.counters.access_failures += 1
    mac.state = MacState.IDLE.value
    _finish(st, number, EventKind.ACCESS_FAILURE.value)


@kernel
def _turn_around(st: MediumState, number: int) -> None:
    """Switch to sending; abort a reception in progress."""
    transceiver = st.transceivers[number]
    mac = transceiver.mac
    abort_reception(st, number, Outcome.HALF_DUPLEX.value)
    transceiver.receiver.ready_ns = NEVER
    mac.state = MacState.TURNAROUND.value
    schedule(st, number, ActionKind.FRAME_BEGIN.value, TURNAROUND_NS, mac.ticket)


@kernel
def begin_frame(st: MediumState, number: int) -> None:
    """Begin the frame at the head of the queue."""
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
    schedule(st, number, ActionKind.FRAME_END.value, _airtime_ns(frame.octets), mac.ticket)


@kernel
def end_frame(st: MediumState, number: int) -> None:
    """End the frame in the air."""
    transceiver = st.transceivers[number]
    mac, flight, counters = transceiver.mac, transceiver.flight, transceiver.counters
    end_signal(st, number)
    decide_reception(st, number)
    transceiver.receiver.ready_ns = st.medium.now_ns + TURNAROUND_NS
    counters.sent += 1
    counters.octets_sent += flight.octets
    counters.on_air_ns += _airtime_ns(flight.octets)
    _deliver(st, number)
    if flight.ack:
        mac.state = MacState.AWAITING.value
        schedule(st, number, ActionKind.ACK_TIMEOUT.value, ACK_WAIT_NS, mac.ticket)
    else:
        _start_spacing(st, number)


@kernel
def _start_spacing(st: MediumState, number: int) -> None:
    """Start the interframe spacing after a successful exchange."""
    mac = st.transceivers[number].mac
    mac.state = MacState.SPACING.value
    short = st.queue[number, mac.head].octets <= LONGEST_SHORT
    spacing = SHORT_SPACING_NS if short else LONG_SPACING_NS
    schedule(st, number, ActionKind.SPACING_END.value, spacing, mac.ticket)
    _finish(st, number, EventKind.SENT.value)


@kernel
def _finish(st: MediumState, number: int, kind: int) -> None:
    """Remove the frame from the queue, record its result, and continue."""
    transceiver = st.transceivers[number]
    traffic, mac = transceiver.traffic, transceiver.mac
    frame = st.queue[number, mac.head]
    record_event(st, kind, number, frame.to, frame.octets, frame.number, frame.tag, frame.asked_ns)
    if kind == EventKind.SENT.value:
        st.medium.sent_by = number
    mac.head = (mac.head + 1) % st.queue.shape[1]
    mac.queued -= 1
    mac.tries = 0
    start_next(st, number)
    if traffic.kind == TrafficKind.SATURATED.value:
        enqueue(st, number, traffic.octets, traffic.to, traffic.ack, -1)


@kernel
def start_next(st: MediumState, number: int) -> None:
    """Start the next frame of the queue if the MAC is idle."""
    mac = st.transceivers[number].mac
    if mac.state == MacState.IDLE.value and mac.queued > 0:
        access(st, number)


@kernel
def _deliver(st: MediumState, sender: int) -> None:
    """Deliver the frame to its receivers, and count its outcomes at all others."""
    medium, flight, outcomes = st.medium, st.transceivers[sender].flight, st.outcomes[sender]
    to, busies = flight.to, flight.ack or medium.dead_ns + medium.dead_octet_ns > 0
    for i in st.reached[sender, : st.transceivers[sender].reached]:
        if outcomes[i] == Outcome.HEARD.value:
            if to not in (BROADCAST, i):
                outcomes[i] = Outcome.FILTERED.value
            elif busies or st.transceivers[i].settings.watched:
                _receive(st, sender, i)
    count(st, sender)


@kernel
def _receive(st: MediumState, sender: int, number: int) -> None:
    medium, flight, transceiver = st.medium, st.transceivers[sender].flight, st.transceivers[number]
    receiver = transceiver.receiver
    if transceiver.settings.watched:
        event = st.events[medium.events]
        record_event(
            st,
            EventKind.HEARD.value,
            number,
            sender,
            flight.octets,
            flight.frame,
            flight.tag,
            flight.asked_ns,
        )
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
        schedule(st, number, ActionKind.ACK_BEGIN.value, TURNAROUND_NS, mac.epoch)


@kernel
def begin_ack(st: MediumState, number: int) -> None:
    """Begin an acknowledgement."""
    transceiver = st.transceivers[number]
    mac, flight = transceiver.mac, transceiver.flight
    flight.octets = ACK_OCTETS
    flight.to = mac.ack_to
    flight.ack = False
    flight.is_ack = True
    flight.frame = mac.ack_number
    flight.draw = mac.ack_draw
    begin(st, number)
    schedule(st, number, ActionKind.ACK_END.value, _airtime_ns(ACK_OCTETS), mac.epoch)


@kernel
def end_ack(st: MediumState, number: int) -> None:
    """End an acknowledgement; the waiting sender continues."""
    transceiver = st.transceivers[number]
    flight = transceiver.flight
    end_signal(st, number)
    decide_reception(st, number)
    transceiver.receiver.ready_ns = st.medium.now_ns + TURNAROUND_NS
    transceiver.counters.on_air_ns += _airtime_ns(ACK_OCTETS)
    asker = flight.to
    mac = st.transceivers[asker].mac
    waits = mac.state == MacState.AWAITING.value and st.queue[asker, mac.head].number == flight.frame
    if st.outcomes[number, asker] == Outcome.HEARD.value and waits:
        mac.ticket += 1  # cancels the timeout
        st.transceivers[asker].counters.acknowledged += 1
        _start_spacing(st, asker)


@kernel
def timed_out(st: MediumState, number: int) -> None:
    """Retry or give up a frame after a missing acknowledgement."""
    transceiver = st.transceivers[number]
    settings, mac, counters = transceiver.settings, transceiver.mac, transceiver.counters
    if mac.tries < settings.max_retries:
        mac.tries += 1
        counters.retries += 1
        access(st, number)
        return
    counters.no_ack += 1
    mac.state = MacState.IDLE.value
    _finish(st, number, EventKind.NO_ACK.value)


@kernel
def arrive(st: MediumState, number: int) -> None:
    """Give the next frame of generated traffic to a transceiver."""
    transceiver = st.transceivers[number]
    traffic, mac = transceiver.traffic, transceiver.mac
    if traffic.kind == TrafficKind.SATURATED.value:
        if mac.queued == 0:
            enqueue(st, number, traffic.octets, traffic.to, traffic.ack, -1)
        return
    enqueue(st, number, traffic.octets, traffic.to, traffic.ack, -1)
    schedule_arrival(st, number)


@kernel
def schedule_arrival(st: MediumState, number: int) -> None:
    """Draw the next arrival of a Poisson process."""
    transceiver = st.transceivers[number]
    settings, traffic = transceiver.settings, transceiver.traffic
    chance = keyed_uniform(st.medium.seed, ARRIVAL, settings.key, traffic.arrivals, 0)
    traffic.arrivals += 1
    wait = int(-log(1.0 - chance) * traffic.interval_ns)
    schedule(st, number, ActionKind.ARRIVAL.value, wait, traffic.ticket)
