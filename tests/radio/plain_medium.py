"""Independent model of the medium in plain Python: slow searches in a history of all transmissions.

It shares only parameters and random numbers with `actors.radio.medium.medium`: interference, energy and
carriers are found in the history, frame error rates by the formula.
"""

import heapq
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.medium import Request
from actors.radio.medium.reception import ACK_RECEPTION, BACKOFF, RECEPTION, bit_error_rate, keyed_uniform
from actors.radio.medium.state import BROADCAST, Cca, EventKind, Outcome, PhyParameters, Transceiver

SYMBOL = 16_000
ENDS, ACK_ENDS, CCA_ENDS, BEGINS, ACK_BEGINS, TIMES_OUT, SPACED, CCA_BEGINS, ARRIVES = range(9)
EventRow = tuple[int, int, int, int, int]
"""Instant, kind, transceiver, other, tag."""


def mw(dbm: float) -> float:
    return float(10.0 ** (dbm / 10.0))


@cache
def log_right(sinr: float) -> float:
    return math.log1p(-float(bit_error_rate(np.array(sinr))))


@dataclass
class Flight:
    sender: int
    request: Request
    number: int
    draw: int
    begin: int
    end: int
    ack_of: int | None = None
    outcomes: dict[int, Outcome] = field(default_factory=dict)


@dataclass
class PlainTransceiver:
    queue: deque[tuple[int, Request]] = field(default_factory=deque)
    doing: str = "nothing"
    number: int = 0
    nb: int = 0
    be: int = 0
    tries: int = 0
    waiting_for: int = -1
    ready: int = 0
    dead_until: int = 0
    lock: Flight | None = None
    locked: int = 0
    locks: list[tuple[int, int]] = field(default_factory=list)
    """Begin and end of each lock of the receiver."""
    cca_deaf: bool = False


class PlainMedium:
    def __init__(
        self,
        transceivers: list[Transceiver],
        losses_db: NDArray[np.float64],
        phy: PhyParameters,
        seed: int,
        bursts: list[tuple[int, int, float]],
    ) -> None:
        """Create a medium; `bursts`: begin and end, ns, and power, mW, at all transceivers."""
        self.t = transceivers
        tx = np.array([t.tx_power_dbm for t in transceivers])
        self.power = 10.0 ** ((tx[:, None] - losses_db) / 10.0)
        self.phy, self.seed, self.bursts = phy, seed, bursts
        self.state = [PlainTransceiver() for _ in transceivers]
        self.history: list[Flight] = []
        self.said: list[EventRow] = []
        self.outcomes = [dict.fromkeys(Outcome, 0) for _ in transceivers]
        self.agenda: list[tuple[int, int, int, int, Any]] = []
        self.serial = 0
        self.now = 0

    def play(self, requests: list[Request]) -> list[EventRow]:
        for request in requests:
            self.at(request.instant_ns, ARRIVES, request.transceiver, request)
        while self.agenda:
            self.now, due, i, _, what = heapq.heappop(self.agenda)
            handlers: tuple[Callable[[int, Any], None], ...] = (
                self.frame_end, self.ack_end, self.cca_end, self.frame_begin, self.ack_begin,
                self.timeout, self.spaced, self.cca_begin, self.arrival,
            )  # fmt: skip
            handlers[due](i, what)
        return self.said

    def at(self, instant: int, due: int, number: int, what: object = None) -> None:
        self.serial += 1
        heapq.heappush(self.agenda, (instant, due, number, self.serial, what))

    # --- the MAC -------------------------------------------------------------------------------------------

    def arrival(self, i: int, request: Request) -> None:
        own = self.state[i]
        number, own.number = own.number, own.number + 1
        if len(own.queue) == self.t[i].queue:
            self.said.append((self.now, EventKind.OVERFLOW, i, -1, request.tag))
            return
        own.queue.append((number, request))
        if own.doing == "nothing":
            self.access(i)

    def access(self, i: int) -> None:
        own = self.state[i]
        own.doing, own.nb, own.be = "backing off", 0, self.t[i].min_be
        self.back_off(i)

    def back_off(self, i: int) -> None:
        own = self.state[i]
        key = own.tries * 16 + own.nb
        luck = keyed_uniform(self.seed, BACKOFF, self.t[i].address, own.queue[0][0], key)
        self.at(self.now + int(luck * 2**own.be) * 20 * SYMBOL, CCA_BEGINS, i)

    def cca_begin(self, i: int, _: object) -> None:
        own = self.state[i]
        own.cca_deaf = own.ready > self.now
        if self.t[i].cca == Cca.NEVER and not own.cca_deaf:
            self.turn_around(i)
        else:
            self.at(self.now + 8 * SYMBOL, CCA_ENDS, i)

    def cca_end(self, i: int, _: object) -> None:
        own, settings = self.state[i], self.t[i]
        if self.is_clear(i):
            self.turn_around(i)
            return
        own.nb, own.be = own.nb + 1, min(own.be + 1, settings.max_be)
        if own.nb <= settings.max_backoffs:
            self.back_off(i)
        else:
            own.doing = "nothing"
            self.done(i, EventKind.ACCESS_FAILURE)

    def is_clear(self, i: int) -> bool:
        own, since = self.state[i], self.now - 8 * SYMBOL
        if own.cca_deaf or own.ready > self.now:
            return False
        spans = [(f.begin, f.end, self.power[f.sender, i]) for f in self.history if f.sender != i]
        spans += self.bursts
        energy = sum(p * max(min(e, self.now) - max(b, since), 0) for b, e, p in spans) / (8 * SYMBOL)
        carrier = own.lock is not None or any(e > since for _, e in own.locks)
        if self.phy.peak_cca:
            edges = [self.now, *(b for b, _, _ in spans if since <= b <= self.now)]
            energy = max(sum(p for b, e, p in spans if b <= at < e) for at in edges)
            carrier = own.lock is not None
        loud = energy >= mw(self.t[i].cca_threshold_dbm)
        busy = {Cca.ENERGY: loud, Cca.CARRIER: carrier, Cca.EITHER: loud or carrier}
        return not busy.get(self.t[i].cca, loud and carrier)

    def turn_around(self, i: int) -> None:
        own = self.state[i]
        if own.lock:
            own.lock.outcomes[i] = Outcome.HALF_DUPLEX
            self.unlock(own)
        own.ready, own.doing = 2**62, "turnaround"
        self.at(self.now + 12 * SYMBOL, BEGINS, i)

    def frame_begin(self, i: int, _: object) -> None:
        own = self.state[i]
        number, request = own.queue[0]
        end = self.now + (12 + 2 * request.octets) * SYMBOL
        flight = Flight(i, request, number, number * 16 + own.tries, self.now, end)
        own.doing = "sending"
        self.appear(flight)
        self.at(end, ENDS, i, flight)

    def frame_end(self, i: int, flight: Flight) -> None:
        own, request = self.state[i], flight.request
        self.vanish(flight)
        own.ready = self.now + 12 * SYMBOL
        asks = request.ack and request.to != BROADCAST
        for j, outcome in flight.outcomes.items():
            heard = outcome == Outcome.HEARD and request.to in (BROADCAST, j)
            self.outcomes[j][Outcome.FILTERED if outcome == Outcome.HEARD and not heard else outcome] += 1
            if heard:
                self.said.append((self.now, EventKind.HEARD, j, i, request.tag))
                phy, other = self.phy, self.state[j]
                read = min(request.octets, phy.dead_octets)
                other.dead_until = self.now + 1000 * (phy.dead_us + phy.dead_octet_us * read)
                if asks:
                    other.ready = 2**62
                    self.at(self.now + 12 * SYMBOL, ACK_BEGINS, j, flight)
        if asks:
            own.doing, own.waiting_for = "awaiting", flight.draw
            self.at(self.now + 54 * SYMBOL, TIMES_OUT, i, flight.draw)
        else:
            self.space(i)

    def ack_begin(self, i: int, data: Flight) -> None:
        request = Request(self.now, i, 5, data.sender)
        ack = Flight(i, request, data.number, data.draw, self.now, self.now + 22 * SYMBOL, data.sender)
        self.appear(ack)
        self.at(ack.end, ACK_ENDS, i, ack)

    def ack_end(self, i: int, ack: Flight) -> None:
        self.vanish(ack)
        self.state[i].ready = self.now + 12 * SYMBOL
        asker = self.state[ack.request.to]
        waits = asker.doing == "awaiting" and asker.queue[0][0] == ack.number
        if waits and ack.outcomes[ack.request.to] == Outcome.HEARD:
            self.space(ack.request.to)

    def timeout(self, i: int, draw: int) -> None:
        own = self.state[i]
        if own.doing != "awaiting" or own.waiting_for != draw:
            return
        if own.tries < self.t[i].max_retries:
            own.tries += 1
            self.access(i)
        else:
            own.doing = "nothing"
            self.done(i, EventKind.NO_ACK)

    def space(self, i: int) -> None:
        own = self.state[i]
        own.doing = "spacing"
        self.at(self.now + (12 if own.queue[0][1].octets <= 18 else 40) * SYMBOL, SPACED, i)
        self.done(i, EventKind.SENT)

    def spaced(self, i: int, _: object) -> None:
        self.state[i].doing = "nothing"
        if self.state[i].queue:
            self.access(i)

    def done(self, i: int, kind: EventKind) -> None:
        own = self.state[i]
        _, request = own.queue.popleft()
        own.tries = 0
        self.said.append((self.now, kind, i, request.to, request.tag))
        if own.doing == "nothing" and own.queue:
            self.access(i)

    # --- the PHY -------------------------------------------------------------------------------------------

    def unlock(self, own: PlainTransceiver) -> None:
        own.locks.append((own.locked, self.now))
        own.lock = None

    def sums(self, i: int, at: int, but: Flight) -> tuple[float, float]:
        frames = [f for f in self.history if f is not but and f.sender != i and f.begin <= at < f.end]
        return sum(self.power[f.sender, i] for f in frames), sum(p for b, e, p in self.bursts if b <= at < e)

    def appear(self, flight: Flight) -> None:
        for i, own in enumerate(self.state):
            if i != flight.sender:
                flight.outcomes[i] = self.meet(i, own, flight)
        self.history.append(flight)

    def meet(self, i: int, own: PlainTransceiver, flight: Flight) -> Outcome:
        phy, power = self.phy, self.power[flight.sender, i]
        noise, lock = mw(phy.noise_dbm), mw(phy.lock_sinr_db)
        if power < max(mw(self.t[i].sensitivity_dbm), noise * lock):
            return Outcome.BELOW_SENSITIVITY
        if own.ready > self.now:
            return Outcome.HALF_DUPLEX
        if own.dead_until > self.now:
            return Outcome.RECEIVER_BUSY
        frames, outside = self.sums(i, self.now, flight)
        clear = power > lock * (noise + outside + mw(phy.cochannel_penalty_db) * frames)
        if own.lock is None and not clear:
            return Outcome.COLLISION if power > lock * (noise + outside) else Outcome.DISTURBED
        if own.lock is not None:
            first = self.power[own.lock.sender, i]
            late = self.now - own.locked >= phy.capture_us * 1000
            if late or not clear or power < mw(phy.capture_db) * first:
                return Outcome.COLLISION
            own.lock.outcomes[i] = Outcome.COLLISION
            self.unlock(own)
        own.lock, own.locked = flight, self.now
        return Outcome.HEARD

    def vanish(self, flight: Flight) -> None:
        for i, own in enumerate(self.state):
            if own.lock is flight:
                self.unlock(own)
                flight.outcomes[i] = self.outcome(i, flight)

    def outcome(self, i: int, flight: Flight) -> Outcome:
        edges = {flight.begin, flight.end}
        for begin, end in [*((f.begin, f.end) for f in self.history), *((b, e) for b, e, _ in self.bursts)]:
            edges |= {at for at in (begin, end) if flight.begin < at < flight.end}
        power, noise = self.power[flight.sender, i], mw(self.phy.noise_dbm)
        right = quiet = alone = 0.0
        cuts = sorted(edges)
        for begin, end in pairwise(cuts):
            frames, outside = self.sums(i, begin, flight)
            bits = (end - begin) * 250e-6
            quiet += bits * log_right(power / noise)
            alone += bits * log_right(power / (noise + outside))
            disturbing = noise + outside + mw(self.phy.cochannel_penalty_db) * frames
            right += bits * log_right(power / disturbing)
        purpose = RECEPTION if flight.ack_of is None else ACK_RECEPTION
        origin = flight.sender if flight.ack_of is None else flight.ack_of
        luck = keyed_uniform(self.seed, purpose, self.t[origin].address, flight.draw, self.t[i].address)
        for log, outcome in ((right, Outcome.HEARD), (quiet, None), (alone, Outcome.COLLISION)):
            if outcome is None and luck >= math.exp(log):
                return Outcome.BELOW_SENSITIVITY
            if outcome is not None and luck < math.exp(log):
                return outcome
        return Outcome.DISTURBED
