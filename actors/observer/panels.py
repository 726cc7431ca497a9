"""Drawing of lanes, events, knowledge, plots, ensembles and robots' perception."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr

from actors.array_types import Floats, Int64s, Octets, Singles
from actors.observer.canvas import (
    BODY,
    CIRCLE,
    CLOUD,
    COSTS,
    NOSE,
    WAY,
    Canvas,
    at_height,
    packed,
    quaternions,
    ring,
)
from actors.observer.glyphs import (
    ACTIVITY_GLYPHS,
    ARC,
    COSTS_COLOUR,
    GREY,
    PARTICLES,
    PLAN,
    RADIUS,
    SCAN,
    WHITE,
    Colour,
)

_MIN_DURATION: Final = 0.6
"""Minimum duration of an activity in a lane, s; shorter ones are merged with the previous one."""
_PHRASES: Final = {"driving": "to {}", "adopted": "adopted {}", "blocked": "blocked, {}"}
_ALWAYS_SHOWN: Final = frozenset({"blocked", "deadlock", "frozen", "off"})
"""Activities shown for any duration."""
_ROUND: Final = 60.0
"""Radius of the circle of robots in the graph of ensembles."""


class LaneActivity(NamedTuple):
    """Activity of a robot from an instant on."""

    second: float
    activity: str
    """One of ACTIVITY_GLYPHS."""
    destination: str = ""
    """Name of the goal such as "r1/3"."""


class DrawnEvent(NamedTuple):
    """An event in the log."""

    second: float
    robot: str
    words: str
    level: str = "INFO"
    """INFO, WARN or ERROR."""


class Lane:
    """Lane of a robot's activities, labelled with goals."""

    def __init__(self, canvas: Canvas, robot: str) -> None:
        self._canvas, self._path = canvas, robot  # the viewer shows the path as the name
        self._kinds: dict[str, Colour] = {}

    def draw(self, activities: Sequence[LaneActivity]) -> None:
        """Draw activities, each of which lasts until the next one."""
        canvas, known = self._canvas, len(self._kinds)
        self._kinds |= {
            _label(activity): ACTIVITY_GLYPHS[activity.activity].colour for activity in activities
        }
        if len(self._kinds) > known:
            values, colours = list(self._kinds), list(self._kinds.values())
            canvas.draw_static(
                self._path, rr.StateConfiguration(values=values, labels=values, colors=colours)
            )
        states = [_label(activity) for activity in activities]
        canvas.draw_columns(
            self._path, [activity.second for activity in activities], rr.StateChange.columns(state=states)
        )

    def end(self, second: float) -> None:
        """End the lane at an instant, s."""
        self._canvas.draw_columns(self._path, [second], rr.StateChange.columns(state=[""]))


def drop_short(activities: Sequence[LaneActivity]) -> list[LaneActivity]:
    """Return activities without those that are too short, except for those in `_ALWAYS_SHOWN`."""
    shown: list[LaneActivity] = []
    for activity, after in zip(activities, [*(one.second for one in activities[1:]), np.inf], strict=True):
        short = after - activity.second < _MIN_DURATION and activity.activity not in _ALWAYS_SHOWN
        if shown and (short or shown[-1][1:] == activity[1:]):
            continue
        shown.append(activity)
    return shown


def _label(activity: LaneActivity) -> str:
    phrase = _PHRASES.get(activity.activity)
    return phrase.format(activity.destination) if phrase and activity.destination else activity.activity


def draw_events(canvas: Canvas, source: str, events: Sequence[DrawnEvent]) -> None:
    """Draw events as text in the robots' colours; `source`: name of their group."""
    ordered = sorted(events)
    for robot in dict.fromkeys(event.robot for event in ordered):
        mine = [event for event in ordered if event.robot == robot]
        canvas.draw_columns(
            f"events/{robot or 'run'}/{source}",
            [event.second for event in mine],
            rr.TextLog.columns(
                text=[f"{robot} {event.words}" if robot else event.words for event in mine],
                level=[event.level for event in mine],
                color=packed([canvas.colour(robot)] * len(mine)),
            ),
        )


def draw_knowledge(
    canvas: Canvas, robot: str, tables: Sequence[tuple[float, Sequence[tuple[str, str]]]]
) -> None:
    """Draw a robot's knowledge as a table, from each instant on."""
    _draw_texts(canvas, f"knowledge/{robot}", [(second, _table(robot, rows)) for second, rows in tables])


def draw_decisions(canvas: Canvas, robot: str, decisions: Sequence[tuple[float, Sequence[str]]]) -> None:
    """Draw a robot's last decision and its causes, from each instant on."""
    texts = [
        (second, "\n".join((f"**{second:.3f} s** {_cell(made)}", "", *(f"- {_cell(one)}" for one in causes))))
        for second, (made, *causes) in decisions
    ]
    _draw_texts(canvas, f"decisions/{robot}", texts)


def _draw_texts(canvas: Canvas, path: str, texts: Sequence[tuple[float, str]]) -> None:
    """Draw Markdown texts, from each instant on."""
    columns = rr.TextDocument.columns(
        text=[text for _, text in texts], media_type=["text/markdown"] * len(texts)
    )
    canvas.draw_columns(path, [second for second, _ in texts], columns)


def _cell(text: str) -> str:
    """Escape arbitrary text for a cell of a table."""
    return text.replace("|", "/").replace("\n", " ").replace("`", "'")


def _table(robot: str, rows: Sequence[tuple[str, str]]) -> str:
    """Format rows as a Markdown table."""
    told = ((name, _cell(value)) for name, value in rows)
    return "\n".join((f"| {robot} | |", "|---|---|", *(f"| {name} | {value} |" for name, value in told)))


def set_line_style(
    canvas: Canvas, path: str, name: str, colour: Colour, *, steps: bool = False, dots: bool = False
) -> None:
    """Set the style of a plot's line; `steps`: as a step function, `dots`: as points."""
    if dots:
        style = rr.SeriesPoints(colors=[colour], names=[name], markers=["Circle"], marker_sizes=[1.8])
        canvas.draw_static(path, style)
        return
    mode: Any = "StepAfter" if steps else None
    canvas.draw_static(
        path, rr.SeriesLines(colors=[colour], names=[name], widths=[1.6], interpolation_mode=mode)
    )


def draw_line(canvas: Canvas, path: str, seconds: Sequence[float] | Floats, values: Floats) -> None:
    """Draw values of a plot's line."""
    canvas.draw_columns(path, seconds, rr.Scalars.columns(scalars=values))


class KnowledgeExchange(NamedTuple):
    """An exchange that changed a robot's knowledge."""

    second: float
    ensemble: str
    source: str
    learner: str


def draw_ensembles(
    canvas: Canvas, exchanges: Sequence[KnowledgeExchange], lasting: float, since: float = 0.0
) -> None:
    """Draw the graph of robots with the exchanges of the last `lasting` s between them.

    `since`: everything earlier is already drawn, s.
    """
    where = _circle(canvas.robots)
    canvas.draw_static(
        "ensembles/robots",
        rr.GraphNodes(
            list(canvas.robots),
            positions=[where[robot] for robot in canvas.robots],
            labels=list(canvas.robots),
            colors=[canvas.colour(robot) for robot in canvas.robots],
            radii=[6.0] * len(canvas.robots),
        ),
    )
    known = [one for one in exchanges if one.source in where and one.learner in where]
    moments = sorted({0.0, *(at for one in known for at in (one.second, one.second + lasting))})
    for second in [one for one in moments if one >= since]:
        now = [one for one in known if one.second <= second < one.second + lasting]
        names = {f"{one.ensemble}: {one.source} > {one.learner}": one for one in now}
        canvas.draw_at(second, "ensembles/exchanges", _exchange_nodes(names, where))
        edges = [edge for name, one in names.items() for edge in ((one.source, name), (name, one.learner))]
        canvas.draw_at(second, "ensembles/exchanges/edges", rr.GraphEdges(edges, graph_type="directed"))


def _exchange_nodes(
    names: Mapping[str, KnowledgeExchange], where: Mapping[str, tuple[float, float]]
) -> rr.GraphNodes:
    """Return a node for each exchange, halfway between the robots."""
    ends = [(where[one.source], where[one.learner]) for one in names.values()]
    return rr.GraphNodes(
        list(names),
        positions=[((a[0] + b[0]) / 2, (a[1] + b[1]) / 2) for a, b in ends],
        labels=[one.ensemble for one in names.values()],
        colors=[GREY] * len(names),
        radii=[3.0] * len(names),
    )


def _circle(robots: Sequence[str]) -> dict[str, tuple[float, float]]:
    angles = np.linspace(0, 2 * np.pi, len(robots), endpoint=False) - np.pi / 2
    size = _ROUND * max(1.0, len(robots) / 6)
    return {
        robot: (size * float(np.cos(angle)), size * float(np.sin(angle)))
        for robot, angle in zip(robots, angles, strict=True)
    }


_AHEAD_S: Final = 1.7
"""Length of the drawn arc, s: horizon of the local planner."""
_SIGMAS: Final = 2.0
"""Half axes of the covariance ellipse, standard deviations; it covers 86 %."""
_OPACITY: Final = 0.999
"""Opacity of the cost map: below 1, or the viewer does not blend it."""
_HUES: Final = np.zeros((256, 4), np.uint8)
"""Red, green, blue and opacity by cost: one hue, more opaque for higher costs."""
_HUES[:, :3] = COSTS_COLOUR
_HUES[1:, 3] = np.linspace(20, 110, 255).astype(np.uint8)
_HUES[253:, 3] = 190


def set_perception_style(canvas: Canvas, robot: str) -> None:
    """Set colours and sizes of a robot's own view."""
    own = f"inside/{robot}"
    canvas.draw_static(f"{own}/scan", rr.Points3D.from_fields(colors=[SCAN], radii=[-1.4]))
    canvas.draw_static(f"{own}/particles", rr.Points3D.from_fields(colors=[PARTICLES], radii=[-1.0]))
    canvas.draw_static(f"{own}/plan", rr.LineStrips3D.from_fields(colors=[PLAN], radii=[-1.5]))
    canvas.draw_static(f"{own}/arc", rr.LineStrips3D.from_fields(colors=[ARC], radii=[-2.2]))
    canvas.draw_static(
        f"{own}/estimate", rr.LineStrips3D.from_fields(colors=[WHITE, PARTICLES], radii=[-1.3])
    )


def draw_clouds(
    canvas: Canvas, robot: str, layer: str, seconds: Floats, counts: Int64s, points: Singles
) -> None:
    """Draw scans or particles (`layer`); `counts`: points per instant, `points`: (k, 2), m."""
    height = BODY if layer == "scan" else CLOUD
    columns = rr.Points3D.columns(positions=at_height(points, height)).partition(counts)
    canvas.draw_columns(f"inside/{robot}/{layer}", seconds, columns)


def draw_estimates(canvas: Canvas, robot: str, seconds: Floats, poses: Floats, spread: Floats) -> None:
    """Draw pose estimates of a robot, (n, 3), with covariances xx, xy, yy of the position, (n, 3), m²."""
    rows = []
    for (x, y, _), (xx, xy, yy) in zip(poses.tolist(), spread.tolist(), strict=True):
        sizes, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        reach = _SIGMAS * np.sqrt(np.maximum(sizes, 1e-6))
        ellipse = (CIRCLE * reach) @ axes.T + (x, y)
        rows.append((ring(x, y, RADIUS, NOSE), at_height(ellipse, NOSE)))
    canvas.draw_strips(f"inside/{robot}/estimate", seconds, rows)


def draw_plans(canvas: Canvas, robot: str, seconds: Floats, plans: Sequence[Singles]) -> None:
    """Draw plans, (k, 2), m, from each instant on; none with fewer than two points."""
    rows = [[at_height(plan, WAY)] if len(plan) > 1 else [] for plan in plans]
    canvas.draw_strips(f"inside/{robot}/plan", seconds, rows)


def draw_arcs(canvas: Canvas, robot: str, seconds: Floats, poses: Floats, twists: Floats) -> None:
    """Draw commanded arcs from poses, (n, 3); `twists`: speed, m/s, and turn rate, rad/s, (n, 2)."""
    ahead = np.linspace(0.0, _AHEAD_S, 24)
    rows: list[list[Singles]] = []
    for (x, y, heading), (speed, turn) in zip(poses.tolist(), twists.tolist(), strict=True):
        if abs(speed) < 0.01:
            rows.append([])
            continue
        headings = heading + turn * ahead
        steps = speed * (ahead[1] - ahead[0])
        arc = np.column_stack(
            (x + np.cumsum(steps * np.cos(headings)), y + np.cumsum(steps * np.sin(headings)))
        )
        rows.append([at_height(arc, CLOUD)])
    canvas.draw_strips(f"inside/{robot}/arc", seconds, rows)


def draw_costs(
    canvas: Canvas, robot: str, seconds: Floats, costs: Octets, corners: Floats, cell: float
) -> None:
    """Draw local cost maps, (n, rows, columns), southernmost row first.

    `corners`: poses of the south-west corners, (n, 3); `cell`: edge of a cell, m.
    """
    if not len(costs):
        return
    n, rows, columns = costs.shape
    kind = rr.components.ImageFormat(width=columns, height=rows, color_model="RGBA", channel_datatype="U8")
    shown = _HUES[costs[:, ::-1]]
    canvas.draw_columns(
        f"inside/{robot}/costs",
        seconds,
        rr.GridMap.columns(
            data=[window.tobytes() for window in shown],
            format=[kind] * n,
            cell_size=[cell] * n,
            translation=at_height(corners[:, :2], COSTS),
            opacity=[_OPACITY] * n,
            quaternion=quaternions(corners[:, 2]),
        ),
    )
