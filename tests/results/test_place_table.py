"""What the places of a run come to, and the table of them."""

import csv
from pathlib import Path
from typing import Any

from actors.task.referee import PlaceOutcome
from observation.results.place_table import PlaceCounts, counted, write_table

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


def test_places_are_counted_by_what_became_of_them() -> None:
    every = counted((DONE, MISTAKEN, GIVEN_UP, LATE, LOST, OPEN))
    assert every == PlaceCounts(
        total=6, done=2, claimed=3, given_up=1, lost=1, completion_s=None, settled_s=None, last_reached_s=40.5
    )


def test_all_is_settled_with_the_last_place_that_was_reported_or_given_up_for_the_first_time() -> None:
    settled = counted((DONE, MISTAKEN, LATE))
    assert (settled.settled_s, settled.completion_s, settled.last_reached_s) == (20.0, None, 40.5)
    assert counted((DONE, GIVEN_UP)).settled_s == 90.0
    assert counted((DONE, GIVEN_UP)).last_reached_s == 11.0


def test_all_is_complete_with_the_last_report() -> None:
    assert counted((DONE, LATE)).completion_s == 40.5
    assert counted(()).completion_s == 0.0 and counted(()).last_reached_s is None


def test_nothing_reported_is_no_instant() -> None:
    assert counted((GIVEN_UP, LOST)).last_reached_s is None


def test_the_table_has_a_row_per_place(tmp_path: Path) -> None:
    write_table((DONE, GIVEN_UP, OPEN), tmp_path / "places.csv")
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
