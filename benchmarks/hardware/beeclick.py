"""The link to a radio board: how it bears noise, how soon it is back, and how much it carries."""

import time
from collections import Counter
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from actors.instant import START, Duration, Instant, milliseconds, seconds
from actors.messages import AccessFailure, Overflow, Refused, Sent
from actors.radio.frame import octets
from actors.radio.medium import Medium, Saturated
from actors.radio.radio_model import RadioSetup, radio_model
from firmware_bridge.beeclick.air import BoardRadio, EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.lab import Desk, Lab
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.reception import Event, UnconfirmedPacket
from firmware_bridge.beeclick.wire import Answer, PacketSent, byte_time
from firmware_bridge.device_lines import CLEAN, Disturbance

SIZES: Final = (1, 20, 60, 118)
"""Data bytes of the packets whose throughput is measured."""
_ENDS: Final = (Sent, AccessFailure, UnconfirmedPacket, Overflow, Refused)
_SET_UP: Final = (0xBABA, 2, 15)
"""PAN, address and channel code of a board that a link with the default settings has set up."""
_RUN: Final = seconds(10.0)


class Trouble(IntEnum):
    """What befalls a line."""

    MILD = 0
    """Some bytes, both ways."""
    WILD = 1
    """All bytes, both ways."""
    REBOOT = 2
    SHOWING = 3
    """Bytes that nobody has sent come to the host."""


_LINES: Final = {
    Trouble.MILD: Disturbance(change=0.002, drop=0.002, insert=0.002),
    Trouble.WILD: Disturbance(change=0.9, drop=0.05, insert=0.05),
}


@dataclass(frozen=True)
class BoardSoak:
    """What a link has borne."""

    bytes: int
    """That came to it: noise, and answers of a board over lines of all sorts."""
    packets: int
    sent: int
    failed: int
    unconfirmed: int
    reported_twice: int
    unreported: int
    invented: int
    """Reported as sent or failed, though the board has not said so."""
    most_kept: int
    """Bytes that the link kept, at most."""
    most_back_ms: float
    """From the end of noise that comes to the host until board and link are ready again, at most."""
    most_bytes_back: int
    """Bytes from the board meanwhile, at most."""
    most_back_unnoticed_ms: float
    """The same after noise that only the board has got, or its reboot: nothing shows but its silence."""
    wall_s: float

    @property
    def borne(self) -> bool:
        """Every packet is reported once, as the board has told; the link is soon back and keeps little."""
        false = self.reported_twice + self.unreported + self.invented
        back = self.most_back_ms <= 100 or self.most_bytes_back <= 300
        return false == 0 and back and self.most_kept < 300


@dataclass(frozen=True)
class Throughput:
    """Packets of one size over a clean line."""

    data_bytes: int
    packets_per_s: float
    share: float
    """Of what the slower of the line and a simulated transceiver with the same waits can carry."""


class _RememberingBoard(EmulatedBoard):
    """Remembers which packets it has told the end of."""

    def __init__(self, radio: BoardRadio, now: Instant) -> None:
        super().__init__(radio, now)
        self.told: Counter[int] = Counter()

    def _say(self, now: Instant, answer: Answer) -> None:
        if isinstance(answer, PacketSent):
            self.told[answer.number] += 1
        super()._say(now, answer)


class _RememberingLink(BoardLink):
    """Remembers the numbers of its packets."""

    def __init__(self, settings: BoardSettings) -> None:
        super().__init__(settings)
        self.numbers: dict[int, int] = {}

    def take(self, now: Instant, data: bytes = b"") -> list[Event]:
        self.numbers |= {asked.tag: asked.number for asked in self._asked if asked.answer is None}
        return super().take(now, data)

    @property
    def kept(self) -> int:
        """Bytes that wait for others."""
        return len(self._reader._bytes)


class _Ordeal:
    """A link and a board, and a ledger of what is said of packets."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        air = _empty_air()
        self.board = _RememberingBoard(air, START)
        self.link = _RememberingLink(BoardSettings(2))
        air.add(self.board)
        self.desk = Desk(self.link, self.board)
        self.lab = Lab(air, [self.desk], self.rng)
        self.packets = self.invented = self.most_kept = 0
        self.most_back = dict.fromkeys(Trouble, (0, 0))
        self.ledger: Counter[int] = Counter()
        self.ends: Counter[str] = Counter()

    def round(self) -> None:
        """Trouble for 5 to 60 ms, then a clean line until all is well again."""
        trouble = Trouble(int(self.rng.integers(0, len(Trouble))))
        self.desk.to_host = self.desk.to_board = _LINES.get(trouble, CLEAN)
        if trouble is Trouble.REBOOT:
            self.board.reboot(self.lab.now)
        for _ in range(int(self.rng.integers(5, 60))):
            for _ in range(int(self.rng.integers(0, 3))):
                self.desk.send(self.lab.now, self.packets, self.rng.bytes(int(self.rng.integers(1, 119))))
                self.packets += 1
            if trouble is Trouble.SHOWING and self.rng.random() < 0.5:
                noise = _noise(self.rng, int(self.rng.integers(1, 400)))
                self.desk.come += len(noise)
                self.desk.events.extend(self.link.take(self.lab.now, noise))
            self.lab.run(milliseconds(1))
            self._enter()
        self.desk.to_host = self.desk.to_board = CLEAN
        if self.board.hung:
            self.board.reboot(self.lab.now)
        back = _come_back(self.lab, self.desk)
        if back is None:
            raise AssertionError(f"6 s after {trouble.name} board and link are not ready yet")
        self.most_back[trouble] = max(self.most_back[trouble], back)
        self._enter()

    def end(self) -> None:
        """Pull the cable; what is in flight is to be reported."""
        self.desk.unplug(self.lab.now)
        self._enter()

    def _enter(self) -> None:
        for event in self.desk.events:
            if isinstance(event, _ENDS):
                self.ledger[event.tag] += 1
                self.ends[type(event).__name__] += 1
                if isinstance(event, Sent | AccessFailure):
                    self.invented += not self.board.told[self.link.numbers[event.tag]]
        self.desk.events.clear()
        self.most_kept = max(self.most_kept, self.link.kept)


def soak(count: int, seed: int) -> BoardSoak:
    """Send packets over a line that is noisy at times, until so many bytes have come to the link."""
    began = time.perf_counter()
    ordeal = _Ordeal(seed)
    while ordeal.desk.come < count:
        ordeal.round()
    ordeal.end()
    showing, bytes_back = ordeal.most_back[Trouble.SHOWING]
    return BoardSoak(
        bytes=ordeal.desk.come,
        packets=ordeal.packets,
        sent=ordeal.ends["Sent"],
        failed=ordeal.ends["AccessFailure"],
        unconfirmed=ordeal.ends["UnconfirmedPacket"],
        reported_twice=sum(times > 1 for times in ordeal.ledger.values()),
        unreported=ordeal.packets - len(ordeal.ledger) - ordeal.link.waiting,
        invented=ordeal.invented,
        most_kept=ordeal.most_kept,
        most_back_ms=showing / 1e3,
        most_bytes_back=bytes_back,
        most_back_unnoticed_ms=max(back for back, _ in ordeal.most_back.values()) / 1e3,
        wall_s=time.perf_counter() - began,
    )


def _noise(rng: np.random.Generator, size: int) -> bytes:
    """Anything, or what looks like messages."""
    if rng.random() < 0.5:
        return rng.bytes(size)
    return rng.integers(0, 11, size, dtype=np.uint8).tobytes()


def _come_back(lab: Lab, desk: Desk) -> tuple[int, int] | None:
    """How long it takes until board and link agree, µs and bytes from the board; None: over 6 s.

    Then the board's radio is idle, too.
    """
    began, come, link, board = lab.now, desk.come, desk.link, desk.board
    back: tuple[int, int] | None = None
    while lab.now < began + seconds(6):
        lab.run(milliseconds(1))
        if (
            link.phase is not LinkPhase.READY
            or not board.commands.in_step
            or (board.pan, board.address, board.channel) != _SET_UP
        ):
            back = None
        elif back is None:
            back = lab.now - began, desk.come - come
        if back is not None and lab.now > began + milliseconds(200) and not link.in_flight:
            return back
    return None


def throughput(data_bytes: int, duration: Duration = _RUN) -> Throughput:
    """Keep the queue full of packets of that size for so long in virtual time."""
    air = _empty_air()
    desk = Desk(BoardLink(BoardSettings(2)), EmulatedBoard(air, START))
    air.add(desk.board)
    lab = Lab(air, [desk], np.random.default_rng(1))
    lab.run(milliseconds(20))
    before, began = desk.link.counters["sent"], lab.now
    while lab.now < began + duration:
        while desk.link.waiting + desk.link.in_flight < 8:
            desk.send(lab.now, 0, bytes(data_bytes))
        lab.run(milliseconds(1))
        desk.events.clear()
    rate = (desk.link.counters["sent"] - before) / (duration / 1e6)
    limit = min(_most_on_air(data_bytes, duration), 1e6 / byte_time(6 + data_bytes))
    return Throughput(data_bytes, rate, rate / limit)


def _empty_air() -> EmulatedAir:
    """One board's, the address 2."""
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    return EmulatedAir([2], lambda channel: model, 1)


def _most_on_air(data_bytes: int, duration: Duration) -> float:
    """Frames a second of a simulated transceiver that always has one, alone on the medium."""
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    medium = Medium([model.parameters.transceiver], model.propagation, model.parameters.phy, seed=1)
    medium.offer(0, Saturated(octets(data_bytes)))
    medium.run(duration * 1000)
    return int(medium.counters()["sent"][0]) / (duration / 1e6)
