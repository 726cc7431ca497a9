"""A link whose board the test plays itself."""

from collections.abc import Iterable

from actors.board_readings import LinkState
from actors.instant import START, Instant
from actors.radio.radio_model import RadioSetup
from actors.world.physics import SUBSTEP
from firmware_bridge.beeclick import wire
from firmware_bridge.beeclick.air import EmulatedAir, State, air
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import DEFAULTS, BeeClickParameters, BoardSettings
from firmware_bridge.beeclick.reception import Event
from firmware_bridge.beeclick.wire import (
    SYNC_PATTERN,
    Answer,
    Command,
    PacketSent,
    SendPacket,
    SetAddress,
    SetChannel,
    SetPower,
    Synchronise,
)

SYNC = b"\xff" * DEFAULTS.filler + SYNC_PATTERN
ECHOES = (SetAddress(0xBABA, 0x0103), SetChannel(15), SetPower(-100))


def said(parts: Iterable[Answer | bytes]) -> bytes:
    """What a board says, noise included."""
    return b"".join(part if isinstance(part, bytes) else wire.encode_answer(part) for part in parts)


class Host:
    """A link and the time; plays both sides."""

    def __init__(self, parameters: BeeClickParameters = DEFAULTS) -> None:
        self.now = Instant(0)
        self.link = BoardLink(BoardSettings(0x0103), parameters)
        self.link.connect(self.now)

    def hear(self, *parts: Answer | bytes, after: int = 0) -> list[Event]:
        """What follows if the board says that, so many µs later."""
        self.now = Instant(self.now + after)
        return self.link.take(self.now, said(parts))

    def due(self) -> bytes:
        return self.link.due(self.now)

    def commands(self) -> list[Command]:
        """What the board is told now."""
        data, found = self.due(), []
        while data:
            size = wire.command_size(data)
            assert size is not None
            found.append(decoded(data[:size]))
            data = data[size:]
        return found

    def get_ready(self) -> "Host":
        """The exchange at the start."""
        assert self.due() == SYNC
        assert self.hear(SYNC_PATTERN) == []
        assert len(self.commands()) == 3
        self.hear(*ECHOES)
        assert self.link.phase is LinkPhase.READY
        return self

    def send(self, *tags: int) -> list[int]:
        """Send packets, one per tag, and give the board what it takes; the packets' numbers."""
        for tag in tags:
            assert self.link.send(self.now, tag, bytes([tag] * 3)) == []
        return [command.number for command in self.commands() if isinstance(command, SendPacket)]


def confirm(number: int, failed: bool = False) -> PacketSent:
    return PacketSent(number, failed)


def states(events: Iterable[Event]) -> list[LinkState]:
    """That a board is up, or down."""
    return [event for event in events if isinstance(event, LinkState)]


def causes(events: Iterable[Event]) -> list[str]:
    """Why it was down each time."""
    return [state.cause for state in states(events) if not state.up]


def boards(count: int, spacing: float = 2.0, seed: int = 1) -> EmulatedAir:
    """So many boards with the addresses 1, 2, … in a row, `spacing` m apart, and nothing between them."""
    addresses = tuple((f"board{number}", number) for number in range(1, count + 1))
    where = air(RadioSetup(seed, SUBSTEP, addresses, "beeclick"))
    for _ in addresses:
        where.add(EmulatedBoard(where, START))
    where.place(START, [standing(number * spacing, 0.0) for number in range(count)])
    return where


def standing(x: float, y: float) -> State:
    """The state of what stands there, m."""
    return (x, y, 0.0, 0.0, 0.0, 0.0)


def decoded(data: bytes) -> Command:
    """The command of all these bytes."""
    match data[0]:
        case 0:
            return Synchronise()
        case 1:
            return SendPacket(int.from_bytes(data[2:6], "little"), data[6:])
        case 2:
            return SetChannel(data[1])
        case 3:
            return SetPower(int.from_bytes(data[1:], "little", signed=True))
        case _:
            return SetAddress(int.from_bytes(data[1:3], "little"), int.from_bytes(data[3:], "little"))
