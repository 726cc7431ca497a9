"""The robots: bodies with headings and names, and the ways that they went."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.drawing.canvas import BODY, FEW, LABEL, NOSE, RADIUS, TRAIL, Canvas
from actors.observer.glyphs import WHITE, faded

Floats = NDArray[np.float64]
RECENT_S: Final = 20.0
"""So long a trail stays bright, s; the history of all that was before is dim."""
SEGMENT_S: Final = 0.5
"""A trail is made of pieces of so much time, s."""
_LEAST: Final = 0.04
"""A robot that has come less far, m, leaves no piece."""
_JUMP: Final = 1.0
"""A robot that is this far, m, from where it was was put there by hand: no piece leads there. Default: more
than a TurtleBot covers between two pictures."""


def introduce(canvas: Canvas, robot: str) -> None:
    """Draw what does not change about a robot: below /world/robots/ID its body turns, the rest does not."""
    colour, own = canvas.colour(robot), f"world/robots/{robot}"
    body = rr.Cylinders3D(
        lengths=[0.02], radii=[RADIUS], centers=[(0.0, 0.0, BODY)], colors=[colour], fill_mode="solid"
    )
    nose = rr.LineStrips3D([[(0.0, 0.0, NOSE), (1.9 * RADIUS, 0.0, NOSE)]], colors=[WHITE], radii=[-1.6])
    canvas.still(f"{own}/turn/body", body)
    canvas.still(f"{own}/turn/nose", nose)
    # From afar a body is smaller than a pixel, and a marker is not.
    canvas.still(f"{own}/marker", rr.Points3D([(0.0, 0.0, BODY)], colors=[colour], radii=[-5.0]))
    for path, share, width in (("trails", 1.0, -1.2), ("history", 0.4, -0.6)):
        style = rr.LineStrips3D.from_fields(colors=[faded(colour, share)], radii=[width])
        canvas.still(f"world/{path}/{robot}", style)


def draw_poses(canvas: Canvas, robot: str, seconds: Floats, poses: Floats) -> None:
    """Where a robot is from each instant on: (n,) s and (n, 3) x, y, m, and heading, rad."""
    none, half = np.zeros(len(poses)), poses[:, 2] / 2
    where = np.column_stack((poses[:, :2], none)).astype(np.float32)
    turned = np.column_stack((none, none, np.sin(half), np.cos(half))).astype(np.float32)
    canvas.columns(f"world/robots/{robot}", seconds, rr.Transform3D.columns(translation=where))
    canvas.columns(f"world/robots/{robot}/turn", seconds, rr.Transform3D.columns(quaternion=turned))


def draw_name(canvas: Canvas, robot: str, second: float, state: str = "") -> None:
    """A robot's name beside it from an instant on, and, if it does not act, why."""
    name = f"{robot} ({state})" if state else robot
    above = 1.1 if len(canvas.robots) <= FEW else 0.5
    label = rr.Points3D(
        [(0.0, above, LABEL)], labels=[name], colors=[canvas.colour(robot)], radii=[0.0], show_labels=True
    )
    canvas.at(second, f"world/robots/{robot}/name", label)


def draw_pieces(canvas: Canvas, robot: str, seconds: Sequence[float], pieces: NDArray[np.float32]) -> None:
    """Pieces of a trail, (k, 2, 3), each there from its instant on."""
    for path in ("trails", "history"):
        canvas.columns(f"world/{path}/{robot}", seconds, rr.LineStrips3D.columns(strips=pieces))


def draw_trail(canvas: Canvas, robot: str, seconds: Floats, places: Floats, trail: "DrawnTrail") -> None:
    """A robot's way, (n,) s and (n, 2) m, from where the trail ends."""
    found = [
        (second, piece)
        for second, x, y in zip(seconds.tolist(), *places.T.tolist(), strict=True)
        if (piece := trail.extend(second, x, y)) is not None
    ]
    if found:
        draw_pieces(canvas, robot, [second for second, _ in found], np.array([piece for _, piece in found]))


class DrawnTrail:
    """A robot's way in pieces; how many there are grows with the time that it drives."""

    def __init__(self) -> None:
        self._last: tuple[float, float, float] | None = None

    def extend(self, second: float, x: float, y: float) -> NDArray[np.float32] | None:
        """The piece, (2, 3), m, that ends where the robot is now, if it is time for one."""
        if self._last is None:
            self._last = second, x, y
            return None
        before, from_x, from_y = self._last
        gone = float(np.hypot(x - from_x, y - from_y))
        if gone > _JUMP:
            self._last = second, x, y
            return None
        if second - before < SEGMENT_S - 1e-6 or gone < _LEAST:
            return None
        self._last = second, x, y
        return np.array([(from_x, from_y, TRAIL), (x, y, TRAIL)], np.float32)
