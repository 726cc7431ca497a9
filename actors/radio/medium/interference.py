"""When the outside sources go on and off, and how strong they then arrive, for the medium's event loop."""

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.channel import Interferer, Trajectory
from actors.radio.medium.initial_state import milliwatts
from actors.radio.medium.state import SWITCH

REFRESH_NS = 20_000_000
"""The power of a long burst is evaluated again at every multiple of this, as transceivers may move."""

OFF = -1


class Interference:
    """The interferers, and the bursts of theirs that have begun and not ended."""

    def __init__(self) -> None:
        self._interferers: list[Interferer | None] = []
        self._ends: dict[int, int] = {}

    def __len__(self) -> int:
        """How many numbers have been given out."""
        return len(self._interferers)

    def add(self, interferer: Interferer) -> None:
        """One more; it takes the number of one that has ended for good, or the next."""
        if None in self._interferers:
            self._interferers[self._interferers.index(None)] = interferer
        else:
            self._interferers.append(interferer)

    def forget(self, now_ns: int) -> None:
        """Let go of the sources that will not be on any more, from `now_ns` on."""
        for source, interferer in enumerate(self._interferers):
            if interferer is not None and interferer.over(now_ns) and source not in self._ends:
                self._interferers[source] = None

    def until(
        self, since_ns: int, until_ns: int, where: Trajectory
    ) -> tuple[NDArray[np.void], NDArray[np.float64]]:
        """The switches in [since, until), in order, and the powers, mW, that they name by row."""
        entries = [
            entry
            for source, interferer in enumerate(self._interferers)
            if interferer is not None
            for entry in self._entries(source, interferer, since_ns, until_ns)
        ]
        if not entries:
            return np.zeros(0, SWITCH), np.zeros((0, len(where(since_ns)) if self._interferers else 0))
        entries.sort()
        switches = np.zeros(len(entries), SWITCH)
        rows: list[NDArray[np.float64]] = []
        for place, (instant, source, on) in enumerate(entries):
            switches[place] = (instant, source, len(rows) if on else OFF)
            interferer = self._interferers[source]
            if on and interferer is not None:
                rows.append(interferer.power_dbm(where(instant)))
        transceivers = len(where(since_ns))
        return switches, milliwatts(np.array(rows).reshape(-1, transceivers))

    def _entries(
        self, source: int, interferer: Interferer, since_ns: int, until_ns: int
    ) -> list[tuple[int, int, bool]]:
        """Instants at which the source goes off (or on; at one instant off is first)."""
        spans = [(begin, end) for begin, end in interferer.bursts(since_ns, until_ns).tolist()]
        entries = [(begin, source, True) for begin, _ in spans]
        if source in self._ends:
            spans.insert(0, (since_ns - 1, self._ends.pop(source)))
        for begin, end in spans:
            first = (begin // REFRESH_NS + 1) * REFRESH_NS
            entries += [(at, source, True) for at in range(first, min(end, until_ns), REFRESH_NS)]
            if end < until_ns:
                entries.append((end, source, False))
            else:
                self._ends[source] = end
        return entries
