"""What a run shows while it goes on: by ground truth, and by what robots say of their places."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.instant import in_seconds
from actors.messages import Drive, RobotTruth, Truth
from actors.observer.drawing import floor, places, robots, words
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.places import PlaceState
from actors.observer.drawing.words import Event
from actors.task.words import PlaceKey

_STANDS: Final = 0.02
"""A robot that is slower stands, m/s."""


class Scene:
    """Draws messages as they come, where `deploy.view` draws the same from recordings, and more."""

    def __init__(self, canvas: Canvas, grid: OccupancyGrid, given: Mapping[str, Sequence[Point]]) -> None:
        """`given`: the robots' places, in the robots' order."""
        self._canvas = canvas
        self._places = {
            PlaceKey(owner, number): PlaceState(point.x, point.y, holders=(owner,))
            for owner, points in given.items()
            for number, point in enumerate(points)
        }
        self._held = {owner: {key for key in self._places if key.owner == owner} for owner in given}
        self._changed = dict.fromkeys(given)
        self._done: dict[str, int] = {}
        self._told: list[Event] = []
        self._trails: dict[str, robots.Trail] = {}
        self._lanes: dict[str, str] = {}
        self._acts: dict[str, str] = {}
        self._truth: Truth | None = None
        self._errors: dict[str, float] = {}
        floor.draw_floor(canvas, grid)

    def show(self, truth: Truth) -> None:
        """Draw everything as it is at the step's start."""
        second = in_seconds(truth.instant)
        self._truth = truth
        for robot in truth.robots:
            if robot.id not in self._trails:
                self._introduce(robot.id, second)
            self._place(robot, second)
        for owner in self._changed:
            mine = [state for key, state in self._places.items() if key.owner == owner]
            if mine:
                places.draw_places(self._canvas, owner, second, mine)
        self._changed.clear()
        words.draw_events(self._canvas, "live", [event._replace(second=second) for event in self._told])
        self._told.clear()

    def missed(self, steps: int) -> None:
        """Tell of steps that never came."""
        self._told.append(Event(0.0, "", f"the view lacks {steps} steps that were not received", "WARN"))

    def heard(self, robot: str, drive: Drive) -> None:
        """Take in a robot's word; it shows with the next picture."""
        for report in drive.reports:
            self._settle(robot, PlaceKey(report.owner, report.place), done=True)
        for gone in drive.given_up:
            self._settle(robot, PlaceKey(gone.owner, gone.place), done=False)
        if drive.route is not None:
            self._hold(robot, set(drive.route))
        self._compare(robot, drive)

    def _settle(self, robot: str, key: PlaceKey, *, done: bool) -> None:
        state, name = self._places.get(key), f"{key.owner}/{key.place}"
        if state is None:
            return
        if done and not state.done:
            self._done[robot] = self._done.get(robot, 0) + 1
            self._told.append(Event(0.0, robot, f"cleaned {name}"))
        elif not done and not state.given_up:
            self._told.append(Event(0.0, robot, f"gives up {name}", "ERROR"))
        self._places[key] = state._replace(done=state.done or done, given_up=state.given_up or not done)
        self._changed[key.owner] = None

    def _hold(self, robot: str, route: set[PlaceKey]) -> None:
        before = self._held.get(robot, set())
        self._held[robot] = route
        for key in sorted(route ^ before, key=lambda one: (one.owner, one.place)):
            if key in self._places:
                holders = tuple(one for one, held in self._held.items() if key in held)
                self._places[key] = self._places[key]._replace(holders=holders)
                self._changed[key.owner] = None
            if key in route and key.owner != robot:
                self._told.append(Event(0.0, robot, f"adopts {key.owner}/{key.place}", "WARN"))

    def _compare(self, robot: str, drive: Drive) -> None:
        """How far off a robot held itself to be, where the truth of the same step is known."""
        if self._truth is None or drive.pose is None or drive.step != self._truth.step:
            return
        for true in self._truth.robots:
            if true.id == robot:
                self._errors[robot] = float(np.hypot(true.x - drive.pose[0], true.y - drive.pose[1]))

    def _introduce(self, robot: str, second: float) -> None:
        canvas, colour = self._canvas, self._canvas.colour(robot)
        self._trails[robot] = robots.Trail()
        robots.introduce(canvas, robot)
        robots.draw_name(canvas, robot, second)
        words.introduce_lane(canvas, robot)
        words.introduce_line(canvas, f"plots/places/{robot}", robot, colour, steps=True)
        for name in ("speed", "error"):
            words.introduce_line(canvas, f"plots/{name}/{robot}", robot, colour)

    def _place(self, robot: RobotTruth, second: float) -> None:
        canvas, at = self._canvas, np.array([second])
        robots.draw_poses(canvas, robot.id, at, np.array([(robot.x, robot.y, robot.heading)]))
        piece = self._trails[robot.id].extend(second, robot.x, robot.y)
        if piece is not None:
            robots.draw_pieces(canvas, robot.id, [second], piece[None])
        speed = float(np.hypot(robot.vx, robot.vy))
        self._do(robot, second, speed)
        values = {"places": float(self._done.get(robot.id, 0)), "speed": speed}
        if robot.id in self._errors:
            values["error"] = self._errors.pop(robot.id)
        for name, value in values.items():
            words.draw_line(canvas, f"plots/{name}/{robot.id}", at, np.array([value]))

    def _do(self, robot: RobotTruth, second: float, speed: float) -> None:
        """What it seems to be about, where that is something else; its name says why it does not act."""
        state = "" if robot.stepping else "frozen"
        if not robot.powered:
            state = "off"
        if self._acts.get(robot.id, "") != state:
            self._acts[robot.id] = state
            robots.draw_name(self._canvas, robot.id, second, state)
            self._told.append(Event(0.0, robot.id, f"is {state}" if state else "acts again", "WARN"))
        moving = "driving" if speed > _STANDS else "standing"
        activity = state or (moving if self._held.get(robot.id) else "idle")
        if self._lanes.get(robot.id) != activity:
            self._lanes[robot.id] = activity
            words.continue_lane(self._canvas, robot.id, second, activity)
