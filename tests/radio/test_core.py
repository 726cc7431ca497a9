"""Events of a few robots in short scenes."""

import math
from collections import Counter

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from actors.messages import (
    AIRED,
    TRANSMIT,
    TRUTH,
    AccessFailure,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    Jam,
    Loss,
    OutgoingFrame,
    RobotTruth,
    Transmit,
    Truth,
)
from actors.radio.core import RadioCore
from actors.radio.medium.state import Cca, Outcome
from actors.radio.program import build
from actors.radio.radio_model import RadioSetup
from actors.radio.robot_medium import TransceiverTruth
from tests.radio.swarm import PLAIN, SPACING, STEP, TURNAROUND, Frame, Robot, Swarm, around
from tests.refusals import refused

NEXT = TURNAROUND + 832 + SPACING
"""Interval between frames of 20 octets of one queue, µs."""


def three() -> Swarm:
    """Return a, b and c in one room; addresses 100, 101 and 102."""
    return Swarm({"a": Robot(0.0), "b": Robot(1.0), "c": Robot(8.0)})


def test_a_frame_is_received_when_its_last_symbol_ends() -> None:
    swarm = three()
    assert swarm.run() == {}
    assert {name for name, count in swarm.core.counters().items() if count} == {"pairs", "pairs_in_reach"}
    events = swarm.run([Frame(STEP + 5, "a", tag=7)])
    assert events["a"] == [FrameSent(STEP + 1029, 7)]
    assert events["b"] == [FrameReceived(STEP + 1029, 100, -72.8, 255, b"12345678901")]
    assert events["c"] == [FrameReceived(STEP + 1029, 100, -90.0, 53, b"12345678901")]
    assert swarm.core.counters()["copies_heard"] == 2


def test_an_ordered_loss_drops_the_next_receivable_frame() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0), "c": Robot(8.0), "far": Robot(30.0)})
    silence = swarm.run(losses=[Loss("c", "a"), Loss("far", "a"), Loss("c", "nobody")])
    assert silence == {}
    first, second = Frame(STEP + 5, "b", 1), Frame(STEP + 20_000, "a", 2)
    events = swarm.run([first, second])
    assert [event.sender for event in events["c"] if isinstance(event, FrameReceived)] == [101]
    assert len(events["b"]) == 2
    counters = swarm.core.counters()
    assert (counters["copies_heard"], counters["copies_lost_withheld"]) == (3, 1)
    again = swarm.run([Frame(2 * STEP + 5, "a", 3)])
    assert [event.sender for event in again["c"] if isinstance(event, FrameReceived)] == [100]
    assert swarm.core.counters()["copies_lost_withheld"] == 1, "far never hears a, and so loses nothing"


def test_outcomes_of_copies_sum_up_to_the_counters() -> None:
    robots = {"a": Robot(0.0), "b": Robot(1.0), "off": Robot(2.0), "c": Robot(8.0), "far": Robot(4000.0)}
    swarm = Swarm(robots, records_outcomes=True)
    swarm.change("off", powered=False)
    swarm.run([Frame(5, "a", 1), Frame(6, "b", 2), Frame(30_000, "a", 3)], losses=[Loss("c", "a")])
    (told,) = swarm.recorded
    counted = Counter[str]()
    for frame in told.frames:
        assert (frame.end, frame.size, frame.ended - frame.handed >= 832) == ("sent", 11, True)
        listed = dict(zip(np.frombuffer(frame.receivers, "<u2").tolist(), frame.outcomes, strict=True))
        assert listed.pop(2) == Outcome.NOT_COUNTED and frame.sender not in listed and 4 not in listed
        assert len(frame.strengths) == 2 * len(frame.outcomes)
        counted.update(
            f"copies_{'' if one == 0 else 'lost_'}{Outcome(one).name.lower()}" for one in listed.values()
        )
        counted["copies_lost_below_sensitivity"] += 1
    assert [frame.tag for frame in told.frames if frame.sender == 0] == [1, 3]
    counters = swarm.core.counters()
    assert counted["copies_lost_withheld"] == 1
    assert counted == {
        name: count for name, count in counters.items() if count and name.startswith("copies_")
    }


def test_a_receiver_is_deaf_while_its_buffer_is_read() -> None:
    phy = replace(PLAIN.phy, dead_us=400, dead_octet_us=5, dead_octets=12)
    robots = {"a": Robot(0.0), "b": Robot(1.0), "c": Robot(2.0)}

    def heard_by_c(pause: int) -> int:
        swarm = Swarm(dict(robots), model=around(replace(PLAIN, phy=phy)))
        swarm.run([Frame(0, "a"), Frame(832 + pause, "b")])
        by_robot = swarm.core.counters_by_robot()
        assert by_robot["c"]["copies_lost_receiver_busy"] == 2 - by_robot["c"]["copies_heard"]
        return by_robot["c"]["copies_heard"]

    assert heard_by_c(459) == 1
    assert heard_by_c(460) == 2


def test_a_channel_that_is_never_clear_is_an_access_failure() -> None:
    polite = replace(PLAIN, transceiver=replace(PLAIN.transceiver, cca=Cca.ENERGY, min_be=0, max_backoffs=0))
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0)}, model=around(polite))
    events = swarm.run([Frame(0, "a", 1), Frame(400, "b", 2)])
    # The assessment takes 8 symbols; a's turned and sends from 320 µs on.
    assert events["b"] == [AccessFailure(528, 2), FrameReceived(1152, 100, -72.8, 255, b"12345678901")]
    assert swarm.core.counters()["frames_access_failure"] == 1


def test_a_frame_crosses_the_step_border() -> None:
    swarm = three()
    start = STEP - 300
    assert swarm.run([Frame(start, "a", 3)]) == {}
    assert swarm.core.counters()["frames_pending"] == 1
    events = swarm.run()
    assert events["a"] == [FrameSent(start + 1024, 3)]
    assert [event.instant for event in events["b"]] == [start + 1024]
    assert swarm.core.counters()["frames_pending"] == 0
    assert swarm.run([Frame(3 * STEP - 1024, "a")]) == {}
    assert swarm.run()["a"] == [FrameSent(3 * STEP, 0)], (
        "one that ends at the border belongs to the next step"
    )


def test_a_jammer_blocks_its_surroundings_until_it_ends() -> None:
    swarm = three()
    jam = Jam(x=1.0, y=0.0, radius=2.0, until=STEP + 2000)
    assert set(swarm.run([Frame(0, "a")], [jam])) == {"a", "c"}
    assert set(swarm.run([Frame(STEP + 1999 - TURNAROUND, "a"), Frame(STEP + 5000, "a")])) == {"a", "b", "c"}
    assert len(swarm.given["c"]) == 3 and len(swarm.given["b"]) == 1
    assert swarm.core.counters()["copies_lost_disturbed"] == 2


def test_robots_move_between_truths() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(10.45, vx=1.0)})
    events = swarm.run([Frame(40_000, "a", 1), Frame(60_000, "a", 2)])
    assert [event.instant for event in events["b"]] == [41_024]
    assert swarm.core.counters()["copies_lost_below_sensitivity"] == 1


def test_a_robot_that_turns_moves_along_its_arc() -> None:
    truth = RobotTruth("a", 2.0, 0.0, math.pi / 2, 0.0, 1.0, 0.5, True, True, 0)
    transceivers = TransceiverTruth(1_000_000, [truth])  # a circle of 2 m around the origin
    for elapsed in (0.0, 0.1, 3.0, 4.0 * math.pi):
        place = transceivers.positions(1_000_000_000 + round(elapsed * 1e9))[0]
        assert place == pytest.approx([2.0 * math.cos(elapsed / 2), 2.0 * math.sin(elapsed / 2)], abs=1e-8)


def test_a_robot_without_power_neither_sends_nor_receives() -> None:
    swarm = three()
    swarm.change("b", powered=False)
    events = swarm.run([Frame(0, "a"), Frame(5000, "b")])
    assert set(events) == {"a", "c"}
    counters = swarm.core.counters()
    assert (counters["copies_heard"], counters["copies_lost_powered_off"]) == (1, 0)
    assert counters["frames_discarded"] == 1


def test_a_kill_cuts_the_frame_and_clears_the_queue() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 300, "a", 1), Frame(STEP - 50, "a", 2)])
    swarm.change("a", powered=False, stepping=False)
    assert swarm.run() == {}
    swarm.change("a", powered=True, stepping=True)
    assert swarm.run([Frame(2 * STEP, "a", 9)])["a"] == [FrameSent(2 * STEP + 1024, 9)]
    counters = swarm.core.counters()
    assert (counters["frames_cut_off"], counters["frames_discarded"], counters["frames_sent"]) == (1, 1, 1)
    assert counters["bytes_sent"] == 11 + 9  # nothing of the one that was cut off
    assert (counters["copies_lost_powered_off"], counters["copies_heard"]) == (2, 2)


def test_a_robot_restarted_within_a_frame_does_not_receive_it() -> None:
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0)}, step_us=300)
    swarm.run([Frame(0, "a")])
    swarm.change("b", powered=False, stepping=False)
    swarm.run()
    swarm.change("b", powered=True, stepping=True)
    assert swarm.run() == {}
    assert swarm.run() == {"a": [FrameSent(1024, 0)]}
    assert swarm.core.counters()["copies_lost_powered_off"] == 1


def test_a_robot_in_a_new_epoch_has_an_empty_transceiver() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 1024, "a", 1), Frame(STEP - 1024, "a", 2)])  # the first one ends at the border
    swarm.change("a", epoch=1)
    events = swarm.run([Frame(STEP + 5000, "a", 7)])
    assert events["a"] == [FrameSent(STEP + 5000 + 1024, 7)]
    assert [event.instant for event in events["b"]] == [STEP, STEP + 5000 + 1024]
    counters = swarm.core.counters()
    assert (counters["frames_sent"], counters["frames_discarded"], counters["events_discarded"]) == (2, 1, 1)


@pytest.mark.parametrize("killed", [False, True])
def test_events_held_for_a_frozen_robot_are_discarded_at_a_restart(killed: bool) -> None:
    swarm = three()
    swarm.change("b", stepping=False)
    swarm.run([Frame(0, "a")])
    if killed:
        swarm.change("b", powered=False)
        swarm.run()
    swarm.change("b", powered=True, stepping=True, epoch=0 if killed else 1)
    assert swarm.run() == {}
    assert swarm.core.counters()["events_discarded"] == 1


def test_a_thawed_robot_gets_the_first_seven_events() -> None:
    swarm = three()
    swarm.change("b", stepping=False)
    swarm.run([Frame(2000 * i, "a", i) for i in range(5)])
    assert "b" not in swarm.given
    swarm.run([Frame(STEP + 2000 * i, "a", i) for i in range(5)])
    swarm.change("b", stepping=True)
    events = swarm.run([Frame(2 * STEP, "a")])["b"]
    expected = [1024 + 2000 * i for i in range(5)] + [STEP + 1024, STEP + 3024, 2 * STEP + 1024]
    assert [event.instant for event in events] == expected
    assert swarm.core.counters()["events_dropped"] == 3
    assert "b" not in swarm.run()


def test_a_frozen_robots_queue_empties_by_itself() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 10, "a", 1), Frame(STEP - 5, "a", 2)])
    swarm.change("a", stepping=False)
    assert len(swarm.run()["b"]) == 2
    swarm.change("a", stepping=True)
    assert swarm.run() == {"a": [FrameSent(STEP + 1014, 1), FrameSent(STEP + 1014 + NEXT, 2)]}


def test_invalid_frames_are_refused() -> None:
    swarm = three()
    frames = [Frame(10, "a", 1, bytes(120)), Frame(20, "a", 2, bytes(119))]
    frames += [Frame(instant, "a", tag) for tag, instant in ((3, STEP), (4, -1), (5, 15))]
    assert swarm.run(frames)["a"] == [
        FrameRefused(0, 4, "The frame's instant -1 µs is outside step 0; it must be 0 to 99999 µs."),
        FrameRefused(10, 1, "The frame has 120 data bytes; it must have 0 to 118."),
        FrameRefused(20, 2, "The frame has 119 data bytes; it must have 0 to 118."),
        FrameSent(1039, 5),
        FrameRefused(99_999, 3, "The frame's instant 100000 µs is outside step 0; it must be 0 to 99999 µs."),
    ]
    assert swarm.core.counters()["frames_refused"] == 4
    swarm.robots["x"] = Robot(0.0)
    events = swarm.run([Frame(STEP + 10, "x", 1)])
    sentence = "Robot x has no transceiver; it is not in the radio's set-up."
    assert events == {"x": [FrameRefused(STEP + 10, 1, sentence)]}


def test_a_transmit_that_breaks_its_announcement_ends_the_run() -> None:
    swarm = three()
    truth = swarm.truth([Frame(0, "a"), Frame(1, "a")])
    with refused("step 0: a announced 2 frames, but its Transmit carries 1"):
        swarm.core.advance({TRUTH.key(): truth, TRANSMIT.key("a"): Transmit(0, (OutgoingFrame(0, 0, b"x"),))})
    with refused("step 0: a sent a Transmit of step 3, expected step 0"):
        swarm.core.advance({TRUTH.key(): truth, TRANSMIT.key("a"): Transmit(3, (OutgoingFrame(0, 0, b"x"),))})


def test_a_truth_of_another_step_ends_the_run() -> None:
    swarm = three()
    with refused("step 0: the world sent Truth of step 2; expected step 0"):
        swarm.core.advance({TRUTH.key(): msgspec.structs.replace(swarm.truth([]), step=2)})


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
        ((("a", 1), ("b", 1)), "Robots a and b share the short address 1; it must be unique."),
        ((("a", 1), ("a", 2)), "Robot a has two entries in the radio's set-up; delete one."),
        ((), "The radio's step_us is 0 µs; must be at least 1 µs."),
        ((("a", 65534),), "Robot a has the short address 65534; must be 0 to 65533."),
    ],
)
def test_invalid_setups_are_refused(robots: tuple[tuple[str, int], ...], sentence: str) -> None:
    with refused(sentence):
        build(RadioSetup(seed=1, step_us=STEP if robots else 0, robots=robots))


def test_consecutive_frames_are_both_received() -> None:
    swarm = three()
    first = Frame(0, "a")
    events = swarm.run([first, Frame(first.instant + first.airtime, "b")])
    assert [event.instant for event in events["c"]] == [TURNAROUND + 832, TURNAROUND + 2 * 832]
    # b was turning while a still sent, and a while b began
    assert swarm.core.counters()["copies_lost_half_duplex"] == 2


def test_a_much_stronger_frame_captures_the_receiver_within_the_preamble() -> None:
    def heard(later: int) -> list[int]:
        swarm = Swarm({"near": Robot(1.0), "far": Robot(-8.0), "c": Robot(0.0)})
        events = swarm.run([Frame(0, "far", data=bytes(50)), Frame(later, "near")])
        return [event.sender for event in events.get("c", []) if isinstance(event, FrameReceived)]

    assert heard(127) == [100]
    assert heard(128) == []
    assert heard(-1 + 128) == [100]


def test_a_frame_frees_its_queue_slot_when_it_ends() -> None:
    swarm = three()
    events = swarm.run([*(Frame(0, "a", tag) for tag in range(8)), Frame(1023, "a", 8), Frame(1024, "a", 9)])
    assert [event for event in events["a"] if isinstance(event, FrameOverflow)] == [FrameOverflow(1023, 8)]


def test_a_frame_that_ends_at_a_kill_is_complete() -> None:
    swarm = three()
    swarm.run([Frame(STEP - 1024, "a", 1), Frame(STEP - 1024, "a", 2)])
    swarm.change("a", powered=False, stepping=False)
    assert set(swarm.run()) == {"b", "c"}
    counters = swarm.core.counters()
    assert (counters["frames_sent"], counters["frames_cut_off"], counters["frames_discarded"]) == (1, 0, 1)
    assert counters["events_discarded"] == 1  # a's own FrameSent
