"""The medium between emulated boards: who hears which frame, and when a board may send.

Much plainer than the simulated radio (actors.radio.medium.medium): a frame arrives where path loss leaves
enough of it, half duplex, collisions without capture; but as single events in the order of time, as boards
answer at once and may differ in channel and power, and with the chip's unslotted CSMA-CA, whose clear channel
assessment is by energy alone.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from actors.ieee802154 import CCA_NS, TURNAROUND_NS, UNIT_BACKOFF_NS, airtime_ns
from actors.instant import Instant
from actors.radio.link_budget import needed_dbm
from actors.radio.presets import PRESETS, RadioParameters
from actors.radio.propagation.indoor import IndoorPropagation, PropagationParameters
from actors.radio.signal_codes import link_qualities, rssi_codes
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard

Place = Callable[[Instant], tuple[float, float]]
"""Where something is at an instant, m."""

_FIRMWARE: Final = PRESETS["beeclick"].transceiver
"""As the boards' firmware sets the chip up."""
_US: Final = 1000
"""ns."""


@dataclass(frozen=True)
class MediumParameters:
    """What lies between the boards, and how they share it."""

    radio: RadioParameters = PRESETS["beeclick"]
    """Path loss and noise; the power is that of each board, and walls do not count."""
    csma: bool = True
    """False: a frame begins when the board has it."""
    busy_dbm: float = _FIRMWARE.cca_threshold_dbm
    """Energy from which the channel counts as busy, dBm. Default: the firmware's, -69."""
    loss: float = 0.0
    """Share of the copies of frames that is lost at random. Default: none; on a real medium it grows with
    distance."""


DEFAULTS: Final = MediumParameters()
"""As the boards' firmware finds it."""


@dataclass
class _Flight:
    """A frame in the air, or about to be."""

    psdu: bytes
    tries: int = 0
    channel: int = -1
    """-1: not begun."""
    dbm: list[float] = field(default_factory=list)
    """How strong it arrives at each board."""
    spoilt: set[int] = field(default_factory=set)
    """Numbers of the boards that cannot hear it."""


class EmulatedMedium:
    """All boards and the frames between them."""

    def __init__(self, rng: np.random.Generator, parameters: MediumParameters = DEFAULTS) -> None:
        self.boards: list[EmulatedBoard] = []
        self.counters = {"frames": 0, "access_failures": 0, "collisions": 0, "copies_heard": 0}
        self._rng = rng
        self._p = parameters
        self._weakest_dbm = needed_dbm(parameters.radio)
        self._propagation = IndoorPropagation(PropagationParameters(parameters.radio.propagation.path_loss))
        self._places: list[Place] = []
        self._flights: dict[int, _Flight] = {}
        self._agenda: list[tuple[int, int, int, _Flight]] = []
        self._serial = 0

    def add(self, board: EmulatedBoard, place: Place) -> None:
        """Put a board, made with this medium as its radio, at a place."""
        self.boards.append(board)
        self._places.append(place)

    def transmit(self, board: EmulatedBoard, now: Instant, psdu: bytes) -> None:
        """As `board.Radio` says."""
        sender = self._number(board)
        flight = self._flights[sender] = _Flight(psdu)
        self._schedule(now + (self._backoff(flight) if self._p.csma else 0), sender, flight)

    def silence(self, board: EmulatedBoard) -> None:
        """As `board.Radio` says."""
        if board in self.boards:
            self._flights.pop(self._number(board), None)

    def wake(self) -> Instant | None:
        """When something happens next."""
        return Instant(self._agenda[0][0]) if self._agenda else None

    def run(self, now: Instant) -> None:
        """Let happen what is due until `now`."""
        while self._agenda and self._agenda[0][0] <= now:
            at, _, sender, flight = heapq.heappop(self._agenda)
            if self._flights.get(sender) is not flight:
                continue  # silenced
            if flight.channel >= 0:
                self._land(Instant(at), sender, flight)
            elif self._p.csma and flight.tries >= 0:
                self._assess(Instant(at), sender, flight)
            else:
                self._begin(Instant(at), sender, flight)

    def _number(self, board: EmulatedBoard) -> int:
        return next(number for number, one in enumerate(self.boards) if one is board)

    def _schedule(self, at: int, sender: int, flight: _Flight) -> None:
        self._serial += 1
        heapq.heappush(self._agenda, (at, self._serial, sender, flight))

    def _backoff(self, flight: _Flight) -> int:
        """Until the end of the assessment after it, µs."""
        be = min(_FIRMWARE.min_be + flight.tries, _FIRMWARE.max_be)
        return (int(self._rng.integers(0, 1 << be)) * UNIT_BACKOFF_NS + CCA_NS) // _US

    def _assess(self, now: Instant, sender: int, flight: _Flight) -> None:
        channel = self.boards[sender].channel
        others = (o for number, o in self._flights.items() if number != sender and o.channel == channel)
        if not any(other.dbm[sender] >= self._p.busy_dbm for other in others):
            flight.tries = -1
            self._schedule(now + TURNAROUND_NS // _US, sender, flight)
            return
        flight.tries += 1
        if flight.tries <= _FIRMWARE.max_backoffs:
            self._schedule(now + self._backoff(flight), sender, flight)
        else:
            del self._flights[sender]
            self.counters["access_failures"] += 1
            self.boards[sender].finished(now, False)

    def _begin(self, now: Instant, sender: int, flight: _Flight) -> None:
        channel = self.boards[sender].channel
        flight.dbm = self._arriving(now, sender)
        weakest = self._weakest_dbm
        for number, other in self._flights.items():
            if number != sender and other.channel == channel:
                self._overlap(sender, flight, number, other)
        flight.channel = channel
        flight.spoilt |= {number for number, dbm in enumerate(flight.dbm) if dbm < weakest} | {sender}
        self._schedule(now + airtime_ns(len(flight.psdu)) // _US, sender, flight)

    def _overlap(self, a: int, flight: _Flight, b: int, other: _Flight) -> None:
        """Two frames at once: lost where both would be heard, and at both senders."""
        weakest = self._weakest_dbm
        both = {
            number
            for number, (one, two) in enumerate(zip(flight.dbm, other.dbm, strict=True))
            if one >= weakest and two >= weakest
        }
        self.counters["collisions"] += bool(both - {a, b})
        flight.spoilt |= both | {b}
        other.spoilt |= both | {a}

    def _arriving(self, now: Instant, sender: int) -> list[float]:
        places = np.array([place(now) for place in self._places], dtype=np.float64)
        loss_db = self._propagation.loss_db(places[sender : sender + 1], places)[0]
        dbm: list[float] = (self.boards[sender].power_dbm - loss_db).tolist()
        return dbm

    def _land(self, now: Instant, sender: int, flight: _Flight) -> None:
        del self._flights[sender]
        self.counters["frames"] += 1
        dbm = np.array(flight.dbm)
        codes, qualities = rssi_codes(dbm).tolist(), link_qualities(dbm, self._weakest_dbm).tolist()
        for number, board in enumerate(self.boards):
            if number in flight.spoilt or board.channel != flight.channel:
                continue
            if self._p.loss and self._rng.random() < self._p.loss:
                continue
            self.counters["copies_heard"] += 1
            board.heard(now, flight.psdu, codes[number], qualities[number])
        self.boards[sender].finished(now, True)


def advance(medium: EmulatedMedium, until: Instant) -> None:
    """Let everything happen on the medium and its boards up to `until`, in the order of time.

    What the boards have to say stays with them; their `run(until)` gives it.
    """
    while True:
        wakes = [medium.wake(), *(board.wake() for board in medium.boards)]
        times = [at for at in wakes if at is not None and at <= until]
        if not times:
            return
        now = min(times)
        medium.run(now)
        for board in medium.boards:
            board.settle(now)
