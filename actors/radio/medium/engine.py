"""Event loop kernels of the medium: actions of transceivers in order of time."""

from typing import Final

from actors.array_types import Floats, Records
from actors.kernels import kernel, njit
from actors.portable.compiled import exp10
from actors.radio.medium import csma
from actors.radio.medium.csma import pop
from actors.radio.medium.reception import abort_reception, count, end_signal, free_share, set_external_power
from actors.radio.medium.state import (
    NEVER,
    NO_TRANSCEIVER,
    ActionKind,
    ExternalInputs,
    MacState,
    MediumState,
    Outcome,
    TrafficKind,
)

DONE: Final = 0
"""All actions before the limit have run."""
ROW: Final = 1
"""The next frame needs the losses from its sender, `medium.sender`."""
FULL: Final = 2
"""The event buffer is full and must be emptied."""
SENT: Final = 3
"""A frame of `medium.sent_by` has been sent, and `medium.pauses` is set."""

_KINDS: Final = 1 << 32


_HALF_DB: Final = 3.0103


@njit()  # type: ignore[untyped-decorator]
def run(st: MediumState, outside: ExternalInputs, until: int, include_ends: bool, loss_db: Floats) -> int:
    """Run everything before `until`, and ends of frames at `until` itself if `include_ends`.

    `loss_db`: (n,) dB, as requested by the previous call with ROW; any value above `medium.most_db` where
    above it; otherwise (0,).
    """
    medium = st.medium
    if loss_db.size > 0:
        _store_row(st, loss_db)
    medium.sent_by = NO_TRANSCEIVER
    while st.events.size - medium.events > st.transceivers.size + 8:
        at = st.agenda[0].instant_ns if medium.due > 0 else NEVER
        switched = _next_instant(outside.switches, medium.next_switch)
        asked = _next_instant(outside.requests, medium.next_request)
        first = min(at, switched, asked)
        if first > until or (first == until and not (include_ends and first == at and _ends(st))):
            medium.now_ns = max(medium.now_ns, until)
            return DONE
        medium.now_ns = first
        if switched == first and not include_ends:
            _switch(st, outside)
        elif at == first:
            if _needs_row(st):
                return ROW
            _dispatch(st)
            if medium.pauses and medium.sent_by != NO_TRANSCEIVER:
                return SENT
        else:
            request = outside.requests[medium.next_request]
            medium.next_request += 1
            csma.enqueue(st, request.transceiver, request.octets, request.to, request.ack, request.tag)
    return FULL


@kernel
def _store_row(st: MediumState, loss_db: Floats) -> None:
    """Store the received powers of frames of `medium.sender`, and their receivers."""
    sender, most_db, reached = st.medium.sender, st.medium.most_db, 0
    transceiver = st.transceivers[sender]
    tx_dbm = transceiver.settings.tx_dbm
    st.gains_mw[sender, :] = 0.0
    for other in range(loss_db.size):
        if loss_db[other] <= most_db:
            st.gains_mw[sender, other] = exp10((tx_dbm - loss_db[other]) / 10.0)
            if other != sender:
                st.reached[sender, reached] = other
                reached += 1
    transceiver.reached = reached
    transceiver.row = st.medium.share


@kernel
def _next_instant(entries: Records, place: int) -> int:
    return entries[place].instant_ns if place < entries.size else NEVER


@kernel
def _ends(st: MediumState) -> bool:
    """Return whether the end of a frame is first on the agenda."""
    return bool(st.agenda[0].order // _KINDS <= ActionKind.ACK_END.value)


@kernel
def _switch(st: MediumState, outside: ExternalInputs) -> None:
    switch = outside.switches[st.medium.next_switch]
    st.medium.next_switch += 1
    for i in range(st.transceivers.size):
        outside.now_mw[switch.source, i] = outside.rows_mw[switch.row, i] if switch.row >= 0 else 0.0
    set_external_power(st, outside.now_mw)


@kernel
def _needs_row(st: MediumState) -> bool:
    medium, order = st.medium, st.agenda[0].order
    due, number = order // _KINDS, order % _KINDS
    if due not in (ActionKind.FRAME_BEGIN.value, ActionKind.ACK_BEGIN.value):
        return False
    medium.share = free_share(st)
    if st.transceivers[number].row >= medium.share or not _is_valid(st, due, number, st.agenda[0].ticket):
        return False
    medium.sender = number
    faintest_dbm = medium.faintest_dbm - _HALF_DB * medium.share
    medium.most_db = st.transceivers[number].settings.tx_dbm - faintest_dbm
    return True


@kernel
def _is_valid(st: MediumState, due: int, number: int, ticket: int) -> bool:
    """Return whether an entry of the agenda has not been cancelled."""
    if due == ActionKind.ARRIVAL.value:
        return bool(ticket == st.transceivers[number].traffic.ticket)
    mac = st.transceivers[number].mac
    if due in (ActionKind.ACK_BEGIN.value, ActionKind.ACK_END.value):
        return bool(ticket == mac.epoch)
    return bool(ticket == mac.ticket)


@kernel
def _dispatch(st: MediumState) -> None:
    """Run the first entry of the agenda."""
    medium = st.medium
    order, ticket = st.agenda[0].order, st.agenda[0].ticket
    medium.due = pop(st.agenda, medium.due)
    due, number = order // _KINDS, order % _KINDS
    if not _is_valid(st, due, number, ticket):
        return
    if due == ActionKind.ARRIVAL.value:
        csma.arrive(st, number)
    elif due == ActionKind.CCA_BEGIN.value:
        csma.begin_assessment(st, number)
    elif due == ActionKind.CCA_END.value:
        csma.end_assessment(st, number)
    elif due == ActionKind.SPACING_END.value:
        st.transceivers[number].mac.state = MacState.IDLE.value
        csma.start_next(st, number)
    else:
        _exchange(st, due, number)


@kernel
def _exchange(st: MediumState, due: int, number: int) -> None:
    if due == ActionKind.FRAME_BEGIN.value:
        csma.begin_frame(st, number)
        _invalidate_row(st, number)
    elif due == ActionKind.FRAME_END.value:
        csma.end_frame(st, number)
    elif due == ActionKind.ACK_BEGIN.value:
        csma.begin_ack(st, number)
        _invalidate_row(st, number)
    elif due == ActionKind.ACK_END.value:
        csma.end_ack(st, number)
    else:
        csma.timed_out(st, number)


@kernel
def _invalidate_row(st: MediumState, number: int) -> None:
    """Invalidate the sender's row after a frame has begun if transceivers move."""
    if st.medium.moving:
        st.transceivers[number].row = 0


@njit()  # type: ignore[untyped-decorator]
def switch_on(st: MediumState, number: int) -> None:
    """Power a transceiver; it can receive at once."""
    medium, transceiver = st.medium, st.transceivers[number]
    place = 0
    while st.rosters[place].off != number:
        place += 1
    medium.off -= 1
    st.rosters[place].off = st.rosters[medium.off].off
    receiver = transceiver.receiver
    transceiver.mac.powered = True
    receiver.ready_ns = receiver.dead_until_ns = 0
    receiver.unlock_ns = -NEVER


@njit()  # type: ignore[untyped-decorator]
def switch_off(st: MediumState, number: int) -> None:
    """Switch a transceiver off: cut its frame, clear its queue, abort its reception."""
    medium, transceiver = st.medium, st.transceivers[number]
    mac, counters = transceiver.mac, transceiver.counters
    cut = False
    for k in range(medium.in_air):
        cut = cut or st.rosters[k].in_air == number
    if cut:
        _cut_frame(st, number)
    abort_reception(st, number, Outcome.POWERED_OFF.value)
    csma.cancel_assessment(st, number)
    for k in range(medium.in_air):
        if st.outcomes[st.rosters[k].in_air, number] != Outcome.NOT_COUNTED.value:
            st.outcomes[st.rosters[k].in_air, number] = Outcome.POWERED_OFF.value
    cut_off = cut and not transceiver.flight.is_ack
    counters.cut_off += cut_off
    counters.discarded += mac.queued - cut_off
    mac.queued = 0
    mac.tries = 0
    mac.state = MacState.IDLE.value
    mac.ticket += 1
    mac.epoch += 1
    mac.powered = False
    st.rosters[medium.off].off = number
    medium.off += 1


@kernel
def _cut_frame(st: MediumState, sender: int) -> None:
    """End a frame early; no transceiver receives it."""
    end_signal(st, sender)
    for i in range(st.transceivers.size):
        if st.transceivers[i].receiver.lock == sender:
            abort_reception(st, i, Outcome.POWERED_OFF.value)
        if st.outcomes[sender, i] != Outcome.NOT_COUNTED.value:
            st.outcomes[sender, i] = Outcome.POWERED_OFF.value
    if not st.transceivers[sender].flight.is_ack:
        count(st, sender)


@njit()  # type: ignore[untyped-decorator]
def offer(st: MediumState, number: int, kind: int, after: int) -> None:
    """Generate a transceiver's traffic from now; saturated traffic begins `after` ns from now."""
    traffic = st.transceivers[number].traffic
    traffic.kind = kind
    traffic.ticket += 1
    if kind == TrafficKind.POISSON.value:
        csma.schedule_arrival(st, number)
    elif kind == TrafficKind.SATURATED.value:
        csma.schedule(st, number, ActionKind.ARRIVAL.value, after, traffic.ticket)
