"""What a robot that keeps to no rule may tell the world: it ends the run, and is named."""

import math

import msgspec
import pytest

from actors.messages import AIRED, Aired, Drive, EventCount
from actors.runtime.codec import encode
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from tests.conduct.theatre import Theatre

TRUE = Drive(7, 0.1, 0.0, 0.0, 0)
MOST = "coordinates should be at most 100000"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"step": 3}, "answers with a Drive of step 3; it should be of step 7"),
        (
            {"vx": math.nan},
            "wants to drive at nan, 0 m/s and 0 rad/s; a velocity should be at most 100000",
        ),
        (
            {"omega": 1e300},
            "wants to drive at 0.1, 0 m/s and 1e+300 rad/s; a velocity should be at most 100000",
        ),
        ({"transmits": 33}, "announces 33 frames; it should be 0 to 32"),
        ({"transmits": -1}, "announces -1 frames; it should be 0 to 32"),
        ({"pose": (math.nan, 1.0, 0.0)}, f"holds itself to be at (nan, 1), 0 rad; {MOST}"),
        ({"pose": (1e200, 1.0, 0.0)}, f"holds itself to be at (1e+200, 1), 0 rad; {MOST}"),
        ({"pose": (1.0, 1.0, math.inf)}, f"holds itself to be at (1, 1), inf rad; {MOST}"),
        (
            {"reports": (PlaceReport("r1", 0, -(10**15)),)},
            "reports a place at -1000000000000000 µs; it should be from 700000 to 799999 µs",
        ),
        (
            {"reports": (PlaceReport("r1", 0, 700_000),) * 1001},
            "reports 1001 places in one step; at most 1000 may be",
        ),
        (
            {"given_up": (PlaceGivenUp("r1", 0, 700_000, "x" * 10_000),)},
            "gives a place up for a reason of 10000 characters; it should have 1 to 100",
        ),
        (
            {"given_up": (PlaceGivenUp("r1", 0, 800_000, "shut"),)},
            "gives a place up at 800000 µs; it should be from 700000 to 799999 µs",
        ),
        ({"route": (PlaceKey("r1", 0),) * 10_001}, "has a route of 10001 places; at most 10000 may be"),
        (
            {"route": (PlaceKey("r1", 0),) * 2},
            "has place 0 of 'r1' twice in its route; each may be there once",
        ),
        (
            {"route": (PlaceKey("x" * 100, 0),)},
            f"has in its route place 0 of '{'x' * 99}…, which nobody was given",
        ),
    ],
)  # fmt: skip
def test_a_false_drive_ends_the_run_and_names_who_sent_it(changes: dict[str, object], sentence: str) -> None:
    play = Theatre(2.0)
    play.acts["r1"].lies = {7: msgspec.structs.replace(TRUE, **changes)}
    with pytest.raises(AcrcError) as caught:
        play.run()
    assert str(caught.value) == f"step 7 (0.7 s): r1 {sentence}"


@pytest.mark.parametrize(
    ("aired", "sentence"),
    [
        (Aired(5, ()), "the radio says what it aired in step 5; it should be of step 0"),
        (
            Aired(0, (EventCount("r9", 1),)),
            "the radio counts 1 events for 'r9'; it should be at least 1, for a robot of the run",
        ),
        (
            Aired(0, (EventCount("r1", -1),)),
            "the radio counts -1 events for 'r1'; it should be at least 1, for a robot of the run",
        ),
    ],
)
def test_a_radio_that_counts_wrongly_is_named(aired: Aired, sentence: str) -> None:
    play = Theatre(2.0)
    play.bus.publish(AIRED.key(), encode(aired))
    with pytest.raises(AcrcError) as caught:
        play.run()
    assert str(caught.value) == f"step 1 (0.1 s): {sentence}"
