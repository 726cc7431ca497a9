"""The bridge: frames to the board at their instants, events from it at each step, nothing lost silently."""

from collections.abc import Sequence

import pytest

from actors.board_readings import LinkState, Temperature
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import (
    TRANSMIT,
    TRUTH,
    Aired,
    Board,
    EventCount,
    Heard,
    Outgoing,
    Overflow,
    Received,
    RobotTruth,
    Sent,
    Transmit,
    Truth,
    Unconfirmed,
)
from actors.runtime.core import Address, at
from actors.topic import Message
from firmware_bridge.beeclick.link import BoardLink
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.onboard.bridge import MOST_PLANNED, Bridge, BridgeCore
from firmware_bridge.onboard.device_loop import Clock
from firmware_bridge.onboard.onboard_setup import BridgeSetup
from tests.beeclick.hosts import boards

POLL = milliseconds(1)


class Room:
    """Bridges with boards in one room, in virtual time."""

    def __init__(self, robots: int = 2) -> None:
        self.now = Instant(0)
        self.air = boards(robots, spacing=1.0)
        self.bridges: list[BridgeCore] = []
        for number in range(robots):
            link = BoardLink(BoardSettings(number + 1))
            link.connect(self.now)
            self.bridges.append(BridgeCore(f"r{number + 1}", link))
        self.run(seconds(0.2))
        self.news = [[output.message for output in bridge.advance({})] for bridge in self.bridges]

    def run(self, duration: Duration) -> None:
        until = self.now + duration
        while self.now < until:
            self.now = Instant(self.now + POLL)
            self.air.advance(self.now)
            for bridge, board in zip(self.bridges, self.air.devices, strict=True):
                bridge.now = self.now
                bridge.hear(board.run(self.now))
                board.take(self.now, bridge.due())

    def give(self, robot: int, address: Address, message: Message) -> list[Message]:
        bridge = self.bridges[robot]
        bridge.expect(address.key)
        assert [one.key for one in bridge.missing({})] == [address.key]
        return [output.message for output in bridge.advance({address.key: message})]

    def transmit(self, robot: int, *frames: tuple[int, float, bytes]) -> None:
        planned = tuple(Outgoing(tag, self.now + milliseconds(later), data) for tag, later, data in frames)
        assert self.give(robot, at(TRANSMIT, f"r{robot + 1}"), Transmit(1, planned)) == []

    def step(self, robot: int, step: int, epoch: int = 0) -> Sequence[Message]:
        here = RobotTruth(f"r{robot + 1}", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True, True, 0, epoch)
        return self.give(robot, at(TRUTH), Truth(step, self.now, (here,)))


def test_a_frame_goes_out_at_its_instant_and_is_heard_by_the_other() -> None:
    room = Room()
    begun = room.now
    room.transmit(0, (7, 30, b"hello"))
    room.run(milliseconds(100))
    received, aired = room.step(0, 4)
    assert isinstance(received, Received) and received.step == 5
    (sent,) = received.events
    assert isinstance(sent, Sent) and sent.tag == 7
    assert 30_000 <= sent.instant - begun < 45_000
    assert aired == Aired(4, (EventCount("r1", 1),))
    received, aired = room.step(1, 4)
    assert isinstance(received, Received)
    (heard,) = received.events
    assert isinstance(heard, Heard) and (heard.sender, heard.data) == (1, b"hello")
    assert -90 < heard.rssi_dbm < -35 and 0 <= heard.lqi <= 255
    assert room.step(1, 5) == [Aired(5, ())]
    assert room.give(0, at(TRUTH), Truth(5, room.now, (), halt=True)) == []
    assert room.bridges[0].finished


def test_the_board_pulled_out_leaves_nothing_in_doubt_but_what_it_had() -> None:
    room = Room()
    room.transmit(0, (1, 0, bytes(118)), (2, 0, bytes(118)))
    room.run(milliseconds(3))
    room.bridges[0].now = room.now
    room.bridges[0].lost()
    received, _ = room.step(0, 1)
    assert isinstance(received, Received)
    assert {type(event) for event in received.events} == {Unconfirmed}
    assert [event.tag for event in received.events if isinstance(event, Unconfirmed)] == [1, 2]


def test_too_many_frames_that_wait_for_their_instants_overflow() -> None:
    room = Room()
    room.transmit(0, *((tag, 1000.0 + tag, b"x") for tag in range(MOST_PLANNED + 2)))
    received, _ = room.step(0, 1)
    assert isinstance(received, Received)
    assert [event.tag for event in received.events if isinstance(event, Overflow)] == [
        MOST_PLANNED,
        MOST_PLANNED + 1,
    ]
    assert room.bridges[0].dropped_frames == 2


def test_news_of_the_board_is_for_people() -> None:
    room = Room(1)
    room.run(seconds(3))
    (bridge,) = room.bridges
    assert bridge.has_news
    (output,) = bridge.advance({})
    assert isinstance(output.message, Board)
    assert Temperature in [type(note) for note in output.message.notes]
    (board,) = room.news[0]
    assert isinstance(board, Board)
    (up,) = board.notes
    assert isinstance(up, LinkState) and up.up
    assert not bridge.has_news and list(bridge.advance({})) == []


def test_a_new_epoch_begins_with_an_empty_transceiver_and_its_tags_are_its_own() -> None:
    """The predecessor's frames: one sent and told of, four on the board, two behind them, one not due yet."""
    room = Room()
    room.step(0, 0, epoch=3)
    room.transmit(0, (1, 0, b"sent"))
    room.run(milliseconds(50))
    room.transmit(0, *((tag, 0, bytes(118)) for tag in range(2, 8)), (8, 40, b"later"))
    room.run(milliseconds(2))
    assert room.step(0, 1, epoch=4) == [Aired(1, ())], "nothing is told to the successor"
    room.transmit(0, (1, 0, b"the successor's first"))
    room.run(milliseconds(100))
    received, _ = room.step(0, 2, epoch=4)
    assert isinstance(received, Received)
    assert [(type(event), event.tag) for event in received.events if not isinstance(event, Heard)] == [
        (Sent, 1)
    ]
    received, _ = room.step(1, 2)
    assert isinstance(received, Received)
    heard = [event.data for event in received.events if isinstance(event, Heard)]
    assert heard == [b"sent", *[bytes(118)] * 4, b"the successor's first"]
    frames = room.bridges[0].outcome()["frames"]
    assert frames == {"events_dropped": 0, "events_forgotten": 5, "frames_dropped": 0, "frames_forgotten": 3}


def test_without_a_board_frames_overflow_and_nothing_is_due(capsys: pytest.CaptureFixture[str]) -> None:
    bridge = Bridge(BridgeSetup("r1", 100_000, "/nowhere/beeclick", 1, 0xBABA, 26, 0.0), Clock())
    core, now = bridge.core, Instant(10_000_000)
    core.now = now
    core.expect(TRANSMIT.key("r1"))
    frames = tuple(Outgoing(tag, now, b"x") for tag in range(20))
    core.advance({at(TRANSMIT, "r1").key: Transmit(1, frames)})
    bridge.serve(now)
    bridge.serve(Instant(now + 5_000_000))
    assert bridge.wake is None, "it waits for the mesh, and tries the port again now and then"
    core.expect(TRUTH.key())
    received = core.advance({at(TRUTH).key: Truth(1, now, ())})[0].message
    assert isinstance(received, Received)
    overflown = [event.tag for event in received.events if isinstance(event, Overflow)]
    assert overflown == list(range(8, 20)), "one in the air and seven behind it wait for the board"
    assert capsys.readouterr().err.count("/nowhere/beeclick: there is no such port") == 1
