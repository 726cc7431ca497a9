"""What became of every copy of every frame, as arrays: by cause, and at which receiver."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.state import Outcome
from observation.trace.frame_fates import FrameFate, frame_fates

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

    def part(self, which: NDArray[np.bool_]) -> "Fates":
        """Those that are wanted, (n,)."""
        return Fates(self.seconds[which], self.senders[which], self.receivers[which], self.outcomes[which])


def read_fates(out: Path, robots: tuple[str, ...]) -> Fates:
    """Of a run; its radio is replayed unless that was done before. AcrcError where that goes wrong.

    `robots`: in the order of the scenario.
    """
    return fates_of(frame_fates(out), robots)


def fates_of(frames: Iterable[FrameFate], robots: tuple[str, ...]) -> Fates:
    """What became of the copies of frames; `robots`: in the order of the scenario."""
    place = {robot: number for number, robot in enumerate(robots)}
    filtered = Outcome.FILTERED.name.lower()
    found = [
        (frame.ended, place[frame.robot], place[copy.robot], Outcome[copy.fate.upper()])
        for frame in frames
        for copy in frame.copies
        if copy.fate != filtered
    ]
    instants, senders, receivers, outcomes = np.array(found, np.int64).reshape(-1, 4).T
    return Fates(instants / 1e6, senders, receivers, outcomes)


def by_outcome(fates: Fates, begin: float, bins: int, bin_s: float) -> NDArray[np.float64]:
    """(bins, outcomes): copies per second from `begin` on, s, by what became of them; the last bin has what
    is later, too."""
    table = np.zeros((bins, len(Outcome)))
    places = np.clip(((fates.seconds - begin) / bin_s).astype(np.int64), 0, bins - 1)
    np.add.at(table, (places, fates.outcomes), 1)
    return table / bin_s


def fate_name(outcome: Outcome) -> str:
    """In words: "half duplex"."""
    return outcome.name.lower().replace("_", " ")
