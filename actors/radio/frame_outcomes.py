"""What became of every frame, and of every frame at every other robot, in words."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.state import Fate

FRAMES: Final = {
    "frames_sent": "sent",
    "frames_cut_off": "cut_off",
    "frames_access_failure": "access_failures",
    "frames_overflowed": "overflowed",
}
"""What became of the frames that a transceiver was handed, by the node's counter: left the antenna; cut by
switching the sender off; the channel never was clear; the transmit queue was full."""
EVENTS: Final = ("dropped", "discarded")
"""For a robot that does not step: beyond its host's buffer; held when the robot was switched off, or begun
anew: what belongs to an epoch that is over."""
COPIES: Final = {
    f"copies_{'' if fate is Fate.HEARD else 'lost_'}{fate.name.lower()}": int(fate)
    for fate in Fate
    if fate not in (Fate.FILTERED, Fate.NOT_COUNTED)
}
"""Robots broadcast, so that nothing is filtered."""


class FrameOutcomes:
    """Counts of what never gets as far as the medium."""

    def __init__(self, stations: int) -> None:
        self.refused = 0
        """Not accepted, of any robot."""
        self.discarded = np.zeros(stations, np.int64)
        """Asked for while the transceiver was off."""
        self._events = dict.fromkeys(EVENTS, 0)

    def events(self, end: str, number: int) -> None:
        """Count events that a robot never got, by one of EVENTS."""
        self._events[end] += number

    def counters(self, nodes: NDArray[np.void]) -> dict[str, int]:
        """All counters by name, of the medium's nodes and of this tally.

        `frames_*` count frames; `bytes_sent` the octets of those sent, with MAC header and FCS; `copies_*`
        count each frame, when it ends, once per other station that was powered when it began: with n stations
        always on their sum is n - 1 times `frames_sent`; `events_*` count lost events.
        """
        frames = {name: int(nodes[field].sum(dtype=np.int64)) for name, field in FRAMES.items()}
        frames["frames_refused"] = self.refused
        frames["frames_discarded"] = int(
            nodes["discarded"].sum(dtype=np.int64) + self.discarded.sum(dtype=np.int64)
        )
        frames["bytes_sent"] = int(nodes["octets_sent"].sum(dtype=np.int64))
        copies = {name: int(nodes["fates"][:, fate].sum(dtype=np.int64)) for name, fate in COPIES.items()}
        return frames | copies | {f"events_{end}": count for end, count in self._events.items()}

    def by_robot(self, robots: Sequence[str], nodes: NDArray[np.void]) -> dict[str, dict[str, int]]:
        """The same per robot: of its own frames, and of the copies of others' frames at it."""
        return {
            robot: {
                **{name: int(node[field]) for name, field in FRAMES.items()},
                "frames_discarded": int(node["discarded"] + self.discarded[number]),
                **{name: int(node["fates"][fate]) for name, fate in COPIES.items()},
            }
            for number, (robot, node) in enumerate(zip(robots, nodes, strict=True))
        }
