"""Counts and rows of places by their final state."""

import csv
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.results.outcome import write_items
from cleaning.referee import COLUMNS, PlaceOutcome, place_values

S = 1_000_000
NOTHING: dict[str, Any] = dict.fromkeys(
    ("reached_at", "reached_by", "reported_at", "reported_by", "given_up_at", "given_up_by", "reason")
)


def place(number: int, in_route_of: tuple[str, ...] = (), **said: object) -> PlaceOutcome:
    return PlaceOutcome("r1", number, 1.5, -2.0, in_route_of=in_route_of, **NOTHING | said)


DONE = place(0, reached_at=10 * S, reached_by="r2", reported_at=11 * S, reported_by="r2")
MISTAKEN = place(1, ("r1",), reported_at=12 * S, reported_by="r1")
GIVEN_UP = place(2, given_up_at=90 * S, given_up_by="r3", reason='the door, "the" door')
LATE = place(
    3, reached_at=39 * S, reached_by="r1", given_up_at=20 * S, given_up_by="r2", reason="shut",
    reported_at=40_500_000, reported_by="r1",
)  # fmt: skip
LOST = place(4, reached_at=5 * S, reached_by="r9")
OPEN = place(5, ("r1", "r4"), given_at=60 * S)


def test_places_are_counted_by_final_state() -> None:
    every = (DONE, MISTAKEN, GIVEN_UP, LATE, LOST, OPEN)
    assert list(place_values(every).values()) == [6, 2, 3, 1, 1, None, None, 40.5]
    assert list(place_values(every, has_truth=False).values()) == [6, None, 3, 1, 1, None, None, 40.5, 3]
    assert place_values((MISTAKEN,))["completion_s"] is None
    assert place_values((MISTAKEN,), has_truth=False)["completion_s"] == 12.0


@pytest.mark.parametrize(
    ("places", "settled_s", "completion_s", "last_reached_s"),
    [
        ((DONE, MISTAKEN, LATE), 20.0, None, 40.5),
        ((DONE, GIVEN_UP), 90.0, None, 11.0),
        ((DONE, LATE), 20.0, 40.5, 40.5),
        ((GIVEN_UP, LOST), None, None, None),
        ((), 0.0, 0.0, None),
    ],
)
def test_settled_and_completion_times(
    places: tuple[PlaceOutcome, ...], settled_s: float, completion_s: float, last_reached_s: float
) -> None:
    expected = {"settled_s": settled_s, "completion_s": completion_s, "last_reached_s": last_reached_s}
    assert place_values(places) == place_values(places) | expected


def test_the_table_has_a_row_per_place(tmp_path: Path) -> None:
    write_items([one.row() for one in (DONE, GIVEN_UP, OPEN)], COLUMNS, tmp_path / "places.csv")
    text = (tmp_path / "places.csv").read_text()
    assert text.splitlines() == [
        "owner,place,x,y,verdict,reached_s,reached_by,reported_s,reported_by,given_up_s,given_up_by,reason,"
        "in_route_of,given_s",
        "r1,0,1.5,-2.0,done,10.0,r2,11.0,r2,,,,,0.0",
        'r1,2,1.5,-2.0,given up,,,,,90.0,r3,"the door, ""the"" door",,0.0',
        "r1,5,1.5,-2.0,open,,,,,,,,r1 r4,60.0",
    ]
    rows = list(csv.DictReader(text.splitlines()))
    assert rows[1]["reason"] == 'the door, "the" door' and rows[2]["in_route_of"].split() == ["r1", "r4"]
