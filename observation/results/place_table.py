"""What became of the places of a run: the counts and instants that matter, and the table of them all."""

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.instant import in_seconds
from actors.runtime import regular_file
from actors.task.referee import PlaceOutcome, Verdict

COLUMNS: Final = (
    "owner", "place", "x", "y", "verdict", "reached_s", "reached_by", "reported_s", "reported_by",
    "given_up_s", "given_up_by", "reason", "in_route_of", "given_s",
)  # fmt: skip


@dataclass(frozen=True)
class PlaceCounts:
    """What some places come to; instants in simulated s."""

    total: int
    done: int
    """Reported, and ground truth was within reach of the place by then."""
    claimed: int
    """Reported, whether true or not."""
    given_up: int
    """Given up, and not reported."""
    lost: int
    """Neither, and in the route of no robot that takes part at the end."""
    completion_s: float | None
    """When the last of them was reported; None if not all are done; 0 if there are none."""
    settled_s: float | None
    """When the last of them was reported or given up for the first time; None if some never was."""
    last_reached_s: float | None
    """When the last of those that were reported was; None if none was."""


def counted(places: Sequence[PlaceOutcome]) -> PlaceCounts:
    """What these places come to."""
    verdicts = Counter(place.verdict for place in places)
    reported = [place.reported_at for place in places if place.reported_at is not None]
    settled = [place.settled_at for place in places if place.settled_at is not None]
    done, last = verdicts[Verdict.DONE], in_seconds(max(reported, default=0))
    return PlaceCounts(
        total=len(places),
        done=done,
        claimed=len(reported),
        given_up=verdicts[Verdict.GIVEN_UP],
        lost=verdicts[Verdict.LOST],
        completion_s=last if done == len(places) else None,
        settled_s=in_seconds(max(settled, default=0)) if len(settled) == len(places) else None,
        last_reached_s=last if reported else None,
    )


def write_table(places: Iterable[PlaceOutcome], path: Path) -> None:
    """Write all places as CSV: COLUMNS first, instants in simulated s, an empty field where there is none."""
    with regular_file.replaced(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_rows(places))


def _rows(places: Iterable[PlaceOutcome]) -> Iterator[tuple[object, ...]]:
    for place in places:
        yield (
            *(place.owner, place.place, place.x, place.y, place.verdict.value),
            *(_seconds(place.reached_at), place.reached_by),
            *(_seconds(place.reported_at), place.reported_by),
            *(_seconds(place.given_up_at), place.given_up_by, place.reason),
            " ".join(place.in_route_of),
            _seconds(place.given_at),
        )


def _seconds(instant: int | None) -> float | None:
    return None if instant is None else in_seconds(instant)
