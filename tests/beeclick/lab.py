"""Radio boards, links and hosts in virtual time."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from actors.instant import START, Duration, Instant, milliseconds
from actors.messages import LinkState
from actors.radio.radio_model import RadioSetup
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick import board_messages
from firmware_bridge.beeclick.answer_decoder import BoardEvent, BoardSettings
from firmware_bridge.beeclick.board_link import BoardLink, LinkPhase
from firmware_bridge.beeclick.board_messages import (
    SYNC_PATTERN,
    Answer,
    Command,
    PacketConfirmation,
    SendPacket,
    SetAddress,
    SetChannel,
    SetPower,
    SyncCommand,
)
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulated_medium import BodyState, EmulatedMedium, RadioDevice, create_medium
from firmware_bridge.device_lines import NO_NOISE, LineNoise, TransceiverLink

SYNC = b"\xff" * board_messages.MAX_COMMAND_BYTES + SYNC_PATTERN
ECHOES = (SetAddress(0xBABA, 0x0103), SetChannel(15), SetPower(-100))


def said(parts: Iterable[Answer | bytes]) -> bytes:
    """Encode a board's answers, with noise."""
    return b"".join(part if isinstance(part, bytes) else board_messages.encode_answer(part) for part in parts)


_SIZES: Final = {board_messages.encode_command(one)[0]: len(board_messages.encode_command(one)) for one in (
    SyncCommand(), SetChannel(0), SetPower(0), SetAddress(0, 0)
)}  # fmt: skip


def command_size(data: bytes) -> int:
    """Return the size of the command at the start of `data`, as computed by the firmware."""
    empty = len(board_messages.encode_command(SendPacket(0, b"")))
    return _SIZES.get(data[0]) or empty + data[1]


class Host:
    """A link in virtual time, with methods for both sides."""

    def __init__(self, drop_bad_fcs: bool = True) -> None:
        self.now = Instant(0)
        self.link = BoardLink(BoardSettings(0x0103), drop_bad_fcs)
        self.link.connect(self.now)

    def hear(self, *parts: Answer | bytes, after: int = 0) -> list[BoardEvent]:
        """Return the events after receiving `parts`, `after` µs later."""
        self.now = Instant(self.now + after)
        return self.link.take(self.now, said(parts))

    def due(self) -> bytes:
        return self.link.due(self.now)

    def commands(self) -> list[Command]:
        """Return the commands sent now."""
        data, found = self.due(), []
        while data:
            size = command_size(data)
            found.append(decoded(data[:size]))
            data = data[size:]
        return found

    def get_ready(self) -> "Host":
        """Complete the set-up."""
        assert self.due() == SYNC
        assert self.hear(SYNC_PATTERN) == []
        assert len(self.commands()) == 3
        self.hear(*ECHOES)
        assert self.link.phase is LinkPhase.READY
        return self

    def send(self, *tags: int) -> list[int]:
        """Queue a packet per tag; return the numbers of the packets sent to the board."""
        for tag in tags:
            assert self.link.send(self.now, tag, bytes([tag] * 3)) == []
        return [command.number for command in self.commands() if isinstance(command, SendPacket)]


def confirm(number: int, failed: bool = False) -> PacketConfirmation:
    return PacketConfirmation(number, failed)


def states(events: Iterable[BoardEvent]) -> list[LinkState]:
    """Return the changes of the link's state."""
    return [event for event in events if isinstance(event, LinkState)]


def causes(events: Iterable[BoardEvent]) -> list[str]:
    """Return the cause of each outage."""
    return [state.cause for state in states(events) if not state.up]


def boards(count: int, spacing: float = 2.0) -> EmulatedMedium:
    """Create boards with addresses 1, 2, … in a row, `spacing` m apart, without obstacles."""
    addresses = tuple((f"board{number}", number) for number in range(1, count + 1))
    where = create_medium(RadioSetup(seed=1, step_us=SUBSTEP, robots=addresses, preset="beeclick"))
    for _ in addresses:
        where.add(EmulatedBoard(where, START))
    where.set_states(START, [standing(number * spacing, 0.0) for number in range(count)])
    return where


def standing(x: float, y: float) -> BodyState:
    """Return the state of a standing body, m."""
    return (x, y, 0.0, 0.0, 0.0, 0.0)


def decoded(data: bytes) -> Command:
    """Decode one command."""
    match data[0]:
        case 0:
            return SyncCommand()
        case 1:
            return SendPacket(int.from_bytes(data[2:6], "little"), data[6:])
        case 2:
            return SetChannel(data[1])
        case 3:
            return SetPower(int.from_bytes(data[1:], "little", signed=True))
        case _:
            return SetAddress(int.from_bytes(data[1:3], "little"), int.from_bytes(data[3:], "little"))


_KEPT: Final = 100_000
"""Maximum number of stored events of a host."""
_POLL: Final = milliseconds(1)


@dataclass
class BoardHost:
    """A host, its board, and the line between them."""

    link: BoardLink | TransceiverLink
    board: RadioDevice
    to_board: LineNoise = NO_NOISE
    to_host: LineNoise = NO_NOISE
    plugged: bool = True
    events: deque[BoardEvent] = field(default_factory=lambda: deque(maxlen=_KEPT))
    come: int = 0
    """Number of bytes received by the host."""

    def serve(self, now: Instant, rng: np.random.Generator) -> None:
        """Exchange bytes between host and board."""
        come = self.to_host.apply(self.board.run(now), rng)
        if not self.plugged:
            return
        self.come += len(come)
        self.events.extend(self.link.take(now, come))
        if out := self.link.due(now):
            self.board.take(now, self.to_board.apply(out, rng))

    def send(self, now: Instant, tag: int, data: bytes) -> None:
        """Send a packet by the link."""
        self.events.extend(self.link.send(now, tag, data))

    def unplug(self, now: Instant) -> None:
        """Disconnect the host; the board continues."""
        self.plugged = False
        self.events.extend(self.link.lost(now))


class Lab:
    """Hosts in one room, which serve their lines periodically."""

    def __init__(self, air: EmulatedMedium, hosts: Sequence[BoardHost], rng: np.random.Generator) -> None:
        self.now = Instant(0)
        self.hosts = hosts
        self._air = air
        self._rng = rng
        for host in hosts:
            host.link.connect(self.now)

    def run(self, duration: Duration) -> None:
        """Advance by `duration`."""
        until = self.now + duration
        while self.now < until:
            self.now = Instant(min(self.now + _POLL, until))
            self._air.advance(self.now)
            for host in self.hosts:
                host.serve(self.now, self._rng)
