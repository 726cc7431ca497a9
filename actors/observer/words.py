"""What is read rather than looked at: lanes of what robots do, events, knowledge, plots, ensembles."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.observer.canvas import (
    BODY,
    CIRCLE,
    CLOUD,
    COSTS,
    NOSE,
    WAY,
    Canvas,
    lifted,
    packed,
    ring,
)
from actors.observer.glyphs import (
    ARC,
    COSTS_COLOUR,
    GREY,
    OWN_STATES,
    PARTICLES,
    PLAN,
    RADIUS,
    SCAN,
    WHITE,
    Colour,
)

_SHORTEST: Final = 0.6
"""A spell in a lane that lasts less long, s, goes with what was before."""
_PHRASES: Final = {"driving": "to {}", "adopted": "adopted {}", "blocked": "blocked, {}"}
_ALWAYS: Final = frozenset({"blocked", "deadlock", "frozen", "off"})
"""Shown however short they last."""
_ROUND: Final = 60.0
"""Radius of the circle in which robots stand in the graph of ensembles."""


class Occupation(NamedTuple):
    """What a robot is about from an instant on."""

    second: float
    activity: str
    """One of OWN_STATES."""
    destination: str = ""
    """Its name, as in "r1/3"."""


class DrawnEvent(NamedTuple):
    """Something that happened."""

    second: float
    robot: str
    words: str
    level: str = "INFO"
    """INFO, WARN or ERROR."""


def lane_path(robot: str) -> str:
    """Where a robot's lane lies; the window shows all of it as the lane's name."""
    return robot


class Lane:
    """What a robot does over time, with where it heads for in the label."""

    def __init__(self, canvas: Canvas, robot: str) -> None:
        self._canvas, self._path = canvas, lane_path(robot)
        self._kinds: dict[str, Colour] = {}

    def draw(self, spells: Sequence[Occupation]) -> None:
        """Draw spells, each of which lasts to the next one, whenever that comes."""
        canvas, known = self._canvas, len(self._kinds)
        self._kinds |= {_label(spell): OWN_STATES[spell.activity].colour for spell in spells}
        if len(self._kinds) > known:
            values, colours = list(self._kinds), list(self._kinds.values())
            canvas.still(self._path, rr.StateConfiguration(values=values, labels=values, colors=colours))
        states = [_label(spell) for spell in spells]
        canvas.columns(self._path, [spell.second for spell in spells], rr.StateChange.columns(state=states))

    def end(self, second: float) -> None:
        """Draw nothing from an instant on: the run is over."""
        self._canvas.columns(self._path, [second], rr.StateChange.columns(state=[""]))


def settled(spells: Sequence[Occupation]) -> list[Occupation]:
    """The same without what lasts too short to be seen; what is blocked, frozen or off always is."""
    kept: list[Occupation] = []
    for spell, after in zip(spells, [*(one.second for one in spells[1:]), np.inf], strict=True):
        short = after - spell.second < _SHORTEST and spell.activity not in _ALWAYS
        if (kept and short) or (kept and kept[-1][1:] == spell[1:]):
            continue
        kept.append(spell)
    return kept


def _label(spell: Occupation) -> str:
    phrase = _PHRASES.get(spell.activity)
    return phrase.format(spell.destination) if phrase and spell.destination else spell.activity


def draw_events(canvas: Canvas, source: str, events: Sequence[DrawnEvent]) -> None:
    """Events as text, in the colours of their robots; `source`: a name for those that come together."""
    ordered = sorted(events)
    for robot in dict.fromkeys(event.robot for event in ordered):
        mine = [event for event in ordered if event.robot == robot]
        canvas.columns(
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
    """A robot's knowledge as a table, from each instant on."""
    _draw_texts(canvas, f"knowledge/{robot}", [(second, _table(robot, rows)) for second, rows in tables])


def draw_decisions(canvas: Canvas, robot: str, decisions: Sequence[tuple[float, Sequence[str]]]) -> None:
    """A robot's last decision from each instant on: the decision, then its causes."""
    texts = [
        (second, "\n".join((f"**{second:.3f} s** {_cell(made)}", "", *(f"- {_cell(one)}" for one in causes))))
        for second, (made, *causes) in decisions
    ]
    _draw_texts(canvas, f"decisions/{robot}", texts)


def _draw_texts(canvas: Canvas, path: str, texts: Sequence[tuple[float, str]]) -> None:
    """Texts in Markdown, from each instant on."""
    columns = rr.TextDocument.columns(
        text=[text for _, text in texts], media_type=["text/markdown"] * len(texts)
    )
    canvas.columns(path, [second for second, _ in texts], columns)


def _cell(text: str) -> str:
    """What may hold anything, and stays in its cell."""
    return text.replace("|", "/").replace("\n", " ").replace("`", "'")


def _table(robot: str, rows: Sequence[tuple[str, str]]) -> str:
    """In Markdown."""
    told = ((name, _cell(value)) for name, value in rows)
    return "\n".join((f"| {robot} | |", "|---|---|", *(f"| {name} | {value} |" for name, value in told)))


def introduce_line(
    canvas: Canvas, path: str, name: str, colour: Colour, *, steps: bool = False, dots: bool = False
) -> None:
    """How a plot's line looks; in steps, or as dots."""
    if dots:
        style = rr.SeriesPoints(colors=[colour], names=[name], markers=["Circle"], marker_sizes=[1.8])
        canvas.still(path, style)
        return
    mode: Any = "StepAfter" if steps else None
    canvas.still(path, rr.SeriesLines(colors=[colour], names=[name], widths=[1.6], interpolation_mode=mode))


def draw_line(
    canvas: Canvas, path: str, seconds: Sequence[float] | NDArray[np.float64], values: NDArray[np.float64]
) -> None:
    """A plot's points."""
    canvas.columns(path, seconds, rr.Scalars.columns(scalars=values))


class LearntExchange(NamedTuple):
    """That a robot has learnt something of another's knowledge."""

    second: float
    ensemble: str
    source: str
    learner: str


def draw_ensembles(
    canvas: Canvas, exchanges: Sequence[LearntExchange], lasting: float, since: float = 0.0
) -> None:
    """The robots in a circle, and between them each ensemble that has exchanged something within `lasting`
    s: from whom to whom. What is earlier than `since`, s, is drawn already."""
    where = _circle(canvas.robots)
    canvas.still(
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
        canvas.at(second, "ensembles/exchanges", _between(names, where))
        edges = [edge for name, one in names.items() for edge in ((one.source, name), (name, one.learner))]
        canvas.at(second, "ensembles/exchanges/edges", rr.GraphEdges(edges, graph_type="directed"))


def _between(names: Mapping[str, LearntExchange], where: Mapping[str, tuple[float, float]]) -> rr.GraphNodes:
    """A node for each exchange, halfway between the two."""
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


Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
_AHEAD_S: Final = 1.7
"""So far the chosen arc is drawn, s: as far as the local planner looks."""
_SIGMAS: Final = 2.0
"""Half axes of the ellipse around the estimate, standard deviations: it covers 86 %."""
_OPACITY: Final = 0.999
"""Opacity of the cost map: below 1, or the viewer does not blend it."""
_HUES: Final = np.zeros((256, 4), np.uint8)
"""Red, green, blue and opacity by cost: one hue, the denser the dearer; nothing where it costs nothing."""
_HUES[:, :3] = COSTS_COLOUR
_HUES[1:, 3] = np.linspace(20, 110, 255).astype(np.uint8)
_HUES[253:, 3] = 190


def introduce_inside(canvas: Canvas, robot: str) -> None:
    """Set colours and sizes of a robot's own view."""
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
    """Draw pose estimates of a robot, (n, 3), with covariances xx, xy, yy of the position, (n, 3), m²."""
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
