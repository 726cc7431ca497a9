"""Simulated radio medium for emulated boards.

`actors.radio` computes reception, as in a simulated run. This module adds what is specific to boards:
immediate answers, a channel and a transmit power per board.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import msgspec
import numpy as np

from actors.instant import START, Instant
from actors.messages import FrameOutcome, FrameReceived, Jam, RadioEvent, RobotTruth
from actors.radio.frame import DataFrame, rssi_codes
from actors.radio.radio_model import RadioModel, RadioSetup, preset, radio_model
from actors.radio.robot_medium import FrameCounters, RobotMedium, SubmittedFrame, TransceiverTruth
from firmware_bridge.beeclick.answer_decoder import FIRST_CHANNEL, BoardSettings

REFERENCE_DBM: Final = BoardSettings(0).power_dbm
"""Power setting that corresponds to the transmit power of the radio's preset."""
BodyState = tuple[float, float, float, float, float, float]
"""x, y, heading; vx, vy, omega, as in `Bodies.truth`."""


class RadioDevice(Protocol):
    """A transceiver on the medium, such as an `EmulatedBoard`."""

    pan: int
    address: int
    channel: int
    """Channel code, 0 to 15."""
    power_dbm: float

    def take(self, now: Instant, data: bytes) -> None:
        """Accept bytes that the host starts to send now."""

    def run(self, now: Instant) -> bytes:
        """Advance to `now`; return the bytes sent to the host since the last call."""

    def settle(self, now: Instant) -> None:
        """Advance to `now`."""

    def wake(self) -> Instant | None:
        """Return the time of the next action; None: none."""

    def finish_frame(self, now: Instant, end: RadioEvent) -> None:
        """Accept the outcome of an own frame, identified by its tag."""

    def receive_frame(self, now: Instant, frame: DataFrame, rssi: int, lqi: int) -> None:
        """Accept a received frame, with RSSI and LQI codes of the chip."""


class DeviceMedium(Protocol):
    """Interface of the medium to devices."""

    def transmit(self, device: RadioDevice, now: Instant, tag: int, data: bytes) -> None:
        """Send a frame; the device's `finish_frame` is called with the outcome."""

    def drop_frames(self, device: RadioDevice) -> None:
        """Drop all frames of the device."""


@dataclass
class _Channel:
    """Medium of one channel; devices on other channels are off in it."""

    robots: RobotMedium
    preset_dbm: float
    jams: list[Jam]
    submitted: list[SubmittedFrame] = field(default_factory=list)

    @property
    def wake(self) -> Instant | None:
        """Time of the next event, rounded up to µs; None: none."""
        due = [frame.instant for frame in self.submitted[:1]]
        if (wake_ns := self.robots.medium.wake_ns) is not None:
            due.append(wake_ns // 1000)
        return Instant(min(due) + 1) if due else None


class EmulatedMedium:
    """Event-driven simulation of all devices and the frames between them."""

    def __init__(self, addresses: Sequence[int], model: Callable[[int], RadioModel], seed: int) -> None:
        """Create a medium without devices.

        `addresses`: of the devices in the order of `add`; with `seed` the key of all random numbers. `model`:
        returns the radio model of a channel, 11 to 26.
        """
        self.devices: list[RadioDevice] = []
        self.keeps_outcomes = False
        """Collect frame outcomes for `take_outcomes`; set it before the first frame."""
        self._addresses = tuple(addresses)
        self._model = model
        self._seed = seed
        self._channels: dict[int, _Channel] = {}
        self._epochs = [0] * len(addresses)
        self._jams: list[Jam] = []
        self._states_since = START
        self._states: Sequence[BodyState] = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * len(addresses)

    def prepare(self, channel: int) -> None:
        """Create the medium of a channel, 11 to 26, before the start, as it reads a map."""
        self._channel(channel - FIRST_CHANNEL)

    def add(self, device: RadioDevice) -> None:
        """Add the next device, created with this medium as its radio."""
        self.devices.append(device)

    def set_states(self, now: Instant, states: Sequence[BodyState]) -> None:
        """Set positions and velocities of all devices from `now` on."""
        self._states_since, self._states = now, states

    def jam(self, now: Instant, jams: Sequence[Jam]) -> None:
        """Add jammers on all channels from `now` on."""
        if not jams:
            return
        self._jams += jams
        for code, channel in self._channels.items():
            self._run(code, channel, now)
            channel.jams += jams

    def withhold(self, sender: int, receiver: int) -> None:
        """Call `Medium.withhold` on the sender's channel; devices by number."""
        self._channel(self.devices[sender].channel).robots.medium.withhold(sender, receiver)

    def transmit(self, device: RadioDevice, now: Instant, tag: int, data: bytes) -> None:
        """Send a frame of the device; its `finish_frame` is called with the outcome."""
        number, channel = self.devices.index(device), self._channel(device.channel)
        power_dbm = channel.preset_dbm + (device.power_dbm - REFERENCE_DBM)
        channel.robots.medium.set_power(number, power_dbm)
        channel.submitted.append(SubmittedFrame(now, number, tag, data))

    def drop_frames(self, device: RadioDevice) -> None:
        """Drop all frames of a device that was reset, without calling `finish_frame`."""
        number = self.devices.index(device)
        self._epochs[number] += 1
        for channel in self._channels.values():
            channel.submitted = [frame for frame in channel.submitted if frame.transceiver != number]

    def wake(self) -> Instant | None:
        """Return the time of the next event on the medium or in a device; None: none."""
        times = (
            *(channel.wake for channel in self._channels.values()),
            *(device.wake() for device in self.devices),
        )
        return min((time for time in times if time is not None), default=None)

    def advance(self, until: Instant) -> None:
        """Simulate all events up to `until`; output of boards is returned by their `run`."""
        while (now := self.wake()) is not None and now <= until:
            for code, channel in [*self._channels.items()]:
                if channel.wake is not None and channel.wake <= now:
                    self._run(code, channel, now)
            for device in self.devices:
                device.settle(now)

    def counters(self) -> dict[str, int]:
        """Count the outcomes of all frames, named as in `RadioCore.counters`."""
        total = Counter({"frames_pending": 0})
        for channel in self._channels.values():
            medium = channel.robots.medium
            total.update(FrameCounters(len(self._addresses)).counters(medium.counters()))
            total["frames_pending"] += medium.pending
        return dict(total)

    def counters_by_robot(self, robots: Sequence[str]) -> dict[str, dict[str, int]]:
        """Count the outcomes by robot, as `RadioCore.counters_by_robot`; `robots`: owners of the devices."""
        total = {robot: Counter[str]() for robot in robots}
        for channel in self._channels.values():
            counters = channel.robots.medium.counters()
            for robot, own in FrameCounters(len(robots)).by_robot(robots, counters).items():
                total[robot].update(own)
        return {robot: dict(counts) for robot, counts in total.items()}

    def take_outcomes(self) -> tuple[FrameOutcome, ...]:
        """Return the outcome of each frame that has ended since the last call, by channel."""
        return tuple(one for channel in self._channels.values() for one in channel.robots.take_outcomes())

    def _channel(self, code: int) -> _Channel:
        if code not in self._channels:
            model = self._model(FIRST_CHANNEL + code)
            robots = RobotMedium(self._addresses, model, self._seed, keeps_outcomes=self.keeps_outcomes)
            self._channels[code] = _Channel(robots, model.parameters.transceiver.tx_power_dbm, [*self._jams])
        return self._channels[code]

    def _run(self, code: int, channel: _Channel, now: Instant) -> None:
        """Simulate a channel up to `now` and pass the events to the devices."""
        robots = [
            RobotTruth("", *state, True, device.channel == code, 0, epoch)
            for state, device, epoch in zip(self._states, self.devices, self._epochs, strict=True)
        ]
        jams, channel.jams = channel.jams, []
        submitted, channel.submitted = channel.submitted, []
        events_by_device = channel.robots.advance(
            TransceiverTruth(self._states_since, robots), jams, submitted, now
        )
        sources = dict(zip(self._addresses, self.devices, strict=True))
        for device, events in zip(self.devices, events_by_device, strict=True):
            for event in events:
                if isinstance(event, FrameReceived):
                    source = sources[event.sender]
                    frame = DataFrame(source.pan, source.address, event.data)
                    rssi = int(rssi_codes(np.array([event.rssi_dbm]))[0])
                    device.receive_frame(now, frame, rssi, event.lqi)
                else:
                    device.finish_frame(now, event)


def create_medium(setup: RadioSetup) -> EmulatedMedium:
    """Create the medium of a radio set-up, for all channels. Raises AcrcError."""
    medium = EmulatedMedium(
        [address for _, address in setup.robots],
        lambda channel: radio_model(msgspec.structs.replace(setup, channel=channel)),
        setup.seed,
    )
    medium.keeps_outcomes = setup.detail == "full"
    medium.prepare(setup.channel or preset(setup.preset).channel)
    return medium
