"""What the radio does not take: from a robot, from the world, from who sets it up."""

import math
from typing import Any

import msgspec
import pytest

from actors.messages import (
    AIRED,
    TRANSMIT,
    TRUTH,
    Jam,
    Outgoing,
    Refused,
    RobotTruth,
    Sent,
    Transmit,
    Truth,
)
from actors.radio.core import RadioCore
from actors.radio.program import build
from actors.radio.radio_model import RadioSetup
from actors.runtime.errors import AcrcError
from tests.radio.swarm import STEP, Frame, Robot
from tests.radio.test_stories import three


def test_a_wrong_frame_is_refused_with_a_sentence() -> None:
    swarm = three()
    frames = [
        Frame(10, "a", 1, bytes(120)),
        Frame(20, "a", 2, bytes(119)),
        Frame(STEP, "a", 3),
        Frame(-1, "a", 4),
        Frame(15, "a", 5),
    ]
    assert swarm.run(frames)["a"] == [
        Refused(0, 4, "The frame's instant -1 µs lies outside step 0; it must be 0 to 99999 µs."),
        Refused(10, 1, "The frame has 120 data bytes; it must have 0 to 118."),
        Refused(20, 2, "The frame has 119 data bytes; it must have 0 to 118."),
        Sent(1039, 5),
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


def test_a_transmit_of_another_step_ends_the_run() -> None:
    swarm = three()
    truth = swarm.truth([Frame(0, "a")])
    with pytest.raises(AcrcError) as error:
        swarm.core.advance({TRUTH.key(): truth, TRANSMIT.key("a"): Transmit(3, (Outgoing(0, 0, b"x"),))})
    assert str(error.value) == "Step 0: a gives a Transmit of step 3; it should be of step 0."


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"step": 2}, "gives Truth of step 2; it should be of step 0"),
        (
            {"robots": (RobotTruth("a", math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, True, True, 0),)},
            "says that a is at (nan, 0), or moves, as no robot can",
        ),
        (
            {"jams": (Jam(0.0, 0.0, -1.0, STEP),)},
            "switches a jammer on that cannot be: a jammer reaches -1 m; it should be above 0 and at most "
            "1e+06 m",
        ),
        (
            {"jams": (Jam(0.0, 0.0, 1.0, 10**16),)},
            "switches a jammer on that cannot be: a jammer is on for 1e+10 s; it should be above 0 and at "
            "most 1e+06 s",
        ),
    ],
)
def test_a_truth_that_cannot_be_ends_the_run(changes: dict[str, Any], sentence: str) -> None:
    swarm = three()
    truth = msgspec.structs.replace(swarm.truth([]), **changes)
    with pytest.raises(AcrcError) as error:
        swarm.core.advance({TRUTH.key(): truth})
    assert str(error.value) == f"Step 0: the world {sentence}."


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
