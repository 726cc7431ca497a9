"""What became of every frame, and of every frame at every other robot."""

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray


class Fate(IntEnum):
    """What becomes of one frame at one station; where several hold, the greatest counts."""

    HEARD = 0
    COLLISION = 1
    """Another frame strong enough to be heard there overlapped it."""
    JAMMED = 2
    HALF_DUPLEX = 3
    """The station was sending at the time."""
    OUT_OF_RANGE = 4
    POWERED_OFF = 5
    """The station or the sender was switched off before the frame ended."""
    NOT_ADDRESSED = 6
    """The sender itself, or a station that was switched off when the frame began; not counted."""


FRAMES: Final = ("sent", "cut_off", "overflowed", "refused", "discarded")
"""Left the antenna; cut by switching the sender off; dropped by a full queue; not accepted; asked for or
still waiting while the transceiver was off."""
EVENTS: Final = ("dropped", "discarded")
"""For a robot that does not step: beyond its host's buffer; held when the robot was switched off."""


class Tally:
    """Counters of one run."""

    def __init__(self) -> None:
        self._fates = np.zeros(len(Fate), dtype=np.int64)
        self._bytes_sent = 0
        self._frames = dict.fromkeys(FRAMES, 0)
        self._events = dict.fromkeys(EVENTS, 0)

    def frame(self, end: str, number: int = 1) -> None:
        """Count frames that came to the `end`, one of FRAMES."""
        self._frames[end] += number

    def sent(self, octets: int) -> None:
        """Count a frame of that size, MAC header and FCS included, that has left the antenna whole."""
        self.frame("sent")
        self._bytes_sent += octets

    def copies(self, fates: NDArray[np.uint8]) -> None:
        """Count what became of one frame at every station."""
        self._fates += np.bincount(fates, minlength=len(Fate))

    def events(self, end: str, number: int) -> None:
        """Count events that a robot never got, by one of EVENTS."""
        self._events[end] += number

    def counters(self) -> dict[str, int]:
        """All counters by name.

        `frames_*` count frames; `bytes_sent` the octets of those sent, with MAC header and FCS; `copies_*`
        count each frame, when it ends, once per other station that was powered when it began: with n stations
        always on their sum is n - 1 times `frames_sent`; `events_*` count lost events.
        """
        frames = {f"frames_{end}": count for end, count in self._frames.items()}
        copies = {
            f"copies_{'' if fate is Fate.HEARD else 'lost_'}{fate.name.lower()}": int(self._fates[fate])
            for fate in Fate
            if fate is not Fate.NOT_ADDRESSED
        }
        frames["bytes_sent"] = self._bytes_sent
        return frames | copies | {f"events_{end}": count for end, count in self._events.items()}
