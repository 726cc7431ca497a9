"""What happened to a run's robots from outside: jammed radios, and robots that were carried away."""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from observation.accounting.episodes import EpisodeParameters
from observation.accounting.said import seconds_of
from observation.accounting.time_spent import Finding
from observation.accounting.tracks import Tracks

JAMMED: Final = "radio jammed"
CARRIED: Final = "carried"
_LOST_TO_OTHERS: Final = "copies_lost_disturbed"
"""The radio's count of frames that something which is no transceiver spoilt at a robot."""


def findings(
    tracks: Tracks, frames: Mapping[str, Mapping[str, int]], p: EpisodeParameters
) -> tuple[Finding, ...]:
    """All there are. `frames`: what became of the copies of frames at each robot, as the radio counted."""
    return (*_jammed(tracks, frames), *_carried(tracks, p))


def _jammed(tracks: Tracks, frames: Mapping[str, Mapping[str, int]]) -> Iterator[Finding]:
    """Robots that were within reach of a jammer, and to which frames were lost that it can have spoilt."""
    begins = np.arange(len(tracks.true)) * tracks.step_us
    for index, robot in enumerate(tracks.robots):
        within = np.zeros(len(begins), np.bool_)
        for begin, jam in tracks.jams:
            near = np.hypot(tracks.true[:, index, 0] - jam.x, tracks.true[:, index, 1] - jam.y) <= jam.radius
            within |= near & (begins >= begin) & (begins < jam.until)
        spoilt = frames.get(robot, {}).get(_LOST_TO_OTHERS, 0)
        if within.any() and spoilt:
            lasted = seconds_of(tracks, int(within.sum()))
            says = f"{robot} was within a jammer's reach for {lasted:g} s; {spoilt} frames were spoilt there"
            yield Finding(JAMMED, (robot,), says)


def _carried(tracks: Tracks, p: EpisodeParameters) -> Iterator[Finding]:
    """Robots that were somewhere else from one step to the next."""
    hops = np.hypot(*np.moveaxis(np.diff(tracks.true[..., :2], axis=0), -1, 0))
    for index, robot in enumerate(tracks.robots):
        for step in np.flatnonzero(hops[:, index] > p.jump).tolist():
            at = seconds_of(tracks, step + 1)
            yield Finding(CARRIED, (robot,), f"{robot} was carried {hops[step, index]:.1f} m at {at:g} s")
