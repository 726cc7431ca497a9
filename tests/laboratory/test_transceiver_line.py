"""The line to a transceiver without a board: sessions, noise on it, and what becomes of every frame."""

import numpy as np
import pytest

from actors.instant import START, Instant
from actors.messages import AccessFailure, Heard, Overflow, Refused, Sent
from actors.radio.radio_model import RadioSetup
from firmware_bridge.beeclick.air import EmulatedAir, air
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.reception import Event, UnconfirmedPacket
from firmware_bridge.transceiver_line import SimulatedTransceiver, TransceiverLink


class Pair:
    """Two transceivers without boards, 2 m apart, each with its link."""

    def __init__(self) -> None:
        self.now = START
        self.air: EmulatedAir = air(RadioSetup(1, 10_000, (("r1", 1), ("r2", 2)), "beeclick"))
        self.transceivers = [SimulatedTransceiver(self.air, BoardSettings(address, 11)) for address in (1, 2)]
        self.links = [TransceiverLink(), TransceiverLink()]
        for transceiver, link in zip(self.transceivers, self.links, strict=True):
            self.air.add(transceiver)
            link.connect(START)
        self.air.place(START, [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0, 0.0, 0.0)])
        self.events: list[list[Event]] = [[], []]
        self.run(5)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.now = Instant(self.now + 1000)
            self.air.advance(self.now)
            for transceiver, link, events in zip(self.transceivers, self.links, self.events, strict=True):
                events.extend(link.take(self.now, transceiver.run(self.now)))
                transceiver.take(self.now, link.due(self.now))

    def send(self, tag: int, data: bytes) -> None:
        self.events[0] += self.links[0].send(self.now, tag, data)

    def ends(self) -> list[tuple[type[Event], int]]:
        return [
            (type(event), event.tag)
            for event in self.events[0]
            if isinstance(event, Sent | Overflow | Refused | UnconfirmedPacket | AccessFailure)
        ]


def test_what_cannot_be_sent_is_told_at_once() -> None:
    pair = Pair()
    pair.send(1, b"")
    pair.send(2, bytes(119))
    for tag in range(3, 13):
        pair.send(tag, bytes(118))
    pair.run(100)
    ends = pair.ends()
    assert ends[0] == (Refused, 2)  # an empty frame is one, as on the air
    assert sorted(tag for _, tag in ends) == list(range(1, 13))
    assert [tag for end, tag in ends if end is Overflow] == [10, 11, 12]  # the preset's queue holds eight


def test_a_line_that_is_cut_leaves_nothing_in_the_books() -> None:
    pair = Pair()
    for tag in range(3):
        pair.send(tag, bytes(118))
    pair.run(1)
    pair.send(3, b"not written yet")
    pair.events[0] += pair.links[0].lost(pair.now)
    pair.send(4, b"nowhere")
    assert pair.ends() == [*((UnconfirmedPacket, tag) for tag in range(4)), (Overflow, 4)]
    assert pair.links[0].due(pair.now) == b""
    pair.links[0].connect(pair.now)
    pair.run(50)
    pair.send(0, b"again")
    pair.run(20)
    assert pair.ends()[5:] == [(Sent, 0)]
    heard = [event.data for event in pair.events[1] if isinstance(event, Heard)]
    assert heard == [b"again"], "a new session resets the transceiver: what it had is gone"


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_counted_and_does_no_harm(seed: int) -> None:
    pair, rng = Pair(), np.random.default_rng(seed)
    for noise in (rng.bytes(300), b"\n" * 9, b"x" * 200_000, b'{"step":1}\n', b"[" * 70_000 + b"\n"):
        pair.transceivers[0].take(pair.now, noise)
        assert pair.links[0].take(pair.now, noise) == []
    pair.transceivers[0].take(pair.now, b"\n")
    assert pair.links[0].take(pair.now, b"\n") == []
    pair.send(1, b"through")
    pair.run(20)
    assert (Sent, 1) in pair.ends()
    assert pair.links[0].counters["bad_lines"] >= 10
