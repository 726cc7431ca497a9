"""Which robots take part in a step, which are frozen or ended, and what their radios still hold for them."""

from dataclasses import dataclass, field
from enum import Enum

from actors.messages import DRIVE, SENSES
from actors.runtime.core import Address, at
from actors.world.world_setup import BodySetup


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
