from actors.board_readings import LinkState, Temperature
from actors.instant import Instant, milliseconds, seconds
from actors.messages import AccessFailure, Overflow, Refused, Sent
from actors.radio.frame import DataFrame
from firmware_bridge.beeclick.link import LinkPhase
from firmware_bridge.beeclick.reception import UnconfirmedPacket
from firmware_bridge.beeclick.wire import (
    SYNC_PATTERN,
    PacketSent,
    ReceivedPacket,
    SendPacket,
    SetAddress,
    SetChannel,
    SetPower,
    Warmth,
)
from tests.beeclick.hosts import ECHOES, SYNC, Host, causes, confirm, states


def packet(data: bytes, pan: int = 0xBABA, address: int = 7) -> ReceivedPacket:
    return ReceivedPacket(pan, address, 138, 200, DataFrame(pan, address, data).check, data)


def test_a_link_starts_with_a_sync_and_the_set_up_confirmed_by_echoes() -> None:
    host = Host()
    assert host.due() == SYNC
    assert host.due() == b""
    assert host.hear(SYNC_PATTERN, after=6_000) == []
    assert host.commands() == [SetAddress(0xBABA, 0x0103), SetChannel(15), SetPower(-100)]
    assert host.hear(*ECHOES[:2]) == []
    assert host.link.phase is LinkPhase.SETTING
    assert host.hear(ECHOES[2]) == [LinkState(host.now, True, "")]
    counted = {name: count for name, count in host.link.counters.items() if count}
    assert counted == {"answers": 4, "syncs": 1, "ups": 1}


def test_nothing_is_believed_before_the_first_sync_answer() -> None:
    host = Host()
    host.due()
    assert host.hear(Warmth(215), packet(b"old"), ECHOES[0], b"\x00Hel", SYNC_PATTERN) == []
    assert host.link.phase is LinkPhase.SETTING
    assert host.link.counters["junk_bytes"] == 3 + 13 + 5 + 4
    assert host.link.counters["heard"] == 0


def test_what_follows_a_sync_answer_is_believed() -> None:
    host = Host()
    host.due()
    assert host.hear(SYNC_PATTERN, Warmth(215)) == [Temperature(host.now, 21.5, valid=True)]


def test_a_sync_is_repeated_until_it_is_answered() -> None:
    host = Host()
    assert host.due() == SYNC
    for _ in range(3):
        assert host.hear(after=79_999) == []
        assert host.due() == b""
        host.hear(after=1)
        assert host.due() == SYNC
    host.hear(SYNC_PATTERN)
    assert len(host.commands()) == 3
    host.hear(SYNC_PATTERN * 2, *ECHOES)  # the answers to the others
    assert host.link.phase is LinkPhase.READY
    assert host.link.counters["late_sync"] == 2


def test_packets_wait_for_the_set_up() -> None:
    host = Host()
    assert host.link.send(host.now, 1, b"early") == []
    assert host.due() == SYNC
    host.hear(SYNC_PATTERN)
    assert len(host.commands()) == 3
    host.hear(*ECHOES)
    (command,) = host.commands()
    assert isinstance(command, SendPacket)
    assert command.data == b"early"


def test_a_wrong_echo_begins_everything_anew() -> None:
    host = Host()
    host.due()
    host.hear(SYNC_PATTERN)
    host.due()
    host.hear(SetAddress(0xBABA, 0x0104))
    assert host.link.phase is LinkPhase.SYNCING
    assert host.link.counters["strange_echo"] == 1


def test_a_missing_echo_begins_everything_anew() -> None:
    host = Host()
    host.due()
    host.hear(SYNC_PATTERN)
    host.due()
    host.hear(ECHOES[0], ECHOES[2])
    assert host.link.phase is LinkPhase.SYNCING
    host.hear(after=80_000)
    assert host.due() == SYNC


# --- packets ---------------------------------------------------------------------------------------------


def test_at_most_four_packets_are_in_flight() -> None:
    host = Host().get_ready()
    numbers = host.send(0, 1, 2, 3, 4, 5)
    assert len(set(numbers)) == 4
    assert (host.link.in_flight, host.link.waiting) == (4, 2)
    assert host.hear(confirm(numbers[0])) == [Sent(host.now, 0)]
    (fifth,) = host.send()
    assert host.hear(*(confirm(n) for n in [*numbers[1:], fifth])) == [
        Sent(host.now, t) for t in (1, 2, 3, 4)
    ]


def test_a_packet_is_sent_or_has_failed() -> None:
    host = Host().get_ready()
    first, second = host.send(10, 11)
    assert host.hear(confirm(first, failed=True), confirm(second), after=5) == [
        AccessFailure(host.now, 10),
        Sent(host.now, 11),
    ]


def test_a_packet_of_the_wrong_size_is_refused() -> None:
    host = Host().get_ready()
    assert host.link.send(host.now, 1, bytes(119)) == [
        Refused(host.now, 1, "The frame has 119 data bytes; it must have 0 to 118.")
    ]
    assert host.due() == b""
    assert host.link.counters["refused"] == 1


def test_beyond_the_queue_the_new_packet_is_dropped() -> None:
    host = Host().get_ready()
    events = [event for tag in range(10) for event in host.link.send(host.now, tag, b"x")]
    assert events == [Overflow(host.now, 8), Overflow(host.now, 9)]
    assert len(host.send()) == 4
    assert host.link.send(host.now, 10, b"x") == [Overflow(host.now, 10)]
    assert host.link.counters["overflowed"] == 3


def test_a_later_confirmation_settles_the_earlier_packets() -> None:
    host = Host().get_ready()
    first, second = host.send(1, 2)
    assert host.hear(confirm(second)) == [UnconfirmedPacket(host.now, 1, "answer_skipped"), Sent(host.now, 2)]
    assert host.hear(confirm(first)) == []  # never twice
    assert host.link.counters["late_confirmation"] == 1
    assert host.link.phase is LinkPhase.READY


def test_a_confirmation_that_comes_twice_counts_once() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    assert host.hear(confirm(number), confirm(number)) == [Sent(host.now, 1)]


def test_a_confirmation_of_no_packet_is_noise() -> None:
    host = Host().get_ready()
    host.send(1)
    events = host.hear(PacketSent(0x12345678, failed=False))
    assert events == [LinkState(host.now, False, "strange_confirmation")]
    assert host.link.counters["strange_confirmation"] == 1
    assert host.link.phase is LinkPhase.SYNCING


# --- out of step -----------------------------------------------------------------------------------------


def test_confirmations_ahead_of_the_sync_answer_count() -> None:
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4)
    assert host.hear(after=seconds(1)) == [LinkState(host.now, False, "no_confirmation")]
    assert host.due() == SYNC
    assert host.hear(confirm(numbers[0]), confirm(numbers[1], failed=True)) == [
        Sent(host.now, 1),
        AccessFailure(host.now, 2),
    ]
    assert host.hear(SYNC_PATTERN) == [
        UnconfirmedPacket(host.now, 3, "answer_skipped"),
        UnconfirmedPacket(host.now, 4, "answer_skipped"),
    ]
    assert len(host.commands()) == 3
    assert host.hear(*ECHOES) == [LinkState(host.now, True, "")]


def test_confirmations_within_noise_count() -> None:
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4)
    assert host.hear(b"\xee") == [LinkState(host.now, False, "unknown_type")]
    host.hear(after=80_000)
    assert host.due() == SYNC
    noise = b"\x01\x70\x02" + confirm_bytes(numbers[1])[:5] + b"\x09"
    assert host.hear(confirm(numbers[0]), noise, confirm(numbers[1]), b"\x02", SYNC_PATTERN) == [
        Sent(host.now, 1),
        Sent(host.now, 2),
        UnconfirmedPacket(host.now, 3, "answer_skipped"),
        UnconfirmedPacket(host.now, 4, "answer_skipped"),
    ]


def confirm_bytes(number: int) -> bytes:
    return b"\x02" + number.to_bytes(4, "little") + b"\x00"


def test_noise_while_nothing_is_in_flight_invents_nothing() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    host.hear(confirm(number))
    assert host.hear(b"\xee", confirm(number), confirm(number + 1)) == [
        LinkState(host.now, False, "unknown_type")
    ]


HEAD = b"\x01\x70\xba\xba\x07\x00\x8a\xc8\x00\x00"
"""Of a packet of 112 bytes that never come."""


def test_an_answer_that_swallows_the_sync_answer_is_given_up() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    host.hear(after=seconds(1))
    assert host.due() == SYNC
    assert host.hear(HEAD, confirm(number), SYNC_PATTERN) == [Sent(host.now, 1)]
    assert host.link.counters["swallowed_sync"] == 1
    assert len(host.commands()) == 3


def test_what_a_given_up_answer_has_swallowed_is_looked_through() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    assert host.hear(HEAD, confirm(number)) == []
    assert host.hear(after=50_000) == [LinkState(host.now, False, "stalled"), Sent(host.now, 1)]


def test_an_answer_that_stops_in_its_middle_is_given_up() -> None:
    host = Host().get_ready()
    assert host.hear(b"\x01\x70\xba", after=10) == []
    assert host.link.wake() == host.now + milliseconds(50)
    assert host.hear(after=milliseconds(50)) == [LinkState(host.now, False, "stalled")]


def test_a_board_that_does_not_listen_any_more_is_found_by_asking() -> None:
    host = Host().get_ready()
    assert host.link.wake() == host.now + milliseconds(250)
    host.hear(packet(b"news"), after=milliseconds(250))  # hearing others does not prove that it hears us
    assert host.commands() == [SetAddress(0xBABA, 0x0103)]
    assert host.hear(after=milliseconds(250)) == []
    assert host.due() == SYNC
    assert host.hear(SYNC_PATTERN, after=5_000) == [LinkState(host.now, False, "answer_skipped")]
    assert len(host.commands()) == 3
    assert host.hear(*ECHOES) == [LinkState(host.now, True, "")]
    assert host.link.counters["probes"] == 1


def test_a_board_that_is_only_slow_is_not_down_and_loses_nothing() -> None:
    """For 0.7 s it does nothing, as with its button pressed: two SYNCs ahead of time, and no more packets."""
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4)
    syncs = []
    for _ in range(70):
        assert host.hear(after=10_000) == []
        host.link.send(host.now, 5, b"x") if host.now == 600_000 else None
        if host.due():
            syncs.append(host.now)
    assert syncs == [250_000, 500_000], "with four packets six commands, as many as the board's ring may have"
    assert host.hear(*map(confirm, numbers), SYNC_PATTERN, SYNC_PATTERN) == [
        Sent(host.now, tag) for tag in (1, 2, 3, 4)
    ]
    assert host.link.phase is LinkPhase.READY and host.link.counters["late_sync"] == 1
    assert len(host.send()) == 1


def test_a_board_that_listens_is_asked_again_and_again() -> None:
    host = Host().get_ready()
    for _ in range(3):
        assert host.hear(after=seconds(1)) == []
        assert host.commands() == [SetAddress(0xBABA, 0x0103)]
        assert host.hear(ECHOES[0], after=1_000) == []
    assert host.link.phase is LinkPhase.READY


def test_a_silent_board_is_reported_once_and_asked_on() -> None:
    host = Host().get_ready()
    host.send(1)
    host.link.send(host.now, 9, b"later")
    host.due()
    events, syncs = [], []
    for _ in range(80):
        events += host.hear(after=50_000)
        if host.due():
            syncs.append(host.now)
    assert events == [
        LinkState(Instant(1_000_000), False, "no_confirmation"),
        LinkState(Instant(2_000_000), False, "silent"),
        UnconfirmedPacket(Instant(2_000_000), 1, "silent"),
        UnconfirmedPacket(Instant(2_000_000), 9, "silent"),
    ]
    assert syncs == [250_000, 500_000, 750_000, 1_000_000, 1_800_000, 2_600_000, 3_400_000]
    host.hear(SYNC_PATTERN)
    assert len(host.commands()) == 3
    assert host.hear(*ECHOES) == [], "first its radio has to be heard of"
    (number,) = host.send(10, 11)
    assert host.hear(confirm(number)) == [Sent(host.now, 10), LinkState(host.now, True, "")]


def test_a_board_that_talks_and_does_not_listen_is_not_filled_up() -> None:
    """Its radio is wedged: what it hears and measures comes, and no command is handled."""
    host = Host().get_ready()
    host.send(1, 2, 3, 4)
    syncs = []
    for step in range(2_000):
        host.hear(*([Warmth(215)] if step % 50 == 0 else []), after=10_000)
        if host.due():
            syncs.append(host.now)
    assert syncs == [250_000, 500_000, 1_300_000, 11_300_000]


def test_two_packets_in_a_row_of_which_nothing_becomes_make_the_radio_silent() -> None:
    """Though the board answers all else: it is not up and down in turns, but silent until it confirms one."""
    host = Host().get_ready()
    events = []
    for tag in range(1, 30):
        events += host.link.send(host.now, tag, b"x")
        for command in host.commands():
            assert isinstance(command, SendPacket)
        events += host.hear(after=seconds(1))
        assert host.due() == SYNC
        events += host.hear(SYNC_PATTERN, after=5_000)
        host.commands()
        events += host.hear(*ECHOES, after=1_000)
    told = states(events)
    assert [event.up for event in told] == [False, True, False]
    assert causes(told) == [
        "no_confirmation",
        "silent",
    ]
    assert len({event.tag for event in events if isinstance(event, UnconfirmedPacket)}) >= 28
    (number,) = host.send(40)
    assert host.hear(confirm(number)) == [Sent(host.now, 40), LinkState(host.now, True, "")]


def test_noise_that_shows_brings_the_next_sync_forward() -> None:
    host = Host()
    for _ in range(4):
        host.due()
        host.hear(after=80_000)
    assert host.due() == b""
    assert host.link.wake() == 1_000_000  # then it is given up; the next SYNC at 1.04 s
    host.hear(b"\x77")
    assert host.due() == SYNC


def test_without_a_port_what_is_in_flight_is_unconfirmed_and_the_rest_waits() -> None:
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4, 5)
    assert host.link.lost(host.now) == [
        LinkState(host.now, False, "lost"),
        *(UnconfirmedPacket(host.now, tag, "lost") for tag in (1, 2, 3, 4)),
    ]
    assert host.hear(confirm(numbers[0])) == []
    assert (host.due(), host.link.wake(), host.link.waiting) == (b"", None, 1)
    host.link.connect(host.now)
    assert host.due() == SYNC
    # What the board still had to say of the time before is of no interest any more.
    assert host.hear(confirm(numbers[1]), SYNC_PATTERN) == []
    host.due()
    host.hear(*ECHOES)
    (fifth,) = host.send()
    assert host.hear(confirm(fifth)) == [Sent(host.now, 5)]


def test_syncs_keep_their_distance() -> None:
    host = Host().get_ready()
    host.hear(b"\xee", after=1_000)
    assert host.due() == b""
    assert host.link.wake() == 80_000


def test_a_host_that_was_held_up_reads_before_it_judges() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    assert host.hear(confirm(number), after=seconds(5)) == [Sent(host.now, 1)]
    assert host.link.phase is LinkPhase.READY


# --- what the board says unasked -------------------------------------------------------------------------
