"""The medium as the robots know it: frames with their data and jams in, what the transceivers say out."""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.messages import AccessFailure, Heard, Jam, Overflow, RadioEvent, Sent
from actors.portable import arrays, exp10
from actors.radio.frame import octets
from actors.radio.link_budget import needed_dbm
from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import Kind
from actors.radio.propagation.interferers import Jammer
from actors.radio.radio_model import RadioModel
from actors.radio.signal_codes import link_qualities, rssi_codes, strengths_dbm
from actors.radio.transceiver_truth import TransceiverTruth

_HEARD: Final = int(Kind.HEARD)
_SENT: Final = int(Kind.SENT)
_NEVER_CLEAR: Final = int(Kind.ACCESS_FAILURE)


class Handed(NamedTuple):
    """A frame, of a size that is allowed, that a robot hands to its transceiver."""

    instant: int
    """µs."""
    transceiver: int
    """Its number on the medium."""
    tag: int
    data: bytes


Notices = list[list[RadioEvent]]
"""By a transceiver's number: what it has to say to its robot, in order of time."""


class RobotMedium:
    """All transceivers and the frames between them; it keeps the frames' data, the medium their sizes."""

    def __init__(self, addresses: Sequence[int], model: RadioModel, seed: int) -> None:
        parameters = model.parameters
        self._addresses = tuple(addresses)
        self._noise_mw = exp10(parameters.phy.noise_dbm / 10.0)
        self._weakest_dbm = needed_dbm(parameters)
        self.medium = Medium(
            [parameters.transceiver.numbered(address) for address in addresses],
            model.propagation,
            parameters.phy,
            seed=seed,
            interferers=model.interferers,
        )
        self._powered = (True,) * len(self._addresses)
        self._epochs: tuple[int, ...] | None = None
        self.discarded = 0
        """Notices that nobody was given: the epoch that they belong to was over."""
        self._placed: NDArray[np.float64] | None = None
        # By transceiver, then by a number that is the medium's tag: the robot's own tags need not differ.
        self._frames: list[dict[int, Handed]] = [{} for _ in self._addresses]
        self._serial = 0

    def advance(
        self, truth: TransceiverTruth, jams: Sequence[Jam], handed: Iterable[Handed], until: int
    ) -> Notices:
        """What the transceivers say from the step's start up to, and without, `until`, µs.

        The transceivers of `handed` must be on. One in a new epoch says nothing of the one before.
        """
        notices: Notices = [[] for _ in self._addresses]
        if truth.powered != self._powered or truth.epochs != self._epochs:
            restarted = self._restarted(truth.epochs)
            self._note(self.medium.finish_frames(), notices)
            for number in restarted:
                self.discarded += len(notices[number])
                notices[number].clear()
            self._switch(truth.powered, restarted)
        self._move(truth)
        now_ns = self.medium.now_ns
        for jam in jams:
            self.medium.add(Jammer(jam.x, jam.y, jam.radius, now_ns, jam.until * 1000))
        self.medium.submit([self._request(frame) for frame in handed])
        self._note(self.medium.run(until * 1000), notices)
        return notices

    def handed(self, transceiver: int, serial: int) -> Handed:
        """A frame of which the medium has not said yet what became of it; `serial` is its tag there."""
        return self._frames[transceiver][serial]

    def _request(self, frame: Handed) -> Request:
        self._serial += 1
        self._frames[frame.transceiver][self._serial] = frame
        return Request(frame.instant * 1000, frame.transceiver, octets(len(frame.data)), tag=self._serial)

    def _restarted(self, epochs: tuple[int, ...]) -> frozenset[int]:
        """The transceivers whose epoch is another one than in the step before."""
        before, self._epochs = self._epochs or epochs, epochs
        return frozenset(
            number for number, (was, now) in enumerate(zip(before, epochs, strict=True)) if was != now
        )

    def _switch(self, powered: tuple[bool, ...], restarted: frozenset[int]) -> None:
        """Switch on and off; what was restarted was off in between, and has forgotten everything."""
        for number, (was, on) in enumerate(zip(self._powered, powered, strict=True)):
            off = was and (not on or number in restarted)
            if off:
                self.medium.switch(number, False)
                self._frames[number].clear()
            if on and (off or not was):
                self.medium.switch(number, True)
        self._powered = powered

    def _move(self, truth: TransceiverTruth) -> None:
        if not truth.still:
            self._placed = None
            self.medium.follow(truth.positions)
        elif self._placed is None or not np.array_equal(self._placed, truth.places):
            self._placed = truth.places
            self.medium.place(truth.places)

    def _note(self, events: NDArray[np.void], notices: Notices) -> None:
        if not events.size:
            return
        strengths, qualities = self._quality(events["power_mw"], events["sinr"])
        addresses, frames = self._addresses, self._frames
        rows = zip(events.tolist(), strengths.tolist(), qualities.tolist(), strict=True)
        for (instant_ns, kind, number, sender, _, _, serial, *_), strength, quality in rows:
            instant = instant_ns // 1000
            if kind == _HEARD:
                data = frames[sender][serial].data
                notices[number] += (Heard(instant, addresses[sender], strength, quality, data),)
            else:
                says = Sent if kind == _SENT else AccessFailure if kind == _NEVER_CLEAR else Overflow
                notices[number] += (says(instant, frames[number].pop(serial).tag),)

    def _quality(
        self, power_mw: NDArray[np.float64], sinr: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Signal strengths, dBm, and link qualities, as the chip's codes can say them; (n,) each.

        What lowers the ratio lowers the quality as if the frame had arrived that much weaker. Of events that
        tell of no frame heard both mean nothing.
        """
        strengths = strengths_dbm(rssi_codes(10.0 * arrays.log10(power_mw)))
        as_strong_dbm = 10.0 * arrays.log10(np.minimum(power_mw, sinr * self._noise_mw))
        return strengths, link_qualities(as_strong_dbm, self._weakest_dbm)
