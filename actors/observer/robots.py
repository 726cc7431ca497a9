"""Drawing of robots, trails, radio links and losses."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np
import rerun as rr

from actors.array_types import Floats, Singles
from actors.observer.canvas import BODY, LABEL, NOSE, TRAIL, Canvas, at_height, quaternions, ring
from actors.observer.canvas import LINK as HEIGHT
from actors.observer.glyphs import (
    LINK,
    OUTCOME_COLOURS,
    PERSON,
    PERSON_RADIUS,
    RADIUS,
    WHITE,
    Colour,
    faded,
)

RECENT_S: Final = 20.0
"""Age up to which a trail is bright, s; the earlier history is dim."""
SEGMENT_S: Final = 0.5
"""Duration of a segment of a trail, s."""
_MIN_STEP: Final = 0.04
"""Minimum length of a segment, m."""
_JUMP: Final = 1.0
"""Distance from which a robot counts as carried, m, and no segment is drawn: more than a TurtleBot drives
between two samples."""


def draw_body(canvas: Canvas, robot: str) -> None:
    """Draw the body of a robot; below /world/robots/ID only `turn` rotates."""
    colour, own = canvas.colour(robot), f"world/robots/{robot}"
    body = rr.Cylinders3D(
        lengths=[0.02], radii=[RADIUS], centers=[(0.0, 0.0, BODY)], colors=[colour], fill_mode="solid"
    )
    nose = rr.LineStrips3D([[(0.0, 0.0, NOSE), (1.9 * RADIUS, 0.0, NOSE)]], colors=[WHITE], radii=[-1.6])
    canvas.draw_static(f"{own}/turn/body", body)
    canvas.draw_static(f"{own}/turn/nose", nose)
    # The marker stays visible where the body is smaller than a pixel.
    canvas.draw_static(f"{own}/marker", rr.Points3D([(0.0, 0.0, BODY)], colors=[colour], radii=[-5.0]))
    for path, share, width in (("trails", 1.0, -1.2), ("history", 0.4, -0.6)):
        style = rr.LineStrips3D.from_fields(colors=[faded(colour, share)], radii=[width])
        canvas.draw_static(f"world/{path}/{robot}", style)


def draw_poses(canvas: Canvas, robot: str, seconds: Floats, poses: Floats) -> None:
    """Draw a robot's poses, (n, 3), x, y, m, and heading, rad, from each instant on, (n,), s."""
    where, turned = at_height(poses[:, :2], 0.0), quaternions(poses[:, 2])
    canvas.draw_columns(f"world/robots/{robot}", seconds, rr.Transform3D.columns(translation=where))
    canvas.draw_columns(f"world/robots/{robot}/turn", seconds, rr.Transform3D.columns(quaternion=turned))


def draw_people(canvas: Canvas, seconds: Floats, people: Floats) -> None:
    """Draw all people, (n, p, 4), x, y, m, vx, vy, m/s, from each instant on, (n,), s."""
    steps, count, _ = people.shape
    style = rr.Points3D.from_fields(colors=[PERSON], radii=[PERSON_RADIUS])
    canvas.draw_static("world/people", style)
    where = at_height(people[..., :2].reshape(-1, 2), BODY)
    canvas.draw_columns(
        "world/people", seconds, rr.Points3D.columns(positions=where).partition([count] * steps)
    )


def draw_name(canvas: Canvas, robot: str, second: float, state: str = "") -> None:
    """Draw a robot's name from an instant on, with its state if it is not active."""
    name = f"{robot} ({state})" if state else robot
    above = 1.1 if canvas.is_small_swarm else 0.5
    label = rr.Points3D(
        [(0.0, above, LABEL)], labels=[name], colors=[canvas.colour(robot)], radii=[0.0], show_labels=True
    )
    canvas.draw_at(second, f"world/robots/{robot}/name", label)


def draw_trail(canvas: Canvas, robot: str, seconds: Floats, points: Floats, trail: "DrawnTrail") -> None:
    """Extend a robot's trail by positions, (n, 2), m, at times, (n,), s."""
    found = [
        (second, piece)
        for second, x, y in zip(seconds.tolist(), *points.T.tolist(), strict=True)
        if (piece := trail.extend(second, x, y)) is not None
    ]
    for path in ("trails", "history") if found else ():
        strips = rr.LineStrips3D.columns(strips=np.array([piece for _, piece in found]))
        canvas.draw_columns(f"world/{path}/{robot}", [second for second, _ in found], strips)


class DrawnTrail:
    """Segments of a robot's trail."""

    def __init__(self) -> None:
        self._last: tuple[float, float, float] | None = None

    def extend(self, second: float, x: float, y: float) -> Singles | None:
        """Return the segment, (2, 3), m, that ends at the robot's position, if one is due."""
        if self._last is None:
            self._last = second, x, y
            return None
        before, from_x, from_y = self._last
        gone = float(np.hypot(x - from_x, y - from_y))
        if gone > _JUMP:
            self._last = second, x, y
            return None
        if second - before < SEGMENT_S - 1e-6 or gone < _MIN_STEP:
            return None
        self._last = second, x, y
        return np.array([(from_x, from_y, TRAIL), (x, y, TRAIL)], np.float32)


LASTING: Final = 2.5
"""Fading time of a link, s: longer than two publication periods."""
_WEAKEST: Final = -95.0
_STRONGEST: Final = -45.0
"""Range of RSSI for the brightness of a link, dBm."""
_MAX_LINKS: Final = 2
"""Number of links per robot among many robots."""
SHOWN: Final = ("collision", "disturbed", "half duplex", "receiver busy")
"""Losses drawn as a ring at the receiver; receivers out of range or off have none."""


def period(canvas: Canvas) -> float:
    """Return the period at which links are drawn, s; longer for many robots."""
    return 0.2 if canvas.is_small_swarm else 1.0


def set_radio_style(canvas: Canvas) -> None:
    """Set the line widths of links and losses."""
    canvas.draw_static("world/radio/links", rr.LineStrips3D.from_fields(radii=[-1.0]))
    canvas.draw_static("world/radio/losses", rr.LineStrips3D.from_fields(radii=[-2.0]))


class _RecentLink(NamedTuple):
    """Link between two robots with a recent reception."""

    rssi_dbm: float
    since: float
    """Age of the reception, s."""
    one: int
    other: int


def draw_links(
    canvas: Canvas, seconds: Floats, positions: Floats, heard: Floats, chosen: Collection[str] = ()
) -> None:
    """Draw links at `seconds`, (n,), with robots at `positions`, (n, robots, 2), m.

    `heard`: (k, 4), instant, s, index of sender and of receiver, RSSI, dBm, in order of time. Among many
    robots only the strongest links of each are drawn, except for `chosen` ones.
    """
    links: list[list[_RecentLink]] = [[] for _ in seconds]
    pairs = np.sort(heard[:, 1:3].astype(np.int64), axis=1)
    codes = pairs[:, 0] * (pairs.max(initial=0) + 1) + pairs[:, 1]
    for code in np.unique(codes).tolist():
        mine = heard[codes == code]
        one, other = sorted(mine[0, 1:3].astype(np.int64).tolist())
        last = np.searchsorted(mine[:, 0], seconds, side="right") - 1
        since = np.where(last >= 0, seconds - mine[last, 0], np.inf)
        for k in np.flatnonzero(since < LASTING).tolist():
            links[k].append(_RecentLink(float(mine[last[k], 3]), float(since[k]), one, other))
    if not canvas.is_small_swarm:
        whole = {number for number, robot in enumerate(canvas.robots) if robot in chosen}
        links = [_strongest(some, whole) for some in links]
    rows = [
        [at_height(positions[k, [link.one, link.other]], HEIGHT) for link in some]
        for k, some in enumerate(links)
    ]
    colours = [[_brightness(link.rssi_dbm, link.since) for link in some] for some in links]
    canvas.draw_strips("world/radio/links", seconds, rows, colours)


def _strongest(links: Sequence[_RecentLink], whole: Collection[int]) -> list[_RecentLink]:
    """Return the strongest links of each robot, and all links of robots in `whole`."""
    drawn: Counter[int] = Counter()
    kept = []
    for link in sorted(links, reverse=True):
        if min(drawn[link.one], drawn[link.other]) < _MAX_LINKS or link.one in whole or link.other in whole:
            kept.append(link)
            drawn.update((link.one, link.other))
    return kept


def _brightness(rssi_dbm: float, since: float) -> Colour:
    strong = min(1.0, max(0.0, (rssi_dbm - _WEAKEST) / (_STRONGEST - _WEAKEST)))
    return faded(LINK, (0.35 + 0.6 * strong) * max(0.15, 1 - since / LASTING))


def shown_s(canvas: Canvas) -> float:
    """Return how long the mark of a loss is shown, s."""
    return _shown(canvas) * period(canvas)


def _shown(canvas: Canvas) -> int:
    return 5 if canvas.is_small_swarm else 1


def draw_losses(
    canvas: Canvas,
    seconds: Floats,
    positions: Floats,
    losses: Sequence[tuple[float, int, str]],
    since: float = 0.0,
) -> None:
    """Draw a ring at the receiver of each lost copy: (instant, s, receiver, cause).

    `seconds`, `positions`: as for `draw_links`; `since`: everything earlier is already drawn, s.
    """
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
    colours = [[OUTCOME_COLOURS[cause] for cause in mark.values()] for mark in marks[new:]]
    canvas.draw_strips("world/radio/losses", seconds[new:], rows, colours)
