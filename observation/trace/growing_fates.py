"""What becomes of frames in a run that is going on: its radio, replayed as its recording grows."""

from pathlib import Path
from typing import Self

import msgspec

from observation.replay.growing_replay import GrowingReplay
from observation.replay.record_replay import Onlook, made_again
from observation.trace.fates import Fates, fates_of
from observation.trace.frame_fates import FrameWatch
from observation.trace.kept import inputs, keep


class GrowingFates:
    """Follows the radio, which is this project's own code; a context manager that closes its recording."""

    def __init__(self, out: Path, robots: tuple[str, ...]) -> None:
        """`robots`: in the order of the scenario. AcrcError where there is no radio that has begun."""
        self._robots = robots
        self._watch = FrameWatch()
        self._replay = GrowingReplay(made_again(out, "radio", Onlook(self._watch.prepare)))
        self._parts: list[bytes] = []
        """To be kept at the end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._replay.__exit__()

    def poll(self, budget_s: float) -> tuple[Fates, float, bool]:
        """What is new after about so long of computing; until when it is known, s; whether that is all.

        Raises ReplayError where the radio does otherwise than it did, RecordingError for a damaged file.
        """
        whole = self._replay.advance(budget_s)
        found, self._watch.found = self._watch.found, []
        self._parts += [msgspec.msgpack.encode(found)] if found else []
        if self._replay.ended and self._parts:
            self._replay.settle()
            keep(self._replay.path, inputs(self._replay.path), self._parts)
            self._parts = []
        return fates_of(found, self._robots), self._watch.instant / 1e6, whole
