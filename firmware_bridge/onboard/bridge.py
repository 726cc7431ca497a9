"""Bridge process between robot and radio board: `python -m firmware_bridge.onboard.bridge SETUP`.

It replaces the simulated radio for one robot. Frames of the robot are sent to the board at their instants.
When the base opens a step with Truth, the board's events since the last step are sent to the robot as
RadioEvents, and their number to the base. When the robot restarts, events and frames of its previous epoch
are dropped, except frames already on the board.
"""

import functools
import heapq
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import msgspec

from actors.instant import Instant
from actors.messages import (
    AIRED,
    BOARD,
    RADIO_READY,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    Board,
    BoardNote,
    EventCount,
    FrameOverflow,
    FrameReceived,
    RadioAdvanced,
    RadioEvent,
    RadioEvents,
    Ready,
    Transmit,
    Truth,
)
from actors.runtime.background import LossyRecorder, write_stderr
from actors.runtime.core import Address, Inputs, Output, at, to
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.rules import client_config
from actors.runtime.isolation.tls import load_keys, medium_client_config
from actors.runtime.linux import die_with_parent
from actors.runtime.process import ActorProcess, run_actor, run_note
from actors.runtime.process_setup import read_setup, setup_parser
from actors.runtime.shell import Shell
from actors.runtime.zenoh_bus import SelectableBus, open_session
from firmware_bridge.beeclick.answer_decoder import BoardEvent
from firmware_bridge.beeclick.board_link import BoardLink
from firmware_bridge.device_lines import TransceiverLink
from firmware_bridge.onboard.device_loop import (
    BridgeProcessSetup,
    BridgeSetup,
    Clock,
    ReconnectingPort,
    TimedCore,
    run_event_loop,
)
from firmware_bridge.serial_port import BoardPort, PortError

MAX_EVENTS: Final = 256
"""Maximum number of queued events; about one second of a busy channel."""
MAX_PLANNED: Final = 256
"""Maximum number of frames waiting for their instants."""


class BridgeCore(TimedCore):
    """Bridge of one robot's board; `receive` accepts bytes, `due` returns bytes."""

    def __init__(self, robot: str, link: BoardLink | TransceiverLink) -> None:
        super().__init__()
        self._robot = robot
        self._link = link
        self._planned: list[tuple[int, int, int, bytes]] = []
        self._added = 0
        self._events: list[RadioEvent] = []
        self._notes: list[BoardNote] = []
        self._epoch: int | None = None
        """Epoch of the robot; None: unknown."""
        self._tags: dict[int, int] = {}
        """The robot's tags of frames in the link, by the link's tags."""
        self._frames_submitted = 0
        self.dropped_events = self.dropped_frames = self.forgotten_events = self.forgotten_frames = 0

    @property
    def wake(self) -> Instant | None:
        """Time of the next action if nothing is received; None: none."""
        due = [self._planned[0][0]] if self._planned else []
        link = self._link.wake()
        due += [] if link is None else [link]
        return Instant(min(due)) if due else None

    def listens(self) -> Sequence[Address]:
        """Return the addresses of incoming messages."""
        return (at(TRUTH), at(TRANSMIT, self._robot))

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Process one message; without one, return pending board notes."""
        self._expected = None
        for message in inputs.values():
            if isinstance(message, Transmit):
                self._plan(message)
            elif isinstance(message, Truth):
                return self._on_truth(message)
        notes, self._notes = tuple(self._notes), []
        return (to(BOARD, Board(self.step, notes)),) if notes else ()

    @property
    def has_news(self) -> bool:
        """True if board notes are pending."""
        return bool(self._notes)

    def receive(self, data: bytes) -> None:
        """Process bytes read (or none) and the passing of time."""
        self._take_events(self._link.take(self.now, data))

    def port_lost(self) -> None:
        """Handle the loss of the port."""
        self._take_events(self._link.lost(self.now))

    def due(self) -> bytes:
        """Return the bytes to write now."""
        while self._planned and self._planned[0][0] <= self.now:
            _, _, tag, data = heapq.heappop(self._planned)
            self._frames_submitted += 1
            self._tags[self._frames_submitted] = tag
            self._take_events(self._link.send(self.now, self._frames_submitted, data))
        return self._link.due(self.now)

    def outcome(self) -> dict[str, object]:
        """Return all counters."""
        link = self._link
        return {
            "board": dict(link.counters),
            "round_trips_ms": dict(link.round_trips_ms) if isinstance(link, TransceiverLink) else {},
            "frames": {
                "events_dropped": self.dropped_events,
                "events_forgotten": self.forgotten_events,
                "frames_dropped": self.dropped_frames,
                "frames_forgotten": self.forgotten_frames,
            },
        }

    def _plan(self, transmit: Transmit) -> None:
        for frame in transmit.frames:
            if len(self._planned) >= MAX_PLANNED:
                self.dropped_frames += 1
                self._add_event(FrameOverflow(self.now, frame.tag))
                continue
            self._added += 1
            heapq.heappush(self._planned, (frame.instant, self._added, frame.tag, frame.data))

    def _on_truth(self, truth: Truth) -> Sequence[Output]:
        if truth.halt:
            self.finished = True
            return ()
        for robot in truth.robots:
            if self._epoch not in (None, robot.epoch):  # drop events and frames of an earlier epoch
                self.forgotten_frames += len(self._planned) + self._link.forget()
                self.forgotten_events += len(self._events)
                self._planned.clear()
                self._events.clear()
                self._tags.clear()
            self._epoch = robot.epoch
            if robot.stepping and isinstance(self._link, TransceiverLink):
                self._link.position = robot.x, robot.y
        self.step = truth.step + 1
        events, self._events = tuple(self._events), []
        if not events:
            return (to(AIRED, RadioAdvanced(truth.step, ())),)
        received = to(RECEIVED, RadioEvents(truth.step + 1, events), self._robot)
        return (received, to(AIRED, RadioAdvanced(truth.step, (EventCount(self._robot, len(events)),))))

    def _take_events(self, events: Sequence[BoardEvent]) -> None:
        for event in events:
            if isinstance(event, BoardNote):
                self._notes.append(event)
            elif isinstance(event, FrameReceived):
                self._add_event(event)
            elif (tag := self._tags.pop(event.tag, None)) is None:  # a frame of the epoch before
                self.forgotten_events += 1
            else:
                self._add_event(msgspec.structs.replace(event, tag=tag))

    def _add_event(self, event: RadioEvent) -> None:
        if len(self._events) >= MAX_EVENTS:
            self.dropped_events += 1
        else:
            self._events.append(event)


class NetworkPort(BoardPort):
    """Connection to a simulated radio medium over a network; it stays open, and reconnects by itself."""

    def __init__(self, robot: str, session: Any) -> None:
        """`session`: as of `open_session`."""
        self.path, self._key, self._pending = "radio.network", TRANSMIT.key(robot), b""
        self._port = SelectableBus(session, (at(RECEIVED, robot),))

    def read(self) -> bytes:
        """Return received bytes."""
        return b"".join(delivery.payload for delivery in self._port.take())

    def write(self, data: bytes) -> None:
        """Send bytes; blocks for 20 ms at most, and then closes the connection."""
        if data:
            self._port.publish(self._key, data)

    def close(self) -> None:
        """Keep the connection."""

    def reopen(self) -> BoardPort:
        """Return this port."""
        return self


class Bridge:
    """Bridge process: the core, and the board's port, which is reopened after a loss."""

    def __init__(self, setup: BridgeSetup, clock: Clock) -> None:
        self._clock = clock
        self._link = BoardLink(setup.settings) if setup.board else TransceiverLink()
        self.core = BridgeCore(setup.robot, self._link)
        self._stack = ExitStack()
        open_port: Callable[[], BoardPort] = functools.partial(BoardPort, setup.radio)
        if setup.keys is not None:
            config = medium_client_config(load_keys(Path(setup.keys)), setup.radio)
            session = self._stack.enter_context(open_session(config))
            open_port = NetworkPort(setup.robot, session).reopen
        self._line = ReconnectingPort(open_port, lambda sentence: write_stderr(f"{sentence}\n"))

    def drive(self, shell: Shell, bus: SelectableBus) -> None:
        """Run until the base ends the run."""
        core = self.core
        try:
            run_event_loop(shell, bus, core, self, self._clock)
        finally:
            self._line.close()
            self._stack.close()

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors to wait for."""
        return self._line.descriptors()

    def serve(self, now: Instant) -> None:
        """Exchange bytes with the board; reopen a lost port."""
        if self._line.connect(now):
            self._link.connect(now)
        if self._line.port is None:
            self.core.due()  # moves due frames to the link's queue
        elif not self._line.exchange(self._exchange_bytes):
            self.core.port_lost()

    def _exchange_bytes(self, port: BoardPort) -> bool:
        """Exchange bytes between core and port; return True. Raises PortError."""
        self.core.receive(port.read())
        if isinstance(self._link, TransceiverLink) and self._link.is_silent(self.core.now):
            raise PortError(
                f"{port.path}: the simulated radio medium has not answered for 2 s; check the network"
            )
        port.write(self.core.due() if port.is_idle else b"")
        return True


def main(argv: Sequence[str]) -> int:
    """Run the bridge process; return the exit code."""
    try:
        parser = setup_parser("firmware_bridge.onboard.bridge", "Connect a robot to its BEE-click board.")
        file = parser.parse_args(argv).setup
        bridge_file, folder = read_setup(file, BridgeProcessSetup, "a bridge"), file.parent
        setup, process_setup = bridge_file.actor, bridge_file.process
        if process_setup.with_parent:
            die_with_parent(os.getppid())
        bridge = Bridge(setup, Clock())
        process = ActorProcess(
            core=bridge.core,
            listens=bridge.core.listens(),
            run=run_note("radio", setup, process_setup.commit),
            ready=to(RADIO_READY, Ready(0, "radio", 0, "")),
            bus=SelectableBus,
            drive=bridge.drive,
            outcome=bridge.core.outcome,
        )
        config = client_config(folder / process_setup.credentials, process_setup.endpoint(folder))
        return run_actor(process, LossyRecorder(folder / process_setup.record, setup.step_us), config)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
