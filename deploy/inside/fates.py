"""The radio executed again: what became of every copy of every frame, by cause and at which receiver."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from actors.messages import RECEIVED, Sent
from actors.radio.core import RadioCore
from actors.radio.medium.state import Outcome
from deploy.evidence.recorded import taken
from deploy.replay.record_replay import Onlook, replay_actor
from deploy.replay.run_recordings import recordings

NOBODY_KNOWS: Final = -1
"""As the sender of a copy: its frame was cut off."""
LOSSES: Final = tuple(
    one for one in Outcome if one not in (Outcome.HEARD, Outcome.FILTERED, Outcome.NOT_COUNTED)
)
"""Why a copy may be lost."""


@dataclass(frozen=True, eq=False)
class Fates:
    """Copies of frames, in the order of the instants at which these ended; (n,) each."""

    seconds: NDArray[np.float64]
    senders: NDArray[np.int64]
    """Index among the robots, or NOBODY_KNOWS."""
    receivers: NDArray[np.int64]
    outcomes: NDArray[np.int64]
    """Of `Outcome`."""
    counts: NDArray[np.int64]
    """How many copies; more than one only where their sender is not known."""


def read_fates(out: Path, robots: tuple[str, ...]) -> Fates:
    """Execute a run's radio again, which is this project's own code. AcrcError where that goes wrong.

    `robots`: in the order of the scenario.
    """
    watch = _Watch(_departures(out, robots))
    replay_actor(out, "radio", Onlook(watch.attach))
    rows = np.array(watch.rows, np.int64).reshape(-1, 5)
    instants, senders, receivers, outcomes, counts = rows.T
    return Fates(instants / 1e6, senders, receivers, outcomes, counts)


def _departures(out: Path, robots: tuple[str, ...]) -> list[tuple[int, int]]:
    """When whose frames left the antenna, µs: that each robot was told."""
    found = []
    for actor, path in recordings(out).items():
        robot = path.parent.name
        if actor not in ("world", "radio") and robot in robots:
            index = robots.index(robot)
            for _, received in taken(path, RECEIVED):
                found += [(one.instant, index) for one in received.events if isinstance(one, Sent)]
    return sorted(found)


class _Watch:
    """Lets the medium run from one departure to the next, so that each has its copies for itself.

    Nothing depends on how the medium's time is cut into calls.
    """

    def __init__(self, departures: list[tuple[int, int]]) -> None:
        self._departures = departures
        self._next = 0
        self._medium: Any = None
        self._before: NDArray[np.int64] = np.zeros((0, 0), np.int64)
        self.rows: list[tuple[int, int, int, int, int]] = []
        """Instant, µs, sender, receiver, outcome, count."""

    def attach(self, core: Any, step_us: int) -> None:
        """Look on."""
        assert isinstance(core, RadioCore)
        self._medium = medium = core.medium
        self._before = medium.outcomes()
        run = medium.run

        def watched(until_ns: int) -> NDArray[np.void]:
            parts = []
            while self._next < len(self._departures):
                instant, sender = self._departures[self._next]
                end_ns = (instant + 1) * 1000
                if end_ns > until_ns:
                    break
                if end_ns > medium.now_ns:
                    parts.append(run(end_ns))
                self._note(instant, sender)
                self._next += 1
            if medium.now_ns < until_ns:
                parts.append(run(until_ns))
                self._note(until_ns // 1000, NOBODY_KNOWS)
            return parts[0] if len(parts) == 1 else cast(NDArray[np.void], np.concatenate(parts))

        cast(Any, medium).run = watched

    def _note(self, instant: int, sender: int) -> None:
        now = self._medium.outcomes()
        new = now - self._before
        new[:, Outcome.NOT_COUNTED] = new[:, Outcome.FILTERED] = 0
        self._before = now
        for receiver, outcome in np.argwhere(new).tolist():
            self.rows.append((instant, sender, receiver, outcome, int(new[receiver, outcome])))


def by_outcome(fates: Fates, until: float, bin_s: float) -> NDArray[np.float64]:
    """(bins, outcomes): copies per second by what became of them."""
    bins = max(1, int(np.ceil(until / bin_s)))
    table = np.zeros((bins, len(Outcome)))
    places = np.minimum((fates.seconds / bin_s).astype(np.int64), bins - 1)
    np.add.at(table, (places, fates.outcomes), fates.counts)
    return table / bin_s
