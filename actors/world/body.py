"""Bodies of all robots: drives, sensors and true states, by index."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from actors.array_types import Flags, Floats
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import FREE, OCCUPIED, outline
from actors.floor.map_file import load_map
from actors.floor.placement import check_pose
from actors.geometry import Point, Pose, Twist
from actors.instant import Instant
from actors.messages import Drive, FloorChanged, PersonTruth, Scan, SensorData, UnmappedObstacle
from actors.randomness import generator
from actors.robot_model import RobotModel, load_model
from actors.runtime.errors import AcrcError
from actors.task.loading import decode_items, load_task
from actors.world.battery import Batteries
from actors.world.odometry import Odometers
from actors.world.people import Pedestrians
from actors.world.physics import SUBSTEP, Arena
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import RealFloor, draw_floor, with_drift
from actors.world.world_setup import WorldSetup
from deeco.knowledge import new_tuple

POST_RADIUS: Final = 0.05
"""Radius of the posts that make up an added wall, m; own choice: as thick as a partition."""
_POST_SPACING: Final = 0.075
"""Maximum spacing of posts, m; the seams of overlapping posts are 66 mm thick."""


class FloorRecord:
    """Collects changes of the floor for FloorChanged."""

    def __init__(self) -> None:
        self._count = 0
        self._put: list[UnmappedObstacle] = []
        self._gone: list[int] = []
        self._doors: dict[int, int] = {}
        """Numbers of closed or closing doors, by index."""

    def put(self, kind: str, points: Sequence[Point], radius: float) -> None:
        """Add an obstacle, wall or door."""
        ends = tuple((point.x, point.y) for point in points)
        self._put.append(UnmappedObstacle(self._count, kind, ends, radius))
        self._count += 1

    def change_door(self, door: int, kind: str = "", ends: Sequence[Point] = ()) -> None:
        """Change the kind of a door, which is as thick as a wall; without `ends` it is open."""
        if door in self._doors:
            self._gone.append(self._doors.pop(door))
        if ends:
            self._doors[door] = self._count
            self.put(kind, ends, POST_RADIUS)

    def take(self, step: int) -> FloorChanged | None:
        """Return the changes since the last call; None without any."""
        if not self._put and not self._gone:
            return None
        changed = FloorChanged(step, tuple(self._put), tuple(self._gone))
        self._put, self._gone = [], []
        return changed


class _DoorLeaf(NamedTuple):
    """A closed or closing door."""

    cells: Flags
    segments: Floats
    ends: tuple[Point, Point]


class Doors:
    """Opens and closes the doors of a floor; finds doorways only at the first such order."""

    def __init__(
        self, floor: RealFloor, radius: float, arena: Arena, sensors: RangeSensors, record: FloorRecord
    ) -> None:
        """Create the doors; `radius`: of the largest robot, m."""
        self._floor = floor
        self._arena = arena
        self._sensors = sensors
        self._record = record
        self._doorways = Doorways(floor.solid, radius)
        self._closed: dict[int, _DoorLeaf] = {}
        self._closing: dict[int, _DoorLeaf] = {}
        """Doors that will close when no robot stands in them."""

    def close(self, point: Point) -> None:
        """Close the door at a point at the next `close_unobstructed` that finds it free.

        Raises DoorError if there is none, or if it is closed or closing.
        """
        door = self._doorways.at(point)
        if door.index in self._closed or door.index in self._closing:
            raise DoorError(f"the door at ({point.x:g}, {point.y:g}) is already closed")
        cells = self._doorways.closed_cells(door)
        door_only = replace(self._floor.solid, cells=np.where(cells, OCCUPIED, FREE).astype(np.uint8))
        leaf = _DoorLeaf(cells, outline(door_only, beyond=False), self._doorways.ends_of(cells))
        self._closing[door.index] = leaf
        self._record.change_door(door.index, "closing door", leaf.ends)

    def open(self, point: Point) -> None:
        """Open the door at a point, or cancel its closing. Raises DoorError if it is open."""
        door = self._doorways.at(point).index
        if self._closing.pop(door, None) is None:
            if self._closed.pop(door, None) is None:
                raise DoorError(f"the door at ({point.x:g}, {point.y:g}) is already open")
            self._arena.open_door(door)
            self._update_sensors()
        self._record.change_door(door)

    def close_unobstructed(self) -> None:
        """Close all closing doors in which no robot stands."""
        free = [door for door, leaf in self._closing.items() if not self._arena.is_obstructed(leaf.segments)]
        for door in free:
            leaf = self._closed[door] = self._closing.pop(door)
            self._arena.close_door(door, leaf.segments)
            self._record.change_door(door, "closed door", leaf.ends)
        if free:
            self._update_sensors()

    def _update_sensors(self) -> None:
        cells = self._floor.visible.cells
        for leaf in self._closed.values():
            cells = np.where(leaf.cells, np.uint8(OCCUPIED), cells)
        self._sensors.set_floor(replace(self._floor.visible, cells=cells))


class Bodies:
    """Physics, range sensors and odometry of all robots on one map."""

    def __init__(self, setup: WorldSetup) -> None:
        if setup.step_us <= 0 or setup.step_us % SUBSTEP:
            raise AcrcError(f"step_us is {setup.step_us} µs; must be a multiple of {SUBSTEP} µs")
        self._models = [load_model(robot.model, robot.sensor) for robot in setup.robots]
        floor = real_floor(setup, self._models)
        self.grid = floor.solid
        """The real floor, with what is missing on the map."""
        self.floor_record = FloorRecord()
        poses = [Pose(*robot.start) for robot in setup.robots]
        self._names = names = setup.ids
        self.people: tuple[PersonTruth, ...] = ()
        """Positions and velocities of all people."""
        self._has_people = setup.has_people
        people = pedestrians(setup, floor, self._models) if self._has_people else None
        self._arena = Arena(outline(floor.solid), names, self._models, poses, people)
        noise = [generator(setup.world_seed, "range noise", name) for name in names]
        dropout = setup.uncertainty.dropout
        dropouts = [generator(setup.world_seed, "range dropout", name) for name in names]
        self._sensors = RangeSensors(floor.visible, self._models, noise, dropout, dropouts)
        radius = max(model.footprint.circumradius for model in self._models)
        self._doors = Doors(floor, radius, self._arena, self._sensors, self.floor_record)
        self._odometers = Odometers(
            [robot.odometry for robot in setup.robots],
            [with_drift(model, setup.uncertainty) for model in self._models],
            self._arena.poses,
            [generator(setup.world_seed, "odometry", name) for name in names],
            SUBSTEP,
        )
        self.batteries = Batteries(setup, self._models)
        self._periods = [model.sensor.period for model in self._models]
        self._different_periods = tuple(dict.fromkeys(self._periods))
        # A frozen robot reads no scans: the queue keeps the latest.
        self._scans = [
            deque[Scan](maxlen=_max_scans_per_step(model, setup.step_us)) for model in self._models
        ]
        self._bumpers = np.zeros(len(names), np.uint8)
        self._driven = np.zeros(len(names))
        self._scan(Instant(0))
        self._cache_states()

    @property
    def positions(self) -> Floats:
        """True x, y of all robots, (n, 2), m."""
        return self._arena.poses[:, :2]

    @property
    def obstacles(self) -> Floats:
        """x, y and radius of added obstacles, (o, 3), m."""
        return self._arena.obstacles

    @property
    def contacts(self) -> int:
        """Number of contacts begun so far."""
        return self._arena.contacts

    @property
    def people_contacts(self) -> dict[str, Any]:
        """Fields of WorldReport on contacts with people so far; empty without people."""
        number, duration = self._arena.people_contacts, self._arena.people_contact_us
        fields = {"people_contacts": number, "people_contact_s": duration / 1e6}
        return fields if self._has_people else {}

    @property
    def driven(self) -> list[float]:
        """Distance covered by each robot, driven or pushed, m; relocations do not count."""
        return self._driven.tolist()

    def truth(self, index: int) -> tuple[float, float, float, float, float, float]:
        """Return x, y, heading; vx, vy (map frame), omega."""
        return (*self._poses[index], *self._velocities[index])

    def senses(
        self, index: int, step: int, instant: Instant, events: int, halt: bool, items: tuple[Any, ...] = ()
    ) -> SensorData:
        """Return the base's report, with new items of the task. Each scan is returned once."""
        scans = self._scans[index]
        scan = scans.pop() if scans else None
        bumper, self._bumpers[index] = int(self._bumpers[index]), 0
        odometry, earlier = self._odometers.read(index), tuple(scans)
        if scans:
            scans.clear()
        return SensorData(
            step,
            instant,
            events,
            odometry,
            bumper,
            scan,
            halt=halt,
            earlier_scans=earlier,
            items=items,
            battery=self.batteries.charges[index],
        )

    def command(self, index: int, drive: Drive, instant: Instant) -> None:
        """Set the robot's velocity command from `instant`."""
        self._arena.command(index, new_tuple(Twist, (drive.vx, drive.vy, drive.omega)), instant)

    def move(self, instant: Instant, duration_us: int) -> None:
        """Advance from `instant`; range sensors scan at their own instants."""
        self._doors.close_unobstructed()
        end = instant + duration_us
        now: int = instant
        while now < end:
            until = min(end, self._next_scan(now))
            before = self.positions
            track = self._arena.advance((until - now) // SUBSTEP)
            moved = track[-1, :, :2] - before
            self._driven += np.sqrt(moved[:, 0] * moved[:, 0] + moved[:, 1] * moved[:, 1])
            self._odometers.follow(track, self._arena.velocities)
            self._bumpers |= self._arena.bumpers
            now = until
            self._scan(Instant(now))
        self._cache_states()

    def place(self, index: int, pose: Pose) -> None:
        """Relocate a robot."""
        check_pose(self.grid, pose.point, self._models[index].footprint.inradius, self._names[index])
        self._arena.move(index, pose)
        self._odometers.relocate(index, pose)
        self._scans[index].clear()  # scans of the former position
        self._cache_states()

    def add_obstacle(self, x: float, y: float, radius: float) -> None:
        """Add a round obstacle."""
        self._arena.add_obstacle(Point(x, y), radius)
        self.floor_record.put("obstacle", [Point(x, y)], radius)

    def add_wall(self, start: Point, end: Point) -> None:
        """Add a wall as a row of overlapping posts; add none of them if one raises as in `add_obstacle`."""
        posts = wall_posts(start, end)
        for post in posts:
            self._arena.check_obstacle(post, POST_RADIUS)
        for post in posts:
            self._arena.add_obstacle(post, POST_RADIUS)
        self.floor_record.put("wall", [start, end], POST_RADIUS)

    def close_door(self, x: float, y: float) -> None:
        """Close the door at a point at the first step in which no robot stands in it."""
        self._doors.close(Point(x, y))

    def open_door(self, x: float, y: float) -> None:
        """Open the door at a point."""
        self._doors.open(Point(x, y))

    def _next_scan(self, now: int) -> int:
        """Return the instant of the next scan of any sensor, rounded up to a sub-step."""
        return min(_round_up((now // period + 1) * period) for period in self._different_periods)

    def _scan(self, now: Instant) -> None:
        ending = [period for period in self._different_periods if _round_up(now // period * period) == now]
        if not ending:
            return
        due = [i for i, period in enumerate(self._periods) if period in ending]
        poses = self._arena.poses
        obstacles = self._arena.discs if self._has_people else self._arena.obstacles
        for index, ranges in zip(due, self._sensors.scan(due, poses, obstacles), strict=True):
            self._scans[index].append(Scan(now, ranges.astype("<u2", copy=False).tobytes()))

    def _cache_states(self) -> None:
        """Convert the states to lists once per step, as reading arrays item by item is slow."""
        self._poses = self._arena.poses.tolist()
        self._velocities = self._arena.velocities.tolist()
        if self._has_people:
            self.people = tuple(PersonTruth(*one) for one in self._arena.people.tolist())


def wall_posts(start: Point, end: Point) -> tuple[Point, ...]:
    """Return the positions of a wall's overlapping posts, both ends included."""
    gaps = max(1, math.ceil(start.distance_to(end) / _POST_SPACING))
    return tuple(
        Point(start.x + (end.x - start.x) * n / gaps, start.y + (end.y - start.y) * n / gaps)
        for n in range(gaps + 1)
    )


def real_floor(setup: WorldSetup, models: Sequence[RobotModel]) -> RealFloor:
    """Return the real floor of a run. Raises MapError, PlacementError if a robot's start is not free."""
    keep_off = [robot.start_point for robot in setup.robots]
    task = load_task(setup.task.use)
    points = (task.point(item) for robot in setup.robots for item in decode_items(task, robot.items))
    keep_off += [point for point in points if point is not None]
    rng = generator(setup.world_seed, "uncertainty", "world")
    real = draw_floor(load_map(Path(setup.map)), setup.uncertainty, rng, keep_off)
    for robot, model in zip(setup.robots, models, strict=True):
        check_pose(real.solid, robot.start_point, model.footprint.inradius, robot.id)
    return real


def pedestrians(setup: WorldSetup, floor: RealFloor, models: Sequence[RobotModel]) -> Pedestrians:
    """Return the people of a run. Raises PlacementError without room for them or their destinations."""
    starts = [robot.start_point for robot in setup.robots]
    radius = max(model.footprint.circumradius for model in models)
    assert setup.people is not msgspec.UNSET
    return Pedestrians(setup.people, floor.solid, setup.world_seed, starts, radius)


def _max_scans_per_step(model: RobotModel, step_us: int) -> int:
    """Return the maximum number of scans that end in one step, at least 1."""
    if model.sensor.period < SUBSTEP:
        raise AcrcError(
            f"the range sensor of {model.name!r} has a rate of {model.sensor.rate:g} Hz; "
            f"the maximum is {1_000_000 // SUBSTEP} Hz"
        )
    return max(-(-step_us // model.sensor.period), 1)


def _round_up(instant: int) -> int:
    """Return the first sub-step boundary at or after `instant`."""
    return -(-instant // SUBSTEP) * SUBSTEP
