"""Kernels of the medium's event loop: what is due, at which node, in the one order that time gives."""

from typing import Final

from numba import njit

from actors.radio.medium import csma
from actors.radio.medium.agenda import pop
from actors.radio.medium.reception import change_outside, leave, let_go
from actors.radio.medium.state import NEVER, Due, Fate, Mac, MediumState, Offer, Outside

DONE: Final = 0
"""All that was due has happened."""
ROW: Final = 1
"""The frame that is first on the agenda needs its sender's row of gains."""
FULL: Final = 2
"""The events must be taken away first."""

_KINDS: Final = 1 << 32


@njit(cache=True)  # type: ignore[untyped-decorator]
def run(st: MediumState, outside: Outside, until: int, ends_too: bool) -> int:
    """Let everything happen before `until`, and the ends of frames at `until` itself if `ends_too`."""
    air = st.air
    while st.events.size - air.events > st.nodes.size + 8:
        at = st.agenda[0].instant_ns if air.due > 0 else NEVER
        switched = _next_switch(st, outside)
        asked = _next_request(st, outside)
        first = min(at, switched, asked)
        if first > until or (first == until and not (ends_too and first == at and _ends(st))):
            air.now_ns = max(air.now_ns, until)
            return DONE
        air.now_ns = first
        if switched == first and not ends_too:
            _switch(st, outside)
        elif at == first:
            if _needs_row(st):
                return ROW
            _dispatch(st)
        else:
            request = outside.requests[air.next_request]
            air.next_request += 1
            csma.hand_over(st, request.node, request.octets, request.to, request.ack, request.tag)
    return FULL


@njit(cache=True)  # type: ignore[untyped-decorator]
def _next_switch(st: MediumState, outside: Outside) -> int:
    place = st.air.next_switch
    return outside.switches[place].instant_ns if place < outside.switches.size else NEVER


@njit(cache=True)  # type: ignore[untyped-decorator]
def _next_request(st: MediumState, outside: Outside) -> int:
    place = st.air.next_request
    return outside.requests[place].instant_ns if place < outside.requests.size else NEVER


@njit(cache=True)  # type: ignore[untyped-decorator]
def _ends(st: MediumState) -> bool:
    """True if the end of a frame is first on the agenda."""
    return bool(st.agenda[0].order // _KINDS <= Due.ACK_END.value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _switch(st: MediumState, outside: Outside) -> None:
    switch = outside.switches[st.air.next_switch]
    st.air.next_switch += 1
    for i in range(st.nodes.size):
        outside.now_mw[switch.source, i] = outside.rows_mw[switch.row, i] if switch.row >= 0 else 0.0
    change_outside(st, outside.now_mw)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _needs_row(st: MediumState) -> bool:
    order = st.agenda[0].order
    due = order // _KINDS
    begins = due in (Due.FRAME_BEGIN.value, Due.ACK_BEGIN.value)
    return (
        begins
        and not st.nodes[order % _KINDS].known
        and _is_valid(st, due, order % _KINDS, st.agenda[0].turn)
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_valid(st: MediumState, due: int, number: int, turn: int) -> bool:
    """False if what was put on the agenda has been called off since."""
    node = st.nodes[number]
    if due == Due.ARRIVAL.value:
        return bool(turn == node.offer_turn)
    if due in (Due.ACK_BEGIN.value, Due.ACK_END.value):
        return bool(turn == node.epoch)
    return bool(turn == node.turn)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _dispatch(st: MediumState) -> None:
    """Let the first thing on the agenda happen."""
    air = st.air
    order, turn = st.agenda[0].order, st.agenda[0].turn
    air.due = pop(st.agenda, air.due)
    due, number = order // _KINDS, order % _KINDS
    if not _is_valid(st, due, number, turn):
        return
    if due == Due.ARRIVAL.value:
        csma.arrive(st, number)
    elif due == Due.CCA_BEGIN.value:
        csma.assess(st, number)
    elif due == Due.CCA_END.value:
        csma.assessed(st, number)
    elif due == Due.SPACING_END.value:
        st.nodes[number].mac = Mac.IDLE.value
        csma.proceed(st, number)
    else:
        _exchange(st, due, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _exchange(st: MediumState, due: int, number: int) -> None:
    if due == Due.FRAME_BEGIN.value:
        csma.transmit(st, number)
        st.nodes[number].known = not st.air.moving
    elif due == Due.FRAME_END.value:
        csma.transmitted(st, number)
    elif due == Due.ACK_BEGIN.value:
        csma.acknowledge(st, number)
        st.nodes[number].known = not st.air.moving
    elif due == Due.ACK_END.value:
        csma.acknowledged(st, number)
    else:
        csma.timed_out(st, number)


@njit(cache=True)  # type: ignore[untyped-decorator]
def switch_on(st: MediumState, number: int) -> None:
    """A node gets power: it can receive at once."""
    node, receiver = st.nodes[number], st.receivers[number]
    node.powered = True
    receiver.ready_ns = receiver.dead_until_ns = 0
    receiver.unlock_ns = -NEVER


@njit(cache=True)  # type: ignore[untyped-decorator]
def switch_off(st: MediumState, number: int) -> None:
    """A node loses power: its frame is cut short, its queue forgotten, and what it was receiving lost."""
    air, node = st.air, st.nodes[number]
    cut = False
    for k in range(air.in_air):
        cut = cut or st.nodes[k].in_air == number
    if cut:
        _cut(st, number)
    let_go(st, number, Fate.POWERED_OFF.value)
    csma.forget_assessment(st, number)
    for k in range(air.in_air):
        if st.fate[st.nodes[k].in_air, number] != Fate.NOT_COUNTED.value:
            st.fate[st.nodes[k].in_air, number] = Fate.POWERED_OFF.value
    own = cut and not st.nodes[number].is_ack
    node.cut_off += own
    node.discarded += node.queued - own
    node.queued = 0
    node.tries = 0
    node.mac = Mac.IDLE.value
    node.turn += 1
    node.epoch += 1
    node.powered = False


@njit(cache=True)  # type: ignore[untyped-decorator]
def _cut(st: MediumState, sender: int) -> None:
    """End a frame before its time: nobody receives it."""
    leave(st, sender)
    for i in range(st.nodes.size):
        if st.receivers[i].lock == sender:
            let_go(st, i, Fate.POWERED_OFF.value)
        if st.fate[sender, i] != Fate.NOT_COUNTED.value:
            st.fate[sender, i] = Fate.POWERED_OFF.value
        if not st.nodes[sender].is_ack:
            st.nodes[i].fates[st.fate[sender, i]] += 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def offer(st: MediumState, number: int, kind: int, after: int) -> None:
    """A node is offered traffic of its own from now on; saturated: the first frame comes after so long."""
    node = st.nodes[number]
    node.offer = kind
    node.offer_turn += 1
    if kind == Offer.POISSON.value:
        csma.expect(st, number)
    elif kind == Offer.SATURATED.value:
        csma.schedule(st, number, Due.ARRIVAL.value, after, node.offer_turn)
