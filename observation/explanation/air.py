"""What the air did between two robots: frames that arrived with how, and frames that were lost with why."""

import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from actors.instant import Instant
from actors.messages import RECEIVED, TRANSMIT, Heard
from actors.radio.frame import airtime_us
from actors.radio.medium.state import Outcome
from actors.radio.radio_model import RadioSetup
from deeco.replication.fragments import HEADER
from observation.evidence.recorded import taken
from observation.replay.recorded_setup import setup_of
from observation.replay.run_recordings import all_recordings
from observation.trace.frame_fates import Fates, fate_name, read_fates
from observation.trace.rows import Arrival

_TOGETHER_US: Final = 2_000_000
"""Fragments of one packet lie no farther apart (`deeco.link.LinkParameters`)."""


class Frame(NamedTuple):
    """A frame as its receiver heard it."""

    instant: Instant
    """When its last symbol ended."""
    sender: str
    """The robot that sent it."""
    octets: int
    """Data bytes."""
    airtime_us: int
    rssi_dbm: float
    lqi: int
    handed: Instant | None
    """When the sender gave it to its transceiver; None where the radio's recording is not there."""


class FrameLoss(NamedTuple):
    """A frame that did not arrive."""

    instant: Instant
    """When it ended."""
    sender: str
    cause: str


@dataclass(frozen=True)
class Air:
    """The air of one run, as one robot's process heard it; read when it is asked for the first time."""

    out: Path
    actor: str

    @property
    def simulated(self) -> bool:
        """True if the radio's recording is there."""
        return "radio" in self._files

    def robot(self, address: int) -> str:
        """Whose short address it is; in words where nobody knows."""
        return self._robots.get(address, f"the address {address}")

    def frames(self, arrival: Arrival) -> tuple[Frame, ...]:
        """The frames that brought the packet, in their order; the arrival itself is the last."""
        last = next((one for one in self._heard if one.instant == arrival.instant), None)
        if last is None:
            return ()
        packets = _packets(last.data)
        since = Instant(arrival.instant - _TOGETHER_US)
        return tuple(
            self._frame(one)
            for one in self._heard
            if since <= one.instant <= arrival.instant
            and one.sender == arrival.sender
            and (one is last or packets & _packets(one.data))
        )

    def losses(self, senders: tuple[str, ...], since: Instant, until: Instant) -> tuple[FrameLoss, ...]:
        """Frames of these robots that ended behind `since` and before `until` and that were lost here."""
        if not self.simulated:
            return ()
        fates, names = self._fates, tuple(self._robots.values())
        receiver = names.index(self.robot_here)
        ended = np.round(fates.seconds * 1e6).astype(np.int64)
        of = [names.index(one) for one in senders if one in names]
        wanted = (fates.receivers == receiver) & (ended > since) & (ended < until)
        wanted &= np.isin(fates.senders, of) & (fates.outcomes != Outcome.HEARD)
        return tuple(
            FrameLoss(
                Instant(int(ended[row])),
                names[int(fates.senders[row])],
                fate_name(Outcome(int(fates.outcomes[row]))),
            )
            for row in np.flatnonzero(wanted)
        )

    @property
    def robot_here(self) -> str:
        """The robot whose process it is."""
        return self._files[self.actor].parent.name

    @cached_property
    def _files(self) -> dict[str, Path]:
        return all_recordings(self.out)

    @cached_property
    def _robots(self) -> dict[int, str]:
        if not self.simulated:
            return {}
        setup = setup_of(self._files["radio"], RadioSetup, "a radio")
        return {address: robot for robot, address in setup.robots}

    @cached_property
    def _fates(self) -> Fates:
        return read_fates(self.out, tuple(self._robots.values()))

    @cached_property
    def _heard(self) -> list[Heard]:
        received = (message for _, message in taken(self._files[self.actor], RECEIVED))
        return [event for message in received for event in message.events if isinstance(event, Heard)]

    @cached_property
    def _handed(self) -> dict[tuple[str, bytes], list[int]]:
        found: dict[tuple[str, bytes], list[int]] = {}
        for robot, transmit in taken(self._files["radio"], TRANSMIT) if self.simulated else ():
            for frame in transmit.frames:
                found.setdefault((robot, frame.data), []).append(frame.instant)
        return found

    def _frame(self, heard: Heard) -> Frame:
        sender = self.robot(heard.sender)
        handed = [at for at in self._handed.get((sender, heard.data), ()) if at <= heard.instant]
        return Frame(
            Instant(heard.instant), sender, len(heard.data), airtime_us(len(heard.data)), heard.rssi_dbm,
            heard.lqi, Instant(max(handed)) if handed else None,
        )  # fmt: skip


def _packets(data: bytes) -> set[tuple[int, int]]:
    """Number and node of each packet of which a frame brings something."""
    found, at = set(), 0
    while len(data) - at > HEADER.size:
        try:
            _, size, _, number, node = HEADER.unpack_from(data, at)
        except struct.error:
            break
        found.add((number, node))
        at += HEADER.size + size
    return found
