"""What is drawn: the map, the places, the robots and the way they went."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Point
from actors.messages import RobotTruth, Truth
from actors.observer.appearance import Appearance, Colour
from actors.observer.trail import Trail
from actors.observer.window import TIMELINE

# Heights of the layers above the floor, m, in the order in which they cover each other.
_PLACE: Final = 0.02
_TRAIL: Final = 0.04
_BODY: Final = 0.10
_NOSE: Final = 0.16
_LABEL: Final = 0.20


class Scene:
    """Draws Truth into a recording; entities lie below /world."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        grid: OccupancyGrid,
        places: Mapping[str, Sequence[Point]],
        appearance: Appearance,
    ) -> None:
        self._recording = recording
        self._appearance = appearance
        self._places = places
        self._reported: set[tuple[str, int]] = set()
        self._given_up: set[tuple[str, int]] = set()
        self._changed: dict[str, None] = {}
        self._trails: dict[str, Trail] = {}
        self._colours: dict[str, Colour] = {}
        self._log_map(grid)

    def show(self, truth: Truth) -> None:
        """Draw the robots as they are at the step's start."""
        self._recording.set_time(TIMELINE, duration=np.timedelta64(truth.instant, "us"))
        for robot in truth.robots:
            if robot.id not in self._trails:
                self._introduce(robot.id)
            self._place(robot)
        for owner in self._changed:
            if owner in self._colours:
                self._mark(owner)
        self._changed.clear()
        self._label(truth.robots)

    def reported(self, owner: str, place: int) -> None:
        """Let a place show from the next picture on that it was reported, given up or not."""
        self._reported.add((owner, place))
        self._changed[owner] = None

    def given_up(self, owner: str, place: int) -> None:
        """Let a place show from the next picture on that it was given up."""
        self._given_up.add((owner, place))
        self._changed[owner] = None

    def _log_map(self, grid: OccupancyGrid) -> None:
        image = _image(grid, self._appearance.paper)
        rows, columns = image.shape
        self._recording.log(
            "world/map",
            rr.GridMap(
                data=image.tobytes(),
                format=rr.components.ImageFormat(
                    width=columns, height=rows, color_model="L", channel_datatype="U8"
                ),
                cell_size=grid.resolution,
                translation=(grid.origin.x, grid.origin.y, 0.0),
                colormap=rr.components.Colormap.Grayscale,
            ),
            static=True,
        )

    def _introduce(self, robot: str) -> None:
        """Draw what does not change about a robot; its number is that of its first appearance."""
        appearance, recording = self._appearance, self._recording
        colour = self._colours[robot] = appearance.colour(len(self._trails))
        self._trails[robot] = Trail(appearance.trail_spacing, appearance.trail_jump)
        radius = appearance.robot_radius
        body = rr.Cylinders3D(
            lengths=[0.02], radii=[radius], centers=[(0.0, 0.0, _BODY)], colors=[colour], fill_mode="solid"
        )
        nose = rr.LineStrips3D(
            [[(0.0, 0.0, _NOSE), (radius, 0.0, _NOSE)]], colors=[(255, 255, 255)], radii=[0.2 * radius]
        )
        recording.log(f"world/robots/{robot}/body", body, static=True)
        recording.log(f"world/robots/{robot}/nose", nose, static=True)
        self._changed[robot] = None

    def _mark(self, owner: str) -> None:
        """Draw the places that a robot was given, as they now stand."""
        colour, arm = self._colours[owner], 0.5 * self._appearance.robot_radius
        strokes, colours = [], []
        for number, point in enumerate(self._places.get(owner, ())):
            reported = (owner, number) in self._reported
            given_up = not reported and (owner, number) in self._given_up
            cross = _cross(point, arm)[: 1 if given_up else 2]
            strokes += cross
            colours += [self._appearance.pale(colour) if reported else colour] * len(cross)
        if strokes:
            marks = rr.LineStrips3D(strokes, colors=colours, radii=[0.02])
            self._recording.log(f"world/places/{owner}", marks)

    def _place(self, robot: RobotTruth) -> None:
        half = robot.heading / 2
        pose = rr.Transform3D(
            translation=(robot.x, robot.y, 0.0),
            quaternion=rr.Quaternion(xyzw=(0.0, 0.0, math.sin(half), math.cos(half))),
        )
        self._recording.log(f"world/robots/{robot.id}", pose)
        for strip in self._trails[robot.id].extend(Point(robot.x, robot.y)):
            points = [[(x, y, _TRAIL) for x, y in strip.points]] if strip.points else []
            line = rr.LineStrips3D(points, colors=[self._colours[robot.id]], radii=[0.025])
            self._recording.log(f"world/trajectories/{robot.id}/{strip.name}", line)

    def _label(self, robots: Sequence[RobotTruth]) -> None:
        above = self._appearance.label_offset
        labels = rr.Points3D(
            [(robot.x, robot.y + above, _LABEL) for robot in robots],
            labels=[_label(robot) for robot in robots],
            colors=[(255, 255, 255)],
            radii=[0.0],
            show_labels=True,
        )
        self._recording.log("world/labels", labels)


def _label(robot: RobotTruth) -> str:
    """The robot's id and, if it does not act, why."""
    if not robot.powered:
        return f"{robot.id} (off)"
    return robot.id if robot.stepping else f"{robot.id} (frozen)"


def _image(grid: OccupancyGrid, paper: int) -> NDArray[np.uint8]:
    """The cells in grey, free white and occupied black; the viewer wants the north edge first."""
    values = np.full(grid.cells.shape, paper, dtype=np.uint8)
    values[grid.cells == FREE] = 255
    values[grid.cells == OCCUPIED] = 0
    return np.flipud(values)


def _cross(place: Point, arm: float) -> list[list[tuple[float, float, float]]]:
    """The two strokes for a place."""
    x, y = place
    return [[(x - arm, y - tilt * arm, _PLACE), (x + arm, y + tilt * arm, _PLACE)] for tilt in (1, -1)]
