"""The arrangement of the viewer's window: the map from above, north up, and a time line of simulated time."""

import math

import rerun.blueprint as rrb

from actors.floor.grid import OccupancyGrid
from actors.observer.appearance import Appearance

TIMELINE = "sim_time"
_FIELD_OF_VIEW = math.radians(55.0)
"""Of the viewer's camera, vertically; with it the height is chosen so that the map just fits."""
_ASPECT = 1.9
"""Width over height of a usual window."""


def blueprint(grid: OccupancyGrid, appearance: Appearance) -> rrb.Blueprint:
    """A single view straight down on the whole map; side panels closed, time following the run."""
    width, height = grid.corner.x - grid.origin.x, grid.corner.y - grid.origin.y
    x, y = grid.origin.x + width / 2, grid.origin.y + height / 2
    shown = 1.04 * max(height, width / _ASPECT)
    altitude = shown / 2 / math.tan(_FIELD_OF_VIEW / 2)
    view = rrb.Spatial3DView(
        origin="/world",
        name="Swarm",
        background=(appearance.paper,) * 3,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            # A hair south of the target: straight down has no "up".
            position=(x, y - 0.001 * altitude, altitude),
            look_target=(x, y, 0.0),
            eye_up=(0.0, 1.0, 0.0),
        ),
    )
    return rrb.Blueprint(
        view,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )
