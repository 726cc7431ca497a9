"""Layout of the viewer, saved in the file: floor, lanes and plots on the left, robots and events right."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import rerun as rr
import rerun.blueprint as rrb

from actors.floor.grid import OccupancyGrid
from actors.observer.canvas import TIMELINE
from actors.observer.glyphs import GROUND, OUTCOME_COLOURS
from actors.observer.robots import RECENT_S
from actors.runtime.errors import AcrcError

_FIELD_OF_VIEW: Final = math.radians(55.0)
"""Vertical field of view of the viewer's camera; determines the height at which the map fits."""
_ASPECT: Final = 1.75
"""Aspect ratio of the floor's view in a typical window."""
_NARROW: Final = 1.4
"""Aspect ratio of the floor's view with two runs side by side."""
_OWN_HEIGHT: Final = 6.3
"""Camera height of a robot's view, m."""
_SPEED: Final = 4.0
"""Playback speed, simulated s per s."""
_GROUND: Final = (GROUND,) * 3


@dataclass(frozen=True)
class ViewerContents:
    """Contents of the viewer for one run."""

    grid: OccupancyGrid
    robots: Sequence[str]
    """All robots in scenario order."""
    detailed_robots: Sequence[str] = ()
    """Robots with a tab of their own."""
    end: float | None = None
    """End of the run, s; None: it is running, and the viewer follows it."""
    true: bool = True
    """False: poses are estimates, as there is no ground truth."""
    batteries: bool = False
    """True if batteries are simulated."""
    items: str = "items"
    """Plural noun for the items of the task."""
    root: str = ""
    """Root of all entity paths, such as "/1", for several runs side by side."""
    name: str = ""
    """Name of the run for several runs side by side."""


def layout(contents: ViewerContents) -> rrb.Blueprint:
    """Return the layout for one run, with side panels closed."""
    left = rrb.Vertical(
        _floor_view(contents), rrb.Horizontal(_lanes(contents), _plots(contents)), row_shares=[2.1, 1]
    )
    parts: list[Any] = [left, _right_part(contents)]
    return _blueprint(rrb.Horizontal(*parts, column_shares=[2.35, 1]), live=contents.end is None)


def _blueprint(content: rrb.Horizontal, *, live: bool) -> rrb.Blueprint:
    speed: dict[str, Any] = {} if live else {"playback_speed": _SPEED}
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, play_state="following" if live else "paused", **speed
        ),
        auto_views=False,
        auto_layout=False,
    )


def side_by_side(runs: Sequence[ViewerContents]) -> rrb.Blueprint:
    """Return the layout for several runs side by side with one time axis, side panels closed."""
    columns: list[Any] = []
    for run in runs:
        below = rrb.Tabs(_lanes(run), _plots(run), _right_part(run), active_tab=0)
        columns.append(
            rrb.Vertical(_floor_view(run, 2 * _NARROW / len(runs)), below, row_shares=[1.6, 1], name=run.name)
        )
    return _blueprint(rrb.Horizontal(*columns), live=False)


def _floor_view(contents: ViewerContents, aspect: float = _ASPECT) -> rrb.Spatial3DView:
    """Return the view of the whole floor from above, north up."""
    grid = contents.grid
    width, height = grid.corner.x - grid.origin.x, grid.corner.y - grid.origin.y
    x, y = grid.origin.x + width / 2, grid.origin.y + height / 2
    altitude = 1.04 * max(height, width / aspect) / 2 / math.tan(_FIELD_OF_VIEW / 2)
    boundary = rrb.TimeRangeBoundary
    starts = {"trails": boundary.cursor_relative(seconds=-RECENT_S), "history": boundary.infinite()}
    ranges = {
        path: rrb.VisibleTimeRange(TIMELINE, start=start, end=boundary.cursor_relative())
        for path, start in starts.items()
    }
    shown: dict[Any, Any] = {
        f"{contents.root}/world/{path}/{robot}": [rrb.VisibleTimeRanges([one])]
        for path, one in ranges.items()
        for robot in contents.robots
    }
    truth = "Swarm, ground truth" if contents.true else "Swarm, estimated poses"
    return rrb.Spatial3DView(
        origin=f"{contents.root}/world",
        name=f"{contents.name}: {truth}" if contents.name else truth,
        contents=[f"{contents.root}/world/**"],
        background=_GROUND,
        line_grid=False,
        eye_controls=_camera(x, y, altitude),
        overrides=shown,
    )


def _camera(x: float, y: float, altitude: float) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        # Slightly south of the target: looking straight down has no "up".
        position=(x, y - 0.001 * altitude, altitude),
        look_target=(x, y, 0.0),
        eye_up=(0.0, 1.0, 0.0),
    )


def _robot_view(robot: str, contents: ViewerContents) -> rrb.Vertical:
    """Return one robot's view, centred on it, with its knowledge and decisions."""
    own = f"{contents.root}/world/robots/{robot}"
    bodies = [f"{contents.root}/world/robots/{other}/turn/**" for other in contents.robots]
    view = rrb.Spatial3DView(
        origin=own,
        name=f"{robot}: perception and plan",
        contents=[
            *(f"{contents.root}/world/{part}" for part in ("map", "items/**")),
            *(*bodies, f"{contents.root}/inside/{robot}/**"),
        ],
        background=_GROUND,
        line_grid=False,
        eye_controls=_camera(0.0, 0.0, _OWN_HEIGHT),
    )
    knowledge = rrb.TextDocumentView(origin=f"{contents.root}/knowledge/{robot}", name=f"{robot}: knowledge")
    decisions = rrb.TextDocumentView(origin=f"{contents.root}/decisions/{robot}", name=f"{robot}: decisions")
    below = rrb.Tabs(knowledge, decisions, active_tab=0)
    return rrb.Vertical(view, below, row_shares=[3, 2], name=robot)


def _right_part(contents: ViewerContents) -> Any:
    """Return the right part: robots' views, events, ensembles and legend."""
    columns = rrb.TextLogColumns(text_log_columns=["body"])
    events: Any = rrb.TextLogView(origin=f"{contents.root}/events", name="Events", columns=columns)
    marks = rrb.TextDocumentView(origin=f"{contents.root}/legend/marks", name="Legend")
    if not contents.detailed_robots:
        return rrb.Tabs(events, marks, active_tab=0)
    ensembles = rrb.GraphView(origin=f"{contents.root}/ensembles", name="Ensembles")
    below = rrb.Tabs(events, ensembles, marks, active_tab=0)
    tabs = rrb.Tabs(
        *(_robot_view(robot, contents) for robot in contents.detailed_robots), active_tab=0, name="Robots"
    )
    return rrb.Vertical(tabs, below, row_shares=[3, 1], name="Robots and events")


def _lanes(contents: ViewerContents) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        origin=contents.root or "/",
        contents=[f"{contents.root}/{robot}" for robot in contents.robots],
        name="Activities of robots",
        time_view=_run_range(contents),
    )


def _plots(contents: ViewerContents) -> rrb.Tabs:
    axis = _run_range(contents)

    def plot(path: str, name: str, **more: Any) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(origin=f"{contents.root}/plots/{path}", name=name, axis_x=axis, **more)

    hidden = rrb.PlotLegend(visible=False)
    done = plot("items", f"{contents.items.capitalize()} done", plot_legend=hidden)
    tabs: list[Any] = [plot("speed", "Speed, m/s", plot_legend=hidden)]
    if contents.true:
        tabs.insert(0, plot("error", "Localisation error, m", plot_legend=hidden))
    if contents.batteries:
        tabs.append(plot("charge", "Charge of batteries", axis_y=rrb.ScalarAxis(range=(0.0, 1.0))))
    copies = plot("copies", "Copies of frames per second, by outcome", plot_legend=hidden)
    fates = rrb.Spatial2DView(
        origin=f"{contents.root}/legend/copies", name="Outcomes", background=_GROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(-1.0, 1.0), y_range=(-0.8, len(OUTCOME_COLOURS) + 0.4)),
    )  # fmt: skip
    curves = rrb.Vertical(done, copies)
    first = rrb.Horizontal(curves, fates, column_shares=[4, 1], name="Progress and radio")
    rssi = plot("rssi", "RSSI, dBm", axis_y=rrb.ScalarAxis(range=(-100, -30)), plot_legend=hidden)
    ages = plot("ages", "Age of replicas, s", plot_legend=hidden)
    return rrb.Tabs(first, rssi, *tabs, ages, active_tab=0, name="Plots")


def _run_range(contents: ViewerContents) -> rrb.TimeAxis | None:
    """Return the time axis of the whole run; None while it is running."""
    if contents.end is None:
        return None
    absolute = rrb.TimeRangeBoundary.absolute
    return rrb.TimeAxis(
        view_range=rrb.TimeRange(start=absolute(seconds=0.0), end=absolute(seconds=max(1.0, contents.end)))
    )


APPLICATION: Final = "acrc-testbed-6"
"""Application id; increment it with each change of the layout, as viewers cache the layout by id."""
FLUSH: Final = 10.0
"""Timeout for sending data to a viewer, s."""


class ViewFile:
    """A rerun recording with the layout; a context manager that finishes the file."""

    def __init__(
        self,
        path: Path,
        contents: ViewerContents | Sequence[ViewerContents],
        *,
        name: str,
        send_to: str | None = None,
    ) -> None:
        """Create the file; `contents`: one run or several side by side, `send_to`: a viewer's address.

        Raises AcrcError if the file cannot be written.
        """
        try:
            path.open("wb").close()
        except OSError as error:
            raise AcrcError(f"{path}: cannot write the view: {error.strerror}") from error
        self.path = path
        self.lost = False
        """True once the viewer was closed; the file is complete nevertheless."""
        self.recording = rr.RecordingStream(APPLICATION)
        self.recording.set_log_time_enabled(False)
        arranged = layout(contents) if isinstance(contents, ViewerContents) else side_by_side(contents)
        viewers = [] if send_to is None else [rr.GrpcSink(send_to)]
        self.recording.set_sinks(rr.FileSink(path), *viewers, default_blueprint=arranged)
        self.recording.send_recording_name(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()
        self.recording.disconnect()

    def flush(self) -> None:
        """Flush all data to file and viewer."""
        try:
            self.recording.flush(timeout_sec=FLUSH)
        except RuntimeError:  # the viewer was closed
            self.lost = True
