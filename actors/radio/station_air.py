"""The medium as the robots' transceivers know it: requests and jams in, what they have to say out."""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.messages import AccessFailure, Heard, Jam, Overflow, RadioEvent, Sent
from actors.portable import exp10, log10
from actors.radio.frame import octets
from actors.radio.link_budget import needed_dbm
from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Kind
from actors.radio.propagation.interferers import Jammer
from actors.radio.signal_codes import link_quality, rssi_code, rssi_dbm
from actors.radio.stations import Stations
from actors.radio.surroundings import Surroundings

_FIELDS: Final = ["kind", "node", "tag", "instant_ns", "other", "power_mw", "sinr"]
_HEARD: Final = int(Kind.HEARD)


class Handed(NamedTuple):
    """A frame, of a size that is allowed, that station number `station` hands to its transceiver."""

    instant: int
    """µs."""
    station: int
    tag: int
    data: bytes


class Notice(NamedTuple):
    """What the transceiver of a station has to say."""

    station: int
    event: RadioEvent


class StationAir:
    """All stations and the frames between them; it keeps the frames' data, the medium their sizes."""

    def __init__(self, addresses: Sequence[int], around: Surroundings, seed: int) -> None:
        parameters = around.parameters
        self._addresses = tuple(addresses)
        self._noise_mw = exp10(parameters.phy.noise_dbm / 10.0)
        self._weakest_dbm = needed_dbm(parameters)
        self.medium = Medium(
            [parameters.transceiver.numbered(address) for address in addresses],
            around.propagation,
            parameters.phy,
            seed=seed,
            interferers=around.interferers,
        )
        self._powered = (True,) * len(self._addresses)
        self._epochs: tuple[int, ...] | None = None
        self.discarded = 0
        """Notices that nobody was given: the epoch that they belong to was over."""
        self._placed: NDArray[np.float64] | None = None
        # By station, then by a number that is the medium's tag: the robot's own tags need not differ.
        self._frames: list[dict[int, Handed]] = [{} for _ in self._addresses]
        self._serial = 0

    def advance(
        self, stations: Stations, jams: Sequence[Jam], handed: Iterable[Handed], until: int
    ) -> list[Notice]:
        """What the transceivers say from the step's start up to, and without, `until`, µs, in order of time.

        The stations of `handed` must be on. A station in a new epoch says nothing of the one before.
        """
        restarted = self._restarted(stations.epochs)
        ended = self._notices(self.medium.finish_frames())
        notices = [notice for notice in ended if notice.station not in restarted]
        self.discarded += len(ended) - len(notices)
        self._switch(stations.powered, restarted)
        self._move(stations)
        now_ns = self.medium.now_ns
        for jam in jams:
            self.medium.add(Jammer(jam.x, jam.y, jam.radius, now_ns, jam.until * 1000))
        self.medium.submit([self._request(frame) for frame in handed])
        return notices + self._notices(self.medium.run(until * 1000))

    def _request(self, frame: Handed) -> Request:
        self._serial += 1
        self._frames[frame.station][self._serial] = frame
        return Request(frame.instant * 1000, frame.station, octets(len(frame.data)), tag=self._serial)

    def _restarted(self, epochs: tuple[int, ...]) -> frozenset[int]:
        """The stations whose epoch is another one than in the step before."""
        before, self._epochs = self._epochs or epochs, epochs
        return frozenset(
            station for station, (was, now) in enumerate(zip(before, epochs, strict=True)) if was != now
        )

    def _switch(self, powered: tuple[bool, ...], restarted: frozenset[int]) -> None:
        """Switch on and off; what was restarted was off in between, and has forgotten everything."""
        for station, (was, on) in enumerate(zip(self._powered, powered, strict=True)):
            if was and (not on or station in restarted):
                self.medium.switch(station, False)
                self._frames[station].clear()
            if on:
                self.medium.switch(station, True)
        self._powered = powered

    def _move(self, stations: Stations) -> None:
        if not stations.still:
            self._placed = None
            self.medium.follow(stations.positions)
        elif self._placed is None or not np.array_equal(self._placed, stations.places):
            self._placed = stations.places
            self.medium.place(stations.places)

    def _notices(self, events: NDArray[np.void]) -> list[Notice]:
        return [self._notice(*event) for event in events[_FIELDS].tolist()]

    def _notice(
        self, kind: int, station: int, serial: int, at_ns: int, sender: int, power_mw: float, sinr: float
    ) -> Notice:
        instant = at_ns // 1000
        if kind == _HEARD:
            rssi, lqi = self._quality(power_mw, sinr)
            data = self._frames[sender][serial].data
            return Notice(station, Heard(instant, self._addresses[sender], rssi, lqi, data))
        frame = self._frames[station].pop(serial)
        if kind == Kind.SENT:
            return Notice(station, Sent(instant, frame.tag))
        says = AccessFailure if kind == Kind.ACCESS_FAILURE else Overflow
        return Notice(station, says(instant, frame.tag))

    def _quality(self, power_mw: float, sinr: float) -> tuple[float, int]:
        """Signal strength, dBm, and link quality, as the chip's codes can say them.

        What lowers the ratio lowers the quality as if the frame had arrived that much weaker.
        """
        strength = rssi_dbm(rssi_code(10.0 * log10(power_mw)))
        as_strong_dbm = 10.0 * log10(min(power_mw, sinr * self._noise_mw))
        return strength, link_quality(as_strong_dbm, self._weakest_dbm)
