"""Doors that close and open while a run goes on."""

import pytest

from actors.orders import CloseDoor, Move, OpenDoor
from actors.runtime.errors import AcrcError
from tests.conduct.theatre import Theatre

EAST = 24.0
"""Robot r3 starts at (20, 11) and drives east, through the neck between cabinets at this x."""


def eastward(seconds: float, *events: tuple[float, CloseDoor | OpenDoor | Move]) -> Theatre:
    return Theatre(seconds, list(events), robots=("r3",), drive=lambda senses: (0.5, 0.0)).run()


def end(play: Theatre) -> float:
    """Where r3 is at last, x."""
    return play.truths[-2].robots[0].x


def test_a_closed_door_stops_a_robot_and_its_sensor_sees_it() -> None:
    free, shut = eastward(10.0), eastward(10.0, (0.0, CloseDoor(EAST, 11.1)))
    assert end(free) > EAST + 0.5
    assert EAST - 0.25 < end(shut) < EAST - 0.177 + 0.012
    assert shut.acts["r3"].senses[-1].bumper == 2 and shut.core.contacts == 1
    shown = [play.acts["r3"].senses[30].scan for play in (free, shut)]
    assert shown[0] is not None and shown[1] is not None
    assert shown[0].ranges_mm != shown[1].ranges_mm
    assert shut.core.driven == {"r3": pytest.approx(end(shut) - 20.0, abs=0.01)}


def test_a_door_that_is_opened_again_lets_it_through() -> None:
    play = eastward(13.0, (0.0, CloseDoor(EAST, 11.1)), (9.0, OpenDoor(EAST, 11.1)))
    assert end(play) > EAST + 0.5
    assert play.digest == eastward(13.0, (0.0, CloseDoor(EAST, 11.1)), (9.0, OpenDoor(EAST, 11.1))).digest


def test_a_door_closes_once_nobody_stands_in_it() -> None:
    """It drives through all the same, and back it cannot."""
    through = eastward(9.0)
    inside = next(truth.instant for truth in through.truths if truth.robots[0].x > EAST - 0.1) / 1e6
    play = eastward(12.0, (inside, CloseDoor(EAST, 11.1)), (11.0, OpenDoor(EAST, 11.1)))
    assert end(play) > EAST + 0.5
    with pytest.raises(AcrcError, match="it would overlap a wall"):
        eastward(12.0, (inside, CloseDoor(EAST, 11.1)), (11.0, Move("r3", EAST, 11.1, 0.0)))


def test_a_door_that_was_yet_to_close_stays_open() -> None:
    through = eastward(9.0)
    inside = next(truth.instant for truth in through.truths if truth.robots[0].x > EAST - 0.1) / 1e6
    later = inside + 0.1
    play = eastward(12.0, (inside, CloseDoor(EAST, 11.1)), (later, OpenDoor(EAST, 11.1)))
    assert end(play) == end(eastward(12.0))


@pytest.mark.parametrize(
    ("events", "sentence"),
    [
        ([(0.5, CloseDoor(9.0, 12.5))], "(9, 12.5) is in no door of the map; its doors are at "),
        ([(0.5, OpenDoor(EAST, 11.1))], "the door at (24, 11.1) is open already"),
        (
            [(0.4, CloseDoor(EAST, 11.1)), (0.5, CloseDoor(EAST, 11.2))],
            "the door at (24, 11.2) is closed already",
        ),
        ([(0.5, CloseDoor(float("nan"), 11.1))], "there is no door at (nan, 11.1); each should be a finite"),
    ],
)
def test_what_cannot_be_is_refused(events: list[tuple[float, CloseDoor | OpenDoor]], sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        eastward(1.0, *events)
    assert str(caught.value).startswith(f"the event at 0.5 s cannot happen: {sentence}")
