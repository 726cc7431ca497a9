"""The link to a radio board on a noisy line: right reports, quick recovery, full throughput."""

from collections import Counter
from collections.abc import Callable
from enum import IntEnum

import numpy as np
import pytest

from actors.instant import START, Instant, milliseconds, seconds
from actors.messages import AccessFailure, Overflow, Refused, Sent
from actors.radio.frame import octets
from actors.radio.medium import Medium, Saturated
from actors.radio.radio_model import RadioSetup, radio_model
from firmware_bridge.beeclick.air import BoardRadio, EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.reception import Event, UnconfirmedPacket
from firmware_bridge.beeclick.wire import Answer, PacketSent, byte_time
from firmware_bridge.device_lines import CLEAN, Disturbance
from tests.beeclick.lab import Desk, Lab

pytestmark = pytest.mark.claim("boards")
ENDS = (Sent, AccessFailure, UnconfirmedPacket, Overflow, Refused)
SET_UP = (0xBABA, 2, 15)
"""PAN, address and channel code that a link with the default settings gives its board."""


class Trouble(IntEnum):
    MILD = 0
    WILD = 1
    REBOOT = 2
    NOISE = 3
    """Bytes that the board has not sent."""


LINES = {
    Trouble.MILD: Disturbance(change=0.002, drop=0.002, insert=0.002),
    Trouble.WILD: Disturbance(change=0.9, drop=0.05, insert=0.05),
}


class CountingBoard(EmulatedBoard):
    """Counts its reports of sent packets by number."""

    def __init__(self, radio: BoardRadio, now: Instant) -> None:
        super().__init__(radio, now)
        self.reports: Counter[int] = Counter()

    def _say(self, now: Instant, answer: Answer) -> None:
        if isinstance(answer, PacketSent):
            self.reports[answer.number] += 1
        super()._say(now, answer)


class CountingLink(BoardLink):
    """Remembers the numbers of its packets by tag."""

    def __init__(self, settings: BoardSettings) -> None:
        super().__init__(settings)
        self.numbers: dict[int, int] = {}

    def take(self, now: Instant, data: bytes = b"") -> list[Event]:
        self.numbers |= {asked.tag: asked.number for asked in self._asked if asked.answer is None}
        return super().take(now, data)


def empty_air() -> EmulatedAir:
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    return EmulatedAir([2], lambda channel: model, 1)


class Soak:
    """A link and a board on a line with troubles, and what the link reports of its packets."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        air = empty_air()
        self.board, self.link = CountingBoard(air, START), CountingLink(BoardSettings(2))
        air.add(self.board)
        self.desk = Desk(self.link, self.board)
        self.lab = Lab(air, [self.desk], self.rng)
        self.packets = self.false = 0
        self.back_ms = dict.fromkeys(Trouble, 0.0)
        self.reported: Counter[int] = Counter()
        self.ends: Counter[str] = Counter()

    def trouble(self) -> None:
        """Trouble for 5 to 60 ms, then a clean line until board and link are ready."""
        trouble = Trouble(int(self.rng.integers(0, len(Trouble))))
        self.desk.to_host = self.desk.to_board = LINES.get(trouble, CLEAN)
        if trouble is Trouble.REBOOT:
            self.board.reboot(self.lab.now)
        for _ in range(int(self.rng.integers(5, 60))):
            for _ in range(int(self.rng.integers(0, 3))):
                self.desk.send(self.lab.now, self.packets, self.rng.bytes(int(self.rng.integers(1, 119))))
                self.packets += 1
            if trouble is Trouble.NOISE and self.rng.random() < 0.5:
                noise = self._noise(int(self.rng.integers(1, 400)))
                self.desk.come += len(noise)
                self.desk.events.extend(self.link.take(self.lab.now, noise))
            self.lab.run(milliseconds(1))
            self._enter()
        self.desk.to_host = self.desk.to_board = CLEAN
        if self.board.hung:
            self.board.reboot(self.lab.now)
        back_ms, back_bytes = self._recovery()
        assert trouble is not Trouble.NOISE or back_ms <= 100 or back_bytes <= 300
        self.back_ms[trouble] = max(self.back_ms[trouble], back_ms)
        self._enter()

    def end(self) -> None:
        self.desk.unplug(self.lab.now)
        self._enter()

    def _noise(self, size: int) -> bytes:
        """Random bytes, or bytes that look like messages."""
        if self.rng.random() < 0.5:
            return self.rng.bytes(size)
        return self.rng.integers(0, 11, size, dtype=np.uint8).tobytes()

    def _recovery(self) -> tuple[float, int]:
        """Time, ms, and bytes from the board until it and the link agree; then its radio is idle, too."""
        began, come, board = self.lab.now, self.desk.come, self.board
        back: tuple[float, int] | None = None
        while self.lab.now < began + seconds(6):
            self.lab.run(milliseconds(1))
            set_up = (board.pan, board.address, board.channel) == SET_UP
            if self.link.phase is not LinkPhase.READY or not board.commands.in_step or not set_up:
                back = None
            elif back is None:
                back = (self.lab.now - began) / 1e3, self.desk.come - come
            if back is not None and self.lab.now > began + milliseconds(200) and not self.link.in_flight:
                return back
        raise AssertionError("board and link are not ready after 6 s")

    def _enter(self) -> None:
        for event in self.desk.events:
            if isinstance(event, ENDS):
                self.reported[event.tag] += 1
                self.ends[type(event).__name__] += 1
                if isinstance(event, Sent | AccessFailure):
                    self.false += not self.board.reports[self.link.numbers[event.tag]]
        self.desk.events.clear()
        assert len(self.link._reader._bytes) < 300


def test_each_packet_is_reported_once_and_as_the_board_says(
    full: bool, record_property: Callable[[str, object], None]
) -> None:
    soak = Soak(seed=3)
    while soak.desk.come < (10_000_000 if full else 200_000):
        soak.trouble()
    soak.end()
    record_property("packets", {"all": soak.packets, **soak.ends})
    record_property("ready again at most after, ms", {one.name: ms for one, ms in soak.back_ms.items()})
    assert soak.ends["Sent"] > 500 and soak.ends["UnconfirmedPacket"] > 100
    assert max(soak.reported.values()) == 1
    assert soak.packets == len(soak.reported) + soak.link.waiting
    assert soak.false == 0


@pytest.mark.parametrize("data_bytes", [1, 20, 60, 118])
def test_the_link_carries_what_line_and_air_can(
    data_bytes: int, full: bool, record_property: Callable[[str, object], None]
) -> None:
    """Compare with the line, and with a simulated transceiver alone on the medium that always has a frame."""
    duration, air = seconds(10.0 if full else 1.0), empty_air()
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
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    medium = Medium([model.parameters.transceiver], model.propagation, model.parameters.phy, seed=1)
    medium.offer(0, Saturated(octets(data_bytes)))
    medium.run(duration * 1000)
    most = min(int(medium.counters()["sent"][0]) / (duration / 1e6), 1e6 / byte_time(6 + data_bytes))
    record_property(f"{data_bytes} bytes: packets per s, share", (rate, rate / most))
    assert rate >= 0.95 * most
