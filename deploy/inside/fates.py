"""What became of every copy of every frame, as arrays: by cause, and at which receiver."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.state import Outcome
from deploy.evidence.frame_fates import frame_fates

LOSSES: Final = tuple(
    one for one in Outcome if one not in (Outcome.HEARD, Outcome.FILTERED, Outcome.NOT_COUNTED)
)
"""Why a copy may be lost."""


@dataclass(frozen=True, eq=False)
class Fates:
    """Copies of frames, in the order of the instants at which these ended; (n,) each."""

    seconds: NDArray[np.float64]
    senders: NDArray[np.int64]
    """Index among the robots."""
    receivers: NDArray[np.int64]
    outcomes: NDArray[np.int64]
    """Of `Outcome`."""


def read_fates(out: Path, robots: tuple[str, ...]) -> Fates:
    """Execute a run's radio again, which is this project's own code. AcrcError where that goes wrong.

    `robots`: in the order of the scenario.
    """
    place = {robot: number for number, robot in enumerate(robots)}
    filtered = Outcome.FILTERED.name.lower()
    found = [
        (frame.ended, place[frame.robot], place[copy.robot], Outcome[copy.fate.upper()])
        for frame in frame_fates(out)
        for copy in frame.copies
        if copy.fate != filtered
    ]
    instants, senders, receivers, outcomes = np.array(found, np.int64).reshape(-1, 4).T
    return Fates(instants / 1e6, senders, receivers, outcomes)


def by_outcome(fates: Fates, until: float, bin_s: float) -> NDArray[np.float64]:
    """(bins, outcomes): copies per second by what became of them."""
    bins = max(1, int(np.ceil(until / bin_s)))
    table = np.zeros((bins, len(Outcome)))
    places = np.minimum((fates.seconds / bin_s).astype(np.int64), bins - 1)
    np.add.at(table, (places, fates.outcomes), 1)
    return table / bin_s
