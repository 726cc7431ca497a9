from dataclasses import replace

import numpy as np

from actors.board_readings import Info, LinkState
from actors.instant import START, Instant, milliseconds, seconds
from actors.messages import Heard, Sent
from actors.radio.radio_model import RadioSetup, radio_model
from benchmarks.hardware.beeclick import soak, throughput
from deeco.replication.fragments import Fragmenter, Reassembly
from firmware_bridge import emulate
from firmware_bridge.beeclick.air import Device, EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.lab import Desk, Lab
from firmware_bridge.beeclick.link import BoardLink, LinkPhase
from firmware_bridge.beeclick.parameters import BeeClickParameters, BoardSettings
from firmware_bridge.beeclick.reception import PacketEnd, UnconfirmedPacket
from firmware_bridge.device_lines import Disturbance
from tests.beeclick.hosts import causes, states

QUICK = BeeClickParameters(
    answer_timeout=milliseconds(100),
    doubt=milliseconds(50),
    probe_interval=milliseconds(100),
    sync_interval=milliseconds(40),
)


def lab(boards: int, seed: int = 1, parameters: BeeClickParameters | None = None, poll: int = 1_000) -> Lab:
    air = emulate.boards(boards, seed=seed)
    desks = []
    for number, board in enumerate(air.devices):
        assert isinstance(board, EmulatedBoard)
        desks.append(Desk(BoardLink(BoardSettings(number + 1), parameters or BeeClickParameters()), board))
    return Lab(air, desks, np.random.default_rng(seed), milliseconds(poll / 1_000))


def ends(desk: Desk) -> list[tuple[str, int]]:
    return [(type(e).__name__, e.tag) for e in desk.events if isinstance(e, PacketEnd)]


def test_robots_hear_one_another() -> None:
    room = lab(3)
    room.run(milliseconds(50))
    assert [desk.link.phase for desk in room.desks] == [LinkPhase.READY] * 3
    for desk, text in zip(room.desks, (b"one", b"two", b"three"), strict=True):
        desk.send(room.now, 7, text)
        room.run(milliseconds(20))
    for number, desk in enumerate(room.desks):
        assert ends(desk) == [("Sent", 7)]
        heard = {(e.sender, e.data) for e in desk.events if isinstance(e, Heard)}
        assert heard == {(1, b"one"), (2, b"two"), (3, b"three")} - {
            (number + 1, (b"one", b"two", b"three")[number])
        }


def test_a_packet_without_data_goes_through_two_boards_and_the_air() -> None:
    room = lab(2)
    room.run(milliseconds(50))
    sender, hearer = room.desks
    sender.send(room.now, 7, b"")
    sender.send(room.now, 8, b"x")
    room.run(milliseconds(50))
    assert ends(sender) == [("Sent", 7), ("Sent", 8)]
    assert [(e.sender, e.data) for e in hearer.events if isinstance(e, Heard)] == [(1, b""), (1, b"x")]


def test_a_restarted_board_is_set_up_again_and_its_packets_are_unconfirmed() -> None:
    room = lab(2)
    desk = room.desks[0]
    room.run(milliseconds(50))
    for tag in range(4):
        desk.send(room.now, tag, bytes(118))
    room.run(milliseconds(7))
    desk.board.reboot(room.now)
    room.run(seconds(1.2))
    assert desk.link.phase is LinkPhase.READY
    assert (desk.board.pan, desk.board.address, desk.board.channel) == (0xBABA, 1, 15)
    kinds = {tag: kind for kind, tag in ends(desk)}
    assert sorted(kinds) == [0, 1, 2, 3]
    assert [kinds[tag] for tag in (1, 2, 3)] == ["UnconfirmedPacket"] * 3
    assert causes(desk.events) == ["answer_skipped"]


def test_an_idle_restarted_board_is_set_up_again_within_two_seconds() -> None:
    room = lab(1)
    (desk,) = room.desks
    room.run(milliseconds(1_500))
    desk.board.reboot(room.now)
    room.run(milliseconds(2_020))
    assert desk.link.phase is LinkPhase.READY
    assert desk.board.address == 1


def test_the_button_costs_no_packet() -> None:
    room = lab(2)
    desk = room.desks[0]
    room.run(milliseconds(50))
    for tag in range(8):
        desk.send(room.now, tag, bytes(100))
    room.run(milliseconds(8))
    desk.board.press(room.now)
    room.run(seconds(1))
    assert ends(desk) == [("Sent", tag) for tag in range(8)]
    assert len(desk.of(Info)) == 1
    assert all(event.up for event in states(desk.events))


def test_the_button_does_no_harm_to_a_board_that_is_being_found() -> None:
    for delay in range(0, 400, 20):
        room = lab(1)
        (desk,) = room.desks
        room.run(milliseconds(50))
        desk.board.reboot(room.now)
        room.run(milliseconds(1_700 + delay))
        desk.board.press(room.now)
        room.run(seconds(3))
        assert not desk.board.hung
        assert desk.link.phase is LinkPhase.READY


def test_noise_that_only_the_board_hears_costs_half_a_second_at_most() -> None:
    """Idle, or with a packet on its way: a command is lost, and nothing shows but that no answer comes."""
    for busy in (False, True):
        for delay in range(0, 250, 25):
            room = lab(1)
            (desk,) = room.desks
            room.run(milliseconds(1_000 + delay))
            desk.board.take(room.now, bytes(range(5, 60)))
            room.run(milliseconds(2))
            assert not desk.board.commands.in_step
            if busy:
                desk.send(room.now, 1, b"lost")
            room.run(milliseconds(510))
            assert desk.board.commands.in_step and desk.link.phase is LinkPhase.READY
            desk.send(room.now, 2, b"comes through")
            room.run(milliseconds(30))
            assert ends(desk)[-1] == ("Sent", 2)


class WedgedAir(EmulatedAir):
    """Loses the interrupt at a frame's end: the board waits for it for ever, and goes on talking."""

    wedged = True

    def transmit(self, device: Device, now: Instant, tag: int, data: bytes) -> None:
        if not self.wedged:
            super().transmit(device, now, tag, data)


def test_a_wedged_radio_is_silent_once_and_its_boards_ring_is_not_overrun() -> None:
    model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
    air = WedgedAir([1], lambda channel: model, 1)
    desk = Desk(BoardLink(BoardSettings(1)), EmulatedBoard(air, START))
    air.add(desk.board)
    room = Lab(air, [desk], np.random.default_rng(1))
    room.run(milliseconds(50))
    for second in range(20):
        desk.send(room.now, second, bytes(50))
        room.run(seconds(1))
    assert [event.up for event in states(desk.events)] == [True, False, False]
    assert causes(desk.events) == [
        "no_confirmation",
        "silent",
    ]
    # At 12 s it has eight commands; with one of them in the air none is lost, but the ring looks empty.
    assert desk.board.commands.overflows == 1
    assert desk.link.counters["silent"] == 1
    air.wedged = False
    desk.board.reboot(room.now)
    room.run(seconds(10.5))
    desk.send(room.now, 99, b"again")
    room.run(milliseconds(100))
    assert states(desk.events)[-1].up and ("Sent", 99) in ends(desk)


def test_a_cable_that_is_pulled_and_put_in_again() -> None:
    room = lab(2)
    desk = room.desks[0]
    room.run(milliseconds(50))
    for tag in range(6):
        desk.send(room.now, tag, bytes(118))
    room.run(milliseconds(2))
    desk.unplug(room.now)
    assert ends(desk) == [("UnconfirmedPacket", tag) for tag in range(4)]
    room.run(milliseconds(300))
    desk.plug(room.now)
    room.run(milliseconds(50))
    assert ends(desk)[4:] == [("Sent", 4), ("Sent", 5)]
    assert [e.up for e in states(desk.events)] == [True, False, True]


def test_a_hung_board_is_silent_until_it_is_reset() -> None:
    room = lab(1)
    (desk,) = room.desks
    room.run(milliseconds(50))
    desk.board.hung = True
    room.run(seconds(4))
    assert causes(desk.events) == ["no_echo", "silent"]
    desk.board.reboot(room.now)
    room.run(milliseconds(900))
    assert desk.link.phase is LinkPhase.READY


def test_a_thousand_restarts_lose_no_packet_from_the_books() -> None:
    room = lab(1, parameters=QUICK, poll=10_000)
    (desk,) = room.desks
    rng = np.random.default_rng(5)
    tag = 0
    books: dict[int, str] = {}
    room.run(milliseconds(50))
    for _ in range(1_000):
        for _ in range(int(rng.integers(0, 6))):
            desk.send(room.now, tag, b"x" * 60)
            tag += 1
        room.run(milliseconds(float(rng.integers(1, 40))))
        desk.board.reboot(room.now)
        room.run(milliseconds(260))
        assert desk.link.phase is LinkPhase.READY
        for kind, one in ends(desk):
            assert one not in books
            books[one] = kind
        desk.events.clear()
    desk.unplug(room.now)
    assert len(books) + len(ends(desk)) + desk.link.waiting == tag
    assert {"Sent", "UnconfirmedPacket"} <= set(books.values())
    assert desk.link.counters["ups"] == 1_001


def test_noise_of_two_hundred_thousand_bytes_is_borne() -> None:
    result = soak(200_000, seed=3)
    assert result.borne
    assert result.sent > 500
    assert result.unconfirmed > 100
    for worse in ("reported_twice", "unreported", "invented"):
        assert not replace(result, **{worse: 1}).borne
    assert not replace(result, most_kept=300).borne
    assert not replace(result, most_back_ms=101.0, most_bytes_back=301).borne


def test_the_link_carries_what_line_and_air_can() -> None:
    assert throughput(118, seconds(1)).share >= 0.95
    assert throughput(1, seconds(1)).share >= 0.95


def test_what_the_line_damages_in_a_packet_the_components_checksum_finds() -> None:
    """Also where the host does not go by the frame check sequence."""
    room = lab(2, parameters=BeeClickParameters(drop_bad_fcs=False))
    sender, receiver = room.desks
    room.run(milliseconds(50))
    fragmenter, reassembly = Fragmenter(1), Reassembly()
    rng = np.random.default_rng(1)
    wanted = [rng.bytes(40) for _ in range(60)]
    got: list[bytes] = []
    receiver.to_host = Disturbance(change=0.005)
    for number, packet in enumerate(wanted):
        (frame,) = fragmenter.frames([packet])
        sender.send(room.now, number, frame)
        room.run(milliseconds(100))
    for event in receiver.events:
        if isinstance(event, Heard):
            got += reassembly.take(Instant(event.instant), event.sender, event.data)
    assert set(got) <= set(wanted)
    assert reassembly.counters()["bad_checksum"] > 0
    assert receiver.link.counters["bad_fcs"] >= reassembly.counters()["bad_checksum"]
    assert len(got) > 30


def test_the_same_seed_gives_the_same_events() -> None:
    def events() -> list[str]:
        room = lab(3, seed=9)
        for desk in room.desks:
            desk.to_host = desk.to_board = Disturbance(0.001, 0.001, 0.001)
        for round_ in range(300):
            for desk in room.desks:
                desk.send(room.now, round_, bytes(50))
            room.run(milliseconds(5))
        return [repr(event) for desk in room.desks for event in desk.events]

    assert events() == events()


def test_a_link_that_meets_a_running_board_waits_for_its_packets() -> None:
    """A host that has been restarted finds its own earlier packets still on the board."""
    room = lab(1)
    (desk,) = room.desks
    room.run(milliseconds(50))
    for tag in range(4):
        desk.send(room.now, tag, bytes(118))
    room.run(milliseconds(3))
    desk.link = BoardLink(BoardSettings(1))
    desk.link.connect(room.now)
    desk.events.clear()
    room.run(milliseconds(80))
    assert [type(e) for e in desk.events] == [LinkState]
    assert not desk.of(Sent, UnconfirmedPacket)
    assert desk.board.counters["transmitted"] >= 4
