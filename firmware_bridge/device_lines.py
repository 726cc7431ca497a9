"""Serial lines of emulated devices, with unplugging and byte errors; both ends of a transceiver's line."""

import errno
import os
import select
import termios
import tty
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated, Final, Generic, NamedTuple, Self, TypeVar

import msgspec
import numpy as np
from numpy.random import Generator

from actors.geometry import Coordinate
from actors.instant import Instant, milliseconds, seconds
from actors.messages import (
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameUnconfirmed,
    LinkState,
    OutgoingFrame,
    RadioEvent,
    RadioEvents,
    Transmit,
)
from actors.radio.frame import DataFrame, rssi_dbm, size_fault
from actors.runtime.errors import AcrcError
from firmware_bridge.beeclick.answer_decoder import FIRST_CHANNEL, BoardEvent, BoardSettings
from firmware_bridge.beeclick.emulated_medium import DeviceMedium


class PseudoTerminal:
    """Device end of a serial line, with a symbolic link to the driver's end.

    The driver's end stays open, so drivers can reconnect. Unread bytes are lost and counted.
    """

    def __init__(self, link: Path) -> None:
        """Create the symbolic link, replacing an existing one. Raises AcrcError."""
        self.link = link
        self.lost = 0
        """Number of unread bytes."""
        self._device, self._driver = os.openpty()
        try:
            tty.setraw(self._driver, termios.TCSANOW)
            os.set_blocking(self._device, False)
            self.port = os.ttyname(self._driver)
            _create_link(link, self.port)
        except BaseException:
            os.close(self._device)
            os.close(self._driver)
            raise

    def fileno(self) -> int:
        """Return the device end's descriptor, readable after the driver has written."""
        return self._device

    def read(self, timeout_s: float) -> bytes:
        """Return bytes written by the driver; waits up to `timeout_s` s."""
        if not select.select([self._device], [], [], timeout_s)[0]:
            return b""
        try:
            return os.read(self._device, 4096)
        except OSError as error:
            if error.errno in {errno.EAGAIN, errno.EIO}:
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Send to the driver; bytes beyond the line's buffer are lost."""
        written = 0
        with suppress(BlockingIOError):
            written = os.write(self._device, data)
        self.lost += len(data) - written

    def close(self) -> None:
        """Remove the symbolic link, if not replaced by another, and close the line."""
        if self.link.is_symlink() and str(self.link.readlink()) == self.port:
            self.link.unlink()
        os.close(self._device)
        os.close(self._driver)


def _create_link(link: Path, port: str) -> None:
    if link.exists() and not link.is_symlink():
        raise AcrcError(f"{link}: exists and is not a symbolic link; choose another path")
    try:
        link.unlink(missing_ok=True)
        link.symlink_to(port)
    except OSError as error:
        raise AcrcError(
            f"{link}: the symbolic link cannot be created ({error.strerror}); choose a writable directory"
        ) from None


class LineNoise(NamedTuple):
    """Probabilities of errors per byte."""

    change: float = 0.0
    """Replacement by a random byte."""
    drop: float = 0.0
    """Loss of the byte."""
    insert: float = 0.0
    """Insertion of a random byte before it."""

    def apply(self, data: bytes, rng: np.random.Generator) -> bytes:
        """Return `data` with random errors."""
        if not data or self == NO_NOISE:
            return data
        limits = np.cumsum(self)
        outcomes = np.searchsorted(limits, rng.random(len(data)), side="right")  # 3: unchanged
        noise = rng.integers(0, 256, len(data))
        pairs = np.column_stack((noise, np.frombuffer(data, np.uint8)))
        chosen = np.column_stack((outcomes % 2 == 0, outcomes > 1))
        noisy: bytes = pairs[chosen].astype(np.uint8).tobytes()
        return noisy


NO_NOISE = LineNoise()
"""A line without errors."""


BASE: Final = "base"
RADIO: Final = "radio"
RANGE: Final = "range"
DEVICES: Final = (BASE, RADIO, RANGE)


class DevicePort(NamedTuple):
    """Port of one robot's device."""

    robot: str
    device: str
    """One of DEVICES."""


class EmulatedLines:
    """Serial lines at FOLDER/<robot>/<device>; a context manager that removes all files at its end.

    An unplugged line has no path, and its host sees a hangup; the device continues, as on a battery.
    """

    def __init__(self, folder: Path, ports: Iterable[DevicePort], generator: Generator) -> None:
        """Create lines for `ports`; `generator`: random errors of corrupted lines."""
        self.ports = tuple(ports)
        self._folder = folder
        self._generator = generator
        self._noise = dict.fromkeys(self.ports, NO_NOISE)
        self._plugged: dict[DevicePort, PseudoTerminal] = {}
        self._created_folders: list[Path] = []
        self._unread: Counter[DevicePort] = Counter()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self.close)
            self._create_folder(self._folder)
            for port in self.ports:
                self._create_folder(self.path(port).parent)
                self.plug(port)
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def descriptors(self) -> dict[int, DevicePort]:
        """Port by file descriptor, for `select`."""
        return {line.fileno(): port for port, line in self._plugged.items()}

    def path(self, port: DevicePort) -> Path:
        """Return the path of a plugged-in line."""
        return self._folder / port.robot / port.device

    def read(self, port: DevicePort) -> bytes:
        """Return bytes written by the host, possibly none."""
        line = self._plugged.get(port)
        if line is None:
            return b""
        return self._noise[port].apply(line.read(0.0), self._generator)

    def send(self, port: DevicePort, data: bytes) -> None:
        """Send to the host; does not block."""
        line = self._plugged.get(port)
        if data and line is not None:
            line.write(self._noise[port].apply(data, self._generator))

    def unread(self, port: DevicePort) -> int:
        """Return the number of bytes lost because the host did not read them."""
        line = self._plugged.get(port)
        return self._unread[port] + (line.lost if line is not None else 0)

    def is_plugged(self, port: DevicePort) -> bool:
        """Return whether the host can open the line."""
        return port in self._plugged

    def plug(self, port: DevicePort) -> None:
        """Connect the line. Raises AcrcError."""
        self._plugged[port] = PseudoTerminal(self.path(port))

    def unplug(self, port: DevicePort) -> None:
        """Disconnect the line."""
        line = self._plugged.pop(port)
        self._unread[port] += line.lost
        line.close()

    def corrupt(self, port: DevicePort, share: float) -> None:
        """Replace, drop or insert a `share` of the bytes from now on, in both directions."""
        self._noise[port] = LineNoise(share / 3, share / 3, share / 3)

    def close(self) -> None:
        """Close all lines; remove their links and the folders created for them."""
        for port in list(self._plugged):
            self.unplug(port)
        while self._created_folders:
            with suppress(OSError):  # not empty
                self._created_folders.pop().rmdir()

    def _create_folder(self, folder: Path) -> None:
        if folder.is_dir():
            return
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise AcrcError(
                f"{folder}: the folder cannot be created ({error.strerror}); choose a writable directory"
            ) from None
        self._created_folders.append(folder)


_MAX_LINE_BYTES: Final = 1 << 16
"""Maximum length of a line, bytes; above MAX_UNSETTLED frames."""
MAX_UNSETTLED: Final = 256
"""Maximum number of a host's frames without an outcome, and of frames in a line."""


class TransceiverInput(Transmit, frozen=True):
    """A line to a transceiver without a board; `step` is the session of the host's link."""

    frames: Annotated[tuple[OutgoingFrame, ...], msgspec.Meta(max_length=MAX_UNSETTLED)]
    """To be sent on arrival."""
    sent: int = 0
    """Time of sending by the host's clock, µs; repeated in the answer."""
    position: tuple[Coordinate, Coordinate] | None = None
    """Estimated position of the robot, m, map frame; None: no new one."""


class TransceiverOutput(RadioEvents, frozen=True):
    """A line from a transceiver without a board."""

    sent: int = 0
    """`sent` of the host's latest line; 0: answered before."""


M = TypeVar("M", TransceiverInput, TransceiverOutput)


class _MessageParser(Generic[M]):
    """Incremental parser of JSON messages, one per line."""

    def __init__(self, kind: type[M]) -> None:
        self.invalid_lines = 0
        """Number of invalid lines."""
        self._decoder: msgspec.json.Decoder[M] = msgspec.json.Decoder(kind)
        self._pending = b""

    def take(self, data: bytes) -> list[M]:
        """Append bytes and return the completed messages."""
        *lines, self._pending = (self._pending + data).split(b"\n")
        if len(self._pending) > _MAX_LINE_BYTES:
            lines, self._pending = [*lines, self._pending], b""
        found = []
        for line in lines:
            try:
                found.append(self._decoder.decode(line))
            except (ValueError, RecursionError):
                self.invalid_lines += 1
        return found


class SimulatedTransceiver:
    """Medium's end of a transceiver without a board, which sends every frame immediately."""

    def __init__(self, radio: DeviceMedium, settings: BoardSettings) -> None:
        self.pan, self.address = settings.pan, settings.address
        self.channel, self.power_dbm = settings.channel - FIRST_CHANNEL, settings.power_dbm
        self.fault = ""
        """Why frames are refused now, as a sentence; empty: they are sent."""
        self.position = (0.0, 0.0)
        """Latest position from the host, m, and the time of its arrival."""
        self.located_at = Instant(-1 << 62)
        self.unsettled = self.refused = 0
        """Numbers of frames on the medium, and of refused frames."""
        self._radio = radio
        self.lines = _MessageParser(TransceiverInput)
        """Parser of the host's lines."""
        self._session: int | None = None
        self._sent = 0
        self._events: list[RadioEvent] = []

    def take(self, now: Instant, data: bytes) -> None:
        """Accept bytes from the host."""
        for message in self.lines.take(data):
            if message.step != self._session:
                self._session = message.step
                self._events.clear()
                self._radio.drop_frames(self)
                self.unsettled = 0
            self._sent = message.sent
            if message.position is not None:
                self.position, self.located_at = message.position, now
            for frame in message.frames:
                crowd = "" if self.unsettled < MAX_UNSETTLED else "Too many frames are waiting."
                if fault := size_fault(len(frame.data)) or self.fault or crowd:
                    self.refused += 1
                    self._events.append(FrameRefused(now, frame.tag, fault))
                else:
                    self.unsettled += 1
                    self._radio.transmit(self, now, frame.tag & _TAGS, frame.data)

    def run(self, now: Instant) -> bytes:
        """Return the bytes for the host."""
        if self._session is None or not (self._events or self._sent):
            return b""
        answer = TransceiverOutput(self._session, tuple(self._events), self._sent)
        self._events, self._sent = [], 0
        return msgspec.json.encode(answer) + b"\n"

    def settle(self, now: Instant) -> None:
        """Do nothing: it has no timed actions."""

    def wake(self) -> None:
        """Return None: it has no timed actions."""

    def finish_frame(self, now: Instant, end: RadioEvent) -> None:
        """Queue the outcome of a frame for the host."""
        self.unsettled -= 1
        self._events.append(end)

    def receive_frame(self, now: Instant, frame: DataFrame, rssi: int, lqi: int) -> None:
        """Queue a received frame for the host, if one is connected."""
        if self._session is not None:
            self._events.append(FrameReceived(now, frame.source, rssi_dbm(rssi), lqi, frame.data))


_TAGS: Final = 2**63 - 1
"""Largest recordable tag; a host, perhaps on another computer, gets other tags back if its own are not."""
_REPORT_INTERVAL: Final = milliseconds(100)
"""Longest interval of lines to a transceiver, and shortest one of positions: a step; own choice."""
_SILENCE: Final = seconds(2.0)
"""Time without an answer after which a transceiver is lost, and once or twice of it, a frame; own choice."""
_MAX_EVENT_BYTES: Final = 240
"""Maximum size of an event, above that of the largest frame; a message of 256 such events is valid."""


class TransceiverLink:
    """Host end of a transceiver without a board, in place of `BoardLink`."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        """Number of events by type, and of invalid lines and events."""
        self.round_trips_ms: Counter[int] = Counter()
        """Number of answers by the age of the line that they answer, ms."""
        self.position: tuple[float, float] | None = None
        """Estimated position, m, map frame, for the next line; None: no new one."""
        self._messages = _MessageParser(TransceiverOutput)
        self._session: int | None = None
        self._is_up = False
        self._due = self._answered = self._checked = Instant(0)
        self._late: Sequence[int] = ()
        """Tags that were in flight at `_checked`."""
        self._waiting: list[OutgoingFrame] = []
        self._in_flight: list[int] = []

    def connect(self, now: Instant) -> None:
        """Start a session on a newly opened port."""
        self._session = self._due = now
        self._answered = Instant(now - 1)

    def lost(self, now: Instant) -> Sequence[BoardEvent]:
        """Handle the loss of the port: all frames are unconfirmed."""
        was_up, self._is_up, self._session = self._is_up, False, None
        tags = [*self._in_flight, *(frame.tag for frame in self._waiting)]
        self.forget()
        self._in_flight.clear()
        state = (LinkState(now, False, "lost"),) if was_up else ()
        return [*state, *(FrameUnconfirmed(now, tag) for tag in tags)]

    def is_silent(self, now: Instant) -> bool:
        """Return whether the transceiver has answered, and then not for 2 s."""
        return self._is_up and now - self._answered > _SILENCE

    def send(self, now: Instant, tag: int, data: bytes) -> Sequence[BoardEvent]:
        """Queue a frame for `due`."""
        if fault := size_fault(len(data)):
            return [FrameRefused(now, tag, fault)]
        if not self._is_up or len(self._in_flight) + len(self._waiting) >= MAX_UNSETTLED:
            return [FrameOverflow(now, tag)]
        self._waiting.append(OutgoingFrame(tag, now, data))
        return ()

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now."""
        if self._session is None or not (self._waiting or now >= self._due):
            return b""
        line = TransceiverInput(self._session, tuple(self._waiting), now, self.position)
        self._in_flight += [frame.tag for frame in self._waiting]
        self._waiting, self.position, self._due = [], None, Instant(now + _REPORT_INTERVAL)
        return msgspec.json.encode(line) + b"\n"

    def take(self, now: Instant, data: bytes) -> Sequence[BoardEvent]:
        """Process bytes read and return the events, stamped with `now`."""
        found: list[BoardEvent] = []
        for message in self._messages.take(data):
            if message.step != self._session:
                continue
            if self._answered < message.sent <= now:
                self._answered = Instant(message.sent)
                self.round_trips_ms[(now - message.sent) // 1000] += 1
                found += [] if self._is_up else [LinkState(now, True, "")]
                self._is_up = True
            events = filter(self._count_event, message.events)
            found += [msgspec.structs.replace(event, instant=now) for event in events]
        self.counters["bad_lines"] = self._messages.invalid_lines
        if now > self._checked + _SILENCE:
            lost = [tag for tag in self._in_flight if tag in self._late]
            found += [FrameUnconfirmed(now, tag) for tag in lost]
            self._in_flight = [tag for tag in self._in_flight if tag not in lost]
            self._checked, self._late = now, (*self._in_flight,)
        return found

    def wake(self) -> None:
        """Return None: it has no timed actions."""

    def forget(self) -> int:
        """Drop unwritten frames; return how many."""
        forgotten = len(self._waiting)
        self._waiting.clear()
        return forgotten

    def _count_event(self, event: RadioEvent) -> bool:
        """Count an event; return False for an invalid one, or the outcome of a frame not in flight."""
        if isinstance(event, FrameUnconfirmed) or not _is_recordable(event):
            self.counters["invalid_events"] += 1
            return False
        self.counters[type(event).__name__.lower()] += 1
        if isinstance(event, FrameReceived):
            return True
        if event.tag not in self._in_flight:
            return False
        self._in_flight.remove(event.tag)
        return True


def _is_recordable(event: RadioEvent) -> bool:
    """Return whether an event, perhaps from another computer, has an ordinary size."""
    try:
        return len(msgspec.msgpack.encode(event)) <= _MAX_EVENT_BYTES
    except OverflowError:
        return False
