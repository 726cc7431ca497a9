"""Drawing of the floor, items of the task, goals, adoptions and floor objects."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr

from actors.array_types import Flags, Floats, Octets, Singles
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.observer.canvas import BODY, CIRCLE, INTENT, ITEM, LABEL, TRAIL, Canvas, at_height, ring
from actors.observer.glyphs import (
    DOOR,
    FLOOR,
    GREY,
    GROUND,
    MARKS,
    OUTCOME_COLOURS,
    WALL,
    WHITE,
    Colour,
    Mark,
    faded,
    item_marks,
)
from actors.runtime.errors import printable
from actors.task.task import TaskDeclaration

_ADOPTION_S: Final = 6.0
"""How long the arrow of an adoption is shown, s."""
_CROSS: Final = [3, 15], [9, 21]
_OUTLINES: Final = {
    "cross": _CROSS,
    "heavy cross": _CROSS,
    "diamond": [[0, 6, 12, 18, 0]],
    "square": [[3, 9, 15, 21, 3]],
    "triangle": [[18, 2, 10, 18]],
    "tick": [[6, 18]],
    "snowflake": [[0, 12], [4, 16], [8, 20]],
}
"""Lines of symbols, by symbol, as indices in CIRCLE; others are rings."""
DrawnItem = tuple[float, float, str, str, tuple[str, ...]]
"""x, y, m, map frame; state; robot responsible for the state; robots that plan to do it."""


def draw_items(
    canvas: Canvas, task: TaskDeclaration, owner: str, second: float, items: Sequence[DrawnItem]
) -> None:
    """Draw all items of an owner from an instant on.

    Open ones have the owner's colour, and outer rings for other holders; done ones are dim or grey.
    """
    marks = item_marks(task)
    lines = [line for item in items for line in _item_lines(canvas, task, marks, owner, item)]
    _draw_lines(canvas, second, f"world/items/{rr.escape_entity_path_part(owner)}", lines)


_Line = tuple[Singles, Colour, float]
"""A line with its colour and width, m; negative: points."""


def _draw_lines(canvas: Canvas, second: float, path: str, lines: Sequence[_Line]) -> None:
    strips, colours, radii = zip(*lines, strict=True) if lines else ((), (), ())
    canvas.draw_at(second, path, rr.LineStrips3D(strips, colors=colours, radii=radii))


def _item_lines(
    canvas: Canvas, task: TaskDeclaration, marks: Mapping[str, Mark], owner: str, item: DrawnItem
) -> Iterator[_Line]:
    x, y, state, by, holders = item
    if state not in marks:
        return
    own, symbol = canvas.colour(owner if owner in canvas.robots else by), marks[state].shape
    is_open = task.marks[state].is_open
    if symbol == "disc":
        yield ring(x, y, 0.05, ITEM), own if is_open else faded(own, 0.55), 0.05
        return
    circle = ring(x, y, 0.15 if is_open else 0.17, ITEM)
    for outline in _OUTLINES.get(symbol, [[*range(len(circle))]]):
        yield circle[outline], own if is_open else GREY, -3.0 if symbol == "heavy cross" else -1.5
    others = [robot for robot in holders if robot != owner] if is_open else []
    for number, robot in enumerate(others):
        yield ring(x, y, 0.24 + 0.08 * number, ITEM), canvas.colour(robot), -1.5


def set_goal_style(canvas: Canvas, robot: str) -> None:
    """Set the style of a robot's goal: a dot, and a faint line to it."""
    colour = canvas.colour(robot)
    line = rr.LineStrips3D.from_fields(colors=[faded(colour, 0.5)], radii=[-0.7])
    canvas.draw_static(f"world/intent/{robot}", line)
    canvas.draw_static(f"world/heading/{robot}", rr.Points3D.from_fields(colors=[colour], radii=[0.07]))


def draw_goals(canvas: Canvas, robot: str, seconds: Floats, here: Floats, there: Floats) -> None:
    """Draw a robot's goals; `here` and `there`: (n, 2), m; NaN: no goal."""
    heads = np.isfinite(there[:, 0])
    lines = np.stack((at_height(here, INTENT), at_height(there, INTENT)), axis=1)
    rows = [[line] if shown else [] for line, shown in zip(lines, heads.tolist(), strict=True)]
    canvas.draw_strips(f"world/intent/{robot}", seconds, rows)
    new = np.ones(len(there), np.bool_)
    new[1:] = (np.nan_to_num(there[1:], nan=-1e9) != np.nan_to_num(there[:-1], nan=-1e9)).any(axis=1)
    dots = rr.Points3D.columns(positions=at_height(there[new & heads], ITEM)).partition(heads[new])
    canvas.draw_columns(f"world/heading/{robot}", seconds[new], dots)


def draw_adoption(
    canvas: Canvas,
    robot: str,
    second: float,
    here: tuple[float, float],
    item: tuple[float, float],
    name: str,
) -> None:
    """Draw an arrow from an adopted item to the robot, for some seconds."""
    (x, y), path = item, f"world/adoptions/{robot}"
    arrow = rr.Arrows3D(
        origins=[(x, y, LABEL)],
        vectors=[(here[0] - x, here[1] - y, BODY - LABEL)],
        colors=[WHITE],
        radii=[-1.6],
        labels=[f"{robot} adopts {name}"],
        show_labels=canvas.is_small_swarm,
    )
    canvas.draw_at(second, path, arrow)
    canvas.draw_at(second + _ADOPTION_S, path, rr.Arrows3D.from_fields(clear_unset=True))


def draw_floor(canvas: Canvas, grid: OccupancyGrid, doors: Flags | None = None) -> None:
    """Draw the floor plan at /world/map; `doors`: tinted cells, (rows, columns)."""
    image = _image(grid, np.zeros(grid.cells.shape, np.bool_) if doors is None else doors)
    rows, columns, _ = image.shape
    canvas.draw_static(
        "world/map",
        rr.GridMap(
            data=image.tobytes(),
            format=rr.components.ImageFormat(
                width=columns, height=rows, color_model="RGB", channel_datatype="U8"
            ),
            cell_size=grid.resolution,
            translation=(grid.origin.x, grid.origin.y, 0.0),
            draw_order=-10.0,
        ),
    )


def _image(grid: OccupancyGrid, doors: Flags) -> Octets:
    """Return the image of the map, (rows, columns, 3), north edge first as the viewer requires."""
    values = np.full((*grid.cells.shape, 3), GROUND, dtype=np.uint8)
    values[grid.cells == FREE] = FLOOR
    values[grid.cells == OCCUPIED] = WALL
    values[doors] = faded(DOOR, 0.3)
    return np.ascontiguousarray(np.flipud(values))


_SIGNS: Final = {
    "ring": "○", "disc": "●", "diamond": "◇", "cross": "✕", "square": "□", "tint": "▒", "bar": "━",
    "dashed ring": "◌", "filled ring": "◉", "soft ring": "◎", "heavy cross": "✖", "snowflake": "✳",
    "tick": "|", "triangle": "▽",
}  # fmt: skip
"""Symbols of marks on the floor."""
_NOT_DRAWN: Final = ("off", "frozen", "carried", "stood")
_MORE: Final = (
    ("bright line", "trail of the last 20 s; dim: earlier"),
    ("thin line", "line to the robot's goal"),
    ("blue line", "radio link; brighter is stronger"),
    ("red or amber ring", "frame lost here: collision, or the receiver was sending"),
)


def draw_legend(canvas: Canvas, task: TaskDeclaration) -> None:
    """Write the legend of the symbols on the floor."""
    marks = [*item_marks(task).items(), *((k, mark) for k, mark in MARKS.items() if k not in _NOT_DRAWN)]
    rows = [(f"{_SIGNS[mark.shape]} {printable(name)}", mark.meaning) for name, mark in marks]
    text = "\n".join(f"- **{name}**: {meaning}" for name, meaning in (*rows, *_MORE))
    canvas.draw_static("legend/marks", rr.TextDocument(text, media_type="text/markdown"))


def draw_outcome_legend(canvas: Canvas) -> None:
    """Draw the outcomes of frames in their colours."""
    count = len(OUTCOME_COLOURS)
    dots = rr.Points2D(
        [(0.0, float(row)) for row in range(count)],
        colors=list(OUTCOME_COLOURS.values()),
        radii=[-4.0] * count,
        labels=list(OUTCOME_COLOURS),
        show_labels=True,
    )
    canvas.draw_static("legend/copies", dots)


DrawnObject = tuple[str, tuple[tuple[float, float], ...], float]
"""Kind, one of MARKS; centre or both ends, m; radius, or half the thickness of a line, m."""
_DASHES: Final = 12
"""Number of dashes of a dashed ring."""
_RINGS: Final = 100.0
"""Maximum number of rings of a disc, as a recording may contain any radius."""


def draw_things(canvas: Canvas, second: float, things: Sequence[DrawnObject]) -> None:
    """Draw all floor objects from an instant on."""
    words: Any = [kind for kind, _, _ in things]
    colours = [MARKS[kind].colour or WHITE for kind in words]
    lines = [
        (strip, colour, width)
        for (kind, points, radius), colour in zip(things, colours, strict=True)
        for strip, width in _strips(MARKS[kind].shape, points, radius)
    ]
    _draw_lines(canvas, second, "world/put", lines)
    names = [(*np.mean(points, axis=0).tolist(), LABEL) for _, points, _ in things]
    label = rr.Points3D(names, labels=words, colors=colours, radii=[0.0] * len(names), show_labels=True)
    canvas.draw_at(second, "world/put/names", label)


def _strips(
    shape: str, points: tuple[tuple[float, float], ...], radius: float
) -> list[tuple[Singles, float]]:
    """Return the lines of an object with widths, m; negative: points."""
    if len(points) > 1:
        return [(np.array([(x, y, TRAIL) for x, y in points], np.float32), -3.0)]
    (x, y), *_ = points
    if shape != "dashed ring":
        rings = round(min(max(2.0, radius / 0.06), _RINGS))
        return [(ring(x, y, radius * (one + 1) / rings, TRAIL), -2.0) for one in range(rings)]
    part = (len(CIRCLE) - 1) // _DASHES
    whole = ring(x, y, radius, TRAIL)
    return [(whole[one * part : one * part + part], -1.5) for one in range(_DASHES)]
