"""The air between emulated boards: who hears which frame, and when a board may send.

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

from actors.instant import Instant
from actors.portable import arrays
from actors.radio.frame import airtime_us
from actors.radio.frame_check import frame_check
from actors.radio.link_budget import needed_dbm
from actors.radio.presets import PRESETS, RadioParameters
from actors.radio.propagation.path_loss import path_loss_db
from actors.radio.signal_codes import link_quality, rssi_code
from firmware_bridge.beeclick.emulation.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.signal import HEADER_SIZE

Place = Callable[[Instant], tuple[float, float]]
"""Where something is at an instant, m."""

_BACKOFF_US: Final = 320
"""aUnitBackoffPeriod, 20 symbols (IEEE 802.15.4-2006, 7.4.1)."""
_ASSESSMENT_US: Final = 128
"""8 symbols (6.9.9)."""
_TURNAROUND_US: Final = 192
"""aTurnaroundTime, 12 symbols (6.4.1)."""
_MIN_BE: Final = 3
_MAX_BE: Final = 5
_MAX_BACKOFFS: Final = 4
"""TXMCR = 0x1C (d3scomp/beeclickarm, MRF24J40.cpp); the standard's defaults, too."""


@dataclass(frozen=True)
class AirParameters:
    """How the air is."""

    radio: RadioParameters = field(default=PRESETS["beeclick"])
    """Path loss and noise; the power is that of each board, and walls do not count."""
    csma: bool = True
    """False: a frame begins when the board has it."""
    busy_dbm: float = -69.0
    """Energy from which the channel counts as busy, dBm. Default: the firmware's CCAEDTH = 0x60."""
    loss: float = 0.0
    """Share of the copies of frames that is lost at random. Default: none; in a real one
    it grows with distance."""


DEFAULTS: Final = AirParameters()
"""As the boards' firmware finds it."""


@dataclass
class _Flight:
    """A frame in the air, or about to be."""

    frame: bytes
    tries: int = 0
    channel: int = -1
    """-1: not begun."""
    dbm: list[float] = field(default_factory=list)
    """How strong it arrives at each station."""
    spoilt: set[int] = field(default_factory=set)
    """Stations that cannot hear it."""


class Air:
    """All boards and the frames between them."""

    def __init__(self, rng: np.random.Generator, parameters: AirParameters = DEFAULTS) -> None:
        self.boards: list[EmulatedBoard] = []
        self.counters = {"frames": 0, "access_failures": 0, "collisions": 0, "copies_heard": 0}
        self._rng = rng
        self._p = parameters
        self._weakest_dbm = needed_dbm(parameters.radio)
        self._places: list[Place] = []
        self._flights: dict[int, _Flight] = {}
        self._agenda: list[tuple[int, int, int, _Flight]] = []
        self._serial = 0

    def add(self, board: EmulatedBoard, place: Place) -> None:
        """Put a board, made with this air as its radio, at a place."""
        self.boards.append(board)
        self._places.append(place)

    def transmit(self, board: EmulatedBoard, now: Instant, frame: bytes) -> None:
        """As `board.Radio` says."""
        station = self._station(board)
        flight = self._flights[station] = _Flight(frame)
        self._schedule(now + (self._backoff(flight) if self._p.csma else 0), station, flight)

    def silence(self, board: EmulatedBoard) -> None:
        """As `board.Radio` says."""
        if board in self.boards:
            self._flights.pop(self._station(board), None)

    def wake(self) -> Instant | None:
        """When something happens next."""
        return Instant(self._agenda[0][0]) if self._agenda else None

    def run(self, now: Instant) -> None:
        """Let happen what is due until `now`."""
        while self._agenda and self._agenda[0][0] <= now:
            at, _, station, flight = heapq.heappop(self._agenda)
            if self._flights.get(station) is not flight:
                continue  # silenced
            if flight.channel >= 0:
                self._land(Instant(at), station, flight)
            elif self._p.csma and flight.tries >= 0:
                self._assess(Instant(at), station, flight)
            else:
                self._begin(Instant(at), station, flight)

    def _station(self, board: EmulatedBoard) -> int:
        return next(number for number, one in enumerate(self.boards) if one is board)

    def _schedule(self, at: int, station: int, flight: _Flight) -> None:
        self._serial += 1
        heapq.heappush(self._agenda, (at, self._serial, station, flight))

    def _backoff(self, flight: _Flight) -> int:
        periods = int(self._rng.integers(0, 1 << min(_MIN_BE + flight.tries, _MAX_BE)))
        return periods * _BACKOFF_US + _ASSESSMENT_US

    def _assess(self, now: Instant, station: int, flight: _Flight) -> None:
        channel = self.boards[station].channel
        others = (o for s, o in self._flights.items() if s != station and o.channel == channel)
        if not any(other.dbm[station] >= self._p.busy_dbm for other in others):
            flight.tries = -1
            self._schedule(now + _TURNAROUND_US, station, flight)
            return
        flight.tries += 1
        if flight.tries <= _MAX_BACKOFFS:
            self._schedule(now + self._backoff(flight), station, flight)
        else:
            del self._flights[station]
            self.counters["access_failures"] += 1
            self.boards[station].finished(now, False)

    def _begin(self, now: Instant, station: int, flight: _Flight) -> None:
        sender = self.boards[station]
        flight.dbm = self._arriving(now, station)
        weakest = self._weakest_dbm
        for number, other in self._flights.items():
            if number != station and other.channel == sender.channel:
                self._overlap(station, flight, number, other)
        flight.channel = sender.channel
        flight.spoilt |= {s for s, dbm in enumerate(flight.dbm) if dbm < weakest} | {station}
        self._schedule(now + airtime_us(len(flight.frame) - HEADER_SIZE), station, flight)

    def _overlap(self, a: int, flight: _Flight, b: int, other: _Flight) -> None:
        """Two frames at once: lost where both would be heard, and at both senders."""
        weakest = self._weakest_dbm
        both = {
            station
            for station, (one, two) in enumerate(zip(flight.dbm, other.dbm, strict=True))
            if one >= weakest and two >= weakest
        }
        self.counters["collisions"] += bool(both - {a, b})
        flight.spoilt |= both | {b}
        other.spoilt |= both | {a}

    def _arriving(self, now: Instant, station: int) -> list[float]:
        places = np.array([place(now) for place in self._places], dtype=np.float64)
        distances = arrays.hypot(*(places - places[station]).T)
        loss = path_loss_db(distances, self._p.radio.propagation.path_loss)
        dbm: list[float] = (self.boards[station].power_dbm - loss).tolist()
        return dbm

    def _land(self, now: Instant, station: int, flight: _Flight) -> None:
        del self._flights[station]
        self.counters["frames"] += 1
        whole = flight.frame + frame_check(flight.frame).to_bytes(2, "little")
        for number, board in enumerate(self.boards):
            if number in flight.spoilt or board.channel != flight.channel:
                continue
            if self._p.loss and self._rng.random() < self._p.loss:
                continue
            self.counters["copies_heard"] += 1
            board.heard(
                now, whole, rssi_code(flight.dbm[number]), link_quality(flight.dbm[number], self._weakest_dbm)
            )
        self.boards[station].finished(now, True)


def advance(air: Air, until: Instant) -> None:
    """Let everything happen in the air and on its boards up to `until`, in the order of time.

    What the boards have to say stays with them; their `run(until)` gives it.
    """
    while True:
        wakes = [air.wake(), *(board.wake() for board in air.boards)]
        times = [at for at in wakes if at is not None and at <= until]
        if not times:
            return
        now = min(times)
        air.run(now)
        for board in air.boards:
            board.settle(now)
