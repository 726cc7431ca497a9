"""Radio: who hears whom how strongly, and where copies of frames are lost, by cause."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.drawing.canvas import FEW, NOSE, Canvas, lifted, ring
from actors.observer.drawing.canvas import LINK as HEIGHT
from actors.observer.glyphs import FATES, LINK, Colour, faded

Floats = NDArray[np.float64]
LASTING: Final = 2.5
"""So long a link fades, s: somewhat longer than robots take to publish twice."""
_WEAKEST: Final = -95.0
_STRONGEST: Final = -45.0
"""Between these, dBm, a link is the brighter the stronger it is."""
_EACH: Final = 2
"""Links of each robot where there are many."""
SHOWN: Final = ("collision", "disturbed", "half duplex", "receiver busy")
"""Losses with a ring at their receiver. Who is out of reach is silent, and who is off, too."""


def period(canvas: Canvas) -> float:
    """How often links are drawn anew, s: as often as robots move, where that is not too much to draw."""
    return 0.2 if len(canvas.robots) <= FEW else 1.0


def introduce_radio(canvas: Canvas) -> None:
    """How links and losses look."""
    canvas.still("world/radio/links", rr.LineStrips3D.from_fields(radii=[-1.0]))
    canvas.still("world/radio/losses", rr.LineStrips3D.from_fields(radii=[-2.0]))


class _HeardLink(NamedTuple):
    """Two robots of which one has heard the other lately."""

    rssi_dbm: float
    since: float
    """How long ago, s."""
    one: int
    other: int


def draw_links(
    canvas: Canvas, seconds: Floats, positions: Floats, heard: Floats, chosen: Collection[str] = ()
) -> None:
    """Draw links at `seconds`, (n,), with robots at `positions`, (n, robots, 2), m.

    `heard`: (k, 4) instant, s, index of sender and of receiver, RSSI, dBm, in order of the instants. Among
    many robots each has its strongest ones only, and those that are `chosen` have all.
    """
    links: list[list[_HeardLink]] = [[] for _ in seconds]
    pairs = np.sort(heard[:, 1:3].astype(np.int64), axis=1)
    codes = pairs[:, 0] * (pairs.max(initial=0) + 1) + pairs[:, 1]
    for code in np.unique(codes).tolist():
        mine = heard[codes == code]
        one, other = sorted(mine[0, 1:3].astype(np.int64).tolist())
        last = np.searchsorted(mine[:, 0], seconds, side="right") - 1
        since = np.where(last >= 0, seconds - mine[last, 0], np.inf)
        for k in np.flatnonzero(since < LASTING).tolist():
            links[k].append(_HeardLink(float(mine[last[k], 3]), float(since[k]), one, other))
    if len(canvas.robots) > FEW:
        whole = {number for number, robot in enumerate(canvas.robots) if robot in chosen}
        links = [_strongest(some, whole) for some in links]
    rows = [
        [lifted(positions[k, [link.one, link.other]], HEIGHT) for link in some]
        for k, some in enumerate(links)
    ]
    colours = [[_brightness(link.rssi_dbm, link.since) for link in some] for some in links]
    canvas.strips("world/radio/links", seconds, rows, colours)


def _strongest(links: Sequence[_HeardLink], whole: Collection[int]) -> list[_HeardLink]:
    """Those that are among the strongest of one of their ends, and all of the robots in `whole`."""
    drawn: Counter[int] = Counter()
    kept = []
    for link in sorted(links, reverse=True):
        if min(drawn[link.one], drawn[link.other]) < _EACH or link.one in whole or link.other in whole:
            kept.append(link)
            drawn.update((link.one, link.other))
    return kept


def _brightness(rssi_dbm: float, since: float) -> Colour:
    strong = min(1.0, max(0.0, (rssi_dbm - _WEAKEST) / (_STRONGEST - _WEAKEST)))
    return faded(LINK, (0.35 + 0.6 * strong) * max(0.15, 1 - since / LASTING))


def shown_s(canvas: Canvas) -> float:
    """So long the mark of a loss is seen, s."""
    return _shown(canvas) * period(canvas)


def _shown(canvas: Canvas) -> int:
    return 5 if len(canvas.robots) <= FEW else 1


def draw_losses(
    canvas: Canvas,
    seconds: Floats,
    positions: Floats,
    losses: Sequence[tuple[float, int, str]],
    since: float = 0.0,
) -> None:
    """A ring at the receiver of each lost copy, (instant, s, receiver, cause), from the next of `seconds` on
    for a while; `positions`: as for `draw_links`. What is earlier than `since`, s, is drawn already."""
    shown = _shown(canvas)
    marks: list[dict[int, str]] = [{} for _ in seconds]
    for second, receiver, cause in losses:
        if cause in SHOWN:
            first = int(np.searchsorted(seconds, second))
            for mark in marks[first : first + shown]:
                mark[receiver] = cause
    new = int(np.searchsorted(seconds, since - 1e-9))
    rows = [
        [ring(positions[k, who, 0], positions[k, who, 1], 0.34, NOSE) for who in mark]
        for k, mark in enumerate(marks)
    ][new:]
    colours = [[FATES[cause] for cause in mark.values()] for mark in marks[new:]]
    canvas.strips("world/radio/losses", seconds[new:], rows, colours)
