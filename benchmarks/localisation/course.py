"""Courses: where a robot truly was, and what its sensors said of it; made by the world's own models."""

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point, Pose
from actors.instant import Duration
from actors.randomness import generator
from actors.robot_model import RangeSensor
from actors.world.odometry import Odometers
from actors.world.sensing import RangeSensors
from actors.world.uncertainty import Uncertainty, drifting, floor
from benchmarks.localisation.crowd import Crowd, CrowdParameters
from benchmarks.localisation.route import CONTROLS, SUBSTEP, Site, WanderingRoute, site

STEP_US: Final = 100_000
"""From one odometry pose and scan to the next, µs; ReportParameters counts in them."""
ROBOT: Final = "robot"

_NONE: Final = Uncertainty()
View = Literal["chapter", "written", "kinect"]
Base = Literal["exact", "stage", "kobuki"]


@dataclass(frozen=True)
class CourseSetup:
    """What a course is made from; equal setups give equal courses."""

    plan: str
    """Path of the map file."""
    seed: int
    robots: int = 0
    """Others around the robot."""
    at_times: bool = False
    """They are near for 15 s of every minute, else all the time."""
    view: View = "chapter"
    """The sensor of the TurtleBot 2: 360° without noise up to 5 m or, "written", to 6.5 m; or 58° with it."""
    base: Base = "exact"
    """The odometry's errors."""
    seconds: float = 240.0
    dose: Uncertainty = _NONE
    """How the floor differs from the map, and how far the odometry drifts."""
    carried_at: float | None = None
    """Then somebody puts the robot elsewhere, which its odometry does not notice; s."""


@dataclass(frozen=True, eq=False)
class Course:
    """One drive as any localisation may be fed with it. All arrays are in order of time."""

    grid: OccupancyGrid
    sensor: RangeSensor
    start: Pose
    """The true pose at the first odometry pose, m and rad, map frame."""
    instants: NDArray[np.int64]
    """(n,), µs: when the odometry was read."""
    odometry: NDArray[np.float64]
    """(n, 3): x, y, heading, m and rad, in the odometry's frame."""
    truth: NDArray[np.float64]
    """(n, 3): the true poses of these instants, m and rad, map frame."""
    stamps: NDArray[np.int64]
    """(k,), µs: when the scans were made."""
    scans: NDArray[np.uint16]
    """(k, rays), mm; NO_ECHO_MM = nothing within reach."""
    peers: NDArray[np.float64]
    """(n, m, 2): true positions of other robots, m, NaN while away; what a peer mask is drawn from."""

    @property
    def origin(self) -> Pose:
        """The pose, map frame, at which the odometry would say (0, 0, 0), had it never erred."""
        return self.start.frame(Pose(*self.odometry[0].tolist()))


def made(setup: CourseSetup) -> Course:
    """Drive a course. Raises CourseError, MapError."""
    place = mapped = site(setup.plan, setup.view)
    chance = generator(setup.seed, "localisation/uncertainty", ROBOT)
    solid, visible = floor(mapped.grid, setup.dose, chance, ())
    if setup.dose != _NONE:  # else the way over it is known already
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
            driver.carry(elsewhere)
            base.carry(elsewhere)
            truth[step] = elsewhere
        else:
            base.follow(track, velocity)
            truth[step] = track[-1]
        odometry[step] = base.read()
    peers = _crowd(setup, place, truth)
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
        peers=peers,
    )


def _pose(place: Site, draws: np.random.Generator) -> Pose:
    return Pose(*place.point(draws), draws.uniform(-math.pi, math.pi))


class _BaseOdometry:
    """The odometry of the one robot."""

    def __init__(self, setup: CourseSetup, place: Site, start: Pose) -> None:
        draws = generator(setup.seed, "localisation/odometry", ROBOT)
        step = Duration(round(SUBSTEP * 1e6))
        errors = drifting(setup.dose)
        self._odometers = Odometers([setup.base], [place.model], np.array([start]), [draws], step, *errors)

    def follow(self, track: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
        assert len(track) == CONTROLS
        self._odometers.follow(track[:, None, :], velocity[None, :])

    def carry(self, pose: Pose) -> None:
        self._odometers.carry(0, pose)

    def read(self) -> tuple[float, float, float]:
        odometry = self._odometers.read(0)
        return odometry.x, odometry.y, odometry.heading


def _crowd(setup: CourseSetup, place: Site, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    draws = generator(setup.seed, "localisation/crowd", ROBOT)
    crowd = Crowd(place.grid, setup.robots, draws, at_times=setup.at_times)
    step = STEP_US / 1e6
    positions = [crowd.advance(k * step, Point(x, y), step) for k, (x, y, _) in enumerate(truth.tolist())]
    return np.array(positions).reshape(len(truth), setup.robots, 2)


def _scans(
    setup: CourseSetup, place: Site, truth: NDArray[np.float64], peers: NDArray[np.float64]
) -> NDArray[np.uint16]:
    draws = generator(setup.seed, "localisation/sensor", ROBOT)
    sensors = RangeSensors(place.grid, [place.model], [draws])
    scans = np.empty((len(truth), place.model.sensor.rays), np.uint16)
    radius = CrowdParameters().radius
    for k, pose in enumerate(truth):
        there = peers[k][~np.isnan(peers[k, :, 0])]
        discs = np.column_stack([there, np.full(len(there), radius)])
        scans[k] = sensors.scan([0], pose[None, :], discs)[0]
    return scans
