"""A transceiver without a board, and the line to it: Transmit and Received themselves, a line of JSON each.

In a laboratory only: what a board adds is left out, its rings, its serial line's pace and its faults.
A message's step numbers the host's sessions: a new one resets the transceiver.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Final, Generic, TypeVar

import msgspec

from actors import messages
from actors.instant import Instant
from actors.messages import Heard, Outgoing, Overflow, RadioEvent, Received, Refused, Transmit
from actors.radio.frame import DataFrame, rssi_dbm, size_fault
from firmware_bridge.beeclick.air import BoardRadio
from firmware_bridge.beeclick.parameters import FIRST_CHANNEL, BoardSettings
from firmware_bridge.beeclick.reception import Event, UnconfirmedPacket

_LONGEST: Final = 1 << 16
"""Of a line, bytes: far above 32 frames."""
M = TypeVar("M", Transmit, Received)


class _Messages(Generic[M]):
    """Messages out of what comes on a line."""

    def __init__(self, kind: type[M]) -> None:
        self.bad = 0
        """Lines that held no such message."""
        self._decoder: msgspec.json.Decoder[M] = msgspec.json.Decoder(kind)
        self._pending = b""

    def take(self, data: bytes) -> list[M]:
        """The messages that are whole by now."""
        *lines, self._pending = (self._pending + data).split(b"\n")
        if len(self._pending) > _LONGEST:
            lines, self._pending = [*lines, self._pending], b""
        found = []
        for line in lines:
            try:
                found.append(self._decoder.decode(line))
            except (ValueError, RecursionError):
                self.bad += 1
        return found


class SimulatedTransceiver:
    """The laboratory's end: one that hands the medium every frame as it comes."""

    def __init__(self, radio: BoardRadio, settings: BoardSettings) -> None:
        self.pan, self.address = settings.pan, settings.address
        self.channel, self.power_dbm = settings.channel - FIRST_CHANNEL, settings.power_dbm
        self._radio = radio
        self._messages = _Messages(Transmit)
        self._session: int | None = None
        self._said: list[RadioEvent] = []

    def take(self, now: Instant, data: bytes) -> None:
        """Bytes that have come from the host."""
        for message in self._messages.take(data):
            if message.step != self._session:
                self._session = message.step
                self._said.clear()
                self._radio.silence(self)
            for frame in message.frames:
                if wrong := size_fault(len(frame.data)):
                    self._said.append(Refused(now, frame.tag, wrong))
                else:
                    self._radio.transmit(self, now, frame.tag, frame.data)

    def run(self, now: Instant) -> bytes:
        """What is for the host by now."""
        if self._session is None or not self._said:
            return b""
        said, self._said = tuple(self._said), []
        return msgspec.json.encode(Received(self._session, said)) + b"\n"

    def settle(self, now: Instant) -> None:
        """As `Device`: nothing happens in it by itself."""

    def wake(self) -> None:
        """As `Device`."""

    def finished(self, now: Instant, end: RadioEvent) -> None:
        """As `Device`."""
        self._said.append(end)

    def heard(self, now: Instant, frame: DataFrame, rssi: int, lqi: int) -> None:
        """As `Device`; what nobody has asked for yet is not kept."""
        if self._session is not None:
            self._said.append(Heard(now, frame.source, rssi_dbm(rssi), lqi, frame.data))


class TransceiverLink:
    """The host's end, in place of `beeclick.link.Link`; a frame counts as handed over once it is written."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        """Events by kind, and lines that were none."""
        self._messages = _Messages(Received)
        self._session: int | None = None
        self._greeted = False
        self._waiting: list[Outgoing] = []
        self._flying: list[int] = []

    def connect(self, now: Instant) -> None:
        """A port has been opened."""
        self._session, self._greeted = now, False

    def lost(self, now: Instant) -> Sequence[Event]:
        """The port has gone: nobody knows what has become of the frames."""
        self._session = None
        tags = [*self._flying, *(frame.tag for frame in self._waiting)]
        self.forget()
        self._flying.clear()
        return [UnconfirmedPacket(now, tag, "lost") for tag in tags]

    def send(self, now: Instant, tag: int, data: bytes) -> Sequence[Event]:
        """Take a frame, to be written by `due`."""
        if wrong := size_fault(len(data)):
            return [Refused(now, tag, wrong)]
        if self._session is None:
            return [Overflow(now, tag)]
        self._waiting.append(Outgoing(tag, now, data))
        return ()

    def due(self, now: Instant) -> bytes:
        """What is to be written now."""
        if self._session is None or (self._greeted and not self._waiting):
            return b""
        frames, self._waiting, self._greeted = tuple(self._waiting), [], True
        self._flying += [frame.tag for frame in frames]
        return msgspec.json.encode(Transmit(self._session, frames)) + b"\n"

    def take(self, now: Instant, data: bytes) -> Sequence[Event]:
        """What the transceiver says, each event at the instant at which it came."""
        told = [one for one in self._messages.take(data) if one.step == self._session]
        self.counters["bad_lines"] = self._messages.bad
        return [
            msgspec.structs.replace(event, instant=now)
            for message in told
            for event in message.events
            if not isinstance(event, messages.Unconfirmed) and self._is_news(event)
        ]

    def wake(self) -> None:
        """Nothing is due by itself."""

    def forget(self) -> int:
        """Drop the frames that have not been written; how many."""
        forgotten = len(self._waiting)
        self._waiting.clear()
        return forgotten

    def _is_news(self, event: RadioEvent) -> bool:
        """False for the end of a frame that is not under way."""
        self.counters[type(event).__name__.lower()] += 1
        if isinstance(event, Heard):
            return True
        if event.tag not in self._flying:
            return False
        self._flying.remove(event.tag)
        return True
