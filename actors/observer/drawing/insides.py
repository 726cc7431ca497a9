"""What one robot perceives and means, as in RViz: below /inside/ID, in the map frame."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.drawing.canvas import BODY, CIRCLE, CLOUD, COSTS, NOSE, RADIUS, WAY, Canvas, lifted, ring
from actors.observer.glyphs import ARC, COSTS_COLOUR, PARTICLES, PLAN, SCAN, WHITE

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
_AHEAD_S: Final = 1.7
"""So far the chosen arc is drawn, s: as far as the local planner looks."""
_SIGMAS: Final = 2.0
"""Of the ellipse round the estimate: 86 % of what is held possible."""
_OPACITY: Final = 0.999
"""Of the whole: below 1, so that the viewer blends at all."""
_HUES: Final = np.zeros((256, 4), np.uint8)
"""Red, green, blue and opacity by cost: one hue, the denser the dearer; nothing where it costs nothing."""
_HUES[:, :3] = COSTS_COLOUR
_HUES[1:, 3] = np.linspace(20, 110, 255).astype(np.uint8)
_HUES[253:, 3] = 190


def introduce_inside(canvas: Canvas, robot: str) -> None:
    """How a robot's own view looks."""
    own = f"inside/{robot}"
    canvas.still(f"{own}/scan", rr.Points3D.from_fields(colors=[SCAN], radii=[-1.4]))
    canvas.still(f"{own}/particles", rr.Points3D.from_fields(colors=[PARTICLES], radii=[-1.0]))
    canvas.still(f"{own}/plan", rr.LineStrips3D.from_fields(colors=[PLAN], radii=[-1.5]))
    canvas.still(f"{own}/arc", rr.LineStrips3D.from_fields(colors=[ARC], radii=[-2.2]))
    canvas.still(f"{own}/estimate", rr.LineStrips3D.from_fields(colors=[WHITE, PARTICLES], radii=[-1.3]))


def draw_clouds(
    canvas: Canvas, robot: str, what: str, seconds: Floats, counts: NDArray[np.int64], points: Singles
) -> None:
    """`what` is scan or particles: so many points, (k, 2) m, in each row."""
    height = BODY if what == "scan" else CLOUD
    columns = rr.Points3D.columns(positions=lifted(points, height)).partition(counts)
    canvas.columns(f"inside/{robot}/{what}", seconds, columns)


def draw_estimates(canvas: Canvas, robot: str, seconds: Floats, poses: Floats, spread: Floats) -> None:
    """Where a robot holds itself to be, (n, 3), and how surely: (n, 3) variance of x, of both, of y, m²."""
    rows = []
    for (x, y, _), (xx, xy, yy) in zip(poses.tolist(), spread.tolist(), strict=True):
        sizes, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        reach = _SIGMAS * np.sqrt(np.maximum(sizes, 1e-6))
        ellipse = (CIRCLE * reach) @ axes.T + (x, y)
        rows.append((ring(x, y, RADIUS, NOSE), lifted(ellipse, NOSE)))
    canvas.strips(f"inside/{robot}/estimate", seconds, rows)


def draw_plans(canvas: Canvas, robot: str, seconds: Floats, ways: Sequence[Singles]) -> None:
    """The way planned from each instant on, (k, 2) m; none where it has fewer than two points."""
    rows = [[lifted(way, WAY)] if len(way) > 1 else [] for way in ways]
    canvas.strips(f"inside/{robot}/plan", seconds, rows)


def draw_arcs(canvas: Canvas, robot: str, seconds: Floats, poses: Floats, twists: Floats) -> None:
    """The chosen arcs: (n, 2) speed, m/s, and turn rate, rad/s, from (n, 3)."""
    ahead = np.linspace(0.0, _AHEAD_S, 24)
    rows: list[list[Singles]] = []
    for (x, y, heading), (speed, turn) in zip(poses.tolist(), twists.tolist(), strict=True):
        if abs(speed) < 0.01:
            rows.append([])
            continue
        headings = heading + turn * ahead
        steps = speed * (ahead[1] - ahead[0])
        way = np.column_stack(
            (x + np.cumsum(steps * np.cos(headings)), y + np.cumsum(steps * np.sin(headings)))
        )
        rows.append([lifted(way, CLOUD)])
    canvas.strips(f"inside/{robot}/arc", seconds, rows)


def draw_costs(
    canvas: Canvas, robot: str, seconds: Floats, costs: NDArray[np.uint8], corners: Floats, cell: float
) -> None:
    """The local cost map: windows (n, rows, columns), row 0 the southernmost, each with the pose of its
    south-west corner, (n, 3), cells of so many m. In one hue, the denser the dearer."""
    if not len(costs):
        return
    n, rows, columns = costs.shape
    none, half = np.zeros(n), corners[:, 2] / 2
    kind = rr.components.ImageFormat(width=columns, height=rows, color_model="RGBA", channel_datatype="U8")
    shown = _HUES[costs[:, ::-1]]
    canvas.columns(
        f"inside/{robot}/costs",
        seconds,
        rr.GridMap.columns(
            data=[window.tobytes() for window in shown],
            format=[kind] * n,
            cell_size=[cell] * n,
            translation=np.column_stack((corners[:, :2], np.full(n, COSTS))).astype(np.float32),
            opacity=[_OPACITY] * n,
            quaternion=np.column_stack((none, none, np.sin(half), np.cos(half))).astype(np.float32),
        ),
    )
