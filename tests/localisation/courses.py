"""Simulated courses of one TurtleBot 2 among other robots, as input of any localisation.

`python -m tests.localisation.courses FILE.zip --seed N` writes one as a log of docs/localisation-log.md.
"""

import argparse
import io
import json
import math
import zipfile
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from PIL import Image

from acrc_testbed.benchmarks.localisation_tracking import FORMAT, POSES, STEP_US, VERSION, Course
from actors.array_types import Floats, Indices, Int64s
from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid, largest_region
from actors.floor.map_file import load_map
from actors.geometry import Point, Pose, wrap
from actors.installation.repository import REPOSITORY
from actors.instant import Duration
from actors.randomness import generator
from actors.robot.navigation.planning import GridPlanner, planning_grid
from actors.robot_model import DriveParameters, RobotModel, load_model
from actors.world.odometry import Odometers
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import Uncertainty, draw_floor, with_drift

ROBOT: Final = "robot"
CORRIDOR, APARTMENT, MAZE = (
    str(REPOSITORY / "maps" / f"{name}.yaml") for name in ("corridor", "apartment", "maze")
)

_NONE: Final = Uncertainty()
View = Literal["chapter", "written", "kinect"]
Base = Literal["exact", "stage", "kobuki"]


@dataclass(frozen=True)
class Setup:
    """Conditions of a course; equal setups give equal courses."""

    plan: str = CORRIDOR
    """Path of the map file."""
    seed: int = 1
    robots: int = 0
    """Others around the robot."""
    at_times: bool = False
    """The others are near for 15 s of every minute only."""
    view: View = "chapter"
    """The sensor of the TurtleBot 2: 360° without noise up to 5 m or, "written", to 6.5 m; or 58° with it."""
    base: Base = "exact"
    """The odometry's errors."""
    seconds: float = 240.0
    dose: Uncertainty = _NONE
    """Differences of the floor from the map, and drift of the odometry."""
    carried_at: float | None = None
    """Time at which the robot is put elsewhere without its odometry noticing, s."""


GOAL_CLEARANCE: Final = 0.3
"""Minimum distance of goals and starts from walls, m."""


@dataclass(frozen=True, eq=False)
class Site:
    grid: OccupancyGrid
    model: RobotModel

    @cached_property
    def planner(self) -> GridPlanner:
        return GridPlanner(planning_grid(self.grid, self.model.footprint.circumradius))

    @cached_property
    def _cells(self) -> Indices:
        """(n, 2): row and column of cells that may contain goals."""
        region = largest_region(self.grid, self.model.footprint.circumradius + 0.05)
        return np.argwhere(region & (self.grid.clearance >= GOAL_CLEARANCE))

    def point(self, generator: Generator) -> Point:
        """Return a reachable point, uniform over cells with GOAL_CLEARANCE; uses three random numbers."""
        which, east, north = generator.random(3).tolist()
        row, column = self._cells[int(which * len(self._cells))].tolist()
        x, y = self.grid.origin
        return Point(x + (column + east) * self.grid.resolution, y + (row + north) * self.grid.resolution)


@lru_cache(maxsize=8)
def site(plan: str, sensor: str) -> Site:
    """Return a map file with a TurtleBot 2 with that sensor; cached. Raises MapError."""
    return Site(load_map(plan), load_model("turtlebot2", sensor))


SUBSTEP: Final = 0.01
"""Sub-step of motion and odometry, s."""
CONTROLS: Final = 10
"""Sub-steps between decisions of the follower, and between scans."""


# Pure pursuit (Coulter, CMU-RI-TR-92-01) on the true pose; own choices for smooth driving.
SPEED: Final = 0.5
"""Highest speed, m/s."""
TURN_RATE: Final = 1.2
"""Highest turn rate, rad/s."""
BRAKING: Final = 0.5
"""Planned deceleration before a goal, m/s²."""
TURNING: Final = 2.0
"""Turn rate per angle when turning on the spot, 1/s."""
SPOT: Final = 1.0
"""Angle to the path above which the robot turns on the spot, rad."""
PURSUED: Final = (0.45, 0.3, 0.2, 0.1)
"""Look-ahead distances, m: the first with a free straight line is used."""
ARRIVED: Final = 0.05
"""Distance from a goal at which the next one is drawn, m."""


class WanderingRoute:
    """A driving robot; equal generators give equal routes."""

    def __init__(self, site: Site, start: Pose, generator: Generator) -> None:
        self._site = site
        self._generator = generator
        self._radius = site.model.footprint.circumradius
        self._pose, self._speed, self._turn = start, 0.0, 0.0
        self._path: Floats = np.empty((0, 2))
        self._passed = 0

    def advance(self) -> tuple[Floats, Floats]:
        """Simulate a decision and its sub-steps: (CONTROLS, 3) poses, and (3,) the velocity at the end.

        m, rad, m/s, rad/s, map frame. Raises RuntimeError if the body touches a wall.
        """
        speed, turn = self._decision()
        track = np.array([self._moved(speed, turn) for _ in range(CONTROLS)])
        here = self._pose.point
        if self._site.grid.clearance_at(here, self._radius) < self._radius:
            raise RuntimeError(f"the route touches a wall at ({here.x:.2f}, {here.y:.2f}); it should never")
        heading = self._pose.heading
        east, north = self._speed * math.cos(heading), self._speed * math.sin(heading)
        return track, np.array([east, north, self._turn])

    def relocate(self, pose: Pose) -> None:
        self._pose, self._speed, self._turn = pose, 0.0, 0.0
        self._path, self._passed = np.empty((0, 2)), 0

    def _moved(self, speed: float, turn: float) -> Pose:
        drive: DriveParameters = self._site.model.drive
        change, twist = drive.acceleration * SUBSTEP, drive.turn_acceleration * SUBSTEP
        self._speed += min(max(speed - self._speed, -change), change)
        self._turn += min(max(turn - self._turn, -twist), twist)
        x, y, heading = self._pose
        middle = heading + self._turn * SUBSTEP / 2
        way = self._speed * SUBSTEP
        self._pose = Pose(
            x + way * math.cos(middle), y + way * math.sin(middle), wrap(heading + self._turn * SUBSTEP)
        )
        return self._pose

    def _decision(self) -> tuple[float, float]:
        remaining = self._remaining()
        while remaining < ARRIVED:
            self._set_out()
            remaining = self._remaining()
        aim = self._aim()
        ahead = self._pose.relative(Pose(*aim, 0.0))
        angle, apart = math.atan2(ahead.y, ahead.x), max(math.hypot(ahead.x, ahead.y), 1e-6)
        if abs(angle) > SPOT:
            return 0.0, _limited(TURNING * angle, TURN_RATE)
        curvature = 2 * math.sin(angle) / apart
        speed = min(SPEED, math.sqrt(2 * BRAKING * remaining), TURN_RATE / max(abs(curvature), 1e-6))
        return speed, speed * curvature

    def _set_out(self) -> None:
        """Draw goals until one is reachable and more than 1 m away."""
        for _ in range(100):
            path = self._site.planner.path(self._pose.point, self._site.point(self._generator))
            if path is not None and math.dist(path[-1], self._pose[:2]) > 1.0:
                self._path, self._passed = path, 0
                return
        raise RuntimeError(f"no path leads on from ({self._pose.x:.2f}, {self._pose.y:.2f}) on this map")

    def _remaining(self) -> float:
        """Return the distance to the end of the path, m; advances to the nearest point of the path."""
        if not len(self._path):
            return 0.0
        near = self._path[self._passed : self._passed + 12]
        self._passed += int(np.argmin(np.hypot(near[:, 0] - self._pose.x, near[:, 1] - self._pose.y)))
        if self._passed < len(self._path) - 20:
            return math.inf
        rest = self._path[self._passed :]
        along = float(np.hypot(*np.diff(rest, axis=0).T).sum())
        return (
            along + math.dist(rest[0], self._pose[:2])
            if len(rest) > 1
            else math.dist(rest[0], self._pose[:2])
        )

    def _aim(self) -> Point:
        rest = self._path[self._passed :]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
        for ahead in PURSUED:
            aim = Point(*rest[min(int(np.searchsorted(along, ahead)), len(rest) - 1)].tolist())
            if self._is_clear(aim):
                return aim
        return aim

    def _is_clear(self, aim: Point) -> bool:
        """Return True if the straight line to that point is free."""
        grid, here = self._site.grid, self._pose
        count = max(2, math.ceil(here.point.distance_to(aim) / grid.resolution))
        shares = np.linspace(0, 1, count)
        columns = ((here.x + shares * (aim.x - here.x) - grid.origin.x) / grid.resolution).astype(np.intp)
        rows = ((here.y + shares * (aim.y - here.y) - grid.origin.y) / grid.resolution).astype(np.intp)
        return bool(grid.clearance[rows, columns].min() >= self._radius + grid.resolution)


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)


_HEADINGS: Final = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
"""Angles between a peer's motion and the direction to its target, degrees, in order of preference."""


NEAREST: Final = 0.45
"""Minimum distance between the centres of the robot and a peer, m."""
FARTHEST: Final = 2.0
"""Maximum distance between the two, m; peers beyond it enter again."""
RADIUS: Final = 0.177
"""Radius of a peer's body, m: a TurtleBot 2."""
PEER_SPEED: Final = 0.7
"""Highest speed of a peer, m/s: a Kobuki's."""
CIRCLING: Final = 0.25
"""Highest rate at which a peer's target circles the robot, rad/s."""
WHIM: Final = 0.02
"""Probability per step that a peer changes its distance and direction."""
NEAR, EVERY = 15.0, 60.0
"""Time per period for which the others are near with `at_times`, s."""
TRIES: Final = 60
"""Number of places tried by an entering peer per step."""


@dataclass
class _Peer:
    at: Point | None
    distance: float
    bearing: float
    rate: float
    side: float
    """1: prefers turning left; otherwise right."""


class Crowd:
    """The other robots. Their positions depend only on the generator and on the robot's path."""

    def __init__(
        self,
        grid: OccupancyGrid,
        count: int,
        generator: Generator,
        *,
        at_times: bool = False,
    ) -> None:
        """Create the peers; `at_times`: near for part of the time, otherwise always."""
        self._grid = grid
        self._generator = generator
        self._begin = generator.uniform(0.0, EVERY - NEAR) if at_times else 0.0
        self._at_times = at_times
        self._free = (grid.clearance >= RADIUS + grid.resolution * 0.75).tolist()
        self._open = grid.free.tolist()
        self._peers = [self._born() for _ in range(count)]

    def advance(self, time: float, robot: Point, step: float) -> Floats:
        """Return the positions of the peers at a time, s: (n, 2), m, NaN for distant ones.

        `step`: since the call before, s.
        """
        present = not self._at_times or 0 <= time % EVERY - self._begin < NEAR
        for peer in self._peers:
            self._move(peer, robot, step, present)
        return np.array([peer.at or (math.nan, math.nan) for peer in self._peers]).reshape(-1, 2)

    def _born(self) -> _Peer:
        peer = _Peer(None, 0.0, self._generator.uniform(-math.pi, math.pi), 0.0, 1.0)
        self._change_mind(peer)
        return peer

    def _change_mind(self, peer: _Peer) -> None:
        distance, rate, side = self._generator.random(3).tolist()
        peer.distance = NEAREST + distance * (FARTHEST - NEAREST)
        peer.rate = (2 * rate - 1) * CIRCLING
        peer.side = 1.0 if side < 0.5 else -1.0

    def _move(self, peer: _Peer, robot: Point, step: float, present: bool) -> None:
        if self._generator.random() < WHIM:
            self._change_mind(peer)
        peer.bearing += peer.rate * step
        if not present:
            peer.at = None
            return
        if peer.at is not None:
            peer.at = self._stepped(peer, peer.at, robot, step)
        if peer.at is None:
            peer.at = self._entrance(peer, robot)

    def _stepped(self, peer: _Peer, here: Point, robot: Point, step: float) -> Point | None:
        """Return the next position of a peer; None if it is enclosed or left behind."""
        x = robot.x + peer.distance * math.cos(peer.bearing)
        y = robot.y + peer.distance * math.sin(peer.bearing)
        apart = math.hypot(x - here.x, y - here.y)
        way = min(apart, PEER_SPEED * step)
        if apart < 1e-6 and self._has_room(here, robot, peer):
            return here
        direction = math.atan2(y - here.y, x - here.x)
        for turn in _HEADINGS:
            if turn == 120.0 and self._has_room(here, robot, peer):
                return here
            # a peer that gives way moves at full speed, however near its target is
            length = way if turn <= 90.0 else PEER_SPEED * step
            for side in (peer.side, -peer.side):
                angle = direction + side * math.radians(turn)
                there = Point(here.x + length * math.cos(angle), here.y + length * math.sin(angle))
                if self._has_room(there, robot, peer):
                    return there
        return None

    def _entrance(self, peer: _Peer, robot: Point) -> Point | None:
        """Return a random visible place for a peer to enter; None if none was found."""
        for _ in range(TRIES):
            distance, angle = self._generator.random(2).tolist()
            distance = NEAREST + distance * (FARTHEST - NEAREST)
            angle *= math.tau
            there = Point(robot.x + distance * math.cos(angle), robot.y + distance * math.sin(angle))
            if self._has_room(there, robot, peer) and self._sees(robot, there):
                peer.bearing, peer.distance = angle, distance
                return there
        return None

    def _has_room(self, there: Point, robot: Point, peer: _Peer) -> bool:
        """Return True if a peer can stand there: within its distances, free of walls and others."""
        apart = there.distance_to(robot)
        if not NEAREST <= apart <= FARTHEST or not self._on(self._free, there):
            return False
        for other in self._peers:
            if other is peer or other.at is None:
                continue
            if there.distance_to(other.at) < 2 * RADIUS:
                return False
        return True

    def _sees(self, one: Point, other: Point) -> bool:
        """Return True if no wall is between two points; sampled every 5 cm."""
        count = math.ceil(one.distance_to(other) / 0.05)
        return all(
            self._on(
                self._open,
                Point(one.x + k / count * (other.x - one.x), one.y + k / count * (other.y - one.y)),
            )
            for k in range(count + 1)
        )

    def _on(self, cells: list[list[bool]], point: Point) -> bool:
        if not self._grid.contains(point):
            return False
        row, column = self._grid.cell(point)
        return cells[row][column]


@lru_cache(maxsize=16)
def drive(setup: Setup) -> Course:
    place = mapped = site(setup.plan, setup.view)
    chance = generator(setup.seed, "localisation/uncertainty", ROBOT)
    solid, visible = draw_floor(mapped.grid, setup.dose, chance, ())
    if setup.dose != _NONE:  # otherwise the floor is the map
        place = replace(mapped, grid=solid)
    steps = round(setup.seconds * 1e6 / STEP_US)
    route = generator(setup.seed, "localisation/route", ROBOT)
    start = _pose(place, route)
    truth, odometry = np.empty((steps + 1, 3)), np.empty((steps + 1, 3))
    truth[0] = start
    base = _BaseOdometry(setup, place, start)
    odometry[0] = base.read()
    driver = WanderingRoute(place, start, route)
    carried = None if setup.carried_at is None else round(setup.carried_at * 1e6 / STEP_US)
    for step in range(1, steps + 1):
        track, velocity = driver.advance()
        if step == carried:
            base.follow(track, np.zeros(3))
            elsewhere = _pose(place, route)
            driver.relocate(elsewhere)
            base.relocate(elsewhere)
            truth[step] = elsewhere
        else:
            base.follow(track, velocity)
            truth[step] = track[-1]
        odometry[step] = base.read()
    peers = peers_of(setup, place, truth)
    instants = np.arange(steps + 1, dtype=np.int64) * STEP_US
    scans = _scans(setup, replace(place, grid=visible), truth, peers)
    return Course(
        grid=mapped.grid,
        sensor=place.model.sensor,
        start=start,
        instants=instants,
        odometry=odometry,
        truth=truth,
        stamps=instants,
        scans=scans,
    )


def _pose(place: Site, draws: np.random.Generator) -> Pose:
    return Pose(*place.point(draws), draws.uniform(-math.pi, math.pi))


class _BaseOdometry:
    def __init__(self, setup: Setup, place: Site, start: Pose) -> None:
        draws = generator(setup.seed, "localisation/odometry", ROBOT)
        step = Duration(round(SUBSTEP * 1e6))
        model = with_drift(place.model, setup.dose)
        self._odometers = Odometers([setup.base], [model], np.array([start]), [draws], step)

    def follow(self, track: Floats, velocity: Floats) -> None:
        assert len(track) == CONTROLS
        self._odometers.follow(track[:, None, :], velocity[None, :])

    def relocate(self, pose: Pose) -> None:
        self._odometers.relocate(0, pose)

    def read(self) -> tuple[float, float, float]:
        odometry = self._odometers.read(0)
        return odometry.x, odometry.y, odometry.heading


def peers_of(setup: Setup, place: Site, truth: Floats) -> Floats:
    """Return (n, m, 2): positions of the other robots, m, NaN while away."""
    draws = generator(setup.seed, "localisation/crowd", ROBOT)
    crowd = Crowd(place.grid, setup.robots, draws, at_times=setup.at_times)
    step = STEP_US / 1e6
    positions = [crowd.advance(k * step, Point(x, y), step) for k, (x, y, _) in enumerate(truth.tolist())]
    return np.array(positions).reshape(len(truth), setup.robots, 2)


def _scans(setup: Setup, place: Site, truth: Floats, peers: Floats) -> NDArray[np.uint16]:
    draws = generator(setup.seed, "localisation/sensor", ROBOT)
    sensors = RangeSensors(place.grid, [place.model], [draws])
    scans = np.empty((len(truth), place.model.sensor.rays), np.uint16)
    for k, pose in enumerate(truth):
        there = peers[k][~np.isnan(peers[k, :, 0])]
        discs = np.column_stack([there, np.full(len(there), RADIUS)])
        scans[k] = sensors.scan([0], pose[None, :], discs)[0]
    return scans


_WHEN: Final = (1980, 1, 1, 0, 0, 0)
"""Time stamp in archives, so that equal courses give equal files."""
_MAP: Final = (
    "image: map.png\nresolution: {resolution!r}\norigin: [{x!r}, {y!r}, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def write_log(file: Path, course: Course) -> None:
    """Write a course as a log; equal courses give equal files."""
    sensor, start = msgspec.to_builtins(course.sensor), list(course.start)
    about = {"format": FORMAT, "version": VERSION, "sensor": sensor, "start": start}
    rays = ",".join(f"r{i}" for i in range(course.sensor.rays))
    members: dict[str, str | bytes] = {
        "about.json": json.dumps(about, indent=2) + "\n",
        **_map_members(course.grid),
        "odometry.csv": _table(POSES, course.instants, course.odometry),
        "truth.csv": _table(POSES, course.instants, course.truth),
        "scans.csv": _table(f"time_us,{rays}", course.stamps, course.scans),
    }
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name, _WHEN), content, zipfile.ZIP_DEFLATED)


def _map_members(grid: OccupancyGrid) -> dict[str, str | bytes]:
    header = _MAP.format(resolution=grid.resolution, x=float(grid.origin.x), y=float(grid.origin.y))
    return {"map.yaml": header, "map.png": _image(grid)}


def _image(grid: OccupancyGrid) -> bytes:
    """Return an image as of ROS map_saver: free 254, unknown 205, occupied 0, north on top."""
    grey = np.zeros(grid.cells.shape, np.uint8)
    grey[grid.cells == FREE] = 254
    grey[grid.cells == UNKNOWN] = 205
    written = io.BytesIO()
    Image.fromarray(np.flipud(grey)).save(written, "PNG")
    return written.getvalue()


def _table(header: str, times: Int64s, values: NDArray[Any]) -> str:
    """Return CSV with numbers as Python writes them, which are read back exactly."""
    rows = zip(times.tolist(), values.tolist(), strict=True)
    return "\n".join([header, *(f"{time},{','.join(map(repr, row))}" for time, row in rows), ""])


def main() -> None:
    """Write the course with four others at times, 360° view and Kobuki's odometry."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration", type=float, default=240.0, metavar="S")
    given = parser.parse_args()
    setup = Setup(seed=given.seed, robots=4, at_times=True, base="kobuki", seconds=given.duration)
    write_log(given.file, drive(setup))


if __name__ == "__main__":
    main()
