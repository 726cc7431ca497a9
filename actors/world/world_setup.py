"""What a world is built from, as whoever starts the run has it."""

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Self

import msgspec

from actors.messages import DRIVE, SENSES
from actors.orders import Order
from actors.randomness import derived_seed, keyed_seed
from actors.robot_model import OdometryKind, RobotDescription
from actors.runtime.core import Address, at
from actors.runtime.process_setup import ActorSetup, ProcessSetup, RecordDetail, located_model
from actors.world.uncertainty import Uncertainty


class BodySetup(RobotDescription, frozen=True, kw_only=True):
    """One robot's body and where it starts; its places are used to measure only."""

    odometry: OdometryKind
    """Which model of odometry errors it has."""


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
    detail: RecordDetail = "lean"
    """How much the world records."""

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


class BarrierStanding(Enum):
    """How a robot's process stands towards the barrier."""

    AWAITED = "awaited"
    """Started, and not Ready yet."""
    STEPPING = "stepping"
    FROZEN = "frozen"
    ENDED = "ended"


@dataclass
class Member:
    """One robot of the roster, at its index in the world's arrays."""

    id: str
    index: int
    standing: BarrierStanding = BarrierStanding.AWAITED
    epoch: int = 0
    kernels: str = ""
    events: int = 0
    """Radio events that lie in wait for the robot's next step."""
    given: tuple[tuple[float, float], ...] = ()
    """The places that it was given since the start of the run, m."""
    told: int = 0
    """So many of these its process has been told of."""
    senses: Address = field(init=False)
    """Where it is told what it senses."""
    drive: Address = field(init=False)
    """Where it says how it wants to drive."""

    def __post_init__(self) -> None:
        self.senses, self.drive = at(SENSES, self.id), at(DRIVE, self.id)

    @property
    def alive(self) -> bool:
        """True while there is a process, frozen or not, or one is under way."""
        return self.standing is not BarrierStanding.ENDED

    def begin_anew(self) -> None:
        """Await a new process, which knows of nothing but the start."""
        self.epoch += 1
        self.told = 0
        self.standing = BarrierStanding.AWAITED


class Participants:
    """All robots of a run, in the order of its set-up."""

    def __init__(self, robots: tuple[BodySetup, ...]) -> None:
        self.members = tuple(Member(robot.id, index) for index, robot in enumerate(robots))
        self._by_id = {member.id: member for member in self.members}

    def __getitem__(self, robot: str) -> Member:
        return self._by_id[robot]

    def __contains__(self, robot: str) -> bool:
        return robot in self._by_id

    def of(self, *standings: BarrierStanding) -> list[Member]:
        """The members with one of these standings."""
        return [member for member in self.members if member.standing in standings]

    @property
    def present(self) -> tuple[str, ...]:
        """The ids of those that take part."""
        return tuple(member.id for member in self.members if member.alive)
