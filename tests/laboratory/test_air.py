"""Emulated medium: boards and simulated transceivers receive the same as in a simulated run."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from actors.instant import START, Instant, milliseconds
from actors.messages import (
    RECEIVED,
    TRANSMIT,
    TRUTH,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    Jam,
    Loss,
    OutgoingFrame,
    RadioEvents,
    RobotTruth,
    Transmit,
    Truth,
)
from actors.radio.program import build
from actors.radio.radio_model import RadioSetup, WifiParameters, radio_model
from actors.radio.walls import WallPatch
from firmware_bridge.beeclick.answer_decoder import BoardEvent, BoardSettings, PacketOutcome
from firmware_bridge.beeclick.board_link import BoardLink
from firmware_bridge.beeclick.board_messages import SetChannel, SyncCommand, encode_command
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulated_medium import BodyState, EmulatedMedium, RadioDevice, create_medium
from firmware_bridge.device_lines import SimulatedTransceiver, TransceiverLink
from tests.beeclick.lab import BoardHost, Lab, standing
from tests.laboratory.hosts import ROOT

STEP = 10_000
"""Physics sub-step, µs, after which a laboratory updates positions."""
STEPS = 300
ROBOTS = ("r1", "r2", "r3", "r4")
DRIVEN: Sequence[BodyState] = (
    (12.5, 3.0, 0.0, 0.0, 0.4, 0.0),
    (17.4, 5.0, 0.0, 0.0, 0.2, 0.1),  # behind two walls from the first one
    (13.0, 12.5, 0.0, 0.3, 0.0, 0.0),
    (20.0, 12.0, 0.0, 0.0, 0.0, 0.0),
)
CORRIDOR = str(ROOT / "maps/corridor.yaml")
ADDRESSES = tuple((robot, number) for number, robot in enumerate(ROBOTS, start=1))
PLAIN = RadioSetup(seed=7, step_us=STEP, robots=ADDRESSES, preset="chapter", map=CORRIDOR)
ROUGH = RadioSetup(
    seed=7, step_us=STEP, robots=ADDRESSES, preset="beeclick", map=CORRIDOR, walls="concrete",
    patches=(WallPatch("glass", (13.0, 17.0), (0.0, 8.0)),),
    shadowing_db=6.0, correlation_distance=2.0, channel=15, wifi=(WifiParameters((14.0, 8.0), 5, 0.5),),
)  # fmt: skip
JAM, LOSS = Jam(13.0, 12.5, 3.0, 2_500_000), Loss("r2", "r1")


def states(step: int) -> list[BodyState]:
    """Return the states at the start of a step."""
    return [
        (x + vx * step / 100, y + vy * step / 100, heading, vx, vy, omega)
        for x, y, heading, vx, vy, omega in DRIVEN
    ]


class WatchedAir:
    """Medium that stores the transmitted frames by step."""

    def __init__(self, inner: EmulatedMedium) -> None:
        self._inner = inner
        self.handed: dict[tuple[int, int], list[OutgoingFrame]] = {}

    def transmit(self, device: RadioDevice, now: Instant, tag: int, data: bytes) -> None:
        number = self._inner.devices.index(device)
        self.handed.setdefault((now // STEP, number), []).append(OutgoingFrame(tag, now, data))
        self._inner.transmit(device, now, tag, data)

    def drop_frames(self, device: RadioDevice) -> None:
        self._inner.drop_frames(device)


class Room:
    """Hosts with links that send random packets, with or without boards."""

    def __init__(self, setup: RadioSetup, without_board: Sequence[str] = ()) -> None:
        self.air = create_medium(setup)
        self.watched = WatchedAir(self.air)
        channel = radio_model(setup).parameters.channel
        self.links: list[BoardLink | TransceiverLink] = []
        for robot, address in ADDRESSES:
            settings = BoardSettings(address, channel)
            board: RadioDevice
            if robot in without_board:
                board = SimulatedTransceiver(self.watched, settings)
                self.links.append(TransceiverLink())
            else:
                board = EmulatedBoard(self.watched, START)
                board.channel = settings.channel - 11  # tuned from the start, like a simulated transceiver
                self.links.append(BoardLink(settings))
            self.air.add(board)
        for link in self.links:
            link.connect(START)
        self.events: list[list[BoardEvent]] = [[] for _ in ROBOTS]

    def run(self, jam_at: int, lose_at: int) -> None:
        """Send packets for `STEPS` steps; hosts serve their lines every ms."""
        rng = np.random.default_rng(3)
        for step in range(STEPS):
            if step == jam_at:
                self.air.jam(Instant(step * STEP), (JAM,))
            if step == lose_at:
                self.air.withhold(0, 1)
            self.air.set_states(Instant(step * STEP), states(step))
            for ms in range(10):
                self._serve(Instant(step * STEP + 1000 * ms), rng, talk=20 < step < STEPS - 20)
        self.air.advance(Instant(STEPS * STEP))

    def _serve(self, now: Instant, rng: np.random.Generator, *, talk: bool) -> None:
        self.air.advance(now)
        for number, (link, device) in enumerate(zip(self.links, self.air.devices, strict=True)):
            if talk and rng.random() < 0.03:
                link.send(now, int(rng.integers(1 << 30)), rng.bytes(int(rng.integers(1, 119))))
            self.events[number] += link.take(now, device.run(now))
            device.take(now, link.due(now))

    def heard(self, number: int) -> list[tuple[int, float, int, bytes]]:
        """Return the received packets of a host: sender, strength, quality, data."""
        events = (event for event in self.events[number] if isinstance(event, FrameReceived))
        return [(event.sender, event.rssi_dbm, event.lqi, event.data) for event in events]


def simulated(
    setup: RadioSetup, handed: Mapping[tuple[int, int], Sequence[OutgoingFrame]], jam_at: int, lose_at: int
) -> tuple[list[list[FrameReceived]], dict[str, dict[str, int]]]:
    """Return what a simulated run's radio does with the frames: receptions by robot, and counters."""
    core = build(setup)
    heard: list[list[FrameReceived]] = [[] for _ in ROBOTS]
    for step in range(STEPS):
        frames = [tuple(handed.get((step, number), ())) for number in range(len(ROBOTS))]
        robots = tuple(
            RobotTruth(robot, *state, True, True, len(sent))
            for robot, state, sent in zip(ROBOTS, states(step), frames, strict=True)
        )
        jams, losses = ((JAM,) if step == jam_at else ()), ((LOSS,) if step == lose_at else ())
        inputs = {TRUTH.key(): Truth(step, Instant(step * STEP), robots, jams, losses=losses)} | {
            TRANSMIT.key(robot): Transmit(step, sent)
            for robot, sent in zip(ROBOTS, frames, strict=True)
            if sent
        }
        for output in core.advance(inputs):
            if isinstance(output.message, RadioEvents):
                number = [RECEIVED.key(robot) for robot in ROBOTS].index(output.address.key)
                heard[number] += [
                    event for event in output.message.events if isinstance(event, FrameReceived)
                ]
    return heard, core.counters_by_robot()


ALL = ("below_sensitivity", "disturbed", "half_duplex", "collision", "withheld")


@pytest.mark.parametrize(
    ("setup", "without_board", "causes"),
    [
        (PLAIN, (), ALL),
        (ROUGH, ("r2", "r3"), ALL),
        (
            RadioSetup(seed=7, step_us=STEP, robots=ADDRESSES, preset="rosomnet", map=CORRIDOR),
            ROBOTS,
            ("below_sensitivity",),
        ),
        (
            RadioSetup(seed=7, step_us=STEP, robots=ADDRESSES, preset="ns3", map=CORRIDOR),
            ("r1",),
            ("collision",),
        ),
        (RadioSetup(seed=7, step_us=STEP, robots=ADDRESSES, preset="ideal"), (), ("collision",)),
    ],
    ids=("chapter", "beeclick, concrete, glass, shadowing, Wi-Fi", "rosomnet", "ns3", "ideal"),
)
def test_boards_and_simulated_transceivers_lose_the_same_frames_for_the_same_causes(
    setup: RadioSetup, without_board: Sequence[str], causes: Sequence[str]
) -> None:
    room = Room(setup, without_board)
    room.run(jam_at=150, lose_at=50)
    frames, counters = simulated(setup, room.watched.handed, jam_at=150, lose_at=50)
    assert room.air.counters_by_robot(ROBOTS) == counters
    for number, events in enumerate(frames):
        expected = [(event.sender, event.rssi_dbm, event.lqi, event.data) for event in events]
        assert room.heard(number) == expected
    total = sum(map(Counter, counters.values()), Counter[str]())
    assert total["frames_sent"] > 100
    assert [cause for cause in causes if not total[f"copies_lost_{cause}"]] == []
    assert room.air.counters()["copies_heard"] == sum(map(len, frames)) > 30


def test_a_board_on_another_channel_receives_nothing_until_it_returns() -> None:
    room = create_medium(RadioSetup(seed=1, step_us=STEP, robots=ADDRESSES[:2], preset="beeclick"))
    boards = [EmulatedBoard(room, START) for _ in range(2)]
    for board in boards:
        room.add(board)
    heard = []
    now = START
    for code in (4, 0, 4):
        boards[1].take(now, b"\xff" + encode_command(SyncCommand()) + encode_command(SetChannel(code)))
        now = Instant(now + 20_000)
        room.advance(now)
        room.transmit(boards[0], now, 1, b"on 11")
        now = Instant(now + 20_000)
        room.advance(now)
        heard.append(boards[1].counters["heard"])
    assert heard == [0, 1, 1]
    assert room.counters()["frames_sent"] == 3 and room.counters()["copies_heard"] == 1


class Pair(Lab):
    """Two transceivers without boards, 2 m apart, each with its link."""

    def __init__(self) -> None:
        both = create_medium(
            RadioSetup(seed=1, step_us=10_000, robots=(("r1", 1), ("r2", 2)), preset="beeclick")
        )
        devices = [SimulatedTransceiver(both, BoardSettings(address, 11)) for address in (1, 2)]
        for device in devices:
            both.add(device)
        both.set_states(START, [standing(0.0, 0.0), standing(2.0, 0.0)])
        hosts = [BoardHost(TransceiverLink(), device) for device in devices]
        super().__init__(both, hosts, np.random.default_rng(1))
        self.first, self.second = hosts
        self.run(milliseconds(5))

    def ends(self) -> list[tuple[type[BoardEvent], int]]:
        return [(type(event), event.tag) for event in self.first.events if isinstance(event, PacketOutcome)]


def test_frames_that_cannot_be_sent_are_reported_at_once() -> None:
    pair = Pair()
    for tag, size in ((1, 0), (2, 119), *((tag, 118) for tag in range(3, 13))):
        pair.first.send(pair.now, tag, bytes(size))
    pair.run(milliseconds(100))
    ends = pair.ends()
    assert ends[0] == (FrameRefused, 2)  # empty frames are valid
    assert sorted(tag for _, tag in ends) == list(range(1, 13))
    assert [tag for end, tag in ends if end is FrameOverflow] == [
        10,
        11,
        12,
    ]  # the preset's queue holds eight


def test_all_frames_are_settled_when_the_line_is_lost() -> None:
    pair = Pair()
    for tag in range(3):
        pair.first.send(pair.now, tag, bytes(118))
    pair.run(milliseconds(1))
    pair.first.send(pair.now, 3, b"not written yet")
    pair.first.unplug(pair.now)
    pair.first.send(pair.now, 4, b"nowhere")
    assert pair.ends() == [*((FrameUnconfirmed, tag) for tag in range(4)), (FrameOverflow, 4)]
    assert pair.first.link.due(pair.now) == b""
    pair.first.link.connect(pair.now)
    pair.first.plugged = True
    pair.run(milliseconds(50))
    pair.first.send(pair.now, 0, b"again")
    pair.run(milliseconds(20))
    assert pair.ends()[5:] == [(FrameSent, 0)]
    heard = [event.data for event in pair.second.events if isinstance(event, FrameReceived)]
    assert heard == [b"again"], "a new session resets the transceiver"


def test_noise_is_counted_and_ignored() -> None:
    pair, rng = Pair(), np.random.default_rng(0)
    device, link = pair.first.board, pair.first.link
    noises = (rng.bytes(300), b"\n" * 9, b"x" * 200_000, b'{"step":1}\n', b"[" * 70_000 + b"\n", b"\n")
    for noise in noises:
        device.take(pair.now, noise)
        assert link.take(pair.now, noise) == []
    pair.first.send(pair.now, 1, b"through")
    pair.run(milliseconds(20))
    assert (FrameSent, 1) in pair.ends()
    assert link.counters["bad_lines"] >= 10
