"""Short stories of a few robots: who hears what, and what each is told."""

import pytest

from actors.messages import (
    AIRED,
    TRANSMIT,
    TRUTH,
    Heard,
    Jam,
    Outgoing,
    Overflow,
    Refused,
    Sent,
    Transmit,
    Truth,
)
from actors.radio.core import RadioCore
from actors.radio.program import build
from actors.radio.setup import RadioSetup
from actors.runtime.errors import AcrcError
from tests.radio.swarm import STEP, Frame, Robot, Swarm


def three() -> Swarm:
    """A, b and c in one room; addresses 100, 101 and 102."""
    return Swarm({"a": Robot(0.0), "b": Robot(1.0), "c": Robot(8.0)})


def test_a_frame_is_heard_when_its_last_symbol_ends() -> None:
    swarm = three()
    events = swarm.run([Frame(5, "a", tag=7)])
    assert events["a"] == [Sent(837, 7)]
    assert events["b"] == [Heard(837, 100, -72.8, 255, b"12345678901")]
    assert events["c"] == [Heard(837, 100, -90.8, 54, b"12345678901")]
    assert swarm.core.counters()["copies_heard"] == 2


def test_nothing_on_the_air_is_said_in_an_empty_aired() -> None:
    swarm = three()
    assert swarm.run() == {}
    assert set(swarm.core.counters().values()) == {0}


def test_two_frames_that_overlap_are_both_lost() -> None:
    swarm = three()
    first = Frame(0, "a")
    events = swarm.run([first, Frame(first.end - 1, "b")])
    assert "c" not in events
    counters = swarm.core.counters()
    assert counters["copies_lost_collision"] == 2  # at c, both
    assert counters["copies_lost_half_duplex"] == 2  # at a and b


def test_frames_that_only_touch_are_both_heard() -> None:
    swarm = three()
    first = Frame(0, "a")
    events = swarm.run([first, Frame(first.end, "b")])
    assert [event.instant for event in events["c"]] == [832, 1664]
    assert swarm.core.counters()["copies_heard"] == 4


def test_a_sender_out_of_range_does_not_disturb() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(5.0), "far": Robot(16.0)})
    events = swarm.run([Frame(0, "a", 1), Frame(100, "far", 2)])
    assert events["b"] == [Heard(832, 100, -86.8, 105, b"12345678901")]
    assert swarm.core.counters()["copies_lost_out_of_range"] == 3


def test_hidden_senders_collide_at_the_one_between() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(9.0), "c": Robot(18.0)})
    assert "b" not in swarm.run([Frame(0, "a"), Frame(400, "c")])
    counters = swarm.core.counters()
    assert (counters["copies_lost_collision"], counters["copies_lost_out_of_range"]) == (2, 2)


def test_a_robot_is_deaf_while_it_sends() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0)})
    events = swarm.run([Frame(0, "a", 1), Frame(300, "b", 2)])
    assert events == {"a": [Sent(832, 1)], "b": [Sent(1132, 2)]}
    assert swarm.core.counters()["copies_lost_half_duplex"] == 2


def test_a_second_frame_waits_for_the_first() -> None:
    swarm = three()
    events = swarm.run([Frame(0, "a", 1), Frame(10, "a", 2)])
    assert events["a"] == [Sent(832, 1), Sent(1664, 2)]
    assert [event.instant for event in events["b"]] == [832, 1664]


def test_a_full_queue_drops_the_newest_frame_and_says_so() -> None:
    swarm = three()
    events = swarm.run([Frame(tag, "a", tag) for tag in range(10)])
    assert events["a"][:2] == [Overflow(8, 8), Overflow(9, 9)]
    assert events["a"][2:] == [Sent(832 * (tag + 1), tag) for tag in range(8)]
    assert swarm.core.counters()["frames_overflowed"] == 2


def test_the_last_waiting_frame_makes_room_at_the_very_instant_it_begins() -> None:
    swarm = three()
    events = swarm.run([*(Frame(0, "a", tag) for tag in range(8)), Frame(832, "a", 8)])
    assert not any(isinstance(event, Overflow) for event in events["a"])


def test_two_queues_that_go_on_at_the_same_instant_do_not_meet_the_frames_that_end() -> None:
    far_apart = Swarm({"a": Robot(0.0), "b": Robot(1.0), "c": Robot(30.0), "d": Robot(31.0)})
    far_apart.run([Frame(0, "a", 1), Frame(0, "a", 2), Frame(0, "c", 1), Frame(0, "c", 2)])
    assert [len(far_apart.given[robot]) for robot in "abcd"] == [2, 2, 2, 2]


def test_a_frame_crosses_the_step_border() -> None:
    swarm = three()
    start = STEP - 100
    assert swarm.run([Frame(start, "a", 3)]) == {}
    assert swarm.core.counters()["frames_pending"] == 1
    events = swarm.run()
    assert events["a"] == [Sent(start + 832, 3)]
    assert [event.instant for event in events["b"]] == [start + 832]
    assert swarm.core.counters()["frames_pending"] == 0


def test_a_frame_that_ends_at_the_border_belongs_to_the_next_step() -> None:
    swarm = three()
    assert swarm.run([Frame(STEP - 832, "a")]) == {}
    assert swarm.run()["a"] == [Sent(STEP, 0)]


def test_frames_overlap_across_the_border() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 100, "a")])
    events = swarm.run([Frame(STEP + 5, "b")])
    assert set(events) == {"a", "b"}
    assert swarm.core.counters()["copies_lost_collision"] == 2


def test_a_jammer_silences_its_surroundings_until_it_ends() -> None:
    swarm = three()
    jam = Jam(x=1.0, y=0.0, radius=2.0, until=STEP + 2000)
    assert set(swarm.run([Frame(0, "a")], [jam])) == {"a", "c"}
    assert set(swarm.run([Frame(STEP + 1999, "a"), Frame(STEP + 5000, "a")])) == {"a", "b", "c"}
    assert len(swarm.given["c"]) == 3 and len(swarm.given["b"]) == 1
    assert swarm.core.counters()["copies_lost_jammed"] == 2


def test_a_jammer_hits_the_frame_that_is_already_in_the_air() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 100, "a")])
    assert set(swarm.run([], [Jam(x=0.0, y=0.0, radius=3.0, until=2 * STEP)])) == {"a", "c"}


def test_robots_move_on_between_truths() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(10.45, vx=1.0)})
    events = swarm.run([Frame(40_000, "a", 1), Frame(60_000, "a", 2)])
    assert [event.instant for event in events["b"]] == [40_832]
    assert swarm.core.counters()["copies_lost_out_of_range"] == 1


def test_a_robot_without_power_neither_sends_nor_hears() -> None:
    swarm = three()
    swarm.change("b", powered=False)
    events = swarm.run([Frame(0, "a"), Frame(5000, "b")])
    assert set(events) == {"a", "c"}
    counters = swarm.core.counters()
    assert (counters["copies_heard"], counters["copies_lost_powered_off"]) == (1, 0)
    assert counters["frames_discarded"] == 1


def test_a_killed_robot_cuts_its_frame_and_forgets_its_queue() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 100, "a", 1), Frame(STEP - 50, "a", 2)])
    swarm.change("a", powered=False, stepping=False)
    assert swarm.run() == {}
    swarm.change("a", powered=True, stepping=True)
    assert swarm.run([Frame(2 * STEP, "a", 9)])["a"] == [Sent(2 * STEP + 832, 9)]
    counters = swarm.core.counters()
    assert (counters["frames_cut_off"], counters["frames_discarded"], counters["frames_sent"]) == (1, 1, 1)
    assert counters["bytes_sent"] == 11 + 9  # nothing of the one that was cut off
    assert (counters["copies_lost_powered_off"], counters["copies_heard"]) == (2, 2)


def test_a_frame_that_ended_at_the_very_border_was_whole_before_the_kill() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 832, "a", 1), Frame(STEP - 832, "a", 2)])
    swarm.change("a", powered=False, stepping=False)
    assert set(swarm.run()) == {"b", "c"}
    counters = swarm.core.counters()
    assert (counters["frames_sent"], counters["frames_cut_off"], counters["frames_discarded"]) == (1, 0, 1)
    assert counters["events_discarded"] == 1  # a's own Sent


def test_a_robot_killed_and_restarted_within_a_frame_does_not_hear_it() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0)}, step_us=300)
    swarm.run([Frame(0, "a")])
    swarm.change("b", powered=False, stepping=False)
    swarm.run()
    swarm.change("b", powered=True, stepping=True)
    assert swarm.run() == {"a": [Sent(832, 0)]}
    assert swarm.core.counters()["copies_lost_powered_off"] == 1


def test_a_frozen_robot_finds_the_first_seven_events_when_it_thaws() -> None:
    swarm = three()
    swarm.change("b", stepping=False)
    swarm.run([Frame(1000 * i, "a", i) for i in range(5)])
    assert "b" not in swarm.given
    swarm.run([Frame(STEP + 1000 * i, "a", i) for i in range(5)])
    swarm.change("b", stepping=True)
    events = swarm.run([Frame(2 * STEP, "a")])["b"]
    expected = [832 + 1000 * i for i in range(5)] + [STEP + 832, STEP + 1832, 2 * STEP + 832]
    assert [event.instant for event in events] == expected
    assert swarm.core.counters()["events_dropped"] == 3
    assert "b" not in swarm.run()


def test_a_frozen_robots_queue_empties_by_itself() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 10, "a", 1), Frame(STEP - 5, "a", 2)])
    swarm.change("a", stepping=False)
    assert len(swarm.run()["b"]) == 2
    swarm.change("a", stepping=True)
    assert swarm.run() == {"a": [Sent(STEP + 822, 1), Sent(STEP + 1654, 2)]}


def test_what_was_held_for_a_robot_is_gone_when_it_is_killed() -> None:
    swarm = three()
    swarm.change("b", stepping=False)
    swarm.run([Frame(0, "a")])
    swarm.change("b", powered=False)
    swarm.run()
    swarm.change("b", powered=True, stepping=True)
    assert swarm.run() == {}
    assert swarm.core.counters()["events_discarded"] == 1


def test_a_wrong_frame_is_refused_with_a_sentence() -> None:
    swarm = three()
    frames = [
        Frame(10, "a", 1, b""),
        Frame(20, "a", 2, bytes(119)),
        Frame(STEP, "a", 3),
        Frame(-1, "a", 4),
        Frame(15, "a", 5),
    ]
    assert swarm.run(frames)["a"] == [
        Refused(0, 4, "The frame's instant -1 µs lies outside step 0; it must be 0 to 99999 µs."),
        Refused(10, 1, "The frame has 0 data bytes; it must have 1 to 118."),
        Refused(20, 2, "The frame has 119 data bytes; it must have 1 to 118."),
        Sent(847, 5),
        Refused(99_999, 3, "The frame's instant 100000 µs lies outside step 0; it must be 0 to 99999 µs."),
    ]
    assert swarm.core.counters()["frames_refused"] == 4


def test_a_robot_that_the_radio_does_not_know_is_refused() -> None:
    swarm = three()
    swarm.robots["x"] = Robot(0.0)
    events = swarm.run([Frame(10, "x", 1)])
    assert events == {"x": [Refused(10, 1, "Robot x has no transceiver; the radio was set up without it.")]}


def test_a_transmit_that_breaks_its_announcement_ends_the_run() -> None:
    swarm = three()
    truth = swarm.truth([Frame(0, "a"), Frame(1, "a")])
    with pytest.raises(AcrcError) as error:
        swarm.core.advance({TRUTH.key(): truth, TRANSMIT.key("a"): Transmit(0, (Outgoing(0, 0, b"x"),))})
    assert str(error.value) == "Step 0: a announced 2 frames, but its Transmit carries 1."


def test_halt_finishes_without_an_answer() -> None:
    core: RadioCore = three().core
    inputs = {TRUTH.key(): Truth(0, 0, (), halt=True)}
    assert core.missing(inputs) == ()
    assert core.advance(inputs) == ()
    assert core.finished
    assert AIRED.key() == "swarm/infra/aired"


@pytest.mark.parametrize(
    ("robots", "sentence"),
    [
        ((("a", 1), ("b", 1)), "Robots a and b share the short address 1; each needs its own."),
        ((("a", 1), ("a", 2)), "Robot a is listed twice for the radio; each robot needs one entry."),
        ((("a", 65534),), "Robot a has the short address 65534; it must be 0 to 65533."),
    ],
)
def test_a_setup_that_makes_no_sense_is_named(robots: tuple[tuple[str, int], ...], sentence: str) -> None:
    with pytest.raises(AcrcError) as error:
        build(RadioSetup(1, STEP, robots))
    assert str(error.value) == sentence


def test_a_step_without_length_is_named() -> None:
    with pytest.raises(AcrcError) as error:
        build(RadioSetup(1, 0, (("a", 1),)))
    assert str(error.value) == "The radio's step is 0 µs long; it must be at least 1 µs."
