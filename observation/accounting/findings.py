"""What happened to a run's robots from outside: those without contact, and those that were carried away."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import seconds
from observation.accounting.episodes import EpisodeParameters, runs
from observation.accounting.passage import Passages
from observation.accounting.said import seconds_of
from observation.accounting.time_spent import Finding
from observation.accounting.tracks import Tracks

NO_CONTACT: Final = "no contact"
CARRIED: Final = "carried"
_FRAMES: Final = 3
"""Who has given so many frames to its radio in a while wants to be heard."""


class FrameCounts(NamedTuple):
    """Of the frames of all robots, (steps, robots) each."""

    sent: NDArray[np.int64]
    """Given to the radio, whether that sent them or not."""
    heard: NDArray[np.int64]


def findings(
    tracks: Tracks, frames: FrameCounts, passages: Passages, p: EpisodeParameters
) -> tuple[Finding, ...]:
    """All there are."""
    return (*_silent(tracks, frames, passages, p), *_carried(tracks, p))


def _silent(
    tracks: Tracks, frames: FrameCounts, passages: Passages, p: EpisodeParameters
) -> Iterator[Finding]:
    """Robots that heard nobody for a while in which others within reach had something to send.

    Whether these sent it does not matter: whoever finds the channel taken all the time does not.
    """
    least = seconds(p.silent_s) // tracks.step_us
    for index, robot in enumerate(tracks.robots):
        deaf = tracks.stepping[:, index] & (frames.heard[:, index] == 0)
        for begin, end in runs(deaf, least):
            near = _within_reach(tracks, index, begin, end, frames, passages, p)
            if near:
                since, until = seconds_of(tracks, begin), seconds_of(tracks, end)
                jam = _jam(tracks, index, begin, end)
                says = (
                    f"{robot} heard nobody from {since:g} s to {until:g} s, with {', '.join(near)} within "
                    f"{p.contact:g} m{jam}"
                )
                yield Finding(NO_CONTACT, (robot,), says)


def _within_reach(
    tracks: Tracks,
    index: int,
    begin: int,
    end: int,
    frames: FrameCounts,
    passages: Passages,
    p: EpisodeParameters,
) -> list[str]:
    """The robots that were near all of this while, and had frames to send."""
    here = tracks.true[begin:end, index, :2]
    found = []
    for other, name in enumerate(tracks.robots):
        there = tracks.true[begin:end, other, :2]
        if other == index or frames.sent[begin:end, other].sum() < _FRAMES:
            continue
        if bool((np.hypot(*(there - here).T) <= p.contact).all() and passages.sees(here, there).all()):
            found.append(name)
    return found


def _jam(tracks: Tracks, index: int, begin: int, end: int) -> str:
    """For how long of the while the robot was within a jammer's reach, in words."""
    begins = np.arange(begin, end) * tracks.step_us
    within = np.zeros(end - begin, np.bool_)
    for since, jam in tracks.jams:
        gaps = np.hypot(*(tracks.true[begin:end, index, :2] - (jam.x, jam.y)).T)
        within |= (gaps <= jam.radius) & (begins >= since) & (begins < jam.until)
    return (
        f"; for {seconds_of(tracks, int(within.sum())):g} s within a jammer's reach" if within.any() else ""
    )


def _carried(tracks: Tracks, p: EpisodeParameters) -> Iterator[Finding]:
    """Robots that were somewhere else from one step to the next."""
    hops = np.hypot(*np.moveaxis(np.diff(tracks.true[..., :2], axis=0), -1, 0))
    for index, robot in enumerate(tracks.robots):
        for step in np.flatnonzero(hops[:, index] > p.jump).tolist():
            at = seconds_of(tracks, step + 1)
            yield Finding(CARRIED, (robot,), f"{robot} was carried {hops[step, index]:.1f} m at {at:g} s")
