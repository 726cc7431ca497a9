"""The air between the stations: which frame is in it when, and who hears it.

A transceiver sends as soon as it has no frame of its own in the air; otherwise the frame waits in its queue,
and one that finds the queue full is dropped. It does not listen before it sends: there is no CSMA/CA here, no
acknowledgement and no spacing between frames, so busy neighbours collide more than real ones would. A
station hears a frame if it arrives at or above the sensitivity, the station itself sends nothing meanwhile,
no jammer is near and no other frame that it could hear overlaps; there is no capture: overlapping frames are
lost, all of them.
"""

import heapq
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.messages import Heard, Jam, Overflow, RadioEvent, Sent
from actors.radio.frame import airtime_us, octets
from actors.radio.parameters import RadioParameters
from actors.radio.path_loss import received_dbm
from actors.radio.stations import Stations
from actors.radio.tally import Fate, Tally

# The order of what happens at one instant: a frame that ends makes room before another begins.
END: Final = 0
BEGIN: Final = 1
REQUEST: Final = 2


class Request(NamedTuple):
    """Station number `station` hands a frame, of a size that is allowed, to its transceiver."""

    instant: int
    station: int
    tag: int
    data: bytes


class Notice(NamedTuple):
    """What the transceiver of a station has to say."""

    station: int
    event: RadioEvent


class Medium:
    """All transceivers and the frames between them; all instants are integer µs.

    What happens does not depend on how the time is cut into steps as long as the stations stand still.
    """

    def __init__(self, addresses: Sequence[int], parameters: RadioParameters, tally: Tally) -> None:
        n = len(addresses)
        self._addresses = tuple(addresses)
        self._parameters = parameters
        self._tally = tally
        self._agenda: list[tuple[int, int, int, int, Request]] = []
        self._serial = 0
        self._waiting: list[deque[Request]] = [deque() for _ in range(n)]
        self._busy = [False] * n
        self._powered = (False,) * n
        self._jams: list[Jam] = []
        self._notices: list[Notice] = []
        # Row: the sender of a frame in the air; column: a station.
        self._in_air = np.zeros(n, dtype=np.bool_)
        self._power_dbm = np.zeros((n, n), dtype=np.float64)
        self._reaches = np.zeros((n, n), dtype=np.bool_)
        self._fate = np.zeros((n, n), dtype=np.uint8)

    @property
    def frames_pending(self) -> int:
        """How many frames are in the air or wait in a queue."""
        return int(self._in_air.sum()) + sum(len(queue) for queue in self._waiting)

    def advance(
        self, stations: Stations, jams: Sequence[Jam], requests: Iterable[Request], until: int
    ) -> list[Notice]:
        """What the transceivers say from the step's start up to, and without, `until`, in order of time."""
        self._notices = []
        self._run(stations, stations.start, END)  # they ended before anything could be switched off
        if stations.powered != self._powered:
            self._switch(stations.powered)
        if jams or self._jams:
            self._jam(stations, jams)
        for request in requests:
            if self._powered[request.station]:
                self._schedule(request.instant, REQUEST, request)
            else:
                self._tally.frame("discarded")
        self._run(stations, until - 1, REQUEST)
        return self._notices

    def _schedule(self, instant: int, kind: int, request: Request) -> None:
        self._serial += 1
        heapq.heappush(self._agenda, (instant, kind, request.station, self._serial, request))

    def _run(self, stations: Stations, instant: int, kind: int) -> None:
        """Let everything happen that is due until the instant and, at the instant, up to the kind."""
        last = (instant, kind, len(self._addresses))
        while self._agenda and self._agenda[0][:3] < last:
            now, what, station, _, request = heapq.heappop(self._agenda)
            if what == END:
                self._end(now, request)
            elif what == BEGIN or not self._busy[station]:
                self._begin(now, request, stations)
            elif len(self._waiting[station]) < self._parameters.transmit_queue:
                self._waiting[station].append(request)
            else:
                self._tally.frame("overflowed")
                self._notices.append(Notice(station, Overflow(now, request.tag)))

    def _begin(self, now: int, request: Request, stations: Stations) -> None:
        sender = request.station
        x, y = stations.positions(now)
        dx, dy = x - x[sender], y - y[sender]
        power_dbm = received_dbm(np.sqrt(dx * dx + dy * dy), self._parameters)
        reaches = power_dbm >= self._parameters.sensitivity_dbm
        fate = np.where(reaches, Fate.HEARD, Fate.OUT_OF_RANGE).astype(np.uint8)
        if self._in_air.any():
            self._overlap(sender, reaches, fate)
        self._jams = [jam for jam in self._jams if jam.until > now]
        for jam in self._jams:
            deaf = _within(jam, x, y)
            fate[deaf] = np.maximum(fate[deaf], Fate.JAMMED)
        fate[~np.array(self._powered)] = Fate.NOT_ADDRESSED
        fate[sender] = Fate.NOT_ADDRESSED
        self._power_dbm[sender], self._reaches[sender], self._fate[sender] = power_dbm, reaches, fate
        self._in_air[sender] = self._busy[sender] = True
        self._schedule(now + airtime_us(len(request.data)), END, request)

    def _overlap(self, sender: int, reaches: NDArray[np.bool_], fate: NDArray[np.uint8]) -> None:
        """Mark the new frame and those in the air where they disturb one another."""
        others = np.flatnonzero(self._in_air)
        disturbed: NDArray[np.bool_] = np.logical_or.reduce(self._reaches[others], axis=0)
        _collide(fate, disturbed)
        fate[others] = np.maximum(fate[others], Fate.HALF_DUPLEX)
        theirs = self._fate[others]
        _collide(theirs, reaches)
        theirs[:, sender] = np.maximum(theirs[:, sender], Fate.HALF_DUPLEX)
        self._fate[others] = theirs

    def _end(self, now: int, request: Request) -> None:
        sender = request.station
        fate = self._fate[sender]
        self._tally.sent(octets(len(request.data)))
        self._tally.copies(fate)
        self._notices.append(Notice(sender, Sent(now, request.tag)))
        heard = np.flatnonzero(fate == Fate.HEARD)
        if heard.size:
            address, data = self._addresses[sender], request.data
            for station, rssi_dbm, lqi in zip(heard.tolist(), *self._quality(sender, heard), strict=True):
                self._notices.append(Notice(station, Heard(now, address, rssi_dbm, lqi, data)))
        self._in_air[sender] = False
        if self._waiting[sender]:
            self._schedule(now, BEGIN, self._waiting[sender].popleft())
        else:
            self._busy[sender] = False

    def _quality(self, sender: int, heard: NDArray[np.intp]) -> tuple[list[float], list[int]]:
        """Signal strength, dBm, and link quality as the transceiver reports them."""
        p = self._parameters
        rssi_dbm = np.rint(self._power_dbm[sender, heard] * p.rssi_steps_per_db) / p.rssi_steps_per_db
        lqi = np.clip(np.rint((rssi_dbm - p.sensitivity_dbm) / p.lqi_span_db * 255.0), 0.0, 255.0)
        return rssi_dbm.tolist(), lqi.astype(np.int64).tolist()

    def _switch(self, powered: tuple[bool, ...]) -> None:
        """Switch transceivers on and off; one that goes off forgets its queue and cuts its frame."""
        off = [i for i, (was, now) in enumerate(zip(self._powered, powered, strict=True)) if was and not now]
        self._powered = powered
        if not off:
            return
        self._fate[:, off] = np.maximum(self._fate[:, off], Fate.POWERED_OFF)
        self._agenda = [entry for entry in self._agenda if entry[2] not in off]
        heapq.heapify(self._agenda)
        for station in off:
            began = bool(self._in_air[station])
            if began:
                self._tally.frame("cut_off")
                self._tally.copies(np.maximum(self._fate[station], Fate.POWERED_OFF))
            # One that left the queue at this very instant is busy, but not yet in the air.
            next_up = int(self._busy[station] and not began)
            self._tally.frame("discarded", len(self._waiting[station]) + next_up)
            self._waiting[station].clear()
            self._in_air[station] = self._busy[station] = False

    def _jam(self, stations: Stations, jams: Sequence[Jam]) -> None:
        """Switch the jammers on: they reach the frames in the air, too."""
        self._jams = [jam for jam in (*self._jams, *jams) if jam.until > stations.start]
        x, y = stations.positions(stations.start)
        for jam in jams:
            deaf = np.flatnonzero(_within(jam, x, y))
            if jam.until > stations.start and deaf.size:
                self._fate[:, deaf] = np.maximum(self._fate[:, deaf], Fate.JAMMED)


def _within(jam: Jam, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the places lie within the jammer's radius."""
    inside: NDArray[np.bool_] = (x - jam.x) ** 2 + (y - jam.y) ** 2 <= jam.radius**2
    return inside


def _collide(fate: NDArray[np.uint8], where: NDArray[np.bool_]) -> None:
    """Mark the frames as collided at the stations (the last axis), in place."""
    np.maximum(fate, where.astype(np.uint8) * np.uint8(Fate.COLLISION), out=fate)
