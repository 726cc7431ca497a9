"""The air of a laboratory: the simulated medium, on which emulated boards are the transceivers.

Who hears what is decided by `actors.radio`, as in a simulated run. Here is what belongs to boards alone: they
answer at once, may be tuned to different channels, and be told another power.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Final, Protocol

import msgspec
import numpy as np

from actors.instant import START, Instant
from actors.messages import Heard, Jam, RadioEvent, RobotTruth
from actors.radio.frame import DataFrame, rssi_codes
from actors.radio.radio_model import RadioModel, RadioSetup, preset, radio_model
from actors.radio.robot_medium import FrameCounters, Handed, RobotMedium, TransceiverTruth
from firmware_bridge.beeclick.reception import FIRST_CHANNEL, BoardSettings

USUAL_DBM: Final = BoardSettings(0).power_dbm
"""A device that is set to this power sends with that of the radio's preset; others as much above or below."""
State = tuple[float, float, float, float, float, float]
"""x, y, heading; vx, vy, omega, as `Bodies.truth` has them."""


class Device(Protocol):
    """A transceiver with what drives it, such as an `EmulatedBoard`."""

    pan: int
    address: int
    channel: int
    """The code, 0 to 15."""
    power_dbm: float

    def take(self, now: Instant, data: bytes) -> None:
        """Bytes that its host begins to send now."""

    def run(self, now: Instant) -> bytes:
        """Do what is due until `now`; the bytes that have come to the host since the last time."""

    def settle(self, now: Instant) -> None:
        """Do what is due until `now`."""

    def wake(self) -> Instant | None:
        """When something will be due; None: nothing is."""

    def finished(self, now: Instant, end: RadioEvent) -> None:
        """What has become of a frame of its own, by the tag that it gave it."""

    def heard(self, now: Instant, frame: DataFrame, rssi: int, lqi: int) -> None:
        """A frame of another one's, with the codes of the chip."""


class BoardRadio(Protocol):
    """The medium, as a device finds it: an `Air`."""

    def transmit(self, device: Device, now: Instant, tag: int, data: bytes) -> None:
        """Send a frame; the device's `finished` says what has become of it."""

    def silence(self, device: Device) -> None:
        """Forget all that it was handed."""


class _Channel:
    """The medium of one channel; a device that is tuned to another one is off there."""

    def __init__(self, addresses: Sequence[int], model: RadioModel, seed: int, jams: Sequence[Jam]) -> None:
        self.robots = RobotMedium(addresses, model, seed)
        self.usual_dbm = model.parameters.transceiver.tx_power_dbm
        self.handed: list[Handed] = []
        self.jams = list(jams)

    @property
    def wake(self) -> Instant | None:
        """The first µs by which something has happened; None: nothing is due."""
        due = [frame.instant for frame in self.handed[:1]]
        if (wake_ns := self.robots.medium.wake_ns) is not None:
            due.append(wake_ns // 1000)
        return Instant(min(due) + 1) if due else None


class EmulatedAir:
    """All devices and the frames between them, as events in the order of time."""

    def __init__(self, addresses: Sequence[int], model: Callable[[int], RadioModel], seed: int) -> None:
        """`addresses`: a device's each, in the order in which they will be put there; they and the seed key
        all that is random. `model`: of a channel, 11 to 26.
        """
        self.devices: list[Device] = []
        self._addresses = tuple(addresses)
        self._model = model
        self._seed = seed
        self._channels: dict[int, _Channel] = {}
        self._epochs = [0] * len(addresses)
        self._jams: list[Jam] = []
        self._since = START
        self._states: Sequence[State] = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * len(addresses)

    def prepare(self, channel: int) -> None:
        """Make the medium of a channel, 11 to 26, before the time runs: a map is to be read for it."""
        self._channel(channel - FIRST_CHANNEL)

    def add(self, device: Device) -> None:
        """Put there the next device, made with this air as its radio."""
        self.devices.append(device)

    def place(self, now: Instant, states: Sequence[State]) -> None:
        """From now on they are and move so."""
        self._since, self._states = now, states

    def jam(self, now: Instant, jams: Sequence[Jam]) -> None:
        """From now on these disturb, too, on every channel."""
        if not jams:
            return
        self._jams += jams
        for code, channel in self._channels.items():
            self._run(code, channel, now)
            channel.jams += jams

    def withhold(self, sender: int, receiver: int) -> None:
        """As `Medium.withhold`, on the sender's channel; both by number."""
        self._channel(self.devices[sender].channel).robots.medium.withhold(sender, receiver)

    def transmit(self, device: Device, now: Instant, tag: int, data: bytes) -> None:
        """Hand the device's transceiver a frame; `finished` says what has become of it."""
        number, channel = self._number(device), self._channel(device.channel)
        power_dbm = channel.usual_dbm + (device.power_dbm - USUAL_DBM)
        channel.robots.medium.set_power(number, power_dbm)
        channel.handed.append(Handed(now, number, tag, data))

    def silence(self, device: Device) -> None:
        """It has been reset: what it had been sending ends, and `finished` says nothing of it."""
        number = self._number(device)
        self._epochs[number] += 1
        for channel in self._channels.values():
            channel.handed = [frame for frame in channel.handed if frame.transceiver != number]

    def wake(self) -> Instant | None:
        """When something happens next, on the medium or in a device; None: nothing is due."""
        return min(self._wakes(), default=None)

    def advance(self, until: Instant) -> None:
        """Let everything happen up to `until`. What boards have to say stays with them: `run` gives it."""
        while (now := self.wake()) is not None and now <= until:
            for code, channel in [*self._channels.items()]:
                if channel.wake is not None and channel.wake <= now:
                    self._run(code, channel, now)
            for device in self.devices:
                device.settle(now)

    def counters(self) -> dict[str, int]:
        """What became of all frames, by the names of a simulated run's (`RadioCore.counters`)."""
        total = Counter({"frames_pending": 0})
        for channel in self._channels.values():
            medium = channel.robots.medium
            total.update(FrameCounters(len(self._addresses)).counters(medium.counters()))
            total["frames_pending"] += medium.pending
        return dict(total)

    def counters_by_robot(self, robots: Sequence[str]) -> dict[str, dict[str, int]]:
        """The same for each (`RadioCore.counters_by_robot`); `robots`: whose devices these are."""
        total = {robot: Counter[str]() for robot in robots}
        for channel in self._channels.values():
            counters = channel.robots.medium.counters()
            for robot, own in FrameCounters(len(robots)).by_robot(robots, counters).items():
                total[robot].update(own)
        return {robot: dict(counts) for robot, counts in total.items()}

    def _wakes(self) -> Iterator[Instant]:
        for part in (
            *(channel.wake for channel in self._channels.values()),
            *(d.wake() for d in self.devices),
        ):
            if part is not None:
                yield part

    def _channel(self, code: int) -> _Channel:
        if code not in self._channels:
            model = self._model(FIRST_CHANNEL + code)
            self._channels[code] = _Channel(self._addresses, model, self._seed, self._jams)
        return self._channels[code]

    def _number(self, device: Device) -> int:
        return next(number for number, one in enumerate(self.devices) if one is device)

    def _run(self, code: int, channel: _Channel, now: Instant) -> None:
        """Let everything happen on a channel before `now`, and tell the devices."""
        robots = [
            RobotTruth("", *state, True, device.channel == code, 0, epoch)
            for state, device, epoch in zip(self._states, self.devices, self._epochs, strict=True)
        ]
        jams, channel.jams = channel.jams, []
        handed, channel.handed = channel.handed, []
        said = channel.robots.advance(TransceiverTruth(self._since, robots), jams, handed, now)
        sources = dict(zip(self._addresses, self.devices, strict=True))
        for device, events in zip(self.devices, said, strict=True):
            for event in events:
                if isinstance(event, Heard):
                    source = sources[event.sender]
                    frame = DataFrame(source.pan, source.address, event.data)
                    rssi = int(rssi_codes(np.array([event.rssi_dbm]))[0])
                    device.heard(now, frame, rssi, event.lqi)
                else:
                    device.finished(now, event)


def air(setup: RadioSetup) -> EmulatedAir:
    """The air that a set-up of the simulated radio describes, on every channel. Raises AcrcError."""

    def model(channel: int) -> RadioModel:
        return radio_model(msgspec.structs.replace(setup, channel=channel))

    made = EmulatedAir([address for _, address in setup.robots], model, setup.seed)
    made.prepare(setup.channel or preset(setup.preset).channel)
    return made
