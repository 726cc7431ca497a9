"""The bridge's process without a board: it says so once, and frames neither pile up nor keep it awake."""

import pytest

from actors.instant import Instant
from actors.messages import TRANSMIT, TRUTH, Outgoing, Overflow, Received, Transmit, Truth
from actors.runtime.core import at
from firmware_bridge.onboard.bridge import Bridge
from firmware_bridge.onboard.device_loop import Clock
from firmware_bridge.onboard.onboard_setup import BridgeSetup


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
