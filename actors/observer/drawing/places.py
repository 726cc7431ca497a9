"""The places to be cleaned: by owner, by what has become of them, by who holds and who heads for them."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.drawing.canvas import BODY, FEW, INTENT, LABEL, PLACE, Canvas, lifted, ring
from actors.observer.glyphs import GREY, WHITE, Colour, faded

Floats = NDArray[np.float64]
_ADOPTION_S: Final = 6.0
"""So long the arrow of an adoption is shown, s."""
_CROSS: Final = 0.12


class PlaceState(NamedTuple):
    """How one place stands."""

    x: float
    """m, map frame."""
    y: float
    done: bool = False
    """Somebody has reported it."""
    given_up: bool = False
    holders: tuple[str, ...] = ()
    """Robots that mean to visit it."""


def draw_places(canvas: Canvas, owner: str, second: float, places: Sequence[PlaceState]) -> None:
    """Draw all places of an owner as they stand from an instant on.

    A ring in the owner's colour; round it one of each other holder's. A dim disc is cleaned, a grey cross
    given up.
    """
    strips: list[NDArray[np.float32]] = []
    colours: list[Colour] = []
    radii: list[float] = []
    for place in places:
        for strip, colour, radius in _marks(canvas, owner, place):
            strips.append(strip)
            colours.append(colour)
            radii.append(radius)
    canvas.at(second, f"world/places/{owner}", rr.LineStrips3D(strips, colors=colours, radii=radii))


def _marks(canvas: Canvas, owner: str, place: PlaceState) -> list[tuple[NDArray[np.float32], Colour, float]]:
    """Lines with their colours and widths, m, or points if below 0."""
    x, y, own = place.x, place.y, canvas.colour(owner)
    if place.done:
        return [(ring(x, y, 0.05, PLACE), faded(own, 0.55), 0.05)]
    if place.given_up:
        arms = ((-_CROSS, -_CROSS), (_CROSS, _CROSS)), ((-_CROSS, _CROSS), (_CROSS, -_CROSS))
        return [(np.array([(x + a, y + b, PLACE) for a, b in arm], np.float32), GREY, -1.5) for arm in arms]
    marks = [(ring(x, y, 0.15, PLACE), own, -1.5)]
    others = [robot for robot in place.holders if robot != owner]
    for number, robot in enumerate(others):
        marks.append((ring(x, y, 0.24 + 0.08 * number, PLACE), canvas.colour(robot), -1.5))
    return marks


def introduce_intent(canvas: Canvas, robot: str) -> None:
    """How a robot's destination looks: a dot where it heads for, and a faint line to there."""
    colour = canvas.colour(robot)
    line = rr.LineStrips3D.from_fields(colors=[faded(colour, 0.5)], radii=[-0.7])
    canvas.still(f"world/intent/{robot}", line)
    canvas.still(f"world/heading/{robot}", rr.Points3D.from_fields(colors=[colour], radii=[0.07]))


def draw_intents(canvas: Canvas, robot: str, seconds: Floats, here: Floats, there: Floats) -> None:
    """Where a robot heads for: (n, 2) m each, `there` NaN where that is nowhere."""
    heads: NDArray[np.bool_] = np.isfinite(there[:, 0])
    lines = np.stack((lifted(here, INTENT), lifted(there, INTENT)), axis=1)
    rows = [[line] if shown else [] for line, shown in zip(lines, heads.tolist(), strict=True)]
    canvas.strips(f"world/intent/{robot}", seconds, rows)
    new = np.ones(len(there), np.bool_)
    new[1:] = (np.nan_to_num(there[1:], nan=-1e9) != np.nan_to_num(there[:-1], nan=-1e9)).any(axis=1)
    dots = rr.Points3D.columns(positions=lifted(there[new & heads], PLACE)).partition(heads[new])
    canvas.columns(f"world/heading/{robot}", seconds[new], dots)


def draw_adoption(
    canvas: Canvas,
    robot: str,
    second: float,
    here: tuple[float, float],
    place: tuple[float, float],
    name: str,
) -> None:
    """An arrow from an adopted place to who has adopted it, for some seconds."""
    (x, y), path = place, f"world/adoptions/{robot}"
    arrow = rr.Arrows3D(
        origins=[(x, y, LABEL)],
        vectors=[(here[0] - x, here[1] - y, BODY - LABEL)],
        colors=[WHITE],
        radii=[-1.6],
        labels=[f"{robot} adopts {name}"],
        show_labels=len(canvas.robots) <= FEW,
    )
    canvas.at(second, path, arrow)
    canvas.at(second + _ADOPTION_S, path, rr.Arrows3D.from_fields(clear_unset=True))
