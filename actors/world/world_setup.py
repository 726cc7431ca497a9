"""Set-up of a world, and the robots that take part."""

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Self

import msgspec

from actors.messages import DRIVE, SENSES
from actors.orders import Order
from actors.randomness import derived_seed, keyed_seed
from actors.robot_model import AdversaryKind, OdometryKind, RobotDescription
from actors.runtime.core import Address, at
from actors.runtime.process_setup import ActorSetup, ProcessSetup, RecordDetail, resolve_model
from actors.settings import Share
from actors.task.loading import TaskSetup
from actors.world.people import PeopleSetup
from actors.world.uncertainty import Uncertainty


class BodySetup(RobotDescription, frozen=True, kw_only=True, omit_defaults=True):
    """One robot's body and its start; its items are for the task's judge."""

    odometry: OdometryKind
    """Kind of odometry errors."""
    battery: Share | None = None
    """Charge at the start; None: the battery is not simulated."""
    adversary: AdversaryKind | None = None


class TimedOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An order of the scenario, carried out at the first step boundary at or after `instant`."""

    instant: int
    order: Order

    def step(self, step_us: int) -> int:
        """Return the step at whose start the order is carried out."""
        return -(-self.instant // step_us)


class WorldSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of a world."""

    map: str
    seed: int
    step_us: int
    """Length of a step, µs; a multiple of the physics sub-step, 10 000 µs."""
    duration_us: int
    robots: tuple[BodySetup, ...]
    task: TaskSetup
    events: tuple[TimedOrder, ...] = ()
    """Orders sorted by instant."""
    uncertainty: Uncertainty = Uncertainty()
    """Differences between floor and map, and odometry drift."""
    key: str = ""
    """Hexadecimal key that enters all random draws beside `seed`; empty for none."""
    detail: RecordDetail = "lean"
    """Level of detail of the world's recording."""
    people: PeopleSetup | msgspec.UnsetType = msgspec.UNSET
    """People on the floor; absent: none."""

    @property
    def initial_work(self) -> int:
        """Number of items given at the start that are to be done."""
        is_work = self.task.declaration.has_initial_work
        return sum(len(robot.items) for robot in self.robots) if is_work else 0

    @property
    def ids(self) -> tuple[str, ...]:
        """The robots' ids, in order."""
        return tuple(robot.id for robot in self.robots)

    @property
    def has_people(self) -> bool:
        """True if people walk about the floor."""
        return self.people is not msgspec.UNSET

    def resolve_paths(self, folder: Path) -> Self:
        """Return the set-up with its paths relative to `folder` resolved."""
        robots = tuple(
            msgspec.structs.replace(robot, model=resolve_model(robot.model, folder)) for robot in self.robots
        )
        return msgspec.structs.replace(self, map=str(folder / self.map), robots=robots)

    @property
    def world_seed(self) -> int:
        """Seed of the world's draws."""
        return keyed_seed(self.seed, self.key, "world")

    def robot_seed(self, robot: str) -> int:
        """Return the seed of a robot's draws."""
        return derived_seed(self.seed, robot, self.key)


class WorldProcess(ProcessSetup, frozen=True):
    """Process parameters of a world."""

    speed: float | None = None
    """Simulated seconds per second; None: as fast as possible."""
    modules: tuple[str, ...] = ()
    """Folders from which the task may be loaded, which the user has named on the command line."""


WorldProgram = ActorSetup[WorldSetup, WorldProcess]
"""Set-up file of a world's process."""


class BarrierState(Enum):
    """State of a robot's process with respect to the step barrier."""

    AWAITED = "awaited"
    """Started, but not Ready yet."""
    STEPPING = "stepping"
    FROZEN = "frozen"
    ENDED = "ended"


@dataclass
class Member:
    """One robot, with its index in the world's arrays."""

    id: str
    index: int
    state: BarrierState = BarrierState.AWAITED
    epoch: int = 0
    kernels: str = ""
    events: int = 0
    """Radio events pending for the robot's next step."""
    given_items: tuple[Any, ...] = ()
    """Items given since the start of the run."""
    sent_items: int = 0
    """Number of these sent to the current process."""
    senses: Address = field(init=False)
    """Address of its SensorData."""
    drive: Address = field(init=False)
    """Address of its Drive."""

    def __post_init__(self) -> None:
        self.senses, self.drive = at(SENSES, self.id), at(DRIVE, self.id)

    @property
    def alive(self) -> bool:
        """True while a process exists, frozen or not, or is being started."""
        return self.state is not BarrierState.ENDED

    def restart(self) -> None:
        """Expect a new process, which has not received the items given since the start."""
        self.epoch += 1
        self.sent_items = 0
        self.state = BarrierState.AWAITED


class Participants:
    """All robots of a run, in the order of its set-up."""

    def __init__(self, robots: tuple[BodySetup, ...]) -> None:
        self.members = tuple(Member(robot.id, index) for index, robot in enumerate(robots))
        self._by_id = {member.id: member for member in self.members}

    def __getitem__(self, robot: str) -> Member:
        return self._by_id[robot]

    def __contains__(self, robot: str) -> bool:
        return robot in self._by_id

    def members_in(self, *states: BarrierState) -> list[Member]:
        """Return the members in one of these states."""
        return [member for member in self.members if member.state in states]

    @property
    def present(self) -> tuple[str, ...]:
        """Ids of the members that are alive."""
        return tuple(member.id for member in self.members if member.alive)
