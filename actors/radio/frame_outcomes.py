"""What became of every frame, and of every frame at every other robot, in words."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.radio.medium.state import Outcome

FRAMES: Final = {
    "frames_sent": "sent",
    "frames_cut_off": "cut_off",
    "frames_access_failure": "access_failures",
    "frames_overflowed": "overflowed",
}
"""What became of the frames that a transceiver was handed, by the medium's counter: left the antenna; cut by
switching the sender off; the channel never was clear; the transmit queue was full."""
EVENTS: Final = ("dropped", "discarded")
"""For a robot that does not step: beyond its host's buffer; held when the robot was switched off, or begun
anew: what belongs to an epoch that is over."""
COPIES: Final = {
    f"copies_{'' if outcome is Outcome.HEARD else 'lost_'}{outcome.name.lower()}": int(outcome)
    for outcome in Outcome
    if outcome not in (Outcome.FILTERED, Outcome.NOT_COUNTED)
}
"""Robots broadcast, so that nothing is filtered."""


class FrameOutcomes:
    """Counts of what never gets as far as the medium."""

    def __init__(self, transceivers: int) -> None:
        self.refused = 0
        """Not accepted, of any robot."""
        self.discarded = np.zeros(transceivers, np.int64)
        """Asked for while the transceiver was off."""
        self._events = dict.fromkeys(EVENTS, 0)

    def events(self, end: str, number: int) -> None:
        """Count events that a robot never got, by one of EVENTS."""
        self._events[end] += number

    def counters(self, medium: NDArray[np.void]) -> dict[str, int]:
        """All counters by name: the medium's (`Medium.counters`) and these.

        `frames_*` count frames; `bytes_sent` the octets of those sent, with MAC header and FCS; `copies_*`
        count each frame, when it ends, once per other transceiver that was powered when it began: with n of
        them always on their sum is n - 1 times `frames_sent`; `events_*` count lost events.
        """
        frames = {name: int(medium[field].sum(dtype=np.int64)) for name, field in FRAMES.items()}
        frames["frames_refused"] = self.refused
        frames["frames_discarded"] = int(
            medium["discarded"].sum(dtype=np.int64) + self.discarded.sum(dtype=np.int64)
        )
        frames["bytes_sent"] = int(medium["octets_sent"].sum(dtype=np.int64))
        copies = {
            name: int(medium["outcomes"][:, outcome].sum(dtype=np.int64)) for name, outcome in COPIES.items()
        }
        return frames | copies | {f"events_{end}": count for end, count in self._events.items()}

    def by_robot(self, robots: Sequence[str], medium: NDArray[np.void]) -> dict[str, dict[str, int]]:
        """The same per robot: of its own frames, and of the copies of others' frames at it."""
        return {
            robot: {
                **{name: int(own[field]) for name, field in FRAMES.items()},
                "frames_discarded": int(own["discarded"] + self.discarded[number]),
                **{name: int(own["outcomes"][outcome]) for name, outcome in COPIES.items()},
            }
            for number, (robot, own) in enumerate(zip(robots, medium, strict=True))
        }
