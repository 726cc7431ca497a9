"""What a world is built from, as whoever starts the run has it."""

from pathlib import Path
from typing import Self

import msgspec

from actors.orders import Order
from actors.randomness import derived_seed, keyed_seed
from actors.robot_model import OdometryKind
from actors.runtime.process_setup import ActorSetup, ProcessSetup, located_model
from actors.world.uncertainty import Uncertainty


class BodySetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One robot's body and where it starts."""

    id: str
    model: str
    """Name of a shipped robot model, or the path of a model file."""
    sensor: str | None
    """Name of a sensor preset of the model; None = the model's default."""
    odometry: OdometryKind
    """Which model of odometry errors it has."""
    start: tuple[float, float, float]
    """x, y in metres and heading in radians, map frame."""
    places: tuple[tuple[float, float], ...]
    """The places the robot has to clean, m; used to measure only, robots read theirs from their own file."""


class TimedOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An order of the scenario; carried out at the first step boundary at or after `instant`."""

    instant: int
    order: Order

    def step(self, step_us: int) -> int:
        """The step at whose boundary that is."""
        return -(-self.instant // step_us)


class WorldSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything a world needs to know."""

    map: str
    seed: int
    step_us: int
    """A multiple of the physics sub-step, 10 000 µs."""
    duration_us: int
    robots: tuple[BodySetup, ...]
    events: tuple[TimedOrder, ...] = ()
    """In order of their instants."""
    uncertainty: Uncertainty = Uncertainty()
    """How the floor differs from the map, and how far odometry drifts."""
    reach: float = 0.7
    """A place counts as visited when ground truth was within so many metres: the 0.5 m at which robots report
    it (d3scomp's testbed), and 0.2 m for what a robot that is not lost may err about where it is."""
    key: str = ""
    """Hexadecimal digits without which nothing that is drawn follows from `seed`; empty: there is none."""

    def located(self, folder: Path) -> Self:
        """With its files as they are called for who does not stand in `folder`, where the set-up lies."""
        robots = tuple(
            msgspec.structs.replace(robot, model=located_model(robot.model, folder)) for robot in self.robots
        )
        return msgspec.structs.replace(self, map=str(folder / self.map), robots=robots)

    @property
    def world_seed(self) -> int:
        """The seed of what the world draws."""
        return keyed_seed(self.seed, self.key, "world")

    def robot_seed(self, robot: str) -> int:
        """The seed of what a robot draws."""
        return derived_seed(self.seed, robot, self.key)


class WorldProcess(ProcessSetup, frozen=True, forbid_unknown_fields=True):
    """A world's place in a run."""

    speed: float | None = None
    """Simulated seconds per second; None: as fast as possible."""


WorldProgram = ActorSetup[WorldSetup, WorldProcess]
"""What a world's process reads."""
